//! Results of device checks between runs.

use super::super::{Command, State};
use super::super::{checks, requests};
use super::bench::{Arm, Bench, bench, bench_of, count, instrument, journalled, on_this_thread, plan, scratch, started, started_with};
use crate::session::handle::{Accepted, Refusal, Towards};
use crate::session::search::DevicesFound;
use crate::session::worker::RunEnd;
use carved_devices::DeviceError;
use carved_devices::testing::FakeAxis;
use carved_records::{Asked, EventData, Handoff, HandoffEnd, HandoffIntent, Phase, fault_table};

fn held() -> DeviceError {
    DeviceError::Intervention { device: "rotation axis", what: "feed hold".into(), way_out: "Press cycle start" }
}

/// A device check with these results.
fn look(b: &mut Bench, rotation: Result<(), DeviceError>, wire: Option<bool>) {
    b.d.devices.instrument_mut().sampler = Box::new(Arm { wire, ..Arm::default() });
    checks::searched(&mut b.d, DevicesFound { rotation, camera: Ok(()), outputs: Vec::new() });
}

#[test]
fn somebody_who_has_the_axis_is_a_fault_once_and_until_he_lets_go() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        for _ in 0..3 {
            look(&mut b, Err(held()), None);
        }
        let status = b.status();
        assert_eq!(status.faults.len(), 1);
        assert_eq!((status.faults[0].code.as_str(), status.ready), (fault_table::ROTATION_INTERVENTION.code, false));
        assert!(matches!(b.put_run(&plan(&["A01"])), Err(Refusal::FaultStands { .. })));
        // Acknowledged while the cause lasts, the fault is raised again.
        requests::acknowledge(&mut b.d, status.faults[0].seq, Asked::default()).unwrap();
        look(&mut b, Err(held()), None);
        assert_eq!(b.status().faults.len(), 1);
        // It is not enough that the cause is over: an operator must acknowledge the fault.
        look(&mut b, Ok(()), None);
        let status = b.status();
        assert_eq!((status.faults.len(), status.ready), (1, false));
        requests::acknowledge(&mut b.d, status.faults[0].seq, Asked::default()).unwrap();
        look(&mut b, Ok(()), None);
        assert!(b.status().ready && b.status().faults.is_empty());
        assert_eq!(count(&journalled(dir.path()), "fault.raised"), 2);
    });
}

#[test]
fn a_specimen_that_no_run_asked_for_is_said_and_neither_ready_nor_removable_goes_with_it() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
        requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
        look(&mut b, Ok(()), Some(false));
        assert!(b.status().ready && b.status().plate.removable);
        for _ in 0..3 {
            look(&mut b, Ok(()), Some(true));
        }
        let status = b.status();
        assert!(!status.ready && !status.plate.removable, "{:?}", status.not_ready_reason);
        assert_eq!(status.faults.len(), 1);
        assert_eq!(status.faults[0].code, fault_table::SAMPLER_FAILED.code);
        assert!(status.faults[0].message.contains("no run asked for"), "{}", status.faults[0].message);
        assert!(matches!(b.put_run(&plan(&["A01"])), Err(Refusal::FaultStands { .. })));
        look(&mut b, Ok(()), Some(false));
        assert!(b.status().plate.removable && !b.status().ready, "somebody has to say that it is known");
        requests::acknowledge(&mut b.d, status.faults[0].seq, Asked::default()).unwrap();
        assert!(b.status().ready);
    });
}

/// It is in the capillary also after a restart, before the sensor is read again. A sampler without a sensor never reads it.
#[test]
fn a_specimen_that_no_run_asked_for_is_known_after_a_restart() {
    on_this_thread(async {
        for then in [Some(true), Some(false), None] {
            let dir = scratch();
            let mut b = bench(dir.path(), false);
            requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
            requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
            look(&mut b, Ok(()), Some(true));
            drop(b);
            let mut b = bench(dir.path(), false);
            let plate = b.status().plate;
            assert!(!plate.removable && plate.needs.is_some_and(|needs| needs.contains("no run asked for")));
            look(&mut b, Ok(()), then);
            assert_eq!((b.status().plate.removable, b.status().faults.len()), (then != Some(true), 1), "{then:?}");
            let readings = usize::from(then != Some(true)) + 1;
            assert_eq!(count(&journalled(dir.path()), "specimen.unasked"), readings, "{then:?}");
        }
    });
}

/// Lists of runs are then incomplete, and their readers must know it.
#[test]
fn an_index_that_cannot_be_written_is_shown_and_stops_nothing() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), true);
        assert_eq!(b.status().hardware.index_trouble, None);
        let other = rusqlite::Connection::open(dir.path().join("index.sqlite")).unwrap();
        other.execute_batch("ALTER TABLE events RENAME TO elsewhere").unwrap();
        b.d.event(None, EventData::StoreRegained);
        b.beat().await;
        let trouble = b.status().hardware.index_trouble.unwrap();
        assert!(trouble.contains("events") && b.status().faults.is_empty() && b.status().ready, "{trouble}");
    });
}

