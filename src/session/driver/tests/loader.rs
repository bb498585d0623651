//! The content of the capillary, the requests to the loader, the causes of a hold and the readiness, as loader and operator see them.

use super::super::*;
use super::bench::{Arm, Bench, RUN, bench, bench_of, count, instrument, journalled, on_this_thread, plan, scratch, started, started_with};
use crate::api::{NextCommand, RunOutcome, SpecimenOutcome};
use crate::session::handle::{Accepted, Refusal, Towards};
use crate::session::search::DevicesFound;
use crate::session::worker::{Progress, RunEnd, RunError};
use carved_devices::DeviceError;
use carved_devices::testing::FakeAxis;
use carved_records::{Asked, EventData, Handoff, HandoffEnd, HandoffIntent, Phase, WellLoaded, fault_table, kind};
use carved_store::StoreError;
use carved_store::testing::trace as disk_trace;
use std::path::PathBuf;
use tokio::sync::oneshot;

pub(super) const IN: [&str; 3] =
    ["the specimen of well A01 in the capillary", "the specimen of well A02 in the capillary", "the specimen of well A03 in the capillary"];

pub(super) fn out(well: &str) -> String {
    format!("the specimen of well {well} to be taken out of the capillary")
}

impl Bench {
    pub(super) fn needs(&self) -> String {
        self.status().plate.needs.unwrap_or_default()
    }

    /// The requests as wells: the specimen to take out, the specimen to bring.
    fn wanted(&self) -> [Option<String>; 2] {
        let plate = self.status().plate;
        [plate.take_out, plate.bring]
    }

    pub(super) fn asks_for(&mut self, well: &str) {
        self.phase(well, Phase::Load, false);
        self.report(Progress::WaitingForLoader { well: well.into() });
    }

    pub(super) fn measures(&mut self, well: &str) {
        self.loaded(well, true).unwrap();
        self.phase(well, Phase::Eject, true);
        self.done(well);
    }

    pub(super) fn put(&mut self, run: &str) -> Result<Accepted, Refusal> {
        self.ask(|answer| Command::PutRun { id: run.into(), plan: plan(&["A01"]), answer })
    }

    pub(super) fn inside_by_status(&self) -> Option<String> {
        self.status().specimen.filter(|s| s.in_capillary).map(|s| s.well)
    }
}

/// Only the loader knows when a specimen is out. While the next one is awaited, the previous one may still be inside.
#[test]
fn a_specimen_is_inside_until_the_loader_says_otherwise_or_brings_the_next() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02", "A03"]);
        b.asks_for("A01");
        assert_eq!(b.needs(), IN[0]);
        assert_eq!(b.wanted(), [None, Some("A01".into())]);
        b.measures("A01");
        b.asks_for("A02");
        assert_eq!(b.needs(), format!("{}, then {}", out("A01"), IN[1]));
        assert_eq!(b.wanted(), ["A01", "A02"].map(|well| Some(well.into())));
        drop(b);

        let mut b = bench(dir.path(), true);
        assert_eq!((b.status().state, b.needs()), (State::Suspended, out("A01")), "a crash does not take it out");
        assert_eq!(b.wanted(), [Some("A01".into()), None]);
        b.loaded("A01", false).unwrap();
        b.report(Progress::Ready);
        b.asks_for("A02");
        assert_eq!(b.needs(), IN[1]);
        b.measures("A02");
        b.asks_for("A03");
        // The loader exchanges both at once.
        b.loaded("A03", true).unwrap();
        let loaded = journalled(dir.path()).into_iter().rfind(|e| e.body.data.kind() == kind::WELL_LOADED).unwrap();
        assert_eq!(loaded.body.data, EventData::WellLoaded(WellLoaded { in_place_of: Some("A02".into()) }));
        assert_eq!(b.loaded("A02", false), Ok(()), "it is out already");
        assert_eq!(b.inside_by_status().as_deref(), Some("A03"));

        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        let left = |b: &Bench| {
            let status = b.status();
            assert_eq!((status.state, status.run.unwrap().outcome), (State::Aborted, Some(RunOutcome::Aborted)));
            assert_eq!((b.inside_by_status().as_deref(), b.needs()), (Some("A03"), out("A03")));
            assert!(!status.ready && !status.plate.removable);
        };
        left(&b);
        drop(b);
        let mut b = bench(dir.path(), true);
        left(&b);
        assert_eq!(b.put("r2"), Err(Refusal::CapillaryFull { run: RUN.into(), well: "A03".into() }));
        assert_eq!((b.loaded("A03", false), b.loaded("A03", false)), (Ok(()), Ok(())));
        drop(b);
        let status = bench(dir.path(), true).status();
        assert!(status.ready && status.plate.removable && status.run.is_some_and(|r| r.outcome.is_some()), "{:?}", status.not_ready_reason);
    });
}

