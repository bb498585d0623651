//! The driver: the one place that changes anything. It takes commands and the worker's progress, journals, then publishes.

use super::fault::Lost;
use super::handle::{Command, Publisher, Refusal};
use super::heart::{self, Heart};
use super::plan::is_plain_name;
use super::search::{self, Search};
use super::state::{self, STARTABLE, Trigger};
use super::worker::{self, Instrument, Progress, RunContext, RunEnd};
use super::{
    Accepted, CalibrationStatus, Eta, Fault, FieldError, Mode, Phase, Plate, RunOutcome, RunPlan, RunStatus, SpecimenOutcome,
    SpecimenStatus, State, Status, WellCounts, WellStatus,
};
use super::{fault, gate, sentence};
use crate::cancel::CancelToken;
use crate::config::Config;
use crate::device::sampler::LoaderGate;
use crate::device::{DeviceError, Link, StopHandle};
use crate::store::{Journal, RunRecord, Store, StoreError, calibrations};
use std::future::Future;
use std::sync::Arc;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// What the driver is made of; `run` consumes it.
pub struct Driver {
    pub config: Arc<Config>,
    pub mode: Mode,
    pub store: Store,
    pub journal: Journal,
    pub publisher: Publisher,
    pub instrument: Instrument,
    /// Where the loader's word goes, on a rig that is loaded from outside.
    pub gate: LoaderGate,
    pub heart: Heart,
}

/// Why the driver ended.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the thread that runs the rig panicked; its motors were stopped as it unwound")]
    WorkerPanicked,
}

/// A run under way.
struct Active {
    record: RunRecord,
    cancel: CancelToken,
    stop: StopHandle,
    worker: JoinHandle<(Instrument, RunEnd)>,
    progress: mpsc::Receiver<Progress>,
    /// How it ends, once somebody has cut it short.
    cut_short: Option<RunOutcome>,
    waiting_for: Option<String>,
    well_seconds: Vec<f64>,
    /// Its larvae are measured without a bead gate that stands.
    lacks_gate: bool,
}

struct Running {
    config: Arc<Config>,
    mode: Mode,
    store: Store,
    journal: Journal,
    publisher: Publisher,
    gate: LoaderGate,
    /// At rest between runs; with the worker during one.
    instrument: Option<Instrument>,
    active: Option<Active>,
    fault_seq: u64,
    /// A write of this run failed: what is shown of it is not all on disk.
    store_failed: bool,
    /// Devices that do not answer any more; nothing runs without them.
    lost: Vec<Lost>,
    /// Whether the camera is there, wherever the instrument is now.
    camera: Link,
    /// A look at the devices between runs, which has the instrument.
    search: Option<Search>,
}

/// However the driver ends, a panic included: motors first, and the worker then ends by itself.
impl Drop for Active {
    fn drop(&mut self) {
        self.cancel.cancel();
        if !self.worker.is_finished() {
            self.stop.stop();
        }
    }
}

impl Driver {
    /// The first snapshot of a boot.
    pub fn first_status(mode: Mode, boot_id: String) -> Status {
        Status {
            schema: "carved.status/1".into(),
            revision: 1,
            boot_id,
            server_time: String::new(),
            uptime_s: 0.0,
            version: env!("CARGO_PKG_VERSION").into(),
            mode,
            ready: false,
            not_ready_reason: Some("starting".into()),
            state: State::Idle,
            doing: "Starting.".into(),
            pending: super::Pending::default(),
            plate: Plate::default(),
            run: None,
            specimen: None,
            hardware: super::HardwareStatus::default(),
            calibration: None,
            faults: Vec::new(),
        }
    }

