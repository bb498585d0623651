//! What survives a restart: a run that is taken up, and an open plate handover.

use super::super::*;
use super::bench::{bench, count, driver, journalled, on_this_thread, plan, scratch, started};
use crate::api::NextCommand;
use crate::session::handle::{Refusal, SessionHandle, Towards};
use crate::session::search::DevicesFound;
use crate::session::worker::{Progress, RunEnd, RunError};
use carved_devices::DeviceError;
use carved_records::{Asked, EventData, Handoff, HandoffEnd, HandoffIntent, Phase, SpecimenOutcome, kind};
use carved_store::StoreError;
use carved_store::testing::trace as disk_trace;
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

/// A loss that ends by itself.
fn camera_lost() -> RunError {
    RunError::Device(DeviceError::ControlLost)
}

/// What a client may read meanwhile: each snapshot before a write to the disk, and the last one.
fn witnessed(handle: &SessionHandle, happens: impl FnOnce()) -> Vec<Status> {
    let seen = Rc::new(RefCell::new(Vec::new()));
    let witness = {
        let (handle, seen) = (handle.clone(), Rc::clone(&seen));
        move || seen.borrow_mut().push(handle.status())
    };
    disk_trace::fill(usize::MAX, witness);
    happens();
    disk_trace::end();
    seen.borrow_mut().push(handle.status());
    seen.take()
}

/// What a client may read while a run is taken up.
fn snapshots(root: &Path) -> Vec<Status> {
    let (driver, handle, _mailbox) = driver(root, true);
    let mut d = DriverState::new(driver);
    witnessed(&handle, || restart::first_report(&mut d))
}

/// The fault is cleared some milliseconds before the run continues.
#[test]
fn a_run_that_goes_on_when_its_fault_is_over_is_never_shown_as_waiting_for_somebody() {
    on_this_thread(async {
        for error in [camera_lost(), RunError::Store(StoreError::Vanished { path: "a disk".into() })] {
            let dir = scratch();
            let mut b = started(dir.path(), false, &["A01"]);
            b.ends(RunEnd::Failed(error)).await;
            let seen = witnessed(&b.handle.clone(), || {
                checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
                checks::try_the_store(&mut b.d);
            });
            let held: Vec<&Status> = seen.iter().filter(|s| s.state == State::Held).collect();
            assert!(held.iter().any(|s| s.faults.is_empty()), "there is nothing to be seen");
            for status in held {
                let run = status.run.as_ref().unwrap();
                assert!(run.goes_on_by_itself && run.hold.as_ref().unwrap().next_command.is_none(), "{status:?}");
                assert!(!status.faults.is_empty() || status.doing.contains("by itself"), "{}", status.doing);
            }
            assert_eq!(seen.last().unwrap().state, State::Unholding);
        }
    });
}

/// It is held for some milliseconds only, so nobody must be called.
#[test]
fn a_run_that_is_taken_up_and_goes_on_is_never_shown_as_waiting_for_somebody() {
    on_this_thread(async {
        let dir = scratch();
        drop(started(dir.path(), true, &["A01"]));
        let seen = snapshots(dir.path());
        let held: Vec<&Status> = seen.iter().filter(|s| s.state == State::Held).collect();
        assert!(!held.is_empty(), "there is nothing to be seen");
        for status in held {
            assert!(status.run.as_ref().unwrap().goes_on_by_itself && status.doing.contains("by itself"), "{}", status.doing);
        }
        let last = seen.last().unwrap();
        assert_eq!((last.state, last.run.as_ref().unwrap().goes_on_by_itself), (State::Unholding, false));

        // Held by an operator, or by a fault that needs one, the run does wait.
        let mut b = bench(dir.path(), true);
        b.steer(Towards::Hold).unwrap();
        drop(b);
        let waits = |status: &Status| status.state == State::Held && !status.run.as_ref().unwrap().goes_on_by_itself;
        for status in snapshots(dir.path()).iter().filter(|s| s.state == State::Held) {
            assert!(waits(status) && status.doing.contains("operator"), "{}", status.doing);
        }
        let mut b = bench(dir.path(), true);
        b.steer(Towards::Unhold).unwrap();
        b.d.raise(&RunError::SpecimenThread);
        drop(b);
        let seen = snapshots(dir.path());
        assert!(seen.iter().filter(|s| s.state == State::Held).all(waits) && waits(seen.last().unwrap()));

        let mut b = bench(dir.path(), true);
        let seq = b.status().faults[0].seq;
        requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
        b.d.event(None, EventData::RunStopRequested(Asked::default()));
        drop(b);
        for status in snapshots(dir.path()).iter().filter(|s| s.state == State::Held) {
            assert!(status.pending.stop && status.doing.contains("ends"), "{}", status.doing);
        }
    });
}