/// The run ends while the next specimen is awaited. The previous one is still inside.
#[test]
fn a_run_that_ends_while_the_next_is_awaited_leaves_the_one_before() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), true, &["A01", "A02"]);
        b.asks_for("A01");
        b.measures("A01");
        b.asks_for("A02");
        b.steer(Towards::Stop).unwrap();
        b.ends(RunEnd::Paused).await;
        assert_eq!((b.status().state, b.inside_by_status().as_deref(), b.needs()), (State::Stopped, Some("A01"), out("A01")));
        assert!(!b.status().plate.removable);
        drop(b);
        assert_eq!(bench(dir.path(), true).status().state, State::Stopped);
    });
}

/// The next run ejects it first, also after restarts. Until then somebody has to take it out before the plate is taken.
#[test]
fn what_an_aborted_run_left_is_ejected_by_the_next_where_a_sampler_is_driven() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.phase("A01", Phase::Eject, true);
        b.steer(Towards::Abort).unwrap();
        b.ends(RunEnd::Cancelled).await;
        for restarted in [false, true] {
            let status = b.status();
            assert!(status.ready && !status.plate.removable, "{restarted}: {:?}", status.not_ready_reason);
            assert_eq!((status.plate.take_out, status.plate.needs), (Some("A01".into()), Some(out("A01"))), "{restarted}");
            assert_eq!(b.inside_by_status().as_deref(), Some("A01"));
            drop(b);
            b = bench(dir.path(), false);
        }
        assert_eq!(b.put("r2"), Ok(Accepted::Created));
        drop(b);
        let mut b = bench(dir.path(), false);
        assert_eq!((b.d.specimens().inside(), b.works()), (Some("A01"), true), "a crash before it was ejected");
        b.phase("A01", Phase::Wash, false);
        assert_eq!(b.d.specimens().inside(), None);
    });
}

/// In both orders: an operator's hold, and a fault that ends by itself.
#[test]
fn what_an_operator_holds_does_not_go_on_by_itself() {
    on_this_thread(async {
        for (before, after, held) in [(false, false, false), (true, false, true), (false, true, true)] {
            let dir = scratch();
            let mut b = started(dir.path(), true, &["A01"]);
            b.asks_for("A01");
            b.loaded("A01", true).unwrap();
            b.phase("A01", Phase::Position, true);
            if before {
                b.steer(Towards::Hold).unwrap();
            }
            b.ends(RunEnd::Failed(DeviceError::ControlLost.into())).await;
            if after {
                assert_eq!((b.steer(Towards::Hold), b.steer(Towards::Hold)), (Ok(()), Ok(())));
            }
            assert_eq!((b.status().state, b.status().run.unwrap().held_by_operator), (State::Held, held));
            checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
            let expected = if held { State::Held } else { State::Suspended };
            assert_eq!((b.status().state, b.status().faults.len()), (expected, 0), "before {before}, after {after}");
            if held {
                b.steer(Towards::Unhold).unwrap();
                assert_eq!((b.status().state, b.status().run.unwrap().held_by_operator), (State::Suspended, false));
            }
        }
    });
}

/// The device check has the instrument at the moment when the disk accepts writes again.
#[test]
fn a_run_that_may_go_on_does_so_when_the_errand_is_done() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.ends(RunEnd::Failed(RunError::Store(StoreError::Vanished { path: PathBuf::from("a disk") }))).await;
        checks::look(&mut b.d);
        checks::try_the_store(&mut b.d);
        let status = b.status();
        assert_eq!((status.state, status.faults.len(), b.d.state().run.as_ref().unwrap().resumed_by_itself()), (State::Held, 0, 0));
        b.task_ends().await;
        assert!(b.works() && b.status().state == State::Unholding, "{:?}", b.status().state);
        assert_eq!(b.d.state().run.as_ref().unwrap().resumed_by_itself(), 1);
    });
}

/// `ready` agrees with the answer to a run.
#[test]
fn what_is_ready_takes_a_run() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = bench(dir.path(), false);
        assert!(b.status().ready);
        let (answer, _answered) = oneshot::channel();
        requests::preflight(&mut b.d, plan(&["A01"]), answer);
        assert!(b.status().not_ready_reason.is_some_and(|why| why.contains("being checked")));
        assert_eq!(b.put("r1"), Err(Refusal::Busy));
        b.task_ends().await;
        assert!(b.status().ready);
        Arc::get_mut(&mut b.d.config).unwrap().store.budget_gb = Some(1e-3);
        b.d.look_for_room();
        assert!(b.status().not_ready_reason.is_some_and(|why| why.contains("budget_gb")));
        assert!(matches!(b.put("r1"), Err(Refusal::OverBudget { .. })));
    });
}

