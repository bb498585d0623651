//! Situations in the life of a run that a rig does not produce on demand.

use super::super::*;
use super::bench::{
    Arm, Bench, RUN, bench, bench_of, count, driver, instrument, journalled, on_this_thread, plan, scratch, started, started_with,
};
use crate::session::handle::{Accepted, Refusal, Towards};
use crate::session::search::DevicesFound;
use crate::session::worker::{Progress, RunEnd, RunError};
use carved_devices::DeviceError;
use carved_devices::testing::FakeAxis;
use carved_records::{Asked, EventData, Handoff, HandoffEnd, HandoffIntent, Phase, ResumedBy, ViewTaken, fault_table};
use futures::FutureExt;
use std::cell::Cell;
use std::future::{poll_fn, ready};
use std::path::Path;
use std::task::Poll;

/// Timeout of steps that take milliseconds.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(60);

fn gone() -> DeviceError {
    DeviceError::Gone { device: "rotation axis", why: "the cable".into() }
}

fn sampler_failed() -> RunError {
    RunError::Device(DeviceError::Sampler { well: "A01".into(), why: "it is stuck".into() })
}

/// The specimen was accepted and could not be ejected. Its numbers follow all the same, and the next specimen must not be brought on top of
/// it.
#[test]
fn a_specimen_that_could_not_be_taken_out_is_not_forgotten_with_its_numbers() {
    for wells in [&["A01"][..], &["A01", "A02"]] {
        on_this_thread(async {
            let dir = scratch();
            let mut b = bench(dir.path(), false);
            assert_eq!(b.put_run(&plan(wells)), Ok(Accepted::Created));
            b.report(Progress::Ready);
            for (phase, inside) in [(Phase::Load, false), (Phase::Measure, true), (Phase::Eject, true)] {
                b.phase("A01", phase, inside);
            }
            b.done("A01");
            b.ends(RunEnd::Failed(sampler_failed())).await;
            let status = b.status();
            // Its result was journalled before. It is not taken back.
            let of_a01 = |kind: &str| {
                journalled(dir.path()).iter().filter(|e| e.body.data.kind() == kind && e.body.well.as_deref() == Some("A01")).count()
            };
            assert_eq!((of_a01("specimen.done"), of_a01("specimen.interrupted")), (1, 0), "{wells:?}");
            let outcome = status.run.as_ref().unwrap().results[0].outcome;
            assert_eq!(outcome, Some(crate::api::SpecimenOutcome::Succeeded), "{wells:?}");
            assert!(status.specimen.is_some_and(|s| s.well == "A01" && s.in_capillary), "{wells:?}");
            assert!(!status.plate.removable && status.state == State::Held, "{:?}", status.state);
            assert_eq!(b.d.must_leave_first(), Some("A01"));
            // It is also ejected if the run has no further well.
            let seq = status.faults[0].seq;
            requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
            assert!(b.works(), "the run has ended with a specimen in the capillary");
        });
    }
}

/// A run of A01 and A02 that this error has interrupted after the loader had brought A01.
async fn cut_short(root: &Path, error: DeviceError) -> Bench {
    let mut b = started(root, true, &["A01", "A02"]);
    b.report(Progress::WaitingForLoader { well: "A01".into() });
    b.loaded("A01", true).unwrap();
    b.phase("A01", Phase::Position, true);
    b.ends(RunEnd::Failed(RunError::Device(error))).await;
    b
}

/// Acknowledges the open faults.
fn acknowledge_all(b: &mut Bench) {
    for fault in b.status().faults {
        requests::acknowledge(&mut b.d, fault.seq, Asked::default()).unwrap();
    }
}

