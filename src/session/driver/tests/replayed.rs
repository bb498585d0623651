//! In every sequence of steps, the live state equals the state that is read from the journal, and a restart gets the same state. The disk
//! may fail, a device may be lost, and the process may die, at any operation within a step. Accepted specimens have a recording, so that
//! their numbers can be computed from their frames.

use super::super::*;
use super::bench::{Arm, Bench, RUN, bench_with, instrument, journalled, on_this_thread, plan, scratch};
use super::rebuilt::{Before, follows_from_the_state};
use crate::session::driver::recovery::Made;
use crate::session::handle::Towards;
use crate::session::worker::{Progress, RunEnd, RunError};
use crate::session::{Live, RotationStatus};
use carved_devices::testing::FakeAxis;
use carved_devices::{DeviceError, StreamCounters};
use carved_records::{
    Asked, Event, EventData, Handoff, HandoffEnd, HandoffIntent, InstrumentState, Interrupted, LiveEstimate, Phase, SpecimenOutcome,
};
use carved_store::RecordingWriter;
use carved_store::testing::{recording as a_recording, trace as disk_trace};
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

pub(super) const WELLS: [&str; 3] = ["A01", "A02", "A03"];
const PHASES: [Phase; 8] =
    [Phase::Load, Phase::Position, Phase::Detect, Phase::Revolve, Phase::Reconstruct, Phase::Measure, Phase::Eject, Phase::Wash];

/// One step of the driver's environment. An impossible step is skipped, or the driver refuses it.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Put,
    Ready,
    Awaits(usize),
    Enters(usize, usize, bool),
    /// The worker has judged the detection frame, or could not.
    Detected(usize, bool),
    TriedAgain(usize),
    View(usize),
    /// The worker has accepted the turn, and the specimen may be released.
    Accepts(usize),
    Measured(usize),
    Hardware,
    Done(usize),
    /// The numbers of a released specimen are computed from its frames.
    Recovered,
    WorkerEnds(u8),
    Steer(u8),
    Loader(usize, bool),
    Plate(u8),
    Fault(u8),
    /// The axis answers from now on, or no more. The next heartbeat between runs finds out.
    AxisAnswers(bool),
    Acknowledge(u64),
    /// The disk fails from this operation on.
    DiskFails(usize),
    DiskHasRoom,
    Beat,
    EmergencyStop,
    /// The daemon ends as requested, with its run or without.
    ShutDown(bool),
    Crash,
    /// The process dies at this operation, within this step or a later one.
    DiesAt(usize),
}

pub(super) fn step() -> impl Strategy<Value = Step> {
    let well = 0..WELLS.len();
    prop_oneof![
        2 => Just(Step::Put),
        1 => Just(Step::Ready),
        3 => well.clone().prop_map(Step::Awaits),
        6 => (well.clone(), 0..PHASES.len(), any::<bool>()).prop_map(|(w, p, inside)| Step::Enters(w, p, inside)),
        1 => (well.clone(), any::<bool>()).prop_map(|(w, judged)| Step::Detected(w, judged)),
        1 => well.clone().prop_map(Step::TriedAgain),
        1 => well.clone().prop_map(Step::View),
        2 => well.clone().prop_map(Step::Accepts),
        1 => well.clone().prop_map(Step::Measured),
        1 => Just(Step::Hardware),
        2 => well.clone().prop_map(Step::Done),
        2 => Just(Step::Recovered),
        2 => (0..10_u8).prop_map(Step::WorkerEnds),
        3 => (0..4_u8).prop_map(Step::Steer),
        4 => (well, any::<bool>()).prop_map(|(w, loaded)| Step::Loader(w, loaded)),
        2 => (0..4_u8).prop_map(Step::Plate),
        1 => (0..8_u8).prop_map(Step::Fault),
        1 => any::<bool>().prop_map(Step::AxisAnswers),
        2 => (1..6_u64).prop_map(Step::Acknowledge),
        2 => (0..12_usize).prop_map(Step::DiskFails),
        2 => Just(Step::DiskHasRoom),
        2 => Just(Step::Beat),
        1 => Just(Step::EmergencyStop),
        1 => any::<bool>().prop_map(Step::ShutDown),
        2 => Just(Step::Crash),
        2 => (0..24_usize).prop_map(Step::DiesAt),
    ]
}

fn error(which: u8) -> RunError {
    let intervention = DeviceError::Intervention { device: "axis", what: "feed hold".into(), way_out: "Release it." };
    match which {
        0 => RunError::SpecimenThread,
        1 => RunError::Device(intervention),
        2 => RunError::Device(DeviceError::ControlLost),
        3 => RunError::Device(DeviceError::NoFrame { waited_ms: 1000, attempts: 3, last: "nothing came".into() }),
        4 => RunError::Device(DeviceError::NotArmed),
        5 => RunError::Device(DeviceError::Sampler { well: "A01".into(), why: "no specimen".into() }),
        6 => RunError::Device(DeviceError::Suspect { why: "it slipped".into() }),
        _ => RunError::Store(StoreError::Vanished { path: "/data".into() }),
    }
}