/// A run of a sampler that brings the specimens of a plate one after the other. That of A01 came after its time.
async fn sampler_is_late(root: &std::path::Path) -> Bench {
    let mut b = started_with(root, instrument(FakeAxis::new(), Arm::default()), &["A01", "A02", "A03"]);
    b.phase("A01", Phase::Load, false);
    b.ends(RunEnd::Failed(DeviceError::Sampler { well: "A01".into(), why: "no specimen".into() }.into())).await;
    b
}

fn outcomes(b: &Bench) -> Vec<Option<SpecimenOutcome>> {
    b.status().run.unwrap().results.iter().map(|result| result.outcome).collect()
}

/// It is in nobody's hands any more, and the next one that comes belongs to the next well.
#[test]
fn a_specimen_that_came_late_or_unasked_can_be_taken_out() {
    on_this_thread(async {
        for (well, at) in [("A01", 0), ("A02", 1)] {
            let dir = scratch();
            let mut b = sampler_is_late(dir.path()).await;
            assert_eq!((b.loaded(well, false), b.loaded(well, false)), (Ok(()), Ok(())));
            assert!(matches!(b.loaded("H12", false), Err(Refusal::UnexpectedWell { .. })));
            for _restart in 0..2 {
                let expected: Vec<_> = (0..3).map(|i| (i == at).then_some(SpecimenOutcome::Interrupted)).collect();
                assert_eq!(outcomes(&b), expected);
                drop(b);
                b = bench_of(dir.path(), instrument(FakeAxis::new(), Arm::default()));
                assert_eq!(b.loaded(well, false), Ok(()), "repeated after a restart");
            }
            let events = journalled(dir.path());
            assert_eq!((count(&events, kind::WELL_UNLOADED), count(&events, "specimen.interrupted")), (1, 1), "the load interrupted none");
            let seq = b.status().faults[0].seq;
            requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            b.steer(Towards::Unhold).unwrap();
            let left = b.d.run.as_ref().unwrap().wells_left(&std::collections::VecDeque::new());
            let asked = ["A01", "A02", "A03"].into_iter().filter(|planned| *planned != well).collect::<Vec<_>>();
            assert_eq!(left.iter().map(|planned| planned.well.as_str()).collect::<Vec<_>>(), asked);
        }
    });
}

/// The sampler is at work. The report counts when its work has ended, so that the next specimen that comes is not taken for this one.
#[test]
fn a_specimen_that_is_taken_out_while_the_sampler_works_counts_as_out_once_the_work_has_ended() {
    on_this_thread(async {
        for dies in [false, true] {
            for (end, outcome) in [(RunEnd::Paused, State::Held), (RunEnd::Cancelled, State::Aborted)] {
                let dir = scratch();
                let mut b = started_with(dir.path(), instrument(FakeAxis::new(), Arm::default()), &["A01", "A02", "A03"]);
                b.phase("A01", Phase::Load, false);
                assert!(!b.d.run.as_mut().unwrap().work_mut().as_ref().unwrap().is_specimen_out());
                assert_eq!((b.loaded("A01", false), b.loaded("A01", false)), (Ok(()), Ok(())), "a repeat changes nothing");
                assert!(matches!(b.loaded("H12", false), Err(Refusal::UnexpectedWell { .. })), "no well of the run");
                assert_eq!(b.status().state, State::Holding, "a person is at the instrument");
                assert!(b.d.run.as_mut().unwrap().work_mut().as_ref().unwrap().is_specimen_out(), "the load ends at once");
                let events = journalled(dir.path());
                assert_eq!((count(&events, kind::WELL_TAKEN_OUT), count(&events, kind::WELL_UNLOADED)), (1, 0), "the work has not ended");
                if dies {
                    drop(b);
                    b = bench_of(dir.path(), instrument(FakeAxis::new(), Arm::default()));
                    assert_eq!(b.status().state, State::Held);
                } else {
                    if outcome == State::Aborted {
                        b.steer(Towards::Abort).unwrap();
                    }
                    b.ends(end).await;
                    assert_eq!(b.status().state, outcome);
                }
                assert_eq!(outcomes(&b)[0], Some(SpecimenOutcome::Interrupted));
                assert_eq!(count(&journalled(dir.path()), kind::WELL_UNLOADED), 1);
                assert_eq!(b.loaded("A01", false), Ok(()), "said again");
                if b.status().state == State::Held {
                    b.steer(Towards::Unhold).unwrap();
                    let left = b.d.run.as_ref().unwrap().wells_left(&std::collections::VecDeque::new());
                    assert_eq!(left.iter().map(|planned| planned.well.as_str()).collect::<Vec<_>>(), ["A02", "A03"]);
                }
            }
        }
    });
}