    /// Serves commands until `shutdown`; then the motors are stopped, the record is closed and everything is joined.
    pub async fn run(self, mut mailbox: mpsc::Receiver<Command>, shutdown: impl Future<Output = ()>) -> Result<(), DriverError> {
        let Self { config, mode, store, journal, publisher, instrument, gate, heart } = self;
        let camera = instrument.rig.camera.link();
        let instrument = Some(instrument);
        let fault_seq = journal.last_fault();
        let mut d = Running {
            config,
            mode,
            store,
            journal,
            publisher,
            gate,
            instrument,
            active: None,
            fault_seq,
            store_failed: false,
            lost: Vec::new(),
            camera,
            search: None,
        };
        d.at_rest()?;
        tokio::pin!(shutdown);
        let mut beat = tokio::time::interval(heart::BEAT);
        let mut look = tokio::time::interval(search::LOOK);
        let mut stopping = false;
        loop {
            if stopping && d.active.is_none() && d.search.is_none() {
                d.go(Trigger::Joined);
                return Ok(d.event("daemon.stopped", None, serde_json::Value::Null)?);
            }
            tokio::select! {
                biased;
                () = &mut shutdown, if !stopping => {
                    stopping = true;
                    d.cut_short(RunOutcome::Interrupted);
                    d.publisher.publish(|s| { s.pending.stop = true; s.ready = false; s.not_ready_reason = Some("shutting down".into()); });
                    d.go(Trigger::ShutDown);
                }
                word = word_of(&mut d.active) => match word {
                    Word::Progress(progress) => {
                        let stored = d.progress(progress);
                        d.keep(stored);
                    }
                    Word::Ended(ended) => d.worker_ended(ended.map_err(|_| DriverError::WorkerPanicked)?, stopping),
                },
                found = search::ended(&mut d.search) => {
                    let (instrument, found) = found.map_err(|_| DriverError::WorkerPanicked)?;
                    let stored = d.searched(instrument, found);
                    d.keep(stored);
                }
                _ = beat.tick() => {
                    heart.beat();
                    d.calibration_ages();
                    if !stopping {
                        let stored = d.look();
                        d.keep(stored);
                    }
                }
                _ = look.tick(), if d.active.is_some() => d.show_camera(),
                // A look at devices that are there takes milliseconds, and a run needs them; without them there is no run.
                command = mailbox.recv(), if !stopping && (d.search.is_none() || !d.lost.is_empty()) => {
                    if let Some(command) = command {
                        d.command(command);
                    } else {
                        // Every handle is gone: nobody can ask for anything any more, not even for an end.
                        stopping = true;
                        d.cut_short(RunOutcome::Interrupted);
                    }
                }
            }
        }
    }
}

enum Word {
    Progress(Progress),
    Ended(Result<(Instrument, RunEnd), tokio::task::JoinError>),
}

/// The worker's next word; its end only after everything it said before.
async fn word_of(active: &mut Option<Active>) -> Word {
    let Some(a) = active else { return std::future::pending().await };
    tokio::select! {
        biased;
        Some(progress) = a.progress.recv() => Word::Progress(progress),
        ended = &mut a.worker => Word::Ended(ended),
    }
}

impl Running {
    /// Follows the state table; every state on the way is published as a revision of its own.
    fn go(&self, trigger: Trigger) {
        self.go_with(trigger, |_| ());
    }

    /// As `go`, with a change that comes with the first state and in the same revision.
    fn go_with(&self, trigger: Trigger, change: impl FnOnce(&mut Status)) {
        let mut change = Some(change);
        let from = self.publisher.status().state;
        let Some(path) = state::next(from, trigger) else {
            tracing::error!(?from, ?trigger, "no such transition");
            return;
        };
        for &to in path {
            self.publisher.publish(|s| {
                s.state = to;
                if let Some(change) = change.take() {
                    change(s);
                }
                s.doing = sentence::of(s);
            });
        }
    }

    fn publish(&self, change: impl FnOnce(&mut Status)) {
        self.publisher.publish(|s| {
            change(s);
            s.doing = sentence::of(s);
        });
    }

    fn event(&mut self, kind: &str, well: Option<&str>, data: serde_json::Value) -> Result<(), StoreError> {
        let run = self.active.as_ref().map(|a| a.record.id.clone());
        let event = self.journal.append(kind, run.as_deref(), well, data)?;
        self.publisher.announce(event);
        Ok(())
    }

    /// A write that fails in the middle of a run ends it: motors first, then the fault. What could not be written is shown
    /// all the same, and the plate is not called removable.
    fn keep(&mut self, written: Result<(), StoreError>) {
        let Err(error) = written else { return };
        tracing::error!(%error, "not stored");
        self.cut_short(RunOutcome::Failed);
        if !std::mem::replace(&mut self.store_failed, true) {
            self.raise(&error.into());
            if state::runs(self.publisher.status().state) {
                self.go(Trigger::Abort);
            }
        }
    }

