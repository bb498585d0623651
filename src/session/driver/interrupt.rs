//! What happens to the specimens that were in progress when a run is interrupted.
//!
//! ```text
//! in progress ─┬─ accepted ────────────────────────────────────► its numbers follow from its frames: no event
//!              ├─ caused by the instrument, the pose is known ─► kept: the run continues with it
//!              ├─ cannot come again, or the method skips it ───► given up: the well ends. Not if it is still to come
//!              └─ otherwise ───────────────────────────────────► begun again, once it is brought
//! in the capillary and not kept ──► removed first, by the loader or by the sampler
//! ```

use super::run::RunInProgress;
use carved_records::Interrupted;
use carved_records::{PlannedWell, RunState};
use std::collections::VecDeque;

/// The effect of an interruption on the specimen in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// Its pose is lost. The method's policy decides whether it is begun again.
    PoseLost,
    /// The instrument caused the interruption. The specimen must be brought again.
    BroughtAgain,
    /// The instrument caused the interruption. The run continues with the specimen in place.
    Stays,
}

/// The decision for one specimen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Interruption {
    pub well: String,
    /// It is in the capillary and must be removed before the run continues.
    pub remove: bool,
    pub course: Course,
}

/// What the run does with a specimen that was in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Course {
    /// It was accepted. Only its numbers are missing.
    LacksNumbers,
    /// The run continues with it in place.
    Kept,
    /// Its well ends.
    GivenUp,
    /// It is begun again, once it is brought.
    Again,
}

/// The decision for each specimen in progress, sorted by well. `accepted`: the wells of which only the numbers are missing. `brings_again`:
/// whether a specimen can come again after it was taken out.
pub(super) fn interruptions(
    run: &RunInProgress,
    state: &RunState,
    accepted: &VecDeque<PlannedWell>,
    brings_again: bool,
    fate: Fate,
) -> Vec<Interruption> {
    let capillary = state.capillary();
    // A specimen that the loader brought is not begun yet. It stays, and the run uses it when it continues.
    let mut wells: Vec<&String> = state.begun().iter().filter(|well| capillary.brought() != Some(well.as_str())).collect();
    wells.sort_unstable();
    wells.into_iter().map(|well| interruption(run, state, well, accepted.iter().any(|a| a.well == *well), brings_again, fate)).collect()
}

fn interruption(run: &RunInProgress, state: &RunState, well: &str, accepted: bool, brings_again: bool, fate: Fate) -> Interruption {
    let capillary = state.capillary();
    // Nobody knows whether a specimen that was asked for before a restart is inside. The sampler is asked for it again.
    let inside = capillary.inside() == Some(well) && capillary.asked_before() != Some(well);
    // A specimen that has not arrived in this attempt can still come.
    let came = inside || state.is_worked_on(well);
    let skip = run.record().method.policy.interrupted == Interrupted::Skip && fate == Fate::PoseLost;
    let course = if accepted {
        Course::LacksNumbers
    } else if fate == Fate::Stays && inside {
        Course::Kept
    } else if came && (!brings_again || skip) {
        Course::GivenUp
    } else {
        Course::Again
    };
    Interruption { well: well.to_owned(), remove: inside && course != Course::Kept, course }
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use carved_records::{EventBody, EventData, Phase, PhaseEntered, WellLoaded};

    fn state(events: &[(&str, EventData)]) -> RunState {
        let mut run = RunState::new("r1");
        for (well, data) in events {
            run.apply(&EventBody { time: String::new(), run: Some("r1".into()), well: Some((*well).into()), data: data.clone() });
        }
        run
    }

    fn phase(well: &str, phase: Phase, in_capillary: bool) -> (&str, EventData) {
        (well, EventData::SpecimenPhase(PhaseEntered { phase, in_capillary }))
    }

    fn skipping() -> RunInProgress {
        let mut skips = run(&["A01", "A02"]);
        skips.record_mut().method.policy.interrupted = Interrupted::Skip;
        skips
    }

    /// The decision for A01, whose turn is interrupted, and whether it must be removed.
    fn of_a01(run: &RunInProgress, brings_again: bool, fate: Fate) -> (Course, bool) {
        let turning = state(&[phase("A01", Phase::Revolve, true)]);
        let found = interruptions(run, &turning, &VecDeque::new(), brings_again, fate);
        assert_eq!(found.len(), 1);
        (found[0].course, found[0].remove)
    }

    #[test]
    fn a_specimen_is_kept_begun_again_or_given_up_by_its_fate_the_policy_and_the_sampler() {
        let redo = run(&["A01", "A02"]);
        assert_eq!(of_a01(&redo, true, Fate::PoseLost), (Course::Again, true));
        assert_eq!(of_a01(&redo, false, Fate::PoseLost), (Course::GivenUp, true), "it cannot come again");
        assert_eq!(of_a01(&redo, false, Fate::Stays), (Course::Kept, false));
        assert_eq!(of_a01(&skipping(), true, Fate::PoseLost), (Course::GivenUp, true));
        assert_eq!(of_a01(&skipping(), true, Fate::BroughtAgain), (Course::Again, true), "the instrument is to blame");
    }

    #[test]
    fn an_accepted_specimen_is_taken_out_and_never_given_up() {
        let r = skipping();
        let accepted = VecDeque::from([r.record().plan.plate_map[0].clone()]);
        for fate in [Fate::PoseLost, Fate::Stays] {
            let found = interruptions(&r, &state(&[phase("A01", Phase::Eject, true)]), &accepted, false, fate);
            assert_eq!(found, [], "an ejection begins nothing");
            let found = interruptions(&r, &state(&[phase("A01", Phase::Measure, true)]), &accepted, false, fate);
            assert_eq!(found, [Interruption { well: "A01".into(), remove: true, course: Course::LacksNumbers }]);
        }
    }

    #[test]
    fn a_specimen_that_is_still_to_come_or_was_only_brought_is_not_given_up() {
        let loading = state(&[phase("A01", Phase::Load, false)]);
        let found = interruptions(&skipping(), &loading, &VecDeque::new(), false, Fate::PoseLost);
        assert_eq!(found, [Interruption { well: "A01".into(), remove: false, course: Course::Again }]);
        let brought = state(&[phase("A01", Phase::Load, false), ("A01", EventData::WellLoaded(WellLoaded { in_place_of: None }))]);
        assert_eq!(interruptions(&skipping(), &brought, &VecDeque::new(), false, Fate::PoseLost), []);
    }
}
