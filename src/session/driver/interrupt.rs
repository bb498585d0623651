//! What happens to the specimens that were worked on when a run is interrupted.
//!
//! ```text
//! worked on ───┬─ accepted ────────────────────────────────────► its numbers follow from its frames: no event
//!              ├─ caused by the instrument, the pose is known ─► kept: the run continues with it
//!              ├─ two processes ended in the same step of it ──► set aside: the well fails, so that no input ends the daemon for ever
//!              ├─ cannot come again, or the method skips it ───► given up: the well ends
//!              └─ otherwise ───────────────────────────────────► begun again, once it is brought
//! ```
//! What stays in the capillary and is not kept must leave before the run continues: `Specimens::must_leave_first`.

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

/// So many processes may end unasked in one step of the work on one specimen, as by a kill or by a picture that ends the process. After a
/// power cut a person continues the run, so that does not count.
const MOST_ENDED: u32 = 2;

/// Why a well is set aside. `None` if it may be begun again.
fn set_aside(state: &RunState, well: &str) -> Option<String> {
    let (phase, times) = state.processes_ended_in(well).filter(|(_, times)| *times >= MOST_ENDED)?;
    Some(format!(
        "set aside: the daemon ended {times} times in the work on {well}, in the step {}, and nobody had asked it to. The run goes on with the \
         next well. Look into its log and at the pictures of the well. To measure the well again, start a run of it: there it is not set aside",
        phase.name()
    ))
}

/// The decision for one specimen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Interruption {
    pub well: String,
    pub course: Course,
}

/// What the run does with a specimen that was in progress.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Course {
    /// It was accepted. Only its numbers are missing.
    LacksNumbers,
    /// The run continues with it in place.
    Kept,
    /// Its well ends as interrupted.
    GivenUp,
    /// Its well ends as failed, for this reason.
    SetAside(String),
    /// It is begun again, once it is brought.
    Again,
}

