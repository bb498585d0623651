//! What people say about wells: skip, redo, and remarks.

use super::bench::{Bench, RUN, bench, count, journalled, on_this_thread, plan, scratch, started};
use crate::api::State;
use crate::session::handle::{Refusal, Said, Towards};
use crate::session::worker::{Progress, RunEnd};
use carved_core::flag::Flag;
use carved_devices::DeviceError;
use carved_records::{Phase, SaidBy, SpecimenOutcome, WellNote, WellStatus, WellTimes};
use carved_store::testing::trace as disk_trace;

fn says(reason: &str) -> SaidBy {
    SaidBy { by: "kim".into(), reason: reason.into() }
}

fn note(excluded: bool, comment: &str) -> Said {
    Said::Note(WellNote {
        by: "kim".into(),
        time: "2026-03-05T09:30:00Z".into(),
        excluded,
        comment: comment.into(),
        tags: vec!["twin".into()],
    })
}

fn outcome(b: &Bench, well: usize) -> Option<SpecimenOutcome> {
    b.status().run.unwrap().results[well].outcome
}

#[test]
fn a_held_run_leaves_out_a_well_and_goes_on_with_the_next_one() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        let while_it_works = b.said("A02", Said::Skip(says("no larva")));
        assert!(matches!(while_it_works, Err(Refusal::WrongState { .. })), "{while_it_works:?}");
        b.phase("A01", Phase::Load, false);
        b.report(Progress::WaitingForLoader { well: "A01".into() });
        b.steer(Towards::Hold).unwrap();
        b.ends(RunEnd::Paused).await;
        assert!(matches!(b.said("A01", Said::Skip(says(" "))), Err(Refusal::InvalidSaying(mistakes)) if mistakes.len() == 1));
        assert!(matches!(b.said("H12", Said::Skip(says("no larva"))), Err(Refusal::WellNotNow { .. })));
        b.said("A01", Said::Skip(says("no larva"))).unwrap();
        b.said("A01", Said::Skip(says("no larva"))).unwrap();
        assert_eq!(outcome(&b, 0), Some(SpecimenOutcome::Skipped));
        assert_eq!(b.status().run.unwrap().results[0].reason.as_deref(), Some("skipped by kim: no larva"));
        assert!(b.loaded("A01", true).is_err(), "nobody asks for it any more");
        drop(b);
        let mut b = bench(dir.path(), true);
        assert_eq!(outcome(&b, 0), Some(SpecimenOutcome::Skipped), "after a restart too");
        b.steer(Towards::Unhold).unwrap();
        b.report(Progress::Ready);
        b.phase("A02", Phase::Load, false);
        b.report(Progress::WaitingForLoader { well: "A02".into() });
        assert_eq!(b.status().plate.bring.as_deref(), Some("A02"));
    });
}

/// The specimen that a fault has left inside must come out, although the run would have continued with it.
#[test]
fn the_specimen_of_a_well_that_is_left_out_leaves_first() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        b.phase("A01", Phase::Load, false);
        b.report(Progress::WaitingForLoader { well: "A01".into() });
        b.loaded("A01", true).unwrap();
        b.phase("A01", Phase::Position, true);
        b.ends(RunEnd::Failed(DeviceError::NoFrame { waited_ms: 1, attempts: 1, last: "nothing came".into() }.into())).await;
        b.said("A01", Said::Skip(says("it blocks"))).unwrap();
        assert_eq!((outcome(&b, 0), b.status().plate.take_out.as_deref()), (Some(SpecimenOutcome::Skipped), Some("A01")));
        b.steer(Towards::Unhold).unwrap();
        assert!(!b.works(), "not before it is out");
        b.loaded("A01", false).unwrap();
        assert!(b.works());
    });
}

#[test]
fn a_held_run_measures_a_well_again_and_keeps_the_first_attempt() {
    on_this_thread(async {
        for restarted in [false, true] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01", "A02"]);
            b.done("A01");
            let folder = dir.path().join("runs").join(RUN);
            std::fs::create_dir_all(folder.join("A01")).unwrap();
            b.steer(Towards::Hold).unwrap();
            b.ends(RunEnd::Paused).await;
            b.said("A01", note(false, "a bubble")).unwrap();
            b.said("A01", Said::Redo(says("a bubble"))).unwrap();
            b.said("A01", Said::Redo(says("a bubble"))).unwrap();
            if restarted {
                drop(b);
                b = bench(dir.path(), true);
            }
            let well = b.status().run.unwrap().results[0].clone();
            assert_eq!((well.outcome, well.volume_um3, b.status().run.unwrap().wells.pending), (None, None, 2));
            assert_eq!(well.note.unwrap().comment, "a bubble");
            assert!(!folder.join("A01").exists() && folder.join("A01.attempt-1").is_dir());
            if b.status().state == State::Held {
                b.steer(Towards::Unhold).unwrap();
            }
            b.report(Progress::Ready);
            b.phase("A01", Phase::Load, false);
            b.report(Progress::WaitingForLoader { well: "A01".into() });
            assert_eq!(b.status().plate.bring.as_deref(), Some("A01"), "restarted: {restarted}");
        }
    });
}