/// The server waits for this, so that no client reads that there is no run and no plate.
#[test]
fn a_status_without_the_run_of_before_says_that_the_daemon_starts() {
    on_this_thread(async {
        let dir = scratch();
        drop(started(dir.path(), true, &["A01"]));
        for status in snapshots(dir.path()) {
            assert!(status.run.is_some() || status.is_starting(), "{status:?}");
        }
        let (driver, handle, _mailbox) = driver(dir.path(), true);
        let mut d = DriverState::new(driver);
        for restored in [false, true] {
            let waited = tokio::select! {
                biased;
                () = handle.until_restored() => true,
                () = std::future::ready(()) => false,
            };
            assert_eq!(waited, restored);
            if !restored {
                restart::first_report(&mut d);
            }
        }
    });
}

/// The same outcome as in an import. An interrupted well is among those that a new run takes up, and this one would end the daemon there.
#[test]
fn a_well_that_two_processes_ended_in_fails_and_the_run_goes_on_with_the_next() {
    on_this_thread(async {
        for outside in [true, false] {
            let dir = scratch();
            let mut b = started(dir.path(), outside, &["A01", "A02"]);
            for deaths in 1..=2 {
                b.phase("A01", Phase::Load, false);
                b.phase("A01", Phase::Position, true);
                b.phase("A01", Phase::Detect, true);
                drop(b);
                b = bench(dir.path(), outside);
                let wells = b.status().run.unwrap().results;
                let ends = (deaths == 2).then_some(SpecimenOutcome::Failed);
                assert_eq!((wells[0].outcome, wells[1].outcome), (ends, None), "death {deaths}, a loader: {outside}");
                let why = wells[0].reason.as_deref().unwrap_or_default();
                assert_eq!(why.starts_with("set aside: the daemon ended 2 times in the work on A01"), deaths == 2, "{why}");
                b.loaded("A01", false).unwrap();
                b.report(Progress::Ready);
            }
            assert_eq!(b.d.run.as_ref().unwrap().next_well(), Some("A02"));
        }
    });
}

/// A lost camera holds the run. The run continues when the camera is back, without a person.
#[test]
fn a_run_says_whether_what_holds_it_lets_it_go_by_itself() {
    on_this_thread(async {
        for alone in [true, false] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01"]);
            let error = if alone { camera_lost() } else { RunError::SpecimenThread };
            b.ends(RunEnd::Failed(error)).await;
            assert_eq!((b.status().state, b.status().run.unwrap().goes_on_by_itself), (State::Held, alone));
            b.steer(Towards::Hold).unwrap();
            assert!(!b.status().run.unwrap().goes_on_by_itself, "an operator holds it");
        }
    });
}