    fn raise(&mut self, error: &worker::RunError) -> Fault {
        self.fault_seq += 1;
        let raised = fault::of(self.fault_seq, error);
        let shown = raised.clone();
        let lost = fault::lost_device(error);
        if let Some(lost) = lost.filter(|lost| !self.lost.contains(lost)) {
            self.lost.push(lost);
        }
        self.publish(|s| {
            match lost {
                Some(Lost::Camera) => s.hardware.camera.connected = false,
                Some(Lost::Rotation) => s.hardware.lose_axes(),
                None => {}
            }
            s.faults.push(shown);
        });
        raised
    }

    /// What to do about lost devices, if any are.
    fn way_out(&self) -> Option<String> {
        self.lost.first().map(|lost| lost.way_out().to_owned())
    }

    /// During a run the worker opens a lost camera again by itself, or ends the run; here it is shown.
    fn show_camera(&self) {
        let is_lost = self.camera.is_lost();
        if self.publisher.status().hardware.camera.connected == is_lost {
            self.publish(|s| s.hardware.camera.connected = !is_lost);
        }
    }

    /// At rest the devices are asked whether they are still there.
    fn look(&mut self) -> Result<(), StoreError> {
        if self.active.is_some() || self.search.is_some() {
            return Ok(());
        }
        if self.camera.is_lost() {
            self.lose(Lost::Camera, DeviceError::ControlLost)?;
        }
        self.search = self.instrument.take().map(search::begin);
        Ok(())
    }

    fn searched(&mut self, instrument: Instrument, found: search::Found) -> Result<(), StoreError> {
        let identity = instrument.rig.rotation.identity().to_owned();
        self.instrument = Some(instrument);
        match found.camera {
            Ok(()) => self.regain(Lost::Camera, |s| s.hardware.camera.connected = true)?,
            Err(error) => tracing::debug!(%error, "the camera is not back yet"),
        }
        match found.rotation {
            Ok(()) => self.regain(Lost::Rotation, |s| s.hardware.find_axes(&identity)),
            Err(error @ (DeviceError::Gone { .. } | DeviceError::Silent { .. })) => self.lose(Lost::Rotation, error),
            Err(error) => {
                tracing::debug!(%error, "the rotation axis is not back yet");
                Ok(())
            }
        }
    }

    /// A loss at rest is a fault of its own, raised once.
    fn lose(&mut self, device: Lost, error: DeviceError) -> Result<(), StoreError> {
        if self.lost.contains(&device) {
            return Ok(());
        }
        let fault = self.raise(&error.into());
        let why = self.way_out();
        self.publish(|s| {
            s.ready = false;
            s.not_ready_reason = why;
        });
        self.event("fault.raised", None, serde_json::to_value(&fault).unwrap_or_default())
    }

    /// What is back is a fault no more.
    fn regain(&mut self, device: Lost, connected: impl FnOnce(&mut Status)) -> Result<(), StoreError> {
        if !self.lost.contains(&device) {
            return Ok(());
        }
        self.lost.retain(|lost| *lost != device);
        let why = self.way_out();
        let over: Vec<u64> = self.publisher.status().faults.iter().filter(|f| device.is_all_of(f)).map(|f| f.seq).collect();
        self.publish(|s| {
            connected(s);
            s.faults.retain(|f| !over.contains(&f.seq));
            s.ready = why.is_none();
            s.not_ready_reason = why;
        });
        self.event("fault.cleared", None, serde_json::json!({ "seq": over, "why": device.is_back() }))
    }