/// A specimen that an aborted run left inside is known, and the next run ejects it.
#[test]
fn a_specimen_that_is_known_to_be_inside_is_not_one_that_nobody_asked_for() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.phase("A01", Phase::Position, true);
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        assert_eq!(b.inside_by_status().as_deref(), Some("A01"));
        look(&mut b, Ok(()), Some(true));
        assert!(b.status().faults.is_empty() && b.status().ready);
    });
}

/// The larva is on its way, and the next run would take it for its own. The sensor does not show it yet.
#[test]
fn a_specimen_that_may_still_come_after_its_run_has_ended_keeps_the_plate_and_the_next_run() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
        requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
        b.put_run(&plan(&["A01", "A02"])).unwrap();
        b.phase("A01", Phase::Load, false);
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        for is_restarted in [false, true] {
            if is_restarted {
                drop(b);
                b = bench(dir.path(), false);
            }
            look(&mut b, Ok(()), Some(false));
            let status = b.status();
            let reason = status.not_ready_reason.unwrap();
            assert!(reason.contains("A01 and may still bring it"), "{reason}");
            assert_eq!((status.ready, status.plate.removable, status.plate.take_out.as_deref()), (false, false, Some("A01")));
            assert!(status.plate.needs.unwrap().contains("that it does not come"));
            assert_eq!(b.put("r2"), Err(Refusal::MayStillCome { run: "r1".into(), well: "A01".into() }));
        }
        assert_eq!(b.loaded("A01", false), Ok(()));
        assert!(b.status().ready && b.status().plate.removable);
    });
}

/// The plate of this run has a larva in that well too. If its well ended, the larva would be measured as that of the next well.
#[test]
fn a_report_that_the_specimen_of_an_earlier_run_is_out_ends_no_well_of_this_run() {
    on_this_thread(async {
        let dir = scratch();
        let in_order = || instrument(FakeAxis::new(), Arm::default());
        let mut b = started_with(dir.path(), in_order(), &["A01"]);
        b.phase("A01", Phase::Position, true);
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        assert_eq!(b.put("r2"), Ok(Accepted::Created));
        b.phase("A01", Phase::Eject, true);
        b.ends(RunEnd::Failed(DeviceError::Sampler { well: "A01".into(), why: "it does not leave".into() }.into())).await;
        for is_restarted in [false, true] {
            if is_restarted {
                drop(b);
                b = bench_of(dir.path(), in_order());
            }
            assert_eq!(b.inside_by_status().is_none(), is_restarted);
            let out = |answer| Command::Loaded { run: "r2".into(), well: "A01".into(), loaded: false, answer };
            assert_eq!((b.ask(out), b.ask(out)), (Ok(()), Ok(())), "a repeat changes nothing");
            let status = b.status();
            assert_eq!((status.state, status.run.unwrap().results[0].outcome), (State::Held, None));
        }
        assert_eq!(count(&journalled(dir.path()), "well.unloaded"), 1);
    });
}

/// The fault names no well, so the plate's request is the only field that says what to do.
#[test]
fn a_run_that_the_samplers_fault_holds_asks_for_an_empty_capillary_while_the_sensor_shows_a_specimen() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.phase("A01", Phase::Load, false);
        b.ends(RunEnd::Failed(DeviceError::Sampler { well: "A01".into(), why: "none was asked for".into() }.into())).await;
        look(&mut b, Ok(()), Some(true));
        assert!(b.status().plate.needs.is_some_and(|needs| needs.contains("no run asked for")));
        let faults = b.status().faults;
        assert_eq!(faults.len(), 1, "that of the load");
        requests::acknowledge(&mut b.d, faults[0].seq, Asked::default()).unwrap();
        look(&mut b, Ok(()), Some(true));
        assert!(b.status().plate.needs.is_some());
        look(&mut b, Ok(()), Some(false));
        assert_eq!((b.status().plate.needs, b.status().state), (None, State::Held));
        // In a run that an operator holds the sampler may bring the next specimen.
        look(&mut b, Ok(()), Some(true));
        assert_eq!(b.status().plate.needs, None);
    });
}

/// A check that opens a lost axis again has a new port. A stop that is written to the closed one stops nothing.
#[test]
fn the_emergency_stop_reaches_the_axis_that_a_check_has_opened_again() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        let reopened = FakeAxis::new();
        let log = reopened.log();
        b.d.devices.instrument_mut().rig.rotation = Box::new(reopened);
        b.beat().await;
        assert_eq!(log.stops(), 0);
        b.d.publisher.halt().stop(Asked::default()).await;
        assert_eq!(log.stops(), 1);
        // Pressed while a check opens the axis again, the stop goes to the old port first.
        b.d.publisher.halt().take();
        b.d.devices.begin_look();
        b.d.publisher.halt().stop(Asked::default()).await;
        requests::emergency_pressed(&mut b.d);
        let before = log.stops();
        b.task_ends().await;
        assert_eq!(log.stops(), before + 1);
        b.beat().await;
        assert_eq!(log.stops(), before + 1, "once");
    });
}