/// A gripper may hold the plate while the daemon starts.
#[test]
fn a_plate_on_its_way_is_remembered_over_a_restart() {
    on_this_thread(async {
        for (intent, end) in [
            (HandoffIntent::Load, HandoffEnd::Aborted),
            (HandoffIntent::Load, HandoffEnd::Completed),
            (HandoffIntent::Unload, HandoffEnd::Aborted),
            (HandoffIntent::Unload, HandoffEnd::Completed),
        ] {
            let dir = scratch();
            let plate = Handoff { intent, barcode: "P-1".into() };
            let mut b = bench(dir.path(), true);
            if intent == HandoffIntent::Unload {
                requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
                requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
            }
            requests::handoff(&mut b.d, plate.clone()).unwrap();
            drop(b);
            let mut b = bench(dir.path(), true);
            let why = b.status().not_ready_reason;
            assert!(why.as_deref().is_some_and(|why| why.contains("P-1 is being handed over")), "{why:?}");
            assert!(matches!(b.put_run(&plan(&["A01"])), Err(Refusal::HandoffOpen { .. })));
            assert_eq!(requests::handoff(&mut b.d, plate).map(|asked| asked.needs), Ok(None), "asked again");
            requests::end_handoff(&mut b.d, end).unwrap();
            let inside = (intent == HandoffIntent::Load) == (end == HandoffEnd::Completed);
            assert_eq!((b.status().ready, b.status().plate.present), (true, inside));
            drop(b);
            let mut b = bench(dir.path(), true);
            assert_eq!(
                (b.status().ready, b.status().plate.present, requests::end_handoff(&mut b.d, end)),
                (true, inside, Ok(())),
                "said again"
            );
            let other = if end == HandoffEnd::Completed { HandoffEnd::Aborted } else { HandoffEnd::Completed };
            assert_eq!(requests::end_handoff(&mut b.d, other), Err(Refusal::NoHandoff));
        }
    });
}

/// The camera is lost and found four times without a finished well. The fault is over, and the status still shows the cause of the hold, how
/// often it occurred and the next action. A restart does not forget it.
#[test]
fn a_hold_whose_cause_is_over_names_it_and_the_next_action() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        for times in 1..=4 {
            b.ends(RunEnd::Failed(camera_lost())).await;
            let status = b.status();
            let hold = status.run.unwrap().hold.unwrap();
            assert_eq!((hold.code.as_str(), hold.times), ("camera_lost", times));
            assert!(hold.next_action.unwrap().contains("power and network cable"), "while it is away");
            checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
            assert_eq!(b.works(), times < 4, "{times}: {:?}", b.status().state);
            b.report(Progress::Ready);
        }
        for restarted in [false, true] {
            if restarted {
                drop(b);
                b = bench(dir.path(), false);
            }
            let status = b.status();
            assert_eq!((status.state, status.faults.len()), (State::Held, 0), "{restarted}");
            let hold = status.run.unwrap().hold.unwrap();
            assert_eq!((hold.code.as_str(), hold.times), ("camera_lost", 4), "{restarted}");
            assert!(hold.next_action.unwrap().contains("let the run go on"), "{restarted}");
            for word in ["Camera lost", "4 times", "let the run go on"] {
                assert!(status.doing.contains(word), "{restarted}: {word}: {}", status.doing);
            }
        }
        b.steer(Towards::Unhold).unwrap();
        assert!(b.works() && b.status().run.unwrap().hold.is_none());
    });
}

/// A load of the computer that nobody sees at night: the run tries again, and calls for a person only when that has not helped.
#[test]
fn a_camera_without_a_frame_is_tried_again_before_somebody_is_woken() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        let mut tries = 0;
        loop {
            let no_frame = DeviceError::NoFrame { waited_ms: 3000, attempts: 3, last: "nothing".into() };
            b.ends(RunEnd::Failed(RunError::Device(no_frame))).await;
            let status = b.status();
            let run = status.run.as_ref().unwrap();
            assert!(!run.hold.as_ref().unwrap().next_action.as_ref().unwrap().is_empty());
            let Some(at) = run.hold.as_ref().unwrap().next_try.clone() else { break };
            tries += 1;
            assert_eq!((run.goes_on_by_itself, status.faults[0].operator_required), (true, false), "try {tries}");
            assert!(!crate::notify::needs_somebody(&status), "try {tries}");
            let pause = at.parse::<jiff::Timestamp>().unwrap().duration_since(jiff::Timestamp::now()).as_secs();
            assert!(pause <= 60 << (tries - 1) && pause > 30 << (tries - 1), "try {tries}: in {pause} s");
            b.beat().await;
            assert!(!b.works(), "the pause is not over");
            b.d.run.as_mut().unwrap().set_tries_again_at(Some(jiff::Timestamp::now()));
            checks::beat(&mut b.d);
            assert!(b.works() && b.status().faults.is_empty(), "try {tries}");
            b.report(Progress::Ready);
        }
        let status = b.status();
        assert_eq!((tries, status.run.as_ref().unwrap().goes_on_by_itself), (5, false));
        assert!(crate::notify::needs_somebody(&status) && status.faults[0].operator_required);
        b.steer(Towards::Unhold).unwrap();
        assert!(b.works());
    });
}

