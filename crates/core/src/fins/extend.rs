//! A known fin followed beyond its end, where it stands out little and each step shows little of it.

use super::follow::State;
use super::pool::{DIRECTIONS, Evidence};

/// Directions on either side of the fin's end that are searched.
const BAND: usize = 12;
/// Most steps in direction and radius from one slice to the next, and what a squared step costs.
const TURN_MOST: usize = 2;
const RISE_MOST: usize = 2;
const TURN_COST: f32 = 0.25;
const RISE_COST: f32 = 0.35;

/// Evidence that neither speaks for a fin nor against it, at least, and per root of the number of half-views. A fin that is known may
/// show less of itself than one that is not.
const BAR: f32 = 2.0;
const BAR_PER_VIEW: f32 = 0.8;
/// Least gain of what is added.
const GAIN: f32 = 6.0;
/// Loss after which the search ends: what lies beyond it is something else.
const DROP: f32 = 8.0;

/// The states beyond the end `from`, which lies in the slice before the first of `slices`. Empty where the evidence says that the fin
/// ends there.
pub(super) fn extended(from: State, slices: &[(&Evidence, &[bool])], radii: usize) -> Vec<State> {
    let width = 2 * BAND + 1;
    let direction = |k: usize| (from.0 + DIRECTIONS + k - BAND) % DIRECTIONS;
    let mut best = vec![f32::NEG_INFINITY; width * radii];
    if from.1 >= radii {
        return Vec::new();
    }
    best[BAND * radii + from.1] = 0.0;
    let mut came: Vec<Vec<u32>> = Vec::new();
    let mut end = (GAIN, None);
    for (evidence, blocked) in slices {
        let (mut next, mut from) = (vec![f32::NEG_INFINITY; width * radii], vec![0u32; width * radii]);
        let mut highest = (f32::NEG_INFINITY, 0);
        for k in (0..width).filter(|&k| !blocked[direction(k)]) {
            for r in 0..radii {
                let cell = direction(k) * radii + r;
                if evidence.score[cell] == f32::NEG_INFINITY {
                    continue;
                }
                let score = evidence.pooled[cell] - BAR.max(BAR_PER_VIEW * f32::from(evidence.views[cell]).sqrt());
                let mut value = (f32::NEG_INFINITY, 0);
                for j in k.saturating_sub(TURN_MOST)..(k + TURN_MOST + 1).min(width) {
                    for s in r.saturating_sub(RISE_MOST)..(r + RISE_MOST + 1).min(radii) {
                        let (turn, rise) = (k.abs_diff(j) as f32, r.abs_diff(s) as f32);
                        let candidate = best[j * radii + s] - TURN_COST * turn * turn - RISE_COST * rise * rise;
                        if candidate > value.0 {
                            value = (candidate, j * radii + s);
                        }
                    }
                }
                if value.0 > f32::NEG_INFINITY {
                    let at = k * radii + r;
                    (next[at], from[at]) = (value.0 + score, value.1 as u32);
                    if next[at] > highest.0 {
                        highest = (next[at], at);
                    }
                }
            }
        }
        came.push(from);
        if highest.0 == f32::NEG_INFINITY {
            break;
        }
        if highest.0 > end.0 {
            end = (highest.0, Some((came.len() - 1, highest.1)));
        }
        if highest.0 < (if end.1.is_some() { end.0 } else { 0.0 }) - DROP {
            break;
        }
        best = next;
    }
    let Some((last, mut cell)) = end.1 else { return Vec::new() };
    let mut states = Vec::with_capacity(last + 1);
    for came in came[..=last].iter().rev() {
        states.push((direction(cell / radii), cell % radii));
        cell = came[cell] as usize;
    }
    states.reverse();
    states
}