/// The worker accepts the turn of a well. It has no views, so none is missing. A disk that refuses this ends the worker with an error.
pub(super) fn accepts(b: &Bench, well: usize) -> Result<(), StoreError> {
    let planned = &b.d.run.as_ref().unwrap().record().plan.plate_map[well];
    let mut recording = a_recording(RUN, planned);
    recording.ended_after_views = Some(0);
    RecordingWriter::create(&b.d.outbox.store().run_folder(RUN).join(&planned.well), recording, None)?.accept()
}

/// Waits for the numbers that are being computed. `false` if there are none.
pub(super) async fn recovers(b: &mut Bench) -> bool {
    let Some(run) = b.d.run.as_mut().filter(|run| run.numbers().are_being_made()) else { return false };
    let made = run.numbers_mut().made().await;
    course::recovered(&mut b.d, made);
    true
}

/// Waits for the thread that computes numbers: it must not write after the end of the process. The driver has not taken the result.
pub(super) async fn thread_ends(b: &mut Bench) -> Option<Made> {
    let run = b.d.run.as_mut().filter(|run| run.numbers().are_being_made())?;
    Some(run.numbers_mut().made().await)
}

pub(super) async fn takes(b: &mut Bench, axis_answers: &AtomicBool, step: &Step) {
    let open = |b: &Bench, well: usize| {
        let Some(run) = &b.d.run else { return false };
        let is_open = run.record().wells.iter().any(|w| w.well == WELLS[well] && w.outcome.is_none());
        is_open && run.numbers().wells().all(|recovered| recovered != WELLS[well])
    };
    match *step {
        Step::Put => drop(b.put_run(&plan(&WELLS))),
        Step::Ready if b.works() => drop(b.report(Progress::Ready)),
        Step::Awaits(well) if b.works() && open(b, well) && b.d.loader.fills_capillary() => {
            b.report(Progress::WaitingForLoader { well: WELLS[well].into() });
        }
        Step::Enters(well, phase, inside) if b.works() => drop(b.phase(WELLS[well], PHASES[phase], inside)),
        Step::Detected(well, judged) if b.works() => {
            let found = judged.then(a_larva);
            b.report(Progress::Detected { well: WELLS[well].into(), found, live: Live::default() });
        }
        Step::TriedAgain(well) if b.works() => {
            b.report(Progress::TriedAgain { well: WELLS[well].into(), attempt: 1, why: "it moved".into() });
        }
        Step::View(well) if b.works() => {
            let (well, live) = (WELLS[well].to_owned(), Live::default());
            let estimate = LiveEstimate::default();
            b.report(Progress::View {
                well,
                index: 0,
                closure: false,
                achieved_steps: 0,
                hull_volume_um3: None,
                estimate,
                wait: None,
                light: None,
                live: Some(live),
            });
        }
        Step::Accepts(well) if b.works() && open(b, well) => {
            b.phase(WELLS[well], Phase::Reconstruct, true);
            drop(accepts(b, well));
        }
        Step::Measured(well) if b.works() => {
            b.report(Progress::Measured { well: WELLS[well].into(), glb: None, end: LiveEstimate::default(), blur_px: None });
        }
        Step::Hardware if b.works() => {
            let (rotation, counters) = (RotationStatus::default(), StreamCounters::default());
            b.report(Progress::Hardware { rotation, translation: None, outputs: Vec::new(), counters, second: None });
        }
        Step::Done(well) if b.works() && open(b, well) => drop(b.done(WELLS[well])),
        Step::Recovered => drop(recovers(b).await),
        Step::WorkerEnds(how) if b.works() => {
            let end = match how {
                0 => RunEnd::Paused,
                1 => RunEnd::Cancelled,
                how => RunEnd::Failed(error(how - 2)),
            };
            b.ends(end).await;
        }
        Step::Steer(towards) => {
            drop(b.steer([Towards::Hold, Towards::Unhold, Towards::Stop, Towards::Abort][usize::from(towards)]));
        }
        Step::Loader(well, loaded) => drop(b.loaded(WELLS[well], loaded)),
        Step::Plate(what) => drop(match what {
            0 => requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Load, barcode: "P-1".into() }).map(|_| ()),
            1 => requests::handoff(&mut b.d, Handoff { intent: HandoffIntent::Unload, barcode: "P-1".into() }).map(|_| ()),
            2 => requests::end_handoff(&mut b.d, HandoffEnd::Completed),
            _ => requests::end_handoff(&mut b.d, HandoffEnd::Aborted),
        }),
        Step::Fault(which) => match error(which) {
            RunError::Store(refused) => b.d.handle_write_error(Err(refused)),
            error => b.d.raise(&error),
        },
        Step::AxisAnswers(answers) => axis_answers.store(answers, Ordering::SeqCst),
        Step::Acknowledge(seq) => drop(requests::acknowledge(&mut b.d, seq, Asked::default())),
        Step::DiskFails(at) => disk_trace::fill(at, || ()),
        Step::DiskHasRoom => disk_trace::make_room(),
        Step::Beat => b.beat().await,
        Step::EmergencyStop => {
            b.handle.emergency_stop(Asked::default()).await;
            requests::emergency_pressed(&mut b.d);
        }
        Step::ShutDown(leaves_run) => {
            let made = if leaves_run { thread_ends(b).await } else { None };
            course::shut_down(&mut b.d, if leaves_run { Departure::LeavesRun } else { Departure::EndsRun });
            if b.works() {
                b.ends(RunEnd::Cancelled).await;
            }
            // The run has stayed, because an abort comes first.
            if let Some(made) = made {
                course::recovered(&mut b.d, made);
            }
            while recovers(b).await {}
            drop(b.d.final_report());
        }
        _ => {}
    }
}

