//! Loader messages that cross a hold, the end of the run or a crash, and loader messages that are invalid.

use super::super::*;
use super::bench::{Bench, RUN, bench, count, journalled, on_this_thread, scratch, started};
use super::loader::{IN, out};
use crate::session::handle::{Accepted, Refusal, Towards};
use crate::session::worker::{Progress, RunEnd};
use carved_devices::DeviceError;
use carved_devices::testing::FakeAxis;
use carved_records::{EventData, Handoff, HandoffEnd, HandoffIntent, Phase, ViewTaken, WellLoaded, kind};

/// A driven sampler was about to bring it when the daemon crashed. It may be inside, and a person has checked.
#[test]
fn out_is_out_also_when_it_is_said_again_of_one_that_was_only_about_to_be_brought() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01", "A02"]);
        b.phase("A01", Phase::Load, false);
        drop(b);
        let mut b = bench(dir.path(), false);
        assert_eq!([b.loaded("A01", false), b.loaded("A01", false)], [Ok(()), Ok(())]);
        drop(b);
        assert_eq!(bench(dir.path(), false).loaded("A01", false), Ok(()), "and after a restart");
    });
}

/// The loader and an operator's abort do not know of each other. The larva is where the loader reports it, whatever has ended.
#[test]
fn a_specimen_that_comes_just_after_the_end_of_its_run_is_known_to_be_inside() {
    on_this_thread(async {
        for (towards, end, state) in [(Towards::Abort, RunEnd::Cancelled, State::Aborted), (Towards::Stop, RunEnd::Paused, State::Stopped)]
        {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01", "A02"]);
            b.asks_for("A01");
            b.steer(towards).unwrap();
            b.ends(end).await;
            assert!(b.status().ready && b.status().plate.removable, "{:?}", b.status().not_ready_reason);
            assert!(matches!(b.loaded("A02", true), Err(Refusal::RunEnded { .. })), "nobody asked for it");
            assert!(matches!(b.loaded("A02", false), Err(Refusal::UnexpectedWell { .. })), "it never was inside");
            let inside = |b: &Bench| {
                let status = b.status();
                assert_eq!((status.state, b.inside_by_status().as_deref(), b.needs()), (state, Some("A01"), out("A01")));
                assert!(!status.ready && !status.plate.removable);
                let why = status.not_ready_reason.unwrap();
                assert!(why.contains("A01") && why.contains("take it out") && status.doing.contains("A01"), "{why}, {}", status.doing);
            };
            assert_eq!((b.loaded("A01", true), b.loaded("A01", true)), (Ok(()), Ok(())));
            inside(&b);
            drop(b);
            let mut b = bench(dir.path(), true);
            inside(&b);
            assert_eq!(b.put("r2"), Err(Refusal::CapillaryFull { run: RUN.into(), well: "A01".into() }));
            assert_eq!((b.loaded("A01", true), b.loaded("A01", false), b.loaded("A01", false)), (Ok(()), Ok(()), Ok(())));
            assert!(b.status().ready && b.status().plate.removable);
            assert!(matches!(b.loaded("A01", true), Err(Refusal::RunEnded { .. })), "it was asked for once");
            drop(b);
            let mut b = bench(dir.path(), true);
            assert!(b.status().ready && matches!(b.loaded("A01", true), Err(Refusal::RunEnded { .. })));
            assert_eq!(b.loaded("A01", false), Ok(()), "said again, over the restart");
            assert!(matches!(b.put("r2"), Ok(Accepted::Created)));
            assert!(matches!(b.loaded("A01", true), Err(Refusal::UnknownRun { .. })), "of a run before the newest");
        }
    });
}

/// The previous specimen is known to be inside. The loader must report both.
#[test]
fn a_late_specimen_is_not_taken_on_top_of_another() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        b.asks_for("A01");
        b.measures("A01");
        b.asks_for("A02");
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        assert_eq!(b.loaded("A02", true), Err(Refusal::CapillaryFull { run: RUN.into(), well: "A01".into() }));
        assert_eq!((b.loaded("A01", false), b.loaded("A02", true)), (Ok(()), Ok(())));
        assert_eq!((b.inside_by_status().as_deref(), b.needs()), (Some("A02"), out("A02")));
    });
}