    /// Puts the devices' first word into the status.
    fn at_rest(&mut self) -> Result<(), StoreError> {
        let mut interrupted = None;
        for run in self.store.close_interrupted()? {
            let event = self.journal.append("run.interrupted", Some(&run.id), None, serde_json::json!({"found": "at start"}))?;
            self.publisher.announce(event);
            interrupted = Some(run);
        }
        let loaded_from_outside = self.instrument.as_ref().is_some_and(|i| i.sampler.waits_for_loader());
        // The well under way is the first without a number; whether its specimen is still there only the loader can say.
        let left = interrupted.as_ref().filter(|_| loaded_from_outside).and_then(|run| {
            let under_way = run.wells.iter().find(|w| w.outcome == Some(SpecimenOutcome::Interrupted))?;
            Some(SpecimenStatus::new(&under_way.well, Phase::Eject, true, run.method.asd))
        });
        let second = self.instrument.as_ref().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
        let identities = self.instrument.as_ref().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
        let has_translation = self.config.translation.is_some();
        let disk_free_bytes = self.store.free_bytes();
        let calibration = self.calibration();
        self.publish(|s| {
            s.calibration = calibration;
            if let Some((rotation, camera)) = identities {
                s.hardware.translation = has_translation.then(super::TranslationStatus::default);
                s.hardware.find_axes(&rotation);
                s.hardware.camera.identity = Some(camera);
                s.hardware.camera.connected = true;
            }
            s.hardware.camera_second =
                second.map(|identity| super::CameraStatus { identity: Some(identity), connected: true, ..super::CameraStatus::default() });
            s.hardware.disk_free_bytes = disk_free_bytes;
            s.ready = true;
            s.not_ready_reason = None;
            if let Some(run) = &interrupted {
                s.plate.barcode = Some(run.plan.plate_barcode.clone());
                s.plate.removable = left.is_none();
                s.plate.needs = left.as_ref().map(take_out);
                s.run = Some(run_status(run));
                s.specimen = left;
            }
        });
        self.event("daemon.started", None, serde_json::json!({"version": env!("CARGO_PKG_VERSION"), "mode": self.mode}))
    }

    /// The rig's newest calibration, from disk.
    fn calibration(&self) -> Option<CalibrationStatus> {
        let config = &self.config;
        let found = calibrations::newest(&config.calibrations(), &config.rig_name, self.mode).unwrap_or_else(|error| {
            tracing::warn!(%error, "the rig's calibrations are not read");
            None
        });
        let size = found.map(|found| CalibrationStatus::new(found, config.calibration.max_age_days, jiff::Timestamp::now()));
        gate::beside(size, gate::newest(config, self.mode))
    }

    /// A calibration that has grown too old is a change of state, and told as one.
    fn calibration_ages(&self) {
        let now = jiff::Timestamp::now();
        let too_old = |c: &CalibrationStatus| c.valid && c.age_s(now).is_none_or(|age_s| age_s >= c.max_age_s);
        if self.publisher.status().calibration.as_ref().is_some_and(too_old) {
            self.publish(|s| s.calibration.iter_mut().for_each(|c| c.valid = false));
        }
    }

    fn command(&mut self, command: Command) {
        // A client that hung up before its answer is no reason to stop: what was decided stands.
        match command {
            Command::PutRun { id, plan, answer } => {
                let result = self.put_run(&id, plan);
                let _hung_up = answer.send(result);
            }
            Command::Abort { id, answer } => {
                let result = self.abort(&id);
                let _hung_up = answer.send(result);
            }
            Command::Loaded { run, well, loaded, answer } => {
                let result = if loaded { self.loaded(run, well) } else { self.unloaded(run, well) };
                let _hung_up = answer.send(result);
            }
        }
    }

    fn put_run(&mut self, id: &str, plan: RunPlan) -> Result<Accepted, Refusal> {
        if !is_plain_name(id) {
            let detail = format!("{id:?} is not a run's name: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'");
            return Err(Refusal::InvalidPlan(vec![FieldError { pointer: "/run_id".into(), detail }]));
        }
        if let Some(known) = self.store.run(id).map_err(Refusal::from)? {
            return if known.plan == plan { Ok(Accepted::Same) } else { Err(Refusal::OtherPlan { id: id.to_owned() }) };
        }
        plan.check(&self.config.methods).map_err(Refusal::InvalidPlan)?;
        gate::refuses(&self.config, self.mode, &plan).map_or(Ok(()), |mistake| Err(Refusal::InvalidPlan(vec![mistake])))?;
        if let Some(why) = self.way_out() {
            return Err(Refusal::DeviceLost { why });
        }
        if let (None, Some(left)) = (&self.active, self.publisher.status().specimen.as_ref().filter(|s| s.in_capillary)) {
            return Err(Refusal::CapillaryFull { well: left.well.clone() });
        }
        let now = self.publisher.status().state;
        let (true, Some(instrument)) = (STARTABLE.contains(&now), self.instrument.take()) else {
            return Err(Refusal::WrongState { state: now, accepted_in: STARTABLE.to_vec() });
        };
        match self.start(id, plan, instrument) {
            Ok(()) => Ok(Accepted::Created),
            Err(refused) => {
                let (instrument, e) = *refused;
                self.instrument = Some(instrument);
                Err(e.into())
            }
        }
    }

