//! Converts angles to the steps of a ledger, by finding an axis whose steps meet all angles.
//!
//! ```text
//!    0  17.143  34.286 ..  deg  ──  504 steps per revolution: 0 24 48 ..      the smallest number that is accurate enough
//!    0 -17.143 -34.286 ..  deg  ──  the same with sense -1
//! ```

use anyhow::{Context, ensure};
use carved_core::units::{Sense, Steps, StepsPerRevolution};
use carved_records::Method;

/// Largest difference between a step and its angle, deg: below the promised 0.001, and above the 0.0005 by which a list with three decimals
/// is rounded.
const NEAR_DEG: f64 = 0.0008;
/// The axis of VAST. No axis has fewer steps.
const LEAST_STEPS: u32 = 500;
const MOST_STEPS: u32 = 36_000;
/// Fits any list: half a step is 0.00025 deg.
const FINE_STEPS: u32 = 720_000;
/// Largest difference between the closure view and a whole turn, deg: more than one step of VAST's axis.
const CLOSURE_DEG: f64 = 1.0;
/// A last angle that differs less than this from a whole turn is the closure view even without --closure, deg: half a step.
const SURELY_CLOSURE_DEG: f64 = 0.36;
/// Angles with more turns than this cannot be rad, turns.
const MOST_TURNS: f64 = 20.0;
/// If no view (opposite directions count as one) lies within a gap of this size, the hull is open on one side, deg.
const OPEN_DEG: f64 = 120.0;

/// A view of the ledger, in the order of the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stop {
    /// Number of the view along the turn, in its direction. The closure view has the number after the last.
    pub view: u32,
    pub steps: Steps,
    pub closure: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Turn {
    pub steps_per_revolution: StepsPerRevolution,
    pub sense: Sense,
    pub stops: Vec<Stop>,
    /// Number of views without the closure view.
    pub asd: u32,
    /// Largest difference between a step and its angle, deg.
    pub error_deg: f64,
}

/// Evenly spaced angles of `pictures` views, deg, the last of which may be the closure view.
pub(super) fn even(pictures: usize, closure: bool) -> Vec<f64> {
    let views = (pictures - usize::from(closure)).max(1) as f64;
    (0..pictures).map(|i| 360.0 * i as f64 / views).collect()
}

/// The turn with these angles (omega, deg). `closure` states that the last one is the closure view.
pub(super) fn turn(mut omega_deg: Vec<f64>, closure: bool) -> anyhow::Result<Turn> {
    let (Some(&first), Some(&last)) = (omega_deg.first(), omega_deg.last()) else { anyhow::bail!("found no angle") };
    let turns = omega_deg.iter().map(|a| (a - first).abs()).fold(0.0, f64::max) / 360.0;
    ensure!(
        turns <= MOST_TURNS,
        "the angles go around {turns:.0} times, expected {MOST_TURNS} at most: are they degrees where rad are expected?"
    );
    let falls = last < first;
    let whole = if falls { -360.0 } else { 360.0 };
    let closure = closure || (omega_deg.len() > 1 && (last - first - whole).abs() <= SURELY_CLOSURE_DEG);
    if closure {
        let off = signed(last - first);
        ensure!(
            off.abs() <= CLOSURE_DEG,
            "--closure: the last view stands at {last:.3} deg, {:.3} deg from a whole turn after the first; the view at 360 deg is expected",
            off.abs()
        );
        // A list may have 0 for the whole turn.
        let after = if (last - first).abs() > 180.0 { whole } else { 360.0 };
        if let Some(last) = omega_deg.last_mut() {
            *last = first + after + off;
        }
    }
    let carved = omega_deg.len() - usize::from(closure);
    let asd = u32::try_from(carved).context("too many views")?;
    let least = Method::LEAST_ASD;
    ensure!(
        asd >= least,
        "found {asd} views{}, expected {least} at least to enclose a volume",
        if closure { " and the closure view" } else { "" }
    );
    check_seen_around(&omega_deg[..carved])?;

    let near = |steps: &u32| error_deg(&omega_deg, *steps) <= NEAR_DEG;
    let steps = (LEAST_STEPS..=MOST_STEPS).find(near).unwrap_or(FINE_STEPS);
    let sense = if falls { Sense::Negative } else { Sense::Positive };
    let sign = f64::from(i8::from(sense));
    let at: Vec<i64> = omega_deg.iter().map(|a| (sign * a / 360.0 * f64::from(steps)).round() as i64).collect();
    Ok(Turn {
        steps_per_revolution: StepsPerRevolution::new(steps, 1)?,
        sense,
        stops: number(&at, carved, steps)?,
        asd,
        error_deg: error_deg(&omega_deg, steps),
    })
}

/// Numbers the views along the turn from the first, whatever the order in which they were taken.
fn number(at: &[i64], carved: usize, steps: u32) -> anyhow::Result<Vec<Stop>> {
    let around = |i: usize| (at[i] - at[0]).rem_euclid(i64::from(steps));
    let mut order: Vec<usize> = (0..carved).collect();
    order.sort_by_key(|&i| around(i));
    for pair in order.windows(2) {
        ensure!(
            around(pair[0]) != around(pair[1]),
            "pictures {} and {} of the turn (counted from 1) stand at one angle, {:.3} deg after the first: one view per angle is expected",
            pair[0] + 1,
            pair[1] + 1,
            around(pair[0]) as f64 * 360.0 / f64::from(steps)
        );
    }
    let mut view = vec![carved as u32; at.len()];
    order.iter().zip(0..).for_each(|(&i, n)| view[i] = n);
    Ok((0..at.len()).map(|i| Stop { view: view[i], steps: Steps(at[i]), closure: i >= carved }).collect())
}

