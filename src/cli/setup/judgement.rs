//! What is wrong with a measurement, and which question can remedy it.

use super::bench::Bead;
use super::period::{Orbit, likely};
use super::state::{Problem, State};
use carved_core::calibration::rig::{ASPECT_OFF_MOST, bead_extents};

/// Least overlap of the bead with itself after one turn.
pub const LEAST_CLOSURE: f64 = 0.95;
/// Largest difference of the steps of a turn from the configured ones.
pub const MOST_STEPS_OFF: f64 = 0.005;
/// Blur above this multiple of the method's is out of focus.
const MOST_BLUR: f64 = 2.5;

/// Whether the capillary turns as far as configured.
pub fn of_turn(s: &State) -> Option<Problem> {
    let turn = s.turn.as_ref()?;
    let ratio = |orbit: Orbit| orbit.period_steps / turn.commanded_steps;
    if turn.seen[0] * 2 < turn.seen[1] {
        let text = format!(
            "A bead was found in {} of {} pictures. Bring a bead into the middle of the picture, and look at focus and light",
            turn.seen[0], turn.seen[1]
        );
        return Some(Problem::new("loaded", text, None));
    }
    match turn.orbit {
        Some(orbit) if (ratio(orbit) - 1.0).abs() > MOST_STEPS_OFF => {
            let proposal = likely(orbit.period_steps);
            let text = format!(
                "The steps per turn are wrong: the bead is back after {:.1} steps, but {} are configured. {proposal} is likely",
                orbit.period_steps, turn.commanded_steps
            );
            Some(Problem::new("steps", text, Some(proposal.to_string())))
        }
        None => {
            let text = "The bead moves less than 1 px while the capillary is told to turn, or not on a circle. Check that the motors \
                        have power and hold the capillary. Let the bead rest on the glass: one on the axis does not show the turn";
            Some(Problem::new("loaded", text, None))
        }
        Some(_) => None,
    }
}

/// Whether the first measurement of the bead agrees with the bore.
pub fn of_bead(s: &State) -> Option<Problem> {
    let bead = s.bead.as_ref()?;
    if let Some(problem) = of_measurement(bead) {
        return Some(problem);
    }
    let stated = s.answered("bead_um")?;
    s.contradicts().then(|| {
        let bore = s.answered("bore_um").unwrap_or_default();
        let text = format!(
            "The bead measures {:.1} um with the scale of a bore of {bore} um, but {stated} um are stated, {:.2} times \
             as much as measured. One of both numbers is wrong. Correct the diameter of the bead here, or go back until the bore is asked. \
             If both are right, give the same diameter again: the bead is then measured again{}",
            bead.diameter_um,
            stated.parse::<f64>().unwrap_or(f64::NAN) / bead.diameter_um,
            out_of_focus(bead)
        );
        let proposal = format!("{:.0}", (bead.diameter_um / 10.0).round() * 10.0);
        Problem::new("bead_um", text, Some(proposal))
    })
}

/// Whether the bead rested during the turn and is round.
pub fn of_measurement(bead: &Bead) -> Option<Problem> {
    of_closure(bead).or_else(|| of_roundness(bead))
}

/// Whether the turn closes.
fn of_closure(bead: &Bead) -> Option<Problem> {
    let closes = bead.closure_iou.is_some_and(|iou| iou >= LEAST_CLOSURE);
    (!closes).then(|| {
        let found = bead.closure_iou.map_or("not measured".into(), |iou| format!("{:.1} %", 100.0 * iou));
        let text = format!(
            "The turn does not close: the overlap of the bead with itself after one turn is {found}, {:.0} % or more are \
             expected. The bead moved in the water, or the motors lost steps. Wait until it rests, and lower the speed of \
             the motors if it happens again",
            100.0 * LEAST_CLOSURE
        );
        Problem::new("loaded", text, None)
    })
}

/// Whether the bead is round. The diameter of another one is no length, and a second measurement would not show it.
fn of_roundness(bead: &Bead) -> Option<Problem> {
    let is_round = bead_extents(bead.diameter_um, bead.aspect).is_ok();
    (!is_round).then(|| {
        let text = format!(
            "The bead is {:.3} times as long as wide, {} to {} are allowed. It is no sphere, or something lies at it: \
                 flush the capillary and bring another bead. If the next one is the same, the scales along and across \
                 differ, as they do in air: put the capillary into water, or measure both scales with carved calibrate \
                 beads",
            bead.aspect,
            1.0 - ASPECT_OFF_MOST,
            1.0 + ASPECT_OFF_MOST
        );
        Problem::new("loaded", text, None)
    })
}

/// Whether the chosen ruler measures the bead within the tolerance.
pub fn of_ruler(s: &State) -> Option<Problem> {
    let tolerance = tolerance_percent(s);
    let off = s.off_percent(s.bead.as_ref())?;
    (s.answered("ruler") == Some("bore") && off.abs() > tolerance).then(|| {
        let text = format!(
            "With the scale of the bore the bead is {off:+.2} % off, {tolerance} % is allowed. Take the bead as the ruler, or type \
             back and correct the numbers"
        );
        Problem::new("ruler", text, None)
    })
}

/// Whether the second measurement of the bead gives its diameter, with the corrected scale.
pub fn of_proof(s: &State) -> Option<Problem> {
    let bead = s.proof.as_ref()?;
    let tolerance = tolerance_percent(s);
    let off = s.off_percent(Some(bead))?;
    (off.abs() > tolerance).then(|| {
        let text = format!(
            "The second measurement of the bead is {off:+.2} % off, {tolerance} % is allowed, although the scale was corrected by \
             the first one: {:.1} um. The bead is not the same or moved between both{}",
            bead.diameter_um,
            out_of_focus(bead)
        );
        Problem::new("loaded", text, None)
    })
}

fn tolerance_percent(s: &State) -> f64 {
    s.number("tolerance_percent").unwrap_or(1.0)
}

/// What to do where the edges are blurred; empty where they are not.
pub fn out_of_focus(bead: &Bead) -> String {
    match bead.blur_px {
        Some([found, expected]) if found > MOST_BLUR * expected => {
            format!(
                ". The edges are blurred over {found:.1} px, {expected:.1} px are expected: focus the lens on the axis of the capillary"
            )
        }
        _ => String::new(),
    }
}
