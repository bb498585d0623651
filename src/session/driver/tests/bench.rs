//! A driver with devices that do nothing. The camera does not arm, so the worker ends at once. The bench withholds this end, and the test
//! sends the progress of the worker.

use super::super::run::RunInProgress;
use super::super::*;
use crate::session::channel;
use crate::session::handle::{Accepted, Refusal, Said, SessionHandle, Towards};
use crate::session::worker::{Progress, RunEnd};
use carved_devices::cancel::CancelToken;
use carved_devices::sampler::{Expected, Loaded, Sampler};
use carved_devices::testing::{FakeAxis, FakeCamera};
use carved_devices::{DeviceError, Rig, RotationAxis};
use carved_records::{Asked, Event, Interrupted, Mode, Phase, RunPlan, SpecimenOutcome, WellTimes};
use carved_store::{Claim, EventsAfter};
use std::path::Path;
use std::sync::{Arc, Mutex};
use tokio::sync::oneshot;

/// A camera that does not arm.
pub fn dark_camera() -> FakeCamera {
    FakeCamera::default().arming(|_| Err(DeviceError::NotArmed))
}

/// A sampler that brings no specimen: for a plate-loader, or driven.
#[derive(Default)]
pub struct Arm {
    pub waits: bool,
    pub brings_again: bool,
    /// The reading of its sensor between runs.
    pub wire: Option<bool>,
    /// The wells whose specimens it has ejected.
    pub ejected: Arc<Mutex<Vec<String>>>,
}

impl Sampler for Arm {
    fn waits_for_loader(&self) -> bool {
        self.waits
    }

    fn brings_again(&self) -> bool {
        self.brings_again
    }

    fn begin_run(&mut self) {}

    fn look(&mut self, _axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        Ok(())
    }

    fn has_sensor(&self) -> bool {
        self.wire.is_some()
    }

    fn sees_specimen(&self) -> Option<bool> {
        self.wire
    }