fn error_deg(omega_deg: &[f64], steps: u32) -> f64 {
    let step_deg = 360.0 / f64::from(steps);
    omega_deg.iter().map(|a| (a / step_deg - (a / step_deg).round()).abs() * step_deg).fold(0.0, f64::max)
}

/// The angle in the range -180 to 180 deg.
fn signed(deg: f64) -> f64 {
    deg - 360.0 * (deg / 360.0).round()
}

/// Opposite views are mirror images, so half a turn is enough. A body that is seen from one side only is unbounded.
fn check_seen_around(omega_deg: &[f64]) -> anyhow::Result<()> {
    let mut folded: Vec<f64> = omega_deg.iter().map(|a| a.rem_euclid(180.0)).collect();
    folded.sort_by(f64::total_cmp);
    folded.extend(folded.first().map(|a| a + 180.0));
    let widest = folded.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    ensure!(
        widest <= OPEN_DEG,
        "the views leave {widest:.1} of 180 deg unseen, {OPEN_DEG} at most leave the hull closed: are these angles of a turn, and degrees where \
         degrees are expected?"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(turn: &Turn) -> Vec<i64> {
        turn.stops.iter().map(|s| s.steps.0).collect()
    }

    fn omegas_deg(turn: &Turn) -> Vec<f64> {
        turn.stops.iter().map(|s| turn.sense.omega(s.steps, turn.steps_per_revolution).to_degrees()).collect()
    }

    #[test]
    fn even_turns_are_exact() {
        for n in [4, 7, 12, 14, 21, 28, 42, 84] {
            let t = turn(even(n, false), false).unwrap();
            assert!(t.error_deg < 1e-9, "{n}: {}", t.error_deg);
            assert_eq!((t.asd, t.stops[n - 1].view), (n as u32, n as u32 - 1));
            let closed = turn(even(n + 1, true), true).unwrap();
            assert_eq!((closed.asd, closed.stops[n].closure, closed.stops[n].view), (n as u32, true, n as u32));
            assert_eq!(i64::from(<[u32; 2]>::from(closed.steps_per_revolution)[0]), closed.stops[n].steps.0);
        }
        assert_eq!(steps(&turn(even(4, false), false).unwrap()), [0, 125, 250, 375]);
    }

    #[test]
    fn any_angles_are_met_to_a_thousandth_of_a_degree() {
        let uneven = vec![0.01, -33.3337, 71.234_567, 150.0, 219.876_5, -60.0, 301.000_3];
        for (list, falls) in [(uneven.clone(), false), (uneven.iter().map(|a| -a).collect(), true)] {
            let t = turn(list.clone(), false).unwrap();
            assert_eq!(t.sense == Sense::Negative, falls);
            assert!(t.error_deg < 0.001);
            for (found, expected) in omegas_deg(&t).into_iter().zip(list) {
                assert!((found - expected).abs() < 0.001, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn a_rounded_or_a_vast_list_finds_its_axis() {
        let list = (0..21).map(|i| (f64::from(i) * 360.0 / 21.0 * 1000.0).round() / 1000.0).collect();
        assert_eq!(<[u32; 2]>::from(turn(list, false).unwrap().steps_per_revolution), [504, 1]);
        let vast = turn((0..84).map(|i| f64::from(i) * 4.32).collect(), false);
        // 83 moves of 6 steps are 358.56 deg.
        assert_eq!(<[u32; 2]>::from(vast.unwrap().steps_per_revolution), [500, 1]);
    }

    #[test]
    fn views_are_numbered_around_the_turn_in_its_direction() {
        let views = |list: &[f64]| turn(list.to_vec(), false).unwrap().stops.iter().map(|s| s.view).collect::<Vec<_>>();
        assert_eq!(views(&[0.0, 180.0, 90.0, 270.0]), [0, 2, 1, 3]);
        assert_eq!(views(&[0.0, -90.0, -180.0, -270.0]), [0, 1, 2, 3]);
        assert_eq!(views(&[90.0, 180.0, 270.0, 360.0]), [0, 1, 2, 3]);
    }

    #[test]
    fn the_whole_turn_is_the_closure_view() {
        for list in [vec![0.0, 90.0, 180.0, 270.0, 360.0], vec![0.0, -90.0, -180.0, -270.0, -360.2]] {
            let t = turn(list, false).unwrap();
            assert!(t.asd == 4 && t.stops[4].closure);
        }
        let zero = turn(vec![0.0, 90.0, 180.0, 270.0, 0.0], true).unwrap();
        assert_eq!(steps(&zero), [0, 125, 250, 375, 500]);
        let said = turn(vec![0.0, 90.0, 180.0, 270.0, 350.0], true).unwrap_err().to_string();
        assert!(said.contains("350.000 deg, 10.000 deg from"), "{said}");
    }

    #[test]
    fn what_is_no_turn_is_named() {
        let said = |list: &[f64]| turn(list.to_vec(), false).unwrap_err().to_string();
        assert!(said(&[0.0, 180.0]).contains("found 2 views"));
        assert!(said(&[0.0, 90.0, 180.0, 90.0]).contains("pictures 2 and 4"));
        assert!(said(&[0.0, 2.0, 4.0, 6.27]).contains("unseen"));
        assert!(said(&[0.0, 90.0f64.to_degrees(), 180.0f64.to_degrees(), 270.0f64.to_degrees()]).contains("go around 43 times"));
    }
}