#[test]
fn an_exclusion_ends_with_the_measurement_that_it_was_said_of() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        b.done("A01");
        b.steer(Towards::Hold).unwrap();
        b.ends(RunEnd::Paused).await;
        b.said("A01", note(true, "two larvae")).unwrap();
        b.said("A01", Said::Redo(says("another larva"))).unwrap();
        b.steer(Towards::Unhold).unwrap();
        b.report(Progress::Ready);
        b.done("A01");
        let well = b.status().run.unwrap().results[0].clone();
        assert_eq!((well.outcome, well.flags.contains(&Flag::Excluded.into())), (Some(SpecimenOutcome::Succeeded), false), "{well:?}");
        let note = *well.note.unwrap();
        assert_eq!((note.excluded, note.by.as_str(), &note.tags[..]), (false, "kim", &["twin".to_owned()][..]));
        assert_eq!(note.comment, "the measurement before was left out of statistics: two larvae");
        let events = journalled(dir.path());
        let noted = events.iter().position(|event| event.body.data.kind() == "well.noted").unwrap();
        assert_eq!(count(&events[noted..], "well.redo_requested"), 1, "the journal has both in their order");
    });
}

/// The process ends before each of the disk operations of a redo. After the next start the well is finished with its files, or it is not done
/// and its files are those of an earlier attempt.
#[test]
fn a_redo_that_a_crash_cuts_short_is_ended_by_the_next_start() {
    on_this_thread(async {
        let mut was_both = [false; 2];
        for at in 0.. {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01", "A02"]);
            b.done("A01");
            let folder = dir.path().join("runs").join(RUN);
            std::fs::create_dir_all(folder.join("A01")).unwrap();
            std::fs::write(folder.join("A01/measurement.json"), "{}").unwrap();
            b.steer(Towards::Hold).unwrap();
            b.ends(RunEnd::Paused).await;
            b.said("A01", note(true, "a bubble")).unwrap();
            disk_trace::begin(None);
            disk_trace::die(at);
            let said = b.said("A01", Said::Redo(says("a bubble")));
            let has_died = disk_trace::was_full();
            assert!(has_died || said.is_ok(), "{said:?}");
            drop(b);
            disk_trace::begin(None);
            let b = bench(dir.path(), true);
            let (is_redone, attempt) = (outcome(&b, 0).is_none(), folder.join("A01.attempt-1/measurement.json").is_file());
            assert_eq!((is_redone, attempt, folder.join("A01").exists()), (is_redone, is_redone, !is_redone), "operation {at}");
            let known = b.status().run.unwrap().results[0].clone();
            assert!(known.note.is_some_and(|note| note.excluded != is_redone && note.comment.ends_with("a bubble")), "operation {at}");
            assert_eq!(known.flags.contains(&Flag::Excluded.into()), !is_redone, "operation {at}");
            let stored = b.d.outbox.store().run(RUN).unwrap().unwrap();
            assert_eq!(stored.wells[0].outcome.is_none(), is_redone, "operation {at}");
            was_both[usize::from(is_redone)] = true;
            disk_trace::end();
            if !has_died {
                break;
            }
        }
        assert_eq!(was_both, [true; 2]);
    });
}

#[test]
fn a_remark_excludes_a_well_during_a_run_and_after_it_and_keeps_its_numbers() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        // Before its numbers come.
        b.said("A01", note(true, "two larvae")).unwrap();
        let mut result = WellStatus::pending(&plan(&["A01"]).plate_map[0]);
        result.end(SpecimenOutcome::Succeeded, None);
        b.report(Progress::WellDone { result, seconds: 1.0, times: WellTimes::default() });
        let excluded = |b: &Bench, well: usize| b.status().run.unwrap().results[well].flags.contains(&Flag::Excluded.into());
        assert!(excluded(&b, 0) && !excluded(&b, 1));
        assert_eq!(outcome(&b, 0), Some(SpecimenOutcome::Succeeded));
        b.done("A02");
        b.ends(RunEnd::AllWells).await;
        assert!(b.status().run.unwrap().outcome.is_some());
        b.said("A02", note(true, "damaged")).unwrap();
        b.said("A01", note(false, "")).unwrap();
        assert!(!excluded(&b, 0) && excluded(&b, 1));
        let noted = || count(&journalled(dir.path()), "well.noted");
        assert_eq!(noted(), 3);
        b.said("A01", note(false, "")).unwrap();
        assert_eq!(noted(), 3, "it says the same");
        drop(b);
        let b = bench(dir.path(), true);
        assert!(!excluded(&b, 0) && excluded(&b, 1), "after a restart too");
    });
}

#[test]
fn a_remark_that_the_disk_refuses_has_no_effect() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01"]);
        disk_trace::begin(None);
        disk_trace::fill(1, || ());
        assert!(matches!(b.said("A01", note(true, "two larvae")), Err(Refusal::Store { .. })));
        assert_eq!(b.status().run.unwrap().results[0].note, None);
        disk_trace::end();
    });
}