/// An emergency stop that cuts the supply of the axis looks like a pulled cable. The power comes back when it is released, and the axis must
/// not turn by that.
#[test]
fn an_axis_that_was_lost_waits_for_a_person_with_and_without_a_run() {
    on_this_thread(async {
        let dir = scratch();
        let found = |rotation| DevicesFound { rotation, camera: Ok(()), outputs: Vec::new() };
        let mut b = cut_short(dir.path(), gone()).await;
        let status = b.status();
        let run = status.run.unwrap();
        assert_eq!((run.goes_on_by_itself, run.hold.unwrap().next_command), (false, None), "there is nothing to acknowledge yet");
        assert_eq!(status.faults[0].code, fault_table::ROTATION_LOST.code);
        assert!(matches!(course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()), Err(Refusal::DeviceLost { .. })));
        for _ in 0..2 {
            checks::searched(&mut b.d, found(Ok(())));
            let status = b.status();
            let codes: Vec<&str> = status.faults.iter().map(|fault| fault.code.as_str()).collect();
            assert_eq!((status.state, codes), (State::Held, vec![fault_table::ROTATION_INTERVENTION.code]));
            assert!(status.hardware.rotation.connected && status.faults[0].message.contains("was away"));
            let run = status.run.unwrap();
            assert_eq!(run.hold.unwrap().next_command, Some(crate::api::NextCommand::Acknowledge));
            assert!(!run.goes_on_by_itself);
        }
        acknowledge_all(&mut b);
        checks::searched(&mut b.d, found(Ok(())));
        assert_eq!((b.status().state, b.works()), (State::Held, false), "an acknowledgement does not turn the axis");
        drop(b);
        let mut b = bench(dir.path(), true);
        assert_eq!((b.status().state, b.works()), (State::Held, false), "the daemon was restarted");
        course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
        assert_eq!(b.status().state, State::Suspended, "it goes on to have the specimen taken out");

        // The daemon is restarted while the axis is away.
        let dir = scratch();
        let b = cut_short(dir.path(), gone()).await;
        drop(b);
        let mut b = bench(dir.path(), true);
        assert!(!b.works() && !b.status().run.unwrap().goes_on_by_itself);
        checks::searched(&mut b.d, found(Ok(())));
        assert_eq!((b.status().state, b.status().faults[0].code.as_str()), (State::Held, fault_table::ROTATION_INTERVENTION.code));

        let dir = scratch();
        let mut b = bench(dir.path(), true);
        checks::searched(&mut b.d, found(Err(gone())));
        drop(b);
        let mut b = bench(dir.path(), true);
        checks::searched(&mut b.d, found(Ok(())));
        assert!(matches!(b.put_run(&plan(&["A01"])), Err(Refusal::FaultStands { .. })), "a scheduler would turn it");
        acknowledge_all(&mut b);
        assert!(b.status().ready && b.status().faults.is_empty());
    });
}

/// The loader reports that it took a specimen out while the axis is lost. The next well cannot be measured now, and must be measured later.
#[test]
fn a_run_that_has_to_go_on_without_its_instrument_waits_for_it() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = cut_short(dir.path(), DeviceError::ControlLost).await;
        checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
        assert_eq!(b.status().state, State::Suspended, "it goes on to have the specimen taken out");
        checks::searched(&mut b.d, DevicesFound { rotation: Err(gone()), camera: Ok(()), outputs: Vec::new() });
        let instrument = b.d.devices.take().unwrap();
        b.loaded("A01", false).unwrap();
        assert_eq!((b.status().state, b.works()), (State::Held, false));
        b.d.devices.give_back(instrument);
        checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
        acknowledge_all(&mut b);
        course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
        assert!(b.works(), "{:?}", b.status().state);
    });
}