fn a_larva() -> carved_core::profile::Detection {
    serde_json::from_value(serde_json::json!({
        "kind": "larva", "confidence": 1.0, "clipped_left": 0.0, "clipped_right": 0.0, "dead": 0.0,
        "likelihoods": {"larva": 1.0, "bead": 0.0, "empty": 0.0, "two": 0.0, "bubble": 0.0, "debris": 0.0},
        "head": {"side": "left", "confidence": 1.0}
    }))
    .unwrap()
}

/// The sampler, and the method's policy for an interrupted specimen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampling {
    pub loaded_from_outside: bool,
    brings_again: bool,
    /// Another program turns the capillary, as on a stock VAST.
    steps_through_a_list: bool,
    interrupted: Interrupted,
}

pub(super) fn sampling() -> impl Strategy<Value = Sampling> {
    let samplers =
        prop_oneof![Just((true, true, false)), Just((false, true, false)), Just((false, false, false)), Just((false, true, true))];
    let policies = prop_oneof![Just(Interrupted::Redo), Just(Interrupted::Skip)];
    (samplers, policies).prop_map(|((loaded_from_outside, brings_again, steps_through_a_list), interrupted)| Sampling {
        loaded_from_outside,
        brings_again,
        steps_through_a_list,
        interrupted,
    })
}

/// A driver on this folder. `axis_answers`: whether its axis answers a check.
pub(super) fn bench(root: &Path, sampling: Sampling, axis_answers: &Arc<AtomicBool>) -> Bench {
    let Sampling { loaded_from_outside, brings_again, steps_through_a_list, interrupted } = sampling;
    let answers = Arc::clone(axis_answers);
    let gone = || DeviceError::Gone { device: "rotation axis", why: "the cable".into() };
    let axis = FakeAxis::new().answering(move || if answers.load(Ordering::SeqCst) { Ok(()) } else { Err(gone()) });
    let axis = if steps_through_a_list { axis.trigger_only() } else { axis };
    bench_with(root, instrument(axis, Arm { waits: loaded_from_outside, brings_again, ..Arm::default() }), interrupted)
}

/// The state that follows from the journal and from the events that wait for the disk.
fn replayed(b: &Bench, events: &[Event]) -> InstrumentState {
    let mut state = InstrumentState::after(events);
    b.d.outbox.waiting_events().for_each(|body| state.apply(body));
    state
}

/// The outcomes of the wells in the file of the run are those of the events. `may_lead`: the file is written before the event, and the
/// process has died between the two.
fn compare_outcomes(b: &Bench, events: &[Event], may_lead: bool, when: &str) {
    let Some(record) = b.d.outbox.store().run(RUN).unwrap() else { return };
    if let Some(run) = &b.d.run {
        assert_eq!(record.wells, run.record().wells, "{when}");
    }
    for well in &record.wells {
        let done = events.iter().rev().find_map(|event| match &event.body.data {
            EventData::SpecimenDone(done) if done.result.well == well.well => Some(done.result.outcome),
            _ => None,
        });
        match done {
            Some(outcome) => assert_eq!(well.outcome, outcome, "{when}"),
            None => assert!(may_lead || well.outcome != Some(SpecimenOutcome::Succeeded), "{} {when}", well.well),
        }
    }
}