/// A plate was taken away before the loader's late message. A start does not show it again.
#[test]
fn a_late_word_does_not_bring_a_plate_back() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01"]);
        b.asks_for("A01");
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Unload, barcode: "P-1".into() }).unwrap();
        requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
        b.loaded("A01", true).unwrap();
        // A start reads the newest 2000 events for its readers. The plate was taken away before them.
        for index in 0..2100 {
            b.d.event(None, EventData::ViewTaken(ViewTaken { index, ..ViewTaken::default() }));
        }
        drop(b);
        let b = bench(dir.path(), true);
        assert!(b.status().plate.barcode.is_none() && b.inside_by_status().as_deref() == Some("A01"));
    });
}

/// Put in before the loader saw the hold: it stays, also after a crash, and the run continues with it without a new request.
#[test]
fn what_the_loader_brings_after_a_hold_is_used_when_the_run_goes_on() {
    on_this_thread(async {
        // Before the run is held, while it is held, and while it is held with a crash afterwards.
        for (at_rest, crash) in [(false, false), (true, false), (true, true)] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01", "A02"]);
            b.asks_for("A01");
            b.steer(Towards::Hold).unwrap();
            if at_rest {
                b.ends(RunEnd::Paused).await;
            }
            assert!(matches!(b.loaded("A02", true), Err(Refusal::UnexpectedWell { .. })));
            assert_eq!((b.loaded("A01", true), b.loaded("A01", true)), (Ok(()), Ok(())));
            if !at_rest {
                b.ends(RunEnd::Paused).await;
            }
            if crash {
                drop(b);
                b = bench(dir.path(), true);
            }
            let status = b.status();
            assert_eq!(
                (status.state, b.inside_by_status().as_deref(), b.needs()),
                (State::Held, Some("A01"), String::new()),
                "{at_rest}, {crash}"
            );
            assert!(!status.ready && !status.plate.removable);
            b.steer(Towards::Unhold).unwrap();
            assert!(b.works(), "{:?}", b.status().state);
            b.report(Progress::Ready);
            b.asks_for("A01");
            assert_eq!((b.status().state, b.inside_by_status().as_deref(), b.needs()), (State::Execute, Some("A01"), String::new()));
            assert!(b.d.loader.interlock().has_loaded("A01"), "the worker waits for a word that was said");
            b.phase("A01", Phase::Eject, true);
            b.done("A01");
            b.asks_for("A02");
            assert_eq!((b.status().state, b.needs()), (State::Suspended, format!("{}, then {}", out("A01"), IN[1])));
            assert_eq!(count(&journalled(dir.path()), kind::WELL_LOADED), 1);
        }
    });
}

/// Taken out again during the hold, it is requested when the run continues.
#[test]
fn what_was_brought_after_a_hold_may_be_taken_out_again() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01"]);
        b.asks_for("A01");
        b.steer(Towards::Hold).unwrap();
        b.ends(RunEnd::Paused).await;
        assert_eq!((b.loaded("A01", true), b.loaded("A01", false)), (Ok(()), Ok(())));
        b.steer(Towards::Unhold).unwrap();
        b.report(Progress::Ready);
        b.asks_for("A01");
        assert_eq!((b.status().state, b.needs()), (State::Suspended, IN[0].to_owned()));
    });
}