/// The worker is about to load it, or is at another specimen, which is measured first.
#[test]
fn a_report_of_a_specimen_that_is_not_loaded_yet_ends_no_work_at_another_one() {
    on_this_thread(async {
        for (at_work, ends_work) in [(None, true), (Some("A02"), false)] {
            let dir = scratch();
            let mut b = started_with(dir.path(), instrument(FakeAxis::new(), Arm::default()), &["A01", "A02"]);
            if let Some(well) = at_work {
                b.phase(well, Phase::Revolve, true);
            }
            assert_eq!(b.loaded("A01", false), Ok(()));
            assert_eq!(b.d.run.as_mut().unwrap().work_mut().as_ref().unwrap().is_specimen_out(), ends_work, "{at_work:?}");
            assert_eq!(b.status().state, State::Holding);
        }
    });
}

#[test]
fn a_message_that_a_specimen_is_out_outlasts_a_death_at_any_moment() {
    on_this_thread(async {
        let mut deaths = 0;
        loop {
            let dir = scratch();
            let mut b = sampler_is_late(dir.path()).await;
            disk_trace::begin(None);
            disk_trace::die(deaths);
            let answer = b.loaded("A01", false);
            let has_died = disk_trace::was_full();
            drop(b);
            disk_trace::begin(None);
            let mut b = bench_of(dir.path(), instrument(FakeAxis::new(), Arm::default()));
            let is_told = answer.is_ok() || count(&journalled(dir.path()), kind::WELL_UNLOADED) == 1;
            assert!(!is_told || outcomes(&b)[0].is_some(), "the next one would be A01, death {deaths}");
            assert_eq!((b.loaded("A01", false), outcomes(&b)[0]), (Ok(()), Some(SpecimenOutcome::Interrupted)), "death {deaths}");
            disk_trace::end();
            if !has_died {
                break;
            }
            deaths += 1;
        }
        assert!(deaths > 3, "{deaths}");
    });
}

/// The run has no use for the message, and the person who sends it needs no other answer.
#[test]
fn a_late_specimen_can_be_taken_out_after_the_end_of_the_run() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = sampler_is_late(dir.path()).await;
        b.steer(Towards::Abort).unwrap();
        for well in ["A01", "A01", "A02"] {
            assert_eq!(b.loaded(well, false), Ok(()));
        }
        let status = b.status();
        assert!(status.plate.removable && status.plate.needs.is_none(), "{:?}", status.plate);
    });
}

/// A run that no frame has held is aborted with its specimen inside, and nobody starts another.
#[test]
fn the_plate_of_an_aborted_run_can_be_taken_from_a_driven_sampler() {
    on_this_thread(async {
        for restarted in [false, true] {
            let dir = scratch();
            let mut b = bench(dir.path(), false);
            requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).unwrap();
            requests::end_handoff(&mut b.d, HandoffEnd::Completed).unwrap();
            b.put_run(&plan(&["A01", "A02"])).unwrap();
            b.report(Progress::Ready);
            b.phase("A01", Phase::Position, true);
            b.ends(RunEnd::Failed(DeviceError::NoFrame { waited_ms: 1, attempts: 1, last: "nothing came".into() }.into())).await;
            let hold = b.status().run.unwrap().hold.unwrap();
            assert_eq!((hold.code.as_str(), hold.next_command), (fault_table::CAMERA_NO_FRAME.code, Some(NextCommand::Unhold)));
            b.steer(Towards::Abort).unwrap();
            if restarted {
                drop(b);
                b = bench(dir.path(), false);
            }
            let faults: Vec<u64> = b.status().faults.iter().map(|fault| fault.seq).collect();
            for seq in faults {
                requests::acknowledge(&mut b.d, seq, Asked::default()).unwrap();
            }
            let plate = b.status().plate;
            assert_eq!((plate.removable, plate.take_out.as_deref(), plate.needs), (false, Some("A01"), Some(out("A01"))));
            assert!(b.status().doing.contains("A01"), "{}", b.status().doing);
            b.loaded("A01", false).unwrap();
            assert!(b.status().plate.removable);
            let unload = requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Unload, barcode: "P-1".into() }).unwrap();
            assert_eq!((unload.needs, requests::end_handoff(&mut b.d, HandoffEnd::Completed)), (None, Ok(())));
            assert!(b.status().ready && b.status().plate.barcode.is_none());
        }
    });
}
