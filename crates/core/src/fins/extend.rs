//! A known fin followed beyond its end, where it stands out little and each step shows little of it.

use super::follow::State;
use super::pool::{DIRECTIONS, Evidence};
use super::faint::p;

/// Directions on either side of the fin's end that are searched.
const BAND: usize = 12;
/// Most steps in direction and radius from one slice to the next, and what a squared step costs.
const TURN_MOST: usize = 2;
const RISE_MOST: usize = 2;
const TURN_COST: f32 = 0.25;
const RISE_COST: f32 = 0.35;

/// The states beyond the end `from`, which lies in the slice before the first of `slices`. Empty where the evidence says that the fin
/// ends there.
pub(super) fn extended(from: State, slices: &[(&Evidence, &[bool])], radii: usize, few: f32) -> Vec<State> {
    let width = 2 * BAND + 1;
    let direction = |k: usize| (from.0 + DIRECTIONS + k - BAND) % DIRECTIONS;
    let mut best = vec![f32::NEG_INFINITY; width * radii];
    if from.1 >= radii {
        return Vec::new();
    }
    best[BAND * radii + from.1] = 0.0;
    let mut came: Vec<Vec<u32>> = Vec::new();
    let mut end = (p("EXTGAIN", 6.0) as f32, None);
    let (bar, per_view) = (p("EXTBAR", 2.2) as f32, p("EXTPER", 0.8) as f32);
    for (evidence, blocked) in slices {
        let (mut next, mut from) = (vec![f32::NEG_INFINITY; width * radii], vec![0u32; width * radii]);
        let mut highest = (f32::NEG_INFINITY, 0);
        for k in (0..width).filter(|&k| !blocked[direction(k)]) {
            for r in 0..radii {
                let cell = direction(k) * radii + r;
                if evidence.score[cell] == f32::NEG_INFINITY {
                    continue;
                }
                let n = f32::from(evidence.views[cell]);
                let score = if n < few { evidence.score[cell] } else { evidence.pooled[cell] - bar.max(per_view * n.sqrt()) };
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
        if std::env::var("FINDBG2").is_ok() { let k = highest.1 / radii.max(1); let c = direction(k) * radii + highest.1 % radii; eprintln!("      step {} cum {:.1} at {:?} T {:.1} n {}", came.len(), highest.0, (direction(k), highest.1 % radii), evidence.pooled[c], evidence.views[c]); }
        came.push(from);
        if highest.0 == f32::NEG_INFINITY {
            break;
        }
        if highest.0 > end.0 {
            end = (highest.0, Some((came.len() - 1, highest.1)));
        }
        // Beyond a gap in the evidence something else begins.
        if highest.0 < (if end.1.is_some() { end.0 } else { 0.0 }) - p("XDROP", 8.0) as f32 {
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