    fn load(
        &mut self,
        _axis: &mut dyn RotationAxis,
        _expected: Expected<'_>,
        _cancel: &CancelToken,
    ) -> Result<Option<Loaded>, DeviceError> {
        Ok(None)
    }
    fn go_on(
        &mut self,
        _axis: &mut dyn RotationAxis,
        _expected: Expected<'_>,
        _cancel: &CancelToken,
    ) -> Result<Option<Loaded>, DeviceError> {
        Ok(None)
    }
    fn eject(&mut self, _axis: &mut dyn RotationAxis, well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        self.ejected.lock().unwrap().push(well.to_owned());
        Ok(())
    }

    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// An instrument whose camera does not arm.
pub fn instrument(axis: FakeAxis, sampler: Arm) -> Instrument {
    let rig = Rig { rotation: Box::new(axis), camera: Box::new(dark_camera()) };
    Instrument { rig, second: None, sampler: Box::new(sampler) }
}

pub const RUN: &str = "r1";

pub struct Bench {
    pub d: DriverState,
    pub handle: SessionHandle,
    _mailbox: mpsc::Receiver<Command>,
    /// The well whose specimen is really in the capillary, whatever the messages say.
    pub inside: Option<String>,
}

/// A temporary folder in memory, if possible.
pub fn scratch() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

pub fn plan(wells: &[&str]) -> RunPlan {
    let wells: Vec<_> = wells.iter().map(|well| serde_json::json!({ "well": well })).collect();
    serde_json::from_value(serde_json::json!({"plate_barcode": "P-1", "method": "standard", "operator": "kim", "plate_map": wells}))
        .unwrap()
}

/// A driver on this folder, its handle and its mailbox.
pub fn driver(root: &Path, loaded_from_outside: bool) -> (Driver, SessionHandle, mpsc::Receiver<Command>) {
    let arm = Arm { waits: loaded_from_outside, brings_again: true, ..Arm::default() };
    driver_of(root, instrument(FakeAxis::new(), arm), Interrupted::default())
}

fn driver_of(root: &Path, instrument: Instrument, interrupted: Interrupted) -> (Driver, SessionHandle, mpsc::Receiver<Command>) {
    let mut config = Config::parse(include_str!("../../../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
    config.store.data_dir = root.to_owned();
    config.methods.values_mut().for_each(|method| method.policy.interrupted = interrupted);
    let (store, journal, events) = Claim::on(root).and_then(Store::open).unwrap();
    let (handle, mailbox, publisher) = channel(Driver::first_status(Mode::Simulated, "boot".into()), events);
    let driver = Driver {
        identity: config.identity("0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11".into()),
        config: Arc::new(config),
        mode: Mode::Simulated,
        store,
        journal,
        publisher,
        instrument,
        interlock: LoaderInterlock::default(),
        notices: None,
        heartbeat: Heartbeat::default(),
    };
    (driver, handle, mailbox)
}

/// A driver that has published its first report.
pub fn bench(root: &Path, loaded_from_outside: bool) -> Bench {
    spoken(driver(root, loaded_from_outside))
}

/// As `bench`, with this instrument.
pub fn bench_of(root: &Path, instrument: Instrument) -> Bench {
    bench_with(root, instrument, Interrupted::default())
}

/// As `bench_of`, with this policy in every method.
pub fn bench_with(root: &Path, instrument: Instrument, interrupted: Interrupted) -> Bench {
    spoken(driver_of(root, instrument, interrupted))
}

fn spoken((driver, handle, mailbox): (Driver, SessionHandle, mpsc::Receiver<Command>)) -> Bench {
    let mut d = DriverState::new(driver);
    restart::first_report(&mut d);
    Bench { d, handle, _mailbox: mailbox, inside: None }
}

/// A bench with a run of these wells in state Execute.
pub fn started(root: &Path, loaded_from_outside: bool, wells: &[&str]) -> Bench {
    at_it(bench(root, loaded_from_outside), wells)
}

/// As `started`, with this instrument.
pub fn started_with(root: &Path, instrument: Instrument, wells: &[&str]) -> Bench {
    at_it(bench_of(root, instrument), wells)
}

fn at_it(mut b: Bench, wells: &[&str]) -> Bench {
    b.put_run(&plan(wells)).unwrap();
    b.report(Progress::Ready);
    b
}

impl Bench {
    pub fn status(&self) -> Status {
        self.handle.status()
    }

    pub fn ask<T>(&mut self, make: impl FnOnce(oneshot::Sender<Result<T, Refusal>>) -> Command) -> Result<T, Refusal> {
        let (answer, mut answered) = oneshot::channel();
        requests::command(&mut self.d, make(answer));
        answered.try_recv().unwrap()
    }

    pub fn put_run(&mut self, plan: &RunPlan) -> Result<Accepted, Refusal> {
        self.ask(|answer| Command::PutRun { id: RUN.into(), plan: plan.clone(), answer })
    }

    pub fn steer(&mut self, towards: Towards) -> Result<(), Refusal> {
        self.ask(|answer| Command::Steer { id: RUN.into(), towards, asked: Asked::default(), answer })
    }

    pub fn said(&mut self, well: &str, said: Said) -> Result<(), Refusal> {
        self.ask(|answer| Command::OfWell { run: RUN.into(), well: well.into(), said, answer })
    }

    pub fn loaded(&mut self, well: &str, loaded: bool) -> Result<(), Refusal> {
        self.ask(|answer| Command::Loaded { run: RUN.into(), well: well.into(), loaded, answer })
    }

    pub fn works(&self) -> bool {
        self.d.run.as_ref().is_some_and(RunInProgress::works)
    }

    /// Sends progress as the worker does. Returns `false` if the run is cancelled.
    pub fn report(&mut self, progress: Progress) -> bool {
        reports::progress(&mut self.d, progress);
        self.d.run.as_mut().and_then(|run| run.work_mut().as_ref()).is_some_and(|work| !work.is_cancelled())
    }

    pub fn phase(&mut self, well: &str, phase: Phase, in_capillary: bool) -> bool {
        self.inside = in_capillary.then(|| well.to_owned());
        self.report(Progress::Phase { well: well.into(), phase, in_capillary })
    }

    /// Reports that the numbers of a well are on disk.
    pub fn done(&mut self, well: &str) -> bool {
        let record = self.d.run.as_ref().unwrap().record();
        let mut result = record.wells.iter().find(|w| w.well == well).unwrap().clone();
        result.end(SpecimenOutcome::Succeeded, None);
        self.report(Progress::WellDone { result, seconds: 1.0, times: WellTimes::default() })
    }

    /// A heartbeat and the device check that it begins. Commands wait for the check.
    pub async fn beat(&mut self) {
        checks::beat(&mut self.d);
        if self.d.devices.are_busy() {
            self.task_ends().await;
        }
    }

    pub async fn task_ends(&mut self) {
        let done = self.d.devices.done().await.unwrap();
        checks::task_done(&mut self.d, done);
    }

    /// The worker returns the instrument and ends in this way.
    pub async fn ends(&mut self, end: RunEnd) {
        let work = self.d.run.as_mut().unwrap().work_mut();
        let instrument = work.as_mut().unwrap().instrument().await;
        course::worker_ended(&mut self.d, (instrument, end));
    }
}

/// The events in the journal of a folder, without an incomplete last line.
pub fn journalled(root: &Path) -> Vec<Event> {
    let text = std::fs::read_to_string(root.join("events.jsonl")).unwrap();
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    whole.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The events in the index.
pub fn indexed(bench: &Bench) -> Vec<Event> {
    match bench.d.outbox.store().reader().events_after(0, 100_000).unwrap() {
        EventsAfter::Events(events) => events,
        EventsAfter::Unknown => panic!("the index has a gap"),
    }
}

pub fn count(events: &[Event], kind: &str) -> usize {
    events.iter().filter(|e| e.body.data.kind() == kind).count()
}

/// Runs an async test on this thread, whose disk operations are traced.
pub fn on_this_thread(test: impl Future<Output = ()>) {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(test);
}
