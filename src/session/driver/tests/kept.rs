//! A fault of the instrument leaves a specimen in the capillary. Nobody has to take it out or bring it again. The run continues with it,
//! also after a restart.

use super::super::*;
use super::bench::{Arm, Bench, RUN, bench, instrument, journalled, on_this_thread, scratch, started, started_with};
use super::loader::{IN, out};
use crate::api::SpecimenOutcome;
use crate::session::handle::{Refusal, Towards};
use crate::session::worker::{OpticsFault, Progress, RunEnd, RunError};
use carved_core::profile::ProfileError;
use carved_devices::DeviceError;
use carved_devices::testing::{FakeAxis, FakeCamera};
use carved_records::{Asked, EventData, Interrupted, Phase, fault_table};
use carved_store::RecordingWriter;
use carved_store::testing::recording as a_recording;
use std::sync::Arc;

fn dark() -> RunError {
    let fault = OpticsFault::Light(ProfileError::Black { brightest: 9, needed: 30 });
    RunError::Optics { well: "A02".into(), fault }
}

fn hand() -> RunError {
    RunError::Device(DeviceError::Intervention { device: "rotation axis", what: "feed hold".into(), way_out: "Release it." })
}

/// A01 is measured. A02 is inside and in progress when `error` ends the worker.
async fn held(b: &mut Bench, error: RunError) {
    for well in ["A01", "A02"] {
        if b.d.loader.fills_capillary() {
            b.asks_for(well);
            b.loaded(well, true).unwrap();
        } else {
            b.phase(well, Phase::Load, false);
        }
        b.phase(well, Phase::Position, true);
        if well == "A01" {
            b.phase(well, Phase::Eject, true);
            if !b.d.loader.fills_capillary() {
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
    assert_eq!(b.d.must_leave_first(), None, "{when}");
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
                requests::acknowledge(&mut b.d, fault.seq, Asked::default()).unwrap();
                is_kept(&b, &when);
                b.steer(Towards::Unhold).unwrap();
                assert!(b.works(), "{when}: {:?}", b.status().state);
                b.report(Progress::Ready);
                if outside {
                    b.asks_for("A02");
                    assert!(b.d.loader.interlock().has_loaded("A02"), "{when}: the worker waits for a word that was said");
                } else {
                    b.phase("A02", Phase::Load, false);
                }
                assert_eq!((b.status().state, b.inside_by_status().as_deref()), (State::Execute, Some("A02")), "{when}");
                assert_eq!(b.needs(), "", "{when}");
                // If the continued run crashes, the specimen loses its pose like any other.
                b.phase("A02", Phase::Position, true);
                drop(b);
                let b = bench(dir.path(), outside);
                assert_eq!(b.d.must_leave_first(), Some("A02"), "{when}");
            }
        }
    });
}

/// A person takes it out by hand while the run is held, and reports it. It is brought again.
#[test]
fn a_kept_specimen_that_is_said_to_be_out_is_brought_again() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        held(&mut b, dark()).await;
        assert_eq!((b.loaded("A02", true), b.loaded("A02", false)), (Ok(()), Ok(())));
        assert_eq!(b.inside_by_status(), None);
        let seq = b.status().faults[0].seq;
        requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
        b.steer(Towards::Unhold).unwrap();
        b.report(Progress::Ready);
        b.asks_for("A02");
        assert_eq!((b.status().state, b.needs()), (State::Suspended, IN[1].to_owned()));
    });
}