    /// Journals the run, then lets the worker go. On failure the instrument comes back.
    fn start(&mut self, id: &str, plan: RunPlan, instrument: Instrument) -> Result<(), Box<(Instrument, StoreError)>> {
        // `check` has looked it up; a plan that names no method never comes here.
        let Some(method) = self.config.methods.get(&plan.method).cloned() else {
            let error = StoreError::Format { path: id.into(), expected: "a known method", found: plan.method };
            return Err(Box::new((instrument, error)));
        };
        let record = RunRecord::new(id, plan, method.clone(), self.mode, self.config.empty_capillary.as_deref());
        let journalled = self.store.save_run(&record).and_then(|()| {
            self.journal.append(
                "run.accepted",
                Some(id),
                None,
                serde_json::json!({"plate_barcode": record.plan.plate_barcode, "method": record.plan.method}),
            )
        });
        match journalled {
            Ok(event) => self.publisher.announce(event),
            Err(e) => {
                // Not accepted: the same request must not read as known when it comes again.
                if let Err(error) = self.store.forget_run(id) {
                    tracing::error!(%error, "a run that was refused is still on disk");
                }
                return Err(Box::new((instrument, e)));
            }
        }
        self.gate.clear();
        let cancel = CancelToken::default();
        let stop = instrument.rig.rotation.stop_handle();
        let (progress_in, progress) = mpsc::channel(64);
        let context = RunContext {
            config: self.config.clone(),
            mode: self.mode,
            run: id.to_owned(),
            wells: record.plan.plate_map.clone(),
            eject_first: None,
            method_name: record.plan.method.clone(),
            method,
            folder: self.store.run_folder(id),
            cancel: cancel.clone(),
            pause: CancelToken::default(),
            progress: progress_in,
        };
        let worker = tokio::task::spawn_blocking(move || worker::run(instrument, &context));
        let calibration = self.calibration();
        let lacks_gate = gate::lacking(calibration.as_ref().and_then(|c| c.gate.as_ref()), &record.method, self.mode).is_some();
        self.go_with(Trigger::Start, |s| {
            s.calibration = calibration;
            s.run = Some(run_status(&record));
            s.specimen = None;
            s.faults.clear();
            s.plate = Plate { barcode: Some(record.plan.plate_barcode.clone()), present: true, removable: false, needs: None };
            s.pending = super::Pending::default();
            s.ready = false;
            s.not_ready_reason = Some("a run is under way".into());
        });
        self.active = Some(Active {
            record,
            cancel,
            stop,
            worker,
            progress,
            cut_short: None,
            waiting_for: None,
            well_seconds: Vec::new(),
            lacks_gate,
        });
        Ok(())
    }

    fn abort(&mut self, id: &str) -> Result<(), Refusal> {
        if self.active.as_ref().is_some_and(|a| a.record.id == id) {
            if self.publisher.status().state != State::Aborting {
                self.cut_short(RunOutcome::Aborted);
                self.publisher.publish(|s| s.pending.abort = true);
                self.go(Trigger::Abort);
                self.event("run.abort_requested", None, serde_json::Value::Null).map_err(Refusal::from)?;
            }
            return Ok(());
        }
        // A repeat after the end moves towards a state that is reached already.
        match self.store.run(id) {
            Ok(Some(run)) if run.outcome == Some(RunOutcome::Aborted) => Ok(()),
            Ok(Some(run)) => Err(Refusal::RunEnded { id: run.id, outcome: run.outcome }),
            Ok(None) => Err(Refusal::UnknownRun { id: id.to_owned(), newest: self.publisher.status().run.as_ref().map(|r| r.id.clone()) }),
            Err(e) => Err(e.into()),
        }
    }

