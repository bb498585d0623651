//! A specimen that a fault of the instrument leaves in the capillary: nobody is asked to take it out or to bring it, and the run goes on
//! with it, over a restart too.

use super::super::*;
use super::bench::{Bench, bench, on_this_thread, scratch, started};
use super::loader::IN;
use crate::session::handle::{Refusal, Towards};
use crate::session::worker::{OpticsFault, Progress, RunEnd, RunError};
use carved_core::profile::ProfileError;
use carved_devices::DeviceError;
use carved_records::{Phase, fault_table};

fn dark() -> RunError {
    let fault = OpticsFault::Light(ProfileError::Black { brightest: 9, needed: 30 });
    RunError::Optics { well: "A02".into(), fault }
}

fn hand() -> RunError {
    RunError::Device(DeviceError::Intervention { device: "rotation axis", what: "feed hold".into(), way_out: "Release it." })
}

/// A01 is measured; A02 is inside and under way when `error` ends the worker.
async fn held(b: &mut Bench, error: RunError) {
    for well in ["A01", "A02"] {
        if b.d.loaded_from_outside {
            b.asks_for(well);
            b.loaded(well, true).unwrap();
        } else {
            b.phase(well, Phase::Load, false);
        }
        b.phase(well, Phase::Position, true);
        if well == "A01" {
            b.phase(well, Phase::Eject, true);
            if !b.d.loaded_from_outside {
                b.phase(well, Phase::Wash, false);
            }
            b.done(well);
        }
    }
    b.ends(RunEnd::Failed(error)).await;
}

fn is_kept(b: &Bench, when: &str) {
    let status = b.status();
    assert_eq!((status.state, b.inside_by_status().as_deref(), b.needs()), (State::Held, Some("A02"), String::new()), "{when}");
    assert!(!status.ready && !status.plate.removable, "{when}");
    let run = status.run.unwrap();
    assert_eq!((run.wells.pending, run.wells.failed, run.goes_on_by_itself), (1, 0, false), "{when}");
    let active = b.d.active.as_ref().unwrap();
    assert_eq!((&active.take_out, &active.eject_first), (&None, &None), "{when}");
}

#[test]
fn what_the_instrument_could_not_see_stays_inside_and_the_run_goes_on_with_it() {
    on_this_thread(async {
        for outside in [true, false] {
            for (crash, error, code) in [
                (false, dark as fn() -> RunError, fault_table::PICTURE_LIGHT.code),
                (true, dark, fault_table::PICTURE_LIGHT.code),
                (false, hand, fault_table::ROTATION_INTERVENTION.code),
            ] {
                let (dir, when) = (scratch(), format!("a loader: {outside}, a crash: {crash}, {code}"));
                let mut b = started(dir.path(), outside, &["A01", "A02"]);
                held(&mut b, error()).await;
                if crash {
                    drop(b);
                    b = bench(dir.path(), outside);
                }
                is_kept(&b, &when);
                let fault = b.status().faults[0].clone();
                assert_eq!((fault.code.as_str(), fault.operator_required), (code, true), "{when}");
                assert!(matches!(b.steer(Towards::Unhold), Err(Refusal::FaultStands { .. })), "{when}");
                b.d.acknowledge(fault.seq).unwrap();
                is_kept(&b, &when);
                b.steer(Towards::Unhold).unwrap();
                assert!(b.works(), "{when}: {:?}", b.status().state);
                b.tell(Progress::Ready);
                if outside {
                    b.asks_for("A02");
                    assert!(b.d.gate.has_loaded("A02"), "{when}: the worker waits for a word that was said");
                } else {
                    b.phase("A02", Phase::Load, false);
                }
                assert_eq!((b.status().state, b.inside_by_status().as_deref()), (State::Execute, Some("A02")), "{when}");
                assert_eq!(b.needs(), "", "{when}");
                // A crash of the run that goes on loses its place as any other.
                b.phase("A02", Phase::Position, true);
                drop(b);
                let b = bench(dir.path(), outside);
                let active = b.d.active.as_ref().unwrap();
                let taken_out = if outside { active.take_out.as_deref() } else { b.d.capillary().inside() };
                assert_eq!(taken_out, Some("A02"), "{when}");
            }
        }
    });
}

/// A person takes it out by hand while the run is held, and says so: it is brought again.
#[test]
fn a_kept_specimen_that_is_said_to_be_out_is_brought_again() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        held(&mut b, dark()).await;
        assert_eq!((b.loaded("A02", true), b.loaded("A02", false)), (Ok(()), Ok(())));
        assert_eq!(b.inside_by_status(), None);
        let seq = b.status().faults[0].seq;
        b.d.acknowledge(seq).unwrap();
        b.steer(Towards::Unhold).unwrap();
        b.tell(Progress::Ready);
        b.asks_for("A02");
        assert_eq!((b.status().state, b.needs()), (State::Suspended, IN[1].to_owned()));
    });
}

/// The run is ended instead: the larva is inside still, and known to be.
#[test]
fn a_kept_specimen_is_not_forgotten_with_its_run() {
    on_this_thread(async {
        for outside in [true, false] {
            let dir = scratch();
            let mut b = started(dir.path(), outside, &["A01", "A02"]);
            held(&mut b, dark()).await;
            b.steer(Towards::Stop).unwrap();
            assert_eq!((b.status().state, b.inside_by_status().as_deref()), (State::Stopped, Some("A02")));
            assert_eq!(b.needs().is_empty(), !outside, "{}", b.needs());
            assert!(!b.status().plate.removable);
            drop(b);
            let mut b = bench(dir.path(), outside);
            assert_eq!(b.inside_by_status().as_deref(), Some("A02"), "after a restart");
            let seq = b.status().faults[0].seq;
            b.d.acknowledge(seq).unwrap();
            if !outside {
                b.put("r2").unwrap();
                b.tell(Progress::Ready);
                // The larva inside is not used as the new plate's A02.
                assert_eq!((b.d.capillary().inside(), b.d.capillary().brought()), (Some("A02"), None));
            }
        }
    });
}
