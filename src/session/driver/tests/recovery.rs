//! Numbers that are computed from stored frames, when this takes too long or crashes the daemon.

use super::super::interrupt::Fate;
use super::super::recovery::{Continuation, Numbers, Recovery};
use super::super::run::next_message;
use super::super::*;
use super::bench::{Bench, RUN, bench, count, journalled, on_this_thread, plan, scratch, started};
use crate::api::{RunOutcome, SpecimenOutcome, WellStatus};
use crate::session::worker::RunEnd;
use carved_records::{Phase, kind};
use carved_store::RecordingWriter;
use carved_store::testing::recording as a_recording;
use std::path::Path;
use std::time::Duration;
use tokio::sync::oneshot;

/// A run of these wells. The first specimen was accepted and released, and has no numbers.
fn let_go(root: &Path, wells: &[&str]) -> Bench {
    let b = started(root, true, wells);
    let run = b.d.run.as_ref().unwrap().record();
    let mut recording = a_recording(RUN, &run.plan.plate_map[0]);
    // The turn ended after no view, so no view is missing.
    recording.ended_after_views = Some(0);
    let mut writer = RecordingWriter::create(&b.d.outbox.store().run_folder(RUN).join(wells[0]), recording, None).unwrap();
    writer.accept().unwrap();
    b
}

fn of_well(b: &Bench, at: usize) -> WellStatus {
    b.status().run.unwrap().results[at].clone()
}

/// Counted in the journal over all starts: the well ends at last, and the run continues.
#[test]
fn numbers_on_which_the_daemon_dies_each_time_are_tried_twice() {
    on_this_thread(async {
        let dir = scratch();
        drop(let_go(dir.path(), &["A01", "A02"]));
        for attempt in 1..=2 {
            let b = bench(dir.path(), true);
            assert_eq!(count(&journalled(dir.path()), kind::SPECIMEN_RECOVERING), attempt);
            assert_eq!(of_well(&b, 0).outcome, None);
        }
        let b = bench(dir.path(), true);
        assert_eq!(count(&journalled(dir.path()), kind::SPECIMEN_RECOVERING), 2, "it is tried for ever");
        let well = of_well(&b, 0);
        let why = well.reason.unwrap();
        let by_hand = format!("carved measure {}", b.d.outbox.store().run_folder(RUN).join("A01").display());
        assert!(well.outcome == Some(SpecimenOutcome::Failed) && why.contains("2 attempts") && why.contains(&by_hand), "{why}");
        assert!(b.works(), "the other well waits for ever: {:?}", b.status().state);
    });
}

fn has_sums(b: &Bench, well: &str) -> bool {
    b.d.outbox.store().run_folder(RUN).join(well).join("SHA256SUMS").is_file()
}

/// Every ended well has checksums of its files.
#[test]
fn a_well_that_is_given_up_has_the_sums_of_what_it_keeps() {
    on_this_thread(async {
        let dir = scratch();
        drop(let_go(dir.path(), &["A01", "A02"]));
        for _attempt in 1..=3 {
            drop(bench(dir.path(), true));
        }
        let b = bench(dir.path(), true);
        assert!(of_well(&b, 0).outcome == Some(SpecimenOutcome::Failed) && has_sums(&b, "A01"));

        // Interrupted in its turn, and given up by the method's policy.
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        b.asks_for("A01");
        b.loaded("A01", true).unwrap();
        b.phase("A01", Phase::Position, true);
        let record = b.d.run.as_mut().unwrap().record_mut();
        record.method.policy.interrupted = carved_records::Interrupted::Skip;
        let recording = a_recording(RUN, &record.plan.plate_map[0]);
        drop(RecordingWriter::create(&b.d.outbox.store().run_folder(RUN).join("A01"), recording, None).unwrap());
        course::interrupt_specimens(&mut b.d, "the power was cut", Fate::PoseLost);
        assert!(has_sums(&b, "A01"), "skipped by policy");

        // A crash left it, and it was never begun again: the end of the run seals it.
        let recording = a_recording(RUN, &b.d.run.as_ref().unwrap().record().plan.plate_map[1]);
        drop(RecordingWriter::create(&b.d.outbox.store().run_folder(RUN).join("A02.attempt-1"), recording, None).unwrap());
        course::end_now(&mut b.d);
        assert!(has_sums(&b, "A02.attempt-1"), "at the end of the run");
    });
}

/// The disk prevented the computation, so this is not a failed attempt.
#[test]
fn a_disk_that_failed_meanwhile_is_no_attempt() {
    on_this_thread(async {
        let dir = scratch();
        drop(let_go(dir.path(), &["A01", "A02"]));
        drop(bench(dir.path(), true));
        let mut b = bench(dir.path(), true);
        b.d.handle_write_error(Err(StoreError::Vanished { path: "a disk".into() }));
        b.ends(RunEnd::Cancelled).await;
        b.beat().await;
        drop(b);
        let b = bench(dir.path(), true);
        assert_eq!((of_well(&b, 0).outcome, count(&journalled(dir.path()), kind::SPECIMEN_RECOVERING)), (None, 3));
    });
}

/// A service manager may kill the daemon before the numbers are computed. A requested end is not counted as a crash.
#[test]
fn a_daemon_that_was_asked_to_end_has_not_died_of_them() {
    on_this_thread(async {
        let dir = scratch();
        drop(let_go(dir.path(), &["A01", "A02"]));
        for _ in 0..4 {
            let mut b = bench(dir.path(), true);
            course::shut_down(&mut b.d, Departure::EndsRun);
        }
        let b = bench(dir.path(), true);
        assert_eq!((of_well(&b, 0).outcome, count(&journalled(dir.path()), kind::SPECIMEN_RECOVERING)), (None, 5));
    });
}

/// An abort waits for numbers only for a limited time.
#[test]
fn numbers_that_take_longer_than_the_method_allows_fail_their_well_and_let_the_run_end() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = let_go(dir.path(), &["A01", "A02"]);
        b.steer(crate::session::Towards::Abort).unwrap();
        let planned = plan(&["A01"]).plate_map.into();
        // Nothing is ever sent on this channel.
        let (_hangs, done) = oneshot::channel();
        let run = b.d.outbox.store().run_folder(RUN);
        let in_progress = b.d.run.as_mut().unwrap();
        *in_progress.work_mut() = None;
        *in_progress.numbers_mut() = Numbers::awaited(Recovery::awaited(planned, &run, done, Duration::from_millis(1)), Continuation::End);
        let Message::Recovered(made) = next_message(&mut b.d.run).await else { panic!("another word") };
        course::recovered(&mut b.d, made);
        let well = of_well(&b, 0);
        let why = well.reason.unwrap();
        assert!(well.outcome == Some(SpecimenOutcome::Failed) && why.contains("measure") && why.contains("carved measure"), "{why}");
        let status = b.status();
        assert_eq!((status.state, status.run.unwrap().outcome), (State::Aborted, Some(RunOutcome::Aborted)));
    });
}