/// By the fault table a scheduler may try again. While the run waits, a person must act, and every field of the status says so.
#[test]
fn a_fault_whose_run_waits_needs_a_person_until_the_run_goes_on() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        let suspect = DeviceError::Suspect { why: "it is not where it was".into() };
        b.ends(RunEnd::Failed(RunError::Device(suspect))).await;
        let status = b.status();
        let (fault, run) = (&status.faults[0], status.run.unwrap());
        let hold = run.hold.unwrap();
        assert_eq!((fault.code.as_str(), run.goes_on_by_itself, fault.operator_required), ("rotation_suspect", false, true));
        assert!(fault.what_to_do.starts_with("Let the run go on"), "{}", fault.what_to_do);
        assert_eq!((hold.next_action.as_ref(), hold.next_command), (Some(&fault.what_to_do), Some(NextCommand::Unhold)));
        b.steer(Towards::Unhold).unwrap();
        assert!(b.status().faults.is_empty() && b.works());
    });
}

#[test]
fn an_operators_hold_and_an_acknowledged_fault_are_named_too() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01"]);
        b.steer(Towards::Hold).unwrap();
        b.ends(RunEnd::Paused).await;
        assert_eq!(b.status().run.unwrap().hold.unwrap().code, "operator");
        b.steer(Towards::Unhold).unwrap();
        b.report(Progress::Ready);
        b.ends(RunEnd::Failed(RunError::SpecimenThread)).await;
        let seq = b.status().faults[0].seq;
        requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
        let status = b.status();
        let hold = status.run.unwrap().hold.unwrap();
        assert_eq!((hold.code.as_str(), hold.times), ("internal_error", 1));
        assert!(status.doing.contains("should not have") && status.doing.contains("Let the run go on"), "{}", status.doing);
    });
}

/// A data folder of an earlier build, killed by `kill -9` during a run. The last specimen is still inside.
#[test]
fn a_data_folder_of_an_earlier_build_is_taken_up() {
    on_this_thread(async {
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/records/tests/data/loader-crash");
        let dir = scratch();
        std::fs::create_dir_all(dir.path().join("runs/old-1")).unwrap();
        for file in ["events.jsonl", "runs/old-1/events.jsonl", "runs/old-1/run.json"] {
            std::fs::copy(from.join(file), dir.path().join(file)).unwrap();
        }
        let b = bench(dir.path(), true);
        let status = b.status();
        assert_eq!((status.plate.barcode.as_deref(), status.plate.take_out.as_deref()), (Some("OLD-1"), Some("B01")));
        let run = status.run.unwrap();
        assert_eq!((run.id.as_str(), run.wells.succeeded, run.wells.pending), ("old-1", 3, 1));
        assert_eq!(status.state, State::Suspended, "it waits for B01 to be taken out, and goes on with it");
        assert!(run.eta_s.is_some(), "what the first three took is forgotten");
    });
}

/// The process died between the outcome in the run's record and the event of the end.
#[test]
fn a_run_whose_end_is_in_its_record_alone_has_ended_for_its_specimens_too() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        b.put_run(&plan(&["A01"])).unwrap();
        b.phase("A01", Phase::Load, false);
        let mut record = b.d.run.as_ref().unwrap().record().clone();
        record.end_interrupted();
        b.d.outbox.store().save_run(&record).unwrap();
        drop(b);
        for _ in 0..2 {
            let b = bench(dir.path(), false);
            assert_eq!(b.status().plate.take_out.as_deref(), Some("A01"), "the sampler may still bring it");
            assert_eq!(count(&journalled(dir.path()), kind::RUN_ENDED), 1);
        }
    });
}