    /// Motors first; the worker then ends by itself.
    fn cut_short(&mut self, outcome: RunOutcome) {
        if let Some(active) = &mut self.active {
            active.cut_short = Some(outcome);
            active.cancel.cancel();
            active.stop.stop();
        }
    }

    fn loaded(&mut self, run: String, well: String) -> Result<(), Refusal> {
        let Some(active) = self.active.as_mut().filter(|a| a.record.id == run) else {
            let status = self.publisher.status();
            return Err(match &status.run {
                Some(ended) if ended.id == run => Refusal::RunEnded { id: run, outcome: ended.outcome },
                newest => Refusal::UnknownRun { id: run, newest: newest.as_ref().map(|r| r.id.clone()) },
            });
        };
        if active.waiting_for.as_deref() == Some(well.as_str()) {
            self.event("well.loaded", Some(&well), serde_json::Value::Null)?;
            if let Some(active) = &mut self.active {
                active.waiting_for = None;
            }
            self.gate.say_loaded(&well);
            // From the loader's word on, not from when the worker takes it up: an abort may come before.
            self.go_with(Trigger::Loaded, |s| {
                s.plate.needs = None;
                if let Some(specimen) = s.specimen.as_mut().filter(|x| x.well == well) {
                    specimen.in_capillary = true;
                }
            });
            return Ok(());
        }
        // Said again after it was taken there is nothing more to do; said before it was asked for it would be lost.
        let current = self.publisher.status().specimen.as_ref().is_some_and(|s| s.well == well && s.in_capillary);
        if current { Ok(()) } else { Err(Refusal::UnexpectedWell { run, well }) }
    }