/// The larva of A01 is on its way out of the sampler when the daemon restarts. It must not be measured as that of A02.
#[test]
fn a_driven_sampler_that_was_asked_before_a_restart_is_asked_for_the_same_well_again() {
    on_this_thread(async {
        let dir = scratch();
        let driven = || instrument(FakeAxis::new(), Arm::default());
        let mut b = started_with(dir.path(), driven(), &["A01", "A02"]);
        b.phase("A01", Phase::Load, false);
        for _restart in 0..2 {
            drop(b);
            b = bench_of(dir.path(), driven());
            assert_eq!((b.status().run.unwrap().results[0].outcome, b.works()), (None, true));
            assert_eq!((b.d.specimens().unknown(), b.d.specimens().inside()), (Some("A01"), Some("A01")));
            assert_eq!(b.d.must_leave_first(), None, "it would be ejected, or the next one taken for it");
        }
        b.phase("A01", Phase::Load, false);
        assert_eq!((b.d.specimens().unknown(), b.d.specimens().inside()), (None, None), "it is awaited");
        b.phase("A01", Phase::Position, true);
        drop(b);
        let b = bench_of(dir.path(), driven());
        assert!(b.status().run.unwrap().results[0].outcome.is_some(), "it came, and cannot come again");
    });
}

/// A02 is loaded while the disk fails with the numbers of A01, so it is ejected. The sampler brings A03 next, which is not A02.
#[test]
fn a_specimen_that_was_ejected_before_any_work_on_it_cannot_come_again() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started_with(dir.path(), instrument(FakeAxis::new(), Arm::default()), &["A01", "A02", "A03"]);
        for (phase, inside) in [(Phase::Load, false), (Phase::Eject, true), (Phase::Wash, false)] {
            b.phase("A02", phase, inside);
        }
        let vanished = carved_store::StoreError::Vanished { path: "/data".into() };
        b.ends(RunEnd::Failed(RunError::Store(vanished))).await;
        assert_eq!(b.status().run.unwrap().results[1].outcome, Some(crate::api::SpecimenOutcome::Interrupted));
    });
}

/// A person presses the emergency stop at the controller while the loader is asked to take a specimen out. The run is held, and the loader's
/// report does not start the axis. It waits for `unhold`, also when a device comes back or the daemon restarts.
#[test]
fn a_run_that_waited_for_the_loader_does_not_go_on_over_a_fault_of_a_person() {
    for acknowledged_first in [false, true] {
        on_this_thread(async {
            let dir = scratch();
            let mut b = cut_short(dir.path(), DeviceError::ControlLost).await;
            let found = |rotation| DevicesFound { rotation, camera: Ok(()), outputs: Vec::new() };
            checks::searched(&mut b.d, found(Ok(())));
            assert_eq!(b.status().state, State::Suspended, "it goes on to have the specimen taken out");
            let pressed = DeviceError::Intervention { device: "axis", what: "emergency stop".into(), way_out: "Release it." };
            checks::searched(&mut b.d, found(Err(pressed)));
            assert_eq!((b.status().state, b.status().plate.take_out.as_deref()), (State::Held, Some("A01")));
            let seq = b.status().faults[0].seq;
            if acknowledged_first {
                requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            }
            b.loaded("A01", false).unwrap();
            assert_eq!((b.status().state, b.works()), (State::Held, false), "the axis would turn");
            requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            assert!(!b.status().run.unwrap().goes_on_by_itself);
            checks::searched(&mut b.d, found(Err(gone())));
            checks::searched(&mut b.d, found(Ok(())));
            acknowledge_all(&mut b);
            assert_eq!((b.status().state, b.works()), (State::Held, false), "the axis was away for a moment");
            drop(b);
            let mut b = bench(dir.path(), true);
            assert_eq!((b.status().state, b.works()), (State::Held, false), "the daemon was restarted");
            assert!(b.status().run.unwrap().hold.is_some_and(|hold| hold.next_command == Some(crate::api::NextCommand::Unhold)));
            course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
            assert!(b.works());
        });
    }
}