/// The wells that were given up according to the journal. No start may begin them again.
fn given_up(b: &Bench, events: &[Event]) -> Vec<String> {
    let wells = b.d.run.iter().flat_map(|run| &run.record().wells);
    let is_told = |well: &str| {
        let last = events.iter().rev().find(|event| event.body.well.as_deref() == Some(well));
        last.is_some_and(|event| matches!(&event.body.data, EventData::SpecimenInterrupted(interrupted) if !interrupted.kept))
    };
    let is_given_up = |outcome| matches!(outcome, Some(SpecimenOutcome::Interrupted | SpecimenOutcome::Failed));
    wells.filter(|w| is_given_up(w.outcome) && is_told(&w.well)).map(|w| w.well.clone()).collect()
}

fn check(sampling: Sampling, steps: &[Step]) {
    on_this_thread(async {
        let (dir, axis_answers) = (scratch(), Arc::new(AtomicBool::new(true)));
        let mut b = bench(dir.path(), sampling, &axis_answers);
        let (mut written, mut is_dying, mut has_died) = (journalled(dir.path()), false, false);
        disk_trace::begin(None);
        for (at, step) in steps.iter().enumerate() {
            let when = format!("after step {at} of {steps:?}");
            let worked = b.works();
            match *step {
                Step::DiesAt(at) => {
                    disk_trace::die(at);
                    is_dying = true;
                }
                // It would replace the death.
                Step::DiskFails(_) | Step::DiskHasRoom if is_dying => {}
                _ => takes(&mut b, &axis_answers, step).await,
            }
            let may_work = b.d.check_faults().is_ok() && !b.d.waits_for_operator();
            assert!(worked || !b.works() || may_work, "work begins under a fault, {when}");
            let dies = is_dying && disk_trace::was_full();
            if dies || matches!(step, Step::Crash | Step::ShutDown(_)) {
                // What the disk did not accept is lost with the process. If it accepted everything, nothing is.
                let mut before = (b.d.outbox.waiting() == 0 && !dies).then(|| b.d.state().clone());
                let run_before = Before::of(&b).filter(|_| before.is_some());
                if before.is_some() {
                    written = journalled(dir.path());
                }
                let _lost = thread_ends(&mut b).await;
                let given_up = given_up(&b, &journalled(dir.path()));
                drop(b);
                disk_trace::begin(None);
                (is_dying, has_died) = (false, has_died || dies || before.is_none());
                b = bench(dir.path(), sampling, &axis_answers);
                if let Some(record) = b.d.outbox.store().run(RUN).unwrap() {
                    let is_open = |well: &&String| record.wells.iter().any(|w| w.well == **well && w.outcome.is_none());
                    assert_eq!(given_up.iter().find(is_open), None, "it is begun again, {when}");
                }
                let after = journalled(dir.path());
                assert_eq!(after[..written.len()], written, "a start changed what is written, {when}");
                if let Some(before) = &mut before {
                    after[written.len()..].iter().for_each(|event| before.apply(&event.body));
                    assert_eq!(b.d.state(), before, "the start forgot something, {when}");
                }
                follows_from_the_state(&b, &when);
                if let Some(run_before) = &run_before {
                    run_before.compare(&b, &when);
                }
            }
            written = journalled(dir.path());
            assert_eq!(*b.d.state(), replayed(&b, &written), "{when}");
            let status = b.status();
            let open: Vec<u64> = b.d.state().faults.open().iter().map(|fault| fault.seq).collect();
            assert_eq!(status.faults.iter().map(|fault| fault.seq).collect::<Vec<_>>(), open, "{when}");
            let inside = status.specimen.filter(|s| s.in_capillary).map(|s| s.well);
            assert!(inside.is_none() || inside.as_deref() == b.d.specimens().inside(), "{when}");
            let plate = b.d.state().plate.inside();
            let handed_over = b.d.state().plate.handed_over().is_some();
            assert_eq!((status.plate.present, status.plate.barcode.as_deref()), (handed_over, plate), "{when}");
            assert!(b.d.run.is_none() || plate == Some("P-1"), "a run without its plate, {when}");
            if b.d.outbox.waiting() == 0 {
                compare_outcomes(&b, &written, has_died, &when);
            }
        }
        disk_trace::end();
    });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, max_shrink_iters: 200, ..ProptestConfig::default() })]

    #[test]
    fn what_the_driver_believes_is_what_its_journal_says(
        sampling in sampling(),
        steps in proptest::collection::vec(step(), 1..60),
    ) {
        check(sampling, &steps);
    }
}

/// It was reported while another specimen was inside, so it takes effect when the work has ended.
#[test]
fn a_specimen_reported_out_during_work_is_shown_as_out_afterwards() {
    let sampling = Sampling { loaded_from_outside: false, brings_again: true, steps_through_a_list: false, interrupted: Interrupted::Redo };
    check(sampling, &[Step::Put, Step::Loader(2, false), Step::Enters(2, 1, true), Step::WorkerEnds(2)]);
}