/// The decision for each specimen that was worked on, sorted by well. What did not come in this attempt can still come. `accepted`: the
/// wells of which only the numbers are missing. `brings_again`: whether a specimen can come again after it was taken out.
pub(super) fn interruptions(
    run: &RunInProgress,
    state: &RunState,
    accepted: &VecDeque<PlannedWell>,
    brings_again: bool,
    fate: Fate,
) -> Vec<Interruption> {
    let worked_on = state.specimens().worked_on();
    worked_on
        .map(|(well, specimen)| {
            let skip = run.record().method.policy.interrupted == Interrupted::Skip && fate == Fate::PoseLost;
            let course = if accepted.iter().any(|accepted| accepted.well == *well) {
                Course::LacksNumbers
            } else if fate == Fate::Stays && specimen.state().is_inside() {
                Course::Kept
            } else if let Some(why) = set_aside(state, well).filter(|_| fate == Fate::PoseLost) {
                Course::SetAside(why)
            } else if !brings_again || skip {
                Course::GivenUp
            } else {
                Course::Again
            };
            Interruption { well: well.to_owned(), course }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use carved_records::{
        DaemonStopping, EventBody, EventData, LoadedBy, Phase, PhaseEntered, RunInterrupted, SpecimenInterrupted, WellLoaded,
    };

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

    /// The decision for A01, whose turn is interrupted.
    fn of_a01(run: &RunInProgress, brings_again: bool, fate: Fate) -> Course {
        let turning = state(&[phase("A01", Phase::Revolve, true)]);
        let found = interruptions(run, &turning, &VecDeque::new(), brings_again, fate);
        assert_eq!(found.len(), 1);
        found[0].course.clone()
    }

    #[test]
    fn a_specimen_is_kept_begun_again_or_given_up_by_its_fate_the_policy_and_the_sampler() {
        let redo = run(&["A01", "A02"]);
        assert_eq!(of_a01(&redo, true, Fate::PoseLost), Course::Again);
        assert_eq!(of_a01(&redo, false, Fate::PoseLost), Course::GivenUp, "it cannot come again");
        assert_eq!(of_a01(&redo, false, Fate::Stays), Course::Kept);
        assert_eq!(of_a01(&skipping(), true, Fate::PoseLost), Course::GivenUp);
        assert_eq!(of_a01(&skipping(), true, Fate::BroughtAgain), Course::Again, "the instrument is to blame");
    }

    #[test]
    fn a_well_that_two_processes_ended_in_is_set_aside_by_name() {
        let r = run(&["A01", "A02"]);
        let found_at = |boot: &str| {
            EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by: None, kernel_boot_id: Some(boot.into()) })
        };
        let found_open = || found_at("one");
        let begun_again =
            || EventData::SpecimenInterrupted(SpecimenInterrupted { reason: "x".into(), policy: Interrupted::Redo, kept: false });
        let turn = phase("A01", Phase::Revolve, true);
        let course = |events: &[(&str, EventData)]| {
            let state = state(events);
            let found = interruptions(&r, &state, &VecDeque::new(), true, Fate::PoseLost);
            assert_eq!(found[0].well, "A01");
            found[0].course.clone()
        };
        let once = [turn.clone(), ("", found_open())];
        assert_eq!(course(&once), Course::Again);
        let twice = [&once[..], &[("A01", begun_again()), turn.clone(), ("", found_open())]].concat();
        let is_named = |course: &Course| matches!(course, Course::SetAside(why) if why.contains("2 times in the work on A01"));
        assert!(is_named(&course(&twice)));
        // The same reason where the specimen would not be begun again in any case.
        for (run, brings_again) in [(&skipping(), true), (&r, false)] {
            assert!(is_named(&interruptions(run, &state(&twice), &VecDeque::new(), brings_again, Fate::PoseLost)[0].course));
        }
        // Power cuts, however many: the computer was started again each time.
        let cuts = ["two", "three", "four"].map(|boot| [("A01", begun_again()), turn.clone(), ("", found_at(boot))]).concat();
        assert_eq!(course(&[&once[..], &cuts].concat()), Course::Again);
        // A person ends the process in any step, a picture in the same one.
        let other_step = [&once[..], &[("A01", begun_again()), phase("A01", Phase::Detect, true), ("", found_open())]].concat();
        assert_eq!(course(&other_step), Course::Again);
        let again = [&other_step[..], &[("A01", begun_again()), turn.clone(), ("", found_open())]].concat();
        assert!(is_named(&course(&again)));
        // Who asked the daemon to end is not the picture.
        let asked = ("", EventData::DaemonStopping(DaemonStopping { ends_run: false }));
        let stopped = [&once[..], &[("A01", begun_again()), turn.clone(), asked, ("", found_open())]].concat();
        assert_eq!(course(&stopped), Course::Again);
        // The well that was only asked for did nothing.
        let next = [&once[..], &[("A01", begun_again()), phase("A02", Phase::Load, false), ("", found_open()), turn]].concat();
        assert_eq!(course(&next), Course::Again);
    }

    #[test]
    fn an_accepted_specimen_is_taken_out_and_never_given_up() {
        let r = skipping();
        let accepted = VecDeque::from([r.record().plan.plate_map[0].clone()]);
        for fate in [Fate::PoseLost, Fate::Stays] {
            let ejected = state(&[phase("A01", Phase::Eject, true)]);
            assert_eq!(interruptions(&r, &ejected, &accepted, false, fate), [], "an ejection begins nothing");
            let measured = state(&[phase("A01", Phase::Measure, true)]);
            let found = interruptions(&r, &measured, &accepted, false, fate);
            assert_eq!(found, [Interruption { well: "A01".into(), course: Course::LacksNumbers }]);
            for state in [ejected, measured] {
                assert_eq!(state.specimens().must_leave_first(LoadedBy::Loader), Some("A01"));
            }
        }
    }

    #[test]
    fn a_specimen_that_is_still_to_come_or_was_only_brought_is_not_given_up() {
        let loading = state(&[phase("A01", Phase::Load, false)]);
        let found = interruptions(&skipping(), &loading, &VecDeque::new(), false, Fate::PoseLost);
        assert_eq!(found, []);
        let brought = state(&[phase("A01", Phase::Load, false), ("A01", EventData::WellLoaded(WellLoaded { in_place_of: None }))]);
        assert_eq!(interruptions(&skipping(), &brought, &VecDeque::new(), false, Fate::PoseLost), []);
    }
}