/// The run is ended instead. The larva is still inside, and the driver knows it.
#[test]
fn a_kept_specimen_is_not_forgotten_with_its_run() {
    on_this_thread(async {
        for outside in [true, false] {
            let dir = scratch();
            let mut b = started(dir.path(), outside, &["A01", "A02"]);
            held(&mut b, dark()).await;
            b.steer(Towards::Stop).unwrap();
            assert_eq!((b.status().state, b.inside_by_status().as_deref()), (State::Stopped, Some("A02")));
            assert!(b.needs().contains("A02"), "{}", b.needs());
            assert!(!b.status().plate.removable);
            drop(b);
            let mut b = bench(dir.path(), outside);
            assert_eq!(b.inside_by_status().as_deref(), Some("A02"), "after a restart");
            let seq = b.status().faults[0].seq;
            requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            if !outside {
                let ejected = Arc::default();
                let sampler = Arm { brings_again: true, ejected: Arc::clone(&ejected), ..Arm::default() };
                let mut with_camera = instrument(FakeAxis::new(), sampler);
                with_camera.rig.camera = Box::new(FakeCamera::default());
                b.d.devices.give_back(with_camera);
                b.put("r2").unwrap();
                b.report(Progress::Ready);
                // The larva inside is not used as A02 of the new plate. It is ejected first.
                assert_eq!((b.d.specimens().inside(), b.d.specimens().continued_with()), (Some("A02"), None));
                b.ends(RunEnd::Paused).await;
                assert_eq!(*ejected.lock().unwrap(), ["A02"]);
            }
        }
    });
}

impl Bench {
    /// The recording that a worker leaves open when it ends in the well `at`.
    fn has_recorded(&self, at: usize) {
        let record = self.d.run.as_ref().unwrap().record();
        let planned = &record.plan.plate_map[at];
        let folder = self.d.outbox.store().run_folder(RUN).join(&planned.well);
        drop(RecordingWriter::create(&folder, a_recording(RUN, planned), None).unwrap());
    }

    fn is_sealed(&self, well: &str) -> bool {
        self.d.outbox.store().run_folder(RUN).join(well).join("SHA256SUMS").is_file()
    }

    /// The outcomes in the status, which must equal those in `run.json`.
    fn outcomes(&self) -> Vec<Option<SpecimenOutcome>> {
        let shown: Vec<_> = self.status().run.unwrap().results.iter().map(|well| well.outcome).collect();
        let stored = self.d.outbox.store().run(RUN).unwrap().unwrap();
        assert_eq!(shown, stored.wells.iter().map(|well| well.outcome).collect::<Vec<_>>());
        shown
    }

    fn goes_on(&mut self) {
        let seq = self.status().faults[0].seq;
        requests::acknowledge(&mut self.d, seq, Asked::default()).unwrap();
        self.steer(Towards::Unhold).unwrap();
    }

    fn skips_interrupted(&mut self) {
        self.d.run.as_mut().unwrap().record_mut().method.policy.interrupted = Interrupted::Skip;
    }

    /// For each interruption of the specimen of A02: whether it was kept.
    fn interruptions(&self) -> Vec<bool> {
        let events = journalled(&self.d.outbox.store().run_folder(RUN));
        let of_a02 = events.into_iter().filter(|e| e.body.well.as_deref() == Some("A02"));
        let kept = of_a02.filter_map(|e| match e.body.data {
            EventData::SpecimenInterrupted(interrupted) => Some(interrupted.kept),
            _ => None,
        });
        kept.collect()
    }
}

/// The specimen of A02 must be taken out by the loader or the sampler. Then the run continues.
fn goes_on_once_it_is_out(b: &mut Bench, outside: bool) {
    assert_eq!(b.d.must_leave_first(), Some("A02"), "a loader: {outside}");
    b.goes_on();
    if outside {
        assert_eq!(b.needs(), out("A02"));
        b.loaded("A02", false).unwrap();
    }
    assert!(b.works(), "a loader: {outside}, {:?}", b.status().state);
    b.report(Progress::Ready);
}

const SUCCEEDED: Option<SpecimenOutcome> = Some(SpecimenOutcome::Succeeded);
const INTERRUPTED: Option<SpecimenOutcome> = Some(SpecimenOutcome::Interrupted);