    /// The specimen has been taken out: after its well is done, or after a run that was cut short left it there.
    fn unloaded(&mut self, run: String, well: String) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let newest = status.run.as_ref().map(|r| r.id.clone());
        if newest.as_ref() != Some(&run) {
            return Err(Refusal::UnknownRun { id: run, newest });
        }
        match &status.specimen {
            // Said again, or said of a specimen that another has taken the place of.
            None => return Ok(()),
            Some(s) if s.well != well => return Ok(()),
            Some(s) if self.active.is_some() && s.phase != Phase::Eject => return Err(Refusal::UnexpectedWell { run, well }),
            Some(_) => {}
        }
        let at_rest = self.active.is_none();
        self.event("well.unloaded", Some(&well), serde_json::Value::Null).map_err(Refusal::from)?;
        self.publish(|s| {
            s.plate.needs = None;
            s.plate.removable = at_rest && !s.faults.iter().any(|f| f.category == "storage");
            match &mut s.specimen {
                Some(specimen) if !at_rest => specimen.in_capillary = false,
                specimen => *specimen = None,
            }
        });
        Ok(())
    }

    fn progress(&mut self, progress: Progress) -> Result<(), StoreError> {
        match progress {
            Progress::Ready => {
                if self.publisher.status().state == State::Starting {
                    self.go_with(Trigger::Ready, |s| {
                        s.hardware.camera.connected = true;
                        s.hardware.rotation.connected = true;
                    });
                }
                self.event("run.started", None, serde_json::Value::Null)?;
            }
            Progress::WaitingForLoader { well } => {
                if let Some(active) = &mut self.active {
                    active.waiting_for = Some(well.clone());
                }
                self.publish(|s| s.plate.needs = Some(format!("the specimen of well {well} in the capillary")));
                if self.publisher.status().state == State::Execute {
                    self.go(Trigger::WaitForLoader);
                }
                self.event("well.awaited", Some(&well), serde_json::Value::Null)?;
            }
            Progress::Phase { well, phase, in_capillary } => {
                let views_planned = self.active.as_ref().map_or(0, |a| a.record.method.asd);
                self.publish(|s| match &mut s.specimen {
                    Some(specimen) if specimen.well == well => {
                        specimen.phase = phase;
                        specimen.in_capillary = in_capillary;
                    }
                    _ => s.specimen = Some(SpecimenStatus::new(&well, phase, in_capillary, views_planned)),
                });
                self.event("specimen.phase", Some(&well), serde_json::json!({ "phase": phase }))?;
            }
            Progress::Detected { well, found, live } => {
                self.publisher.set_live(|l| *l = live);
                self.publish(|_| ());
                self.event("specimen.detected", Some(&well), serde_json::to_value(found).unwrap_or_default())?;
            }
            Progress::TriedAgain { well, attempt, why } => {
                let views_planned = self.active.as_ref().map_or(0, |a| a.record.method.asd);
                self.publish(|s| s.specimen = Some(SpecimenStatus::new(&well, Phase::Position, true, views_planned)));
                self.event("specimen.tried_again", Some(&well), serde_json::json!({"attempt": attempt, "why": why}))?;
            }
            Progress::View { well, index, closure, achieved_steps, volume_um3, light, live } => {
                self.publisher.set_live(|l| *l = live);
                let position_deg = self.config.steps_per_revolution.angle(crate::units::Steps(achieved_steps)).to_degrees();
                self.publish(|s| {
                    s.hardware.rotation.position_steps = Some(achieved_steps);
                    s.hardware.rotation.position_deg = Some(position_deg);
                    s.hardware.camera.light = light;
                    if let (Some(specimen), Some(volume_um3)) = (&mut s.specimen, volume_um3) {
                        specimen.view += 1;
                        specimen.volume_um3 = Some(volume_um3);
                        specimen.volumes_um3.push(volume_um3);
                    }
                });
                let data =
                    serde_json::json!({"index": index, "closure": closure, "achieved_steps": achieved_steps, "volume_um3": volume_um3});
                self.event("view.taken", Some(&well), data)?;
            }
            Progress::Model { well, glb } => {
                // Once the next specimen is looked at, the page shows that one.
                let shown = |s: &SpecimenStatus| s.well == well || matches!(s.phase, Phase::Load | Phase::Position);
                if self.publisher.status().specimen.as_ref().is_none_or(shown) {
                    self.publisher.set_live(|l| l.mesh_glb = Some(glb));
                    self.publish(|_| ());
                }
            }
            Progress::Hardware { rotation, translation, counters, second } => {
                let disk_free_bytes = self.store.free_bytes();
                self.publish(|s| {
                    s.hardware.rotation = rotation;
                    s.hardware.translation = translation;
                    s.hardware.disk_free_bytes = disk_free_bytes;
                    s.hardware.camera.count(&counters);
                    if let (Some(camera), Some(counters)) = (&mut s.hardware.camera_second, second) {
                        camera.count(&counters);
                    }
                });
            }
            Progress::WellDone { result, seconds, times, in_capillary } => self.well_done(result, seconds, &times, in_capillary)?,
        }
        Ok(())
    }

    /// All of a well is on disk; the next may be under way.
    fn well_done(&mut self, mut result: WellStatus, seconds: f64, times: &worker::WellTimes, in_capillary: bool) -> Result<(), StoreError> {
        let Some(active) = &mut self.active else { return Ok(()) };
        gate::flag(&mut result, active.lacks_gate);
        if let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == result.well) {
            *slot = result.clone();
        }
        if result.outcome == Some(SpecimenOutcome::Succeeded) {
            active.well_seconds.push(seconds);
        }
        self.store.save_run(&active.record)?;
        let mut status = run_status(&active.record);
        status.eta_s = eta(&active.well_seconds, status.wells.pending);
        // One revision: counters and phase change together, so that no reader sees a gap between two wells.
        let views_planned = active.record.method.asd;
        let next = active.record.wells.iter().find(|w| w.outcome.is_none()).map(|w| w.well.clone());
        self.publish(|s| {
            s.run = Some(status);
            match next {
                // The next one is brought already while the numbers of this one were made.
                _ if s.specimen.as_ref().is_some_and(|x| x.well != result.well) => {}
                Some(next) => s.specimen = Some(SpecimenStatus::new(&next, Phase::Load, false, views_planned)),
                None => {
                    if let Some(specimen) = &mut s.specimen {
                        specimen.in_capillary = in_capillary;
                    }
                }
            }
        });
        let mut data = serde_json::to_value(&result).unwrap_or_default();
        data["times"] = serde_json::to_value(times).unwrap_or_default();
        self.event("specimen.done", Some(&result.well), data)?;
        Ok(())
    }

    fn worker_ended(&mut self, ended: (Instrument, RunEnd), stopping: bool) {
        let (instrument, end) = ended;
        self.instrument = Some(instrument);
        let Some(active) = &mut self.active else { return };
        // Whoever cut it short was told so: that is its outcome, also where the last well was done in the same moment.
        let (outcome, fault) = match (active.cut_short, end) {
            (_, RunEnd::Failed(error)) => (RunOutcome::Failed, Some(error)),
            (Some(outcome), _) => (outcome, None),
            (None, RunEnd::AllWells) => (RunOutcome::of_wells(&active.record.wells), None),
            (None, RunEnd::Cancelled | RunEnd::Paused) => (RunOutcome::Interrupted, None),
        };
        let left = if outcome == RunOutcome::Aborted { SpecimenOutcome::Aborted } else { SpecimenOutcome::Interrupted };
        let reason = match (&fault, outcome) {
            (Some(error), _) => error.to_string(),
            (None, RunOutcome::Aborted) => "the run was aborted".into(),
            (None, RunOutcome::Failed) => "the run could not be stored".into(),
            _ => "the daemon was stopped".into(),
        };
        for well in active.record.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end(left, Some(&reason));
        }
        active.record.end(outcome);
        let status = run_status(&active.record);
        gate::keep(&self.config, &self.store.run_folder(&active.record.id));
        let saved = self.store.save_run(&active.record);
        if let Some(error) = &fault {
            let fault = self.raise(error);
            let journalled = self.event("fault.raised", None, serde_json::to_value(&fault).unwrap_or_default());
            self.keep(journalled);
        }
        let ended = self.event("run.ended", None, serde_json::json!({ "outcome": outcome, "wells": status.wells }));
        self.keep(saved.and(ended));
        let stored = !std::mem::take(&mut self.store_failed);
        self.active = None;
        if !stopping {
            match self.publisher.status().state {
                State::Aborting => {}
                _ if fault.is_some() => self.go(Trigger::Abort),
                _ => self.go(Trigger::WellsDone),
            }
        }
        let lost = self.way_out();
        let calibration = self.calibration();
        // The end and all that follows from it are one revision.
        let change = |s: &mut Status| {
            s.run = Some(status);
            s.calibration = calibration;
            // Only who takes a specimen out knows that it is out.
            s.specimen = s.specimen.take().filter(|x| x.in_capillary);
            s.plate.removable = s.specimen.is_none() && stored;
            s.plate.needs = s.specimen.as_ref().map(take_out);
            s.pending = super::Pending { stop: stopping, ..super::Pending::default() };
            s.not_ready_reason = if stopping { Some("shutting down".into()) } else { lost };
            s.ready = s.not_ready_reason.is_none();
        };
        match self.publisher.status().state {
            _ if stopping => self.publish(change),
            State::Aborting => self.go_with(Trigger::MotorsStopped, change),
            _ => self.go_with(Trigger::Recorded, change),
        }
    }
}

/// What the loader is asked for while a specimen is left in the capillary.
fn take_out(specimen: &SpecimenStatus) -> String {
    format!("the specimen of well {} to be taken out of the capillary", specimen.well)
}

fn run_status(record: &RunRecord) -> RunStatus {
    RunStatus {
        id: record.id.clone(),
        external_id: record.plan.external_id.clone(),
        method: record.plan.method.clone(),
        operator: record.plan.operator.clone(),
        wells: WellCounts::of(&record.wells),
        results: record.wells.clone(),
        started: record.started.clone(),
        ended: record.ended.clone(),
        eta_s: None,
        outcome: record.outcome,
    }
}

/// From this run's own measured wells; nothing is promised before the first.
fn eta(well_seconds: &[f64], pending: u32) -> Option<Eta> {
    let mut sorted = well_seconds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |q: f64| sorted.get(((sorted.len() as f64 * q) as usize).min(sorted.len().saturating_sub(1))).copied();
    Some(Eta { p50: at(0.5)? * f64::from(pending), p90: at(0.9)? * f64::from(pending) })
}