/// The whole machine lost its power, so the axis very probably did too. A restart of the daemon alone continues the run.
#[test]
fn a_run_waits_for_a_person_after_a_restart_of_the_computer() {
    on_this_thread(async {
        for has_other_boot in [false, true] {
            let dir = scratch();
            let mut b = started_with(dir.path(), instrument(FakeAxis::new(), Arm::default()), &["A01", "A02"]);
            b.phase("A01", Phase::Revolve, true);
            drop(b);
            let boot = start::kernel_boot_id().unwrap();
            for journal in ["events.jsonl".into(), format!("runs/{RUN}/events.jsonl")].map(|name: String| dir.path().join(name)) {
                let text = std::fs::read_to_string(&journal).unwrap();
                assert!(text.contains(&boot), "{text}");
                if has_other_boot {
                    std::fs::write(journal, text.replace(&boot, "00000000-0000-4000-8000-000000000000")).unwrap();
                }
            }
            let mut b = bench_of(dir.path(), instrument(FakeAxis::new(), Arm::default()));
            assert_eq!(b.works(), !has_other_boot, "{:?}", b.status().state);
            if !has_other_boot {
                continue;
            }
            let hold = b.status().run.unwrap().hold.unwrap();
            assert!(hold.cause.contains("computer was restarted"), "{hold:?}");
            assert_eq!(hold.next_command, Some(crate::api::NextCommand::Unhold));
            drop(b);
            b = bench_of(dir.path(), instrument(FakeAxis::new(), Arm::default()));
            assert!(!b.works(), "the daemon was restarted once more");
            course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
            assert!(b.works());
        }
    });
}

#[test]
fn a_run_that_a_person_has_continued_goes_on_when_the_loader_has_taken_the_specimen_out() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = cut_short(dir.path(), DeviceError::Suspect { why: "it slipped".into() }).await;
        assert_eq!(b.status().state, State::Held);
        course::unhold(&mut b.d, ResumedBy::Operator, Asked::default()).unwrap();
        assert_eq!((b.status().state, b.works()), (State::Suspended, false), "its specimen is still inside");
        b.loaded("A01", false).unwrap();
        assert!(b.works());
    });
}

#[test]
fn an_emergency_stop_that_comes_while_a_run_is_launched_ends_it_and_latches() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        // The client disconnected before its command was in the mailbox.
        drop(b.d.publisher.halt().stop(Asked::default()));
        b.put_run(&plan(&["A01"])).unwrap();
        assert!(!b.report(Progress::Ready), "a worker that was launched under the stop is not cancelled");
        b.d.publisher.halt().pressed().await;
        requests::emergency_pressed(&mut b.d);
        b.ends(RunEnd::Cancelled).await;
        let status = b.status();
        assert_eq!((status.state, status.faults[0].code.as_str()), (State::Aborted, fault_table::EMERGENCY_STOP.code));
        assert_eq!(requests::emergency_stopped(&mut b.d), Ok(()), "the word in the mailbox comes after all");
        assert_eq!(count(&journalled(dir.path()), "fault.raised"), 1);
        let seq = status.faults[0].seq;
        requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
        assert!(requests::emergency_stopped(&mut b.d).is_ok() && b.status().faults.is_empty(), "it was seen to");
    });
}

/// An emergency stop takes effect even if the mailbox is full and no client waits for its answer.
#[test]
fn an_emergency_stop_that_never_got_into_the_mailbox_latches() {
    on_this_thread(async {
        let dir = scratch();
        let (driver, handle, mailbox) = driver(dir.path(), false);
        while handle.acknowledge(99, Asked::default()).now_or_never().is_none() && mailbox.len() < mailbox.max_capacity() {}
        handle.emergency_stop(Asked::default()).await;
        assert_eq!(handle.latch_emergency_stop().now_or_never(), None, "it found room in the mailbox");
        let latched = async {
            let mut status = handle.status();
            while status.faults.is_empty() {
                status = handle.status_after(status.revision).await;
            }
            status
        };
        let status = tokio::select! {
            ended = driver.run(mailbox, std::future::pending(), || ready(())) => panic!("{ended:?}"),
            status = tokio::time::timeout(PATIENCE, latched) => status.unwrap(),
        };
        assert_eq!(status.faults[0].code, fault_table::EMERGENCY_STOP.code);
    });
}