/// Such a sampler brings the next larva of its plate. That larva would be measured under the name of the missing one.
#[test]
fn a_kept_specimen_that_is_out_ends_its_well_where_the_sampler_brings_none_twice() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started_with(dir.path(), instrument(FakeAxis::new(), Arm::default()), &["A01", "A02", "A03"]);
        b.has_recorded(1);
        held(&mut b, dark()).await;
        assert_eq!((b.inside_by_status().as_deref(), b.outcomes()), (Some("A02"), vec![SUCCEEDED, None, None]));
        b.loaded("A02", false).unwrap();
        assert_eq!((b.inside_by_status(), b.outcomes()), (None, vec![SUCCEEDED, INTERRUPTED, None]));
        let why = b.status().run.unwrap().results[1].reason.clone().unwrap();
        assert!(why.contains("cannot bring it again"), "{why}");
        assert!(b.is_sealed("A02"));
        assert_eq!(b.interruptions(), [true, false]);
        b.goes_on();
        assert!(b.works(), "{:?}", b.status().state);
        b.report(Progress::Ready);
        b.phase("A03", Phase::Load, false);
        assert_eq!((b.d.specimens().continued_with(), b.status().run.unwrap().wells.pending), (None, 1));
        b.phase("A03", Phase::Position, true);
        b.done("A03");
        b.ends(RunEnd::AllWells).await;
        assert_eq!(b.outcomes(), [SUCCEEDED, INTERRUPTED, SUCCEEDED]);
    });
}

#[test]
fn a_specimen_whose_pose_is_lost_is_given_up_where_the_policy_skips_it_and_the_run_goes_on_with_the_next() {
    on_this_thread(async {
        for outside in [true, false] {
            let dir = scratch();
            let mut b = started(dir.path(), outside, &["A01", "A02", "A03"]);
            b.skips_interrupted();
            b.has_recorded(1);
            held(&mut b, RunError::SpecimenThread).await;
            assert_eq!(b.outcomes(), [SUCCEEDED, INTERRUPTED, None], "a loader: {outside}");
            assert!(b.is_sealed("A02"));
            assert_eq!(b.interruptions(), [false]);
            goes_on_once_it_is_out(&mut b, outside);
            if outside {
                b.asks_for("A03");
                assert_eq!(b.needs(), IN[2]);
            } else {
                b.phase("A02", Phase::Eject, true);
                b.phase("A02", Phase::Wash, false);
                b.phase("A03", Phase::Load, false);
            }
            assert_eq!(b.outcomes(), [SUCCEEDED, INTERRUPTED, None], "a loader: {outside}");
        }
    });
}

/// The instrument caused the interruption, so no policy gives the specimen up. A stock VAST cannot take up a specimen twice, so it cannot
/// stay.
#[test]
fn what_a_rig_that_steps_through_a_list_could_not_see_is_brought_again_whatever_the_policy_says() {
    on_this_thread(async {
        for outside in [true, false] {
            let dir = scratch();
            let axis = FakeAxis::new().trigger_only();
            let sampler = Arm { waits: outside, brings_again: true, ..Arm::default() };
            let mut b = started_with(dir.path(), instrument(axis, sampler), &["A01", "A02"]);
            b.skips_interrupted();
            held(&mut b, dark()).await;
            assert_eq!(b.outcomes(), [SUCCEEDED, None], "a loader: {outside}");
            assert_eq!((b.interruptions(), b.d.specimens().continued_with()), (vec![false], None), "a loader: {outside}");
            goes_on_once_it_is_out(&mut b, outside);
            if outside {
                b.asks_for("A02");
                assert_eq!((b.status().state, b.needs()), (State::Suspended, IN[1].to_owned()));
                b.loaded("A02", true).unwrap();
            } else {
                b.phase("A02", Phase::Eject, true);
                b.phase("A02", Phase::Wash, false);
                b.phase("A02", Phase::Load, false);
            }
            b.phase("A02", Phase::Position, true);
            b.done("A02");
            assert_eq!(b.outcomes(), [SUCCEEDED, SUCCEEDED], "a loader: {outside}");
        }
    });
}