/// A repeated message is accepted. An impossible message is refused, and the refusal names the expected one.
#[test]
fn words_that_mean_nothing_are_refused_with_what_to_say() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02", "A03"]);
        let unexpected = |b: &mut Bench, well: &str, loaded: bool, says: &str| {
            let refused = b.loaded(well, loaded).unwrap_err();
            let said = refused.to_string();
            assert!(matches!(refused, Refusal::UnexpectedWell { .. }) && said.contains(says), "{well} {loaded}: {said}");
        };
        b.asks_for("A01");
        unexpected(&mut b, "A01", false, "wells/A01 {\"loaded\": true}");
        unexpected(&mut b, "H12", false, "wells/A01 {\"loaded\": true}");
        unexpected(&mut b, "H12", true, "H12 is not in this run; ");
        unexpected(&mut b, "A1", true, "A1 is not a well, write A01; ");
        unexpected(&mut b, "A02", true, "wells/A01 {\"loaded\": true}");
        b.loaded("A01", true).unwrap();
        b.phase("A01", Phase::Position, true);
        assert_eq!(b.loaded("A01", true), Ok(()), "said again");
        unexpected(&mut b, "A01", false, "A01 is in the capillary");
        unexpected(&mut b, "A02", true, "A01 is in the capillary");
        b.phase("A01", Phase::Eject, true);
        b.done("A01");
        b.asks_for("A02");
        let full = Err(Refusal::CapillaryFull { run: RUN.into(), well: "A01".into() });
        assert_eq!(b.loaded("A01", true), full, "it is to be taken out");
        unexpected(&mut b, "A03", true, "A02");
        b.loaded("A02", true).unwrap();
        b.phase("A02", Phase::Revolve, true);
        drop(b);
        let mut b = bench(dir.path(), true);
        assert_eq!((b.status().state, b.needs()), (State::Suspended, out("A02")));
        let full = Refusal::CapillaryFull { run: RUN.into(), well: "A02".into() };
        assert!(full.to_string().contains("PUT /v1/runs/r1/wells/A02 {\"loaded\": false}"), "{full}");
        for well in ["A02", "A03", "A01"] {
            assert_eq!(b.loaded(well, true), Err(full.clone()), "{well}: nobody was asked for it since");
        }
        unexpected(&mut b, "A03", false, "wells/A02 {\"loaded\": false}");
        assert_eq!((b.loaded("A01", false), b.loaded("A02", false), b.loaded("A02", false)), (Ok(()), Ok(()), Ok(())));
    });
}

/// The journal contains the request to exchange both specimens. The loader may do so after a crash of the daemon.
#[test]
fn an_exchange_that_was_asked_for_is_taken_after_a_crash() {
    on_this_thread(async {
        for held in [false, true] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01", "A02"]);
            b.asks_for("A01");
            b.measures("A01");
            b.asks_for("A02");
            if held {
                b.steer(Towards::Hold).unwrap();
            }
            drop(b);
            let mut b = bench(dir.path(), true);
            let state = if held { State::Held } else { State::Suspended };
            assert_eq!((b.status().state, b.needs()), (state, out("A01")));
            assert_eq!(b.loaded("A02", true), Ok(()));
            let loaded = journalled(dir.path()).into_iter().rfind(|e| e.body.data.kind() == kind::WELL_LOADED).unwrap();
            let expected = EventData::WellLoaded(WellLoaded { in_place_of: Some("A01".into()) });
            assert_eq!((loaded.body.well.as_deref(), loaded.body.data), (Some("A02"), expected));
            if held {
                assert_eq!((b.status().state, b.needs()), (State::Held, String::new()));
                b.steer(Towards::Unhold).unwrap();
            }
            assert!(b.works(), "{:?}", b.status().state);
            b.report(Progress::Ready);
            b.asks_for("A02");
            assert_eq!((b.status().state, b.inside_by_status().as_deref(), b.needs()), (State::Execute, Some("A02"), String::new()));
            assert_eq!(b.loaded("A01", false), Ok(()), "it is out already");
        }
    });
}

/// The axis driver reports it once, between runs.
#[test]
fn what_a_person_did_at_the_axis_is_a_fault_until_it_is_acknowledged() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), true);
        let what = "the controller reports NC: the axis was turned with the controller's knob".into();
        let by_hand = DeviceError::Intervention { device: "axis", what, way_out: "Let go of the axis" };
        let mut once = Some(by_hand);
        let axis = FakeAxis::new().answering(move || once.take().map_or(Ok(()), Err));
        b.d.devices.instrument_mut().rig.rotation = Box::new(axis);
        for _ in 0..2 {
            b.beat().await;
            let status = b.status();
            let codes: Vec<_> = status.faults.iter().map(|fault| fault.code.as_str()).collect();
            assert_eq!((codes, status.ready, status.hardware.rotation.connected), (vec!["rotation_intervention"], false, true));
        }
        let seq = b.status().faults[0].seq;
        b.ask(|answer| Command::Acknowledge { seq, asked: carved_records::Asked::default(), answer }).unwrap();
        b.beat().await;
        assert!(b.status().faults.is_empty() && b.status().ready, "{:?}", b.status().not_ready_reason);
    });
}