/// The server drops its handles when the daemon is asked to end. A busy driver can find its mailbox closed in the same moment.
#[test]
fn a_daemon_that_ends_for_a_restart_leaves_its_run_open_if_the_last_client_goes_first() {
    on_this_thread(async {
        let dir = scratch();
        drop(started(dir.path(), true, &["A01"]));
        let (driver, handle, mailbox) = driver(dir.path(), true);
        let (is_alone, mut asked) = (Cell::new(false), false);
        let shutdown =
            poll_fn(|_| if std::mem::replace(&mut asked, is_alone.get()) { Poll::Ready(Departure::LeavesRun) } else { Poll::Pending });
        let last_client = async {
            handle.status_after(1).await;
            drop(handle);
            is_alone.set(true);
        };
        let (ended, ()) = tokio::join!(driver.run(mailbox, shutdown, || ready(())), last_client);
        ended.unwrap();
        assert_eq!(count(&journalled(dir.path()), "daemon.stopping"), 1);
        assert_eq!(count(&journalled(dir.path()), "run.ended"), 0, "the run has ended with the daemon");
    });
}

/// The stop is pressed in the moment in which the driver has nothing left to do.
#[test]
fn an_emergency_stop_while_the_daemon_ends_is_known_to_the_next_one() {
    on_this_thread(async {
        let dir = scratch();
        started(dir.path(), true, &["A01"]).steer(Towards::Hold).unwrap();
        let (driver, handle, mailbox) = driver(dir.path(), true);
        let shutdown = poll_fn(|_| {
            let _pressed = handle.emergency_stop(Asked::default()).now_or_never();
            Poll::Ready(Departure::LeavesRun)
        });
        driver.run(mailbox, shutdown, || ready(())).await.unwrap();
        latched_for_the_next_one(dir.path());
    });
}

/// The next daemon knows the emergency stop and ends the run of this one.
fn latched_for_the_next_one(folder: &Path) {
    let status = bench(folder, true).status();
    assert_eq!((status.state, status.faults[0].code.as_str()), (State::Aborted, fault_table::EMERGENCY_STOP.code));
    assert_eq!(status.run.unwrap().outcome, Some(crate::api::RunOutcome::Aborted));
}

/// The run is left already. Clients still reach the daemon.
#[test]
fn an_emergency_stop_at_a_daemon_that_has_nothing_left_to_do_is_journalled_before_its_answer() {
    on_this_thread(async {
        for departure in [Departure::LeavesRun, Departure::EndsRun] {
            let dir = scratch();
            started(dir.path(), true, &["A01"]).steer(Towards::Hold).unwrap();
            let (driver, handle, mailbox) = driver(dir.path(), true);
            let at_rest = || async {
                assert_eq!(count(&journalled(dir.path()), "daemon.stopped"), 1, "it has nothing left to do");
                assert_eq!(handle.acknowledge(1, Asked::default()).await, Err(Refusal::ShuttingDown));
                handle.emergency_stop(Asked::default()).await;
                assert_eq!(handle.latch_emergency_stop().await, Ok(()));
                assert_eq!(count(&journalled(dir.path()), "fault.raised"), 1, "answered before it was on disk");
            };
            driver.run(mailbox, ready(departure), at_rest).await.unwrap();
            if departure == Departure::LeavesRun {
                latched_for_the_next_one(dir.path());
            } else {
                assert_eq!(bench(dir.path(), true).status().faults[0].code, fault_table::EMERGENCY_STOP.code);
            }
        }
    });
}

