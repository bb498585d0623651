//! The chain of points along the capillary that collects the most evidence.
//!
//! ```text
//!   none ──enter── (phi, r) ── (phi', r') ── ... ── none      one state per slice; a bend costs, and so does the entrance
//! ```

use super::pool::DIRECTIONS;
use crate::parallel::prelude::*;

/// Most steps in direction and radius from one slice to the next.
const TURN_MOST: usize = 2;
const RISE_MOST: usize = 3;
/// What a squared step costs.
const TURN_COST: f32 = 0.25;
const RISE_COST: f32 = 0.35;
/// What a fin must gain before it is one.
const ENTER: f32 = 12.0;

/// A point of a chain: direction and radius step.
pub(super) type State = (usize, usize);

/// The best chains over the slices, of which there is at most one in each. `scores` are by slice, direction and radius step, and `blocked`
/// says by slice and direction where no chain may be.
pub(super) fn followed(scores: &[&[f32]], blocked: &[Vec<bool>], radii: usize) -> Vec<Option<State>> {
    let slices = scores.len();
    let none = f32::NEG_INFINITY;
    let mut best: Vec<Vec<f32>> = Vec::with_capacity(slices);
    let mut rest: Vec<f32> = Vec::with_capacity(slices);
    for at in 0..slices {
        let before = at.checked_sub(1).map(|b| (best[b].as_slice(), rest[b]));
        let entrance = before.map_or(0.0, |b| b.1) - ENTER;
        let rise: Option<Vec<f32>> = before.map(|(before, _)| risen(before, radii));
        let rows: Vec<Vec<f32>> = (0..DIRECTIONS)
            .into_par_iter()
            .with_min_len(DIRECTIONS / 2)
            .map(|a| {
                let scores = &scores[at][a * radii..(a + 1) * radii];
                if blocked[at][a] || !scores.iter().any(|score| score.is_finite()) {
                    return vec![none; radii];
                }
                let mut row = vec![entrance; radii];
                if let Some(rise) = &rise {
                    for (b, cost) in turns(a) {
                        let from = &rise[b * radii..(b + 1) * radii];
                        row.iter_mut().zip(from).for_each(|(row, from)| *row = row.max(from - cost));
                    }
                }
                row.iter_mut().zip(scores).for_each(|(row, score)| *row += score);
                row
            })
            .collect();
        let values = rows.concat();
        let leave = before.map_or(0.0, |(before, rest)| before.iter().copied().fold(rest, f32::max));
        best.push(values);
        rest.push(leave);
    }
    back(&best, &rest, radii)
}

/// The neighbouring directions and what a turn to them costs.
fn turns(a: usize) -> impl Iterator<Item = (usize, f32)> {
    (0..=2 * TURN_MOST).map(move |k| {
        let turn = k as f32 - TURN_MOST as f32;
        ((a + DIRECTIONS + k - TURN_MOST) % DIRECTIONS, TURN_COST * turn * turn)
    })
}

/// For each state the best of the states in its direction, less the cost of the rise.
fn risen(before: &[f32], radii: usize) -> Vec<f32> {
    let mut risen = before.to_vec();
    for (to, from) in risen.chunks_exact_mut(radii).zip(before.chunks_exact(radii)) {
        if !from.iter().any(|value| value.is_finite()) {
            continue;
        }
        for rise in 1..=RISE_MOST.min(radii.saturating_sub(1)) {
            let cost = RISE_COST * (rise * rise) as f32;
            to[rise..].iter_mut().zip(from).for_each(|(to, from)| *to = to.max(from - cost));
            to.iter_mut().zip(&from[rise..]).for_each(|(to, from)| *to = to.max(from - cost));
        }
    }
    risen
}

/// Follows the best chain back from the last slice.
fn back(best: &[Vec<f32>], rest: &[f32], radii: usize) -> Vec<Option<State>> {
    let mut chain = vec![None; best.len()];
    let highest = |values: &[f32]| (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).filter(|&i| values[i].is_finite());
    let mut state = match (best.last().and_then(|b| highest(b).map(|i| (i, b[i]))), rest.last()) {
        (Some((i, value)), Some(&rest)) if value > rest => Some(i),
        _ => None,
    };
    for at in (0..best.len()).rev() {
        let Some(before) = at.checked_sub(1) else {
            chain[at] = state.map(|i| (i / radii, i % radii));
            break;
        };
        if let Some(i) = state {
            let (a, r) = (i / radii, i % radii);
            chain[at] = Some((a, r));
            let (mut value, mut from) = (rest[before] - ENTER, None);
            for (b, turn) in turns(a) {
                for s in r.saturating_sub(RISE_MOST)..(r + RISE_MOST + 1).min(radii) {
                    let rise = r.abs_diff(s) as f32;
                    let candidate = best[before][b * radii + s] - RISE_COST * rise * rise - turn;
                    if candidate > value {
                        (value, from) = (candidate, Some(b * radii + s));
                    }
                }
            }
            state = from;
        } else {
            state = highest(&best[before]).filter(|&i| best[before][i] > rest[before]);
        }
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADII: usize = 12;

    /// Scores of -1 with a ridge in slices 5 to 24 that moves by a direction and a radius step every fourth slice.
    fn chain(ridge: f32) -> Vec<Option<State>> {
        let scores: Vec<Vec<f32>> = (0..30)
            .map(|at| {
                let mut score = vec![-1.0; DIRECTIONS * RADII];
                if (5..25).contains(&at) {
                    score[(178 + at / 4) % DIRECTIONS * RADII + 2 + at / 4] = ridge;
                }
                score
            })
            .collect();
        let scores: Vec<&[f32]> = scores.iter().map(Vec::as_slice).collect();
        followed(&scores, &vec![vec![false; DIRECTIONS]; 30], RADII)
    }

    #[test]
    fn a_ridge_is_followed_around_the_first_direction() {
        for (at, state) in chain(2.0).into_iter().enumerate() {
            let on = (5..25).contains(&at).then(|| ((178 + at / 4) % DIRECTIONS, 2 + at / 4));
            assert_eq!(state, on, "slice {at}");
        }
    }

    /// 20 slices of 0.5 gain less than the entrance costs.
    #[test]
    fn a_ridge_that_gains_too_little_is_none() {
        assert!(chain(0.5).iter().all(Option::is_none));
    }
}