#[test]
fn an_emergency_stop_while_the_work_of_a_daemon_that_ends_is_stopped_aborts_the_run() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01"]);
        course::shut_down(&mut b.d, Departure::LeavesRun);
        drop(b.d.publisher.halt().stop(Asked::default()));
        requests::emergency_pressed(&mut b.d);
        b.ends(RunEnd::Cancelled).await;
        assert_eq!((b.status().state, count(&journalled(dir.path()), "run.ended")), (State::Aborted, 1));
        b.d.transition(Trigger::Joined);
        assert_eq!(b.status().state, State::Aborted);
        drop(b);
        let status = bench(dir.path(), true).status();
        assert_eq!((status.state, status.faults[0].code.as_str()), (State::Aborted, fault_table::EMERGENCY_STOP.code));
        assert_eq!(status.run.unwrap().outcome, Some(crate::api::RunOutcome::Aborted));
    });
}

/// A service manager kills a daemon that takes too long to end.
#[test]
fn a_daemon_that_is_killed_while_it_ends_its_run_has_still_ended_it() {
    on_this_thread(async {
        for (departure, ends) in [(Departure::EndsRun, true), (Departure::LeavesRun, false)] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01"]);
            course::shut_down(&mut b.d, departure);
            drop(b);
            let status = bench(dir.path(), true).status();
            let outcome = ends.then_some(crate::api::RunOutcome::Interrupted);
            assert_eq!((status.state == State::Stopped, status.run.unwrap().outcome), (ends, outcome), "{departure:?}");
        }
    });
}

/// Most events of a journal are views. A start must not look only at the newest lines.
#[test]
fn a_start_after_thousands_of_views_knows_the_plate_the_run_and_what_stands() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), true);
        requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
        assert!(!b.status().ready && b.status().not_ready_reason.unwrap().contains("handed over"), "a gripper may hold the plate");
        let overtaken = b.put_run(&plan(&["A01"])).unwrap_err();
        assert!(matches!(overtaken, Refusal::HandoffOpen { .. }), "{overtaken}");
        requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
        b.put_run(&plan(&["A01", "A02", "A03"])).unwrap();
        b.report(Progress::Ready);
        b.report(Progress::WaitingForLoader { well: "A01".into() });
        b.loaded("A01", true).unwrap();
        b.phase("A01", Phase::Load, false);
        b.phase("A01", Phase::Measure, true);
        b.done("A01");
        b.phase("A02", Phase::Position, true);
        b.d.raise(&RunError::SpecimenThread);
        b.steer(Towards::Hold).unwrap();
        for view in 0..2100 {
            b.d.event(Some("A02"), EventData::ViewTaken(ViewTaken { index: view, ..ViewTaken::default() }));
        }
        drop(b);
        let b = bench(dir.path(), true);
        let status = b.status();
        assert_eq!((status.plate.present, b.d.state().plate.inside()), (true, Some("P-1")));
        assert_eq!(status.faults.iter().map(|f| f.code.as_str()).collect::<Vec<_>>(), [fault_table::INTERNAL_ERROR.code]);
        assert!(b.d.is_held_by_operator() && b.status().plate.take_out.as_deref() == Some("A02"), "{:?}", b.status().plate);
        assert!(status.run.unwrap().eta_s.is_some(), "what A01 took is forgotten");
    });
}

#[test]
fn what_comes_with_a_step_that_the_table_lacks_is_reported_all_the_same() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        b.d.transition_with(Trigger::Recorded, |s| s.hardware.disk_free_bytes = Some(7));
        assert_eq!((b.status().state, b.status().hardware.disk_free_bytes), (State::Idle, Some(7)));
    });
}

#[test]
fn a_full_disk_is_distinguished_from_one_that_fails() {
    on_this_thread(async {
        for (kind, full) in [(std::io::ErrorKind::StorageFull, true), (std::io::ErrorKind::PermissionDenied, false)] {
            let dir = scratch();
            let mut b = bench(dir.path(), false);
            b.d.handle_write_error(Err(StoreError::Io { what: "write", path: "/data".into(), source: kind.into() }));
            let refused = b.put_run(&plan(&["A01"])).unwrap_err();
            assert!(matches!(refused, Refusal::Store { full: found, .. } if found == full), "{RUN}: {refused:?}");
        }
    });
}
