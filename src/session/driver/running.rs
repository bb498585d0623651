//! The driver at work. It asks its parts what to do, and does it. All effects are here: events, records, revisions of the status, workers,
//! background tasks. The decisions are in the parts.
//!
//! ```text
//! start ──► launch ──► worker ──► worker_ended ─┬─ all wells ──► finish ──► close ───────► Complete
//!             ▲                                 ├─ paused, failed ──► rest ──► Held ──┐
//!             │                                 └─ stop, abort, shut-down ──► end_run ──► end_now ──► Stopped, Aborted
//!             └──────────── unhold (operator, or by itself) ◄─────────────────────────┘
//! ```
//! `finish` and `end_run` wait for the numbers of specimens that were released.

use super::super::handle::{Accepted, Command, Publisher, Refusal, Towards};
use super::super::preflight;
use super::super::search::DevicesFound;
use super::super::state::{self, HOLDABLE, Trigger};
use super::super::worker::{self, Instrument, Progress, RunContext, RunEnd, RunError};
use super::super::{CameraStatus, Live, OutputStatus, Shown, SpecimenStatus, State, Status, TranslationStatus, fault, gate};
use super::devices::{Devices, Done, Finding, PreflightRequest, findings, intervention};
use super::handling::Waited;
use super::interrupt::{Course, Fate, interruptions};
use super::loader::{Loader, LoaderMessage, capillary_full};
use super::outbox::Outbox;
use super::plates::Surroundings;
use super::progress::{Hardware, View, show_done, show_estimate, show_hardware, show_phase, show_view};
use super::recovery::{self, Attempt, Continuation, Made, Recovered};
use super::room::{self, DiskRoom};
use super::run::{AfterWork, Request, RunInProgress, Work};
use super::sealing::{seal_run, seal_well};
use super::snapshot::{self, Parts, left_specimen, run_status};
use super::{Departure, Driver, Life, commands, faults, resume, start};
use crate::api::{self, HandoffNeeds};
use crate::config::Config;
use crate::notify::Notices;
use carved_core::units::Steps;
use carved_devices::DeviceError;
use carved_devices::cancel::CancelToken;
use carved_records::Method;
use carved_records::{
    AttemptFailed, CalibrationStatus, Capillary, DaemonStarted, Device, EndRequest, Event, EventData, Fault, FaultsCleared, Handoff,
    HandoffEnd, HeldBy, InstrumentIdentity, InstrumentState, LoadedBy, Mode, Phase, PhaseEntered, PlannedWell, RecoveryBegun, ResumedBy,
    RunAccepted, RunEnded, RunHeld, RunInterrupted, RunPlan, RunResumed, RunState, SpecimenDone, SpecimenInterrupted, ViewTaken,
    WellCounts, WellStatus, WellTimes, fault_table,
};
use carved_store::{RunRecord, StoreError};
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::sync::oneshot;

/// The parts of the driver.
pub(super) struct Running {
    pub(super) config: Arc<Config>,
    identity: InstrumentIdentity,
    mode: Mode,
    pub(super) publisher: Publisher,
    notices: Option<Notices>,
    pub(super) outbox: Outbox,
    pub(super) devices: Devices,
    pub(super) loader: Loader,
    room: DiskRoom,
    /// The rig's newest calibration, as of the last lookup.
    calibration: Option<CalibrationStatus>,
    pub(super) run: Option<RunInProgress>,
    pub(super) life: Life,
}

/// A client may disconnect before its answer. The decision still stands.
fn reply<T>(answer: oneshot::Sender<Result<T, Refusal>>, result: Result<T, Refusal>) {
    let _hung_up = answer.send(result);
}

// Start, heartbeat and end of the daemon.
impl Running {
    pub fn new(driver: Driver) -> Self {
        let Driver { config, mode, store, journal, publisher, instrument, identity, interlock, notices, heartbeat: _ } = driver;
        publisher.halt().aim(instrument.rig.rotation.stop_handle(), CancelToken::default());
        // The tail of the journal is not enough: most events are views, and after some dozen wells it no longer names the plate.
        let remembered = store.remembered().unwrap_or_else(|error| {
            tracing::error!(%error, "the journal cannot be read; its newest events are all that is remembered");
            publisher.tail().iter().map(|event| Event::clone(event)).collect()
        });
        Self {
            outbox: Outbox::new(store, journal, publisher.log(), InstrumentState::after(&remembered)),
            loader: Loader::new(interlock, instrument.sampler.as_ref()),
            devices: Devices::new(instrument),
            config,
            identity,
            mode,
            publisher,
            notices,
            room: DiskRoom::default(),
            calibration: None,
            run: None,
            life: Life::Starting,
        }
    }

    /// Shows the devices, then the state that the previous process left. If the disk refuses writes, that is a fault and not the end of the
    /// daemon.
    pub fn first_report(&mut self) {
        let second = self.devices.at_rest().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
        let identities = self.devices.at_rest().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
        let has_translation = self.config.translation.is_some();
        let outputs: Vec<OutputStatus> = self.config.rotation.outputs().into_iter().map(Into::into).collect();
        let disk_free_bytes = self.outbox.store().free_bytes();
        let calibration = gate::calibration(&self.config, self.mode);
        let open = self.open_runs();
        self.event(None, EventData::DaemonStarted(DaemonStarted { version: env!("CARGO_PKG_VERSION").into(), mode: self.mode }));
        self.calibration = calibration;
        self.publish(|s| {
            if let Some((rotation, camera)) = identities {
                s.hardware.translation = has_translation.then(TranslationStatus::default);
                s.hardware.find_axes(&rotation);
                s.hardware.outputs = outputs;
                s.hardware.camera.identity = Some(camera);
                s.hardware.camera.connected = true;
            }
            s.hardware.camera_second =
                second.map(|identity| CameraStatus { identity: Some(identity), connected: true, ..CameraStatus::default() });
            s.hardware.disk_free_bytes = disk_free_bytes;
        });
        self.life = Life::Up;
        if let Some(record) = open {
            let run = start::run_after(&record.id, &start::events_of(self.outbox.store(), &self.publisher, &record.id));
            self.take_up(record, run);
        } else if let Some(record) = start::ended_run(self.outbox.store(), self.mode) {
            self.show_again(&record);
        } else {
            self.publish(|_| ());
        }
    }

    /// The newest open run, if it can continue. The other open runs are ended here.
    fn open_runs(&mut self) -> Option<RunRecord> {
        let open = match self.outbox.store().open_runs() {
            Ok(open) => open,
            Err(error) => {
                self.keep(Err(error));
                return None;
            }
        };
        let (unaccepted, open): (Vec<RunRecord>, _) =
            open.into_iter().partition(|run| start::is_not_accepted(self.outbox.store(), &run.id));
        for run in unaccepted {
            // A repeat of the request must not be answered as known.
            let forgotten = self.outbox.store().forget_run(&run.id);
            self.keep(forgotten);
        }
        let (newest, others) = start::newest_of(open, self.mode);
        for mut run in others {
            seal_run(self.outbox.store(), &run.id);
            run.end_interrupted();
            let id = run.id.clone();
            self.save(run);
            let interrupted = RunInterrupted { found: "at start".into(), loaded_by: None };
            self.outbox.happened(Some(&id), None, EventData::RunInterrupted(interrupted));
            self.write();
        }
        newest
    }

    /// Shows an ended run as before the restart, until the next run starts.
    fn show_again(&mut self, record: &RunRecord) {
        let events = start::events_of(self.outbox.store(), &self.publisher, &record.id);
        let run = start::run_after(&record.id, &events);
        let state = start::rests_in(record.outcome, run.end_request());
        self.outbox.recall(run);
        let change = self.over(record);
        self.publish(|s| {
            change(s);
            s.state = state;
        });
    }

    /// Takes up a run that the previous process left open.
    fn take_up(&mut self, record: RunRecord, run: RunState) {
        let asd = record.method.asd;
        let status = run_status(&record);
        let end_request = run.end_request();
        self.outbox.recall(run);
        self.run = Some(RunInProgress::new(record));
        let by_loader = self.loader.fills_capillary();
        let loaded_by = if by_loader { LoadedBy::Loader } else { LoadedBy::Sampler };
        self.event(None, EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by: Some(loaded_by) }));
        let (known, capillary) = (self.outbox.state().run.as_ref(), snapshot::capillary(self.outbox.state()));
        if let Some(run) = &mut self.run {
            // Set this before publishing, so that no client reads that the run waits for a person.
            run.recall(end_request);
            run.set_may_go_on(end_request.is_none() && resume::is_automatic(run, known));
            // A specimen that the loader brought stays: the run continues with it.
            if let Some(inside) = capillary.inside().filter(|inside| capillary.brought() != Some(inside)) {
                run.handling_mut().remove(inside, by_loader);
            }
        }
        let left = self.left_specimen(asd);
        self.go_with(Trigger::TakeUp, |s: &mut Status| {
            s.run = Some(status);
            s.specimen = left;
        });
        self.interrupt_specimens("the daemon ended before this specimen was done", Fate::PoseLost);
        if let Some(run) = &self.run {
            // Save the wells that were given up, so that they stay so whatever happens before the run continues.
            let (record, status) = (run.record().clone(), run_status(run.record()));
            self.save(record);
            self.publish(|s| s.run = Some(status));
        }
        self.recover();
        match end_request {
            Some(end) => {
                self.go(if end == EndRequest::Stop { Trigger::Stop } else { Trigger::Abort });
                self.end_run();
            }
            None => self.resume_by_itself(),
        }
    }

    pub fn beat(&mut self) {
        self.calibration_ages();
        self.show_index();
        self.show_notices();
        if !self.life.is_stopping() {
            // Before the device check: the check takes the instrument, and a run that continues needs it.
            self.try_the_store();
            self.look();
            self.look_for_room();
        }
    }

    pub fn shut_down(&mut self, departure: Departure) {
        self.life = Life::Stopping(departure);
        self.ask(Request::ShutDown);
        self.go(Trigger::ShutDown);
        if self.run.is_some() {
            self.event(None, EventData::DaemonStopping);
        }
        if self.has_idle_run() {
            self.end_run();
        }
    }

    /// Whether no run and no background task is in progress.
    pub fn is_at_rest(&self) -> bool {
        self.run.is_none() && !self.devices.are_busy()
    }

    /// Writes the daemon's last event, and tries once more to write what is not on disk.
    pub fn final_report(&mut self) -> Result<(), StoreError> {
        let stopped = self.promise(None, EventData::DaemonStopped);
        if self.outbox.waiting() > 0 {
            tracing::error!(waiting = self.outbox.waiting(), "the daemon ends with events and records that the disk did not take");
        }
        stopped
    }
}

// What the parts know.
impl Running {
    /// The state that follows from the events.
    pub fn state(&self) -> &InstrumentState {
        self.outbox.state()
    }

    pub fn capillary(&self) -> &Capillary {
        snapshot::capillary(self.state())
    }

    fn is(&self, run: &str) -> bool {
        self.run.as_ref().is_some_and(|r| r.record().id == run)
    }

    fn works(&self) -> bool {
        self.run.as_ref().is_some_and(RunInProgress::works)
    }

    /// Whether the run has no worker.
    fn has_idle_run(&self) -> bool {
        self.run.as_ref().is_some_and(|r| !r.works())
    }

    pub fn is_held_by_operator(&self) -> bool {
        self.state().run.as_ref().is_some_and(RunState::is_held_by_operator)
    }

    /// Whether the daemon ends without ending the run. An end that was asked for earlier comes first.
    fn leaves_run(&self) -> bool {
        self.life == Life::Stopping(Departure::LeavesRun) && self.run.as_ref().is_some_and(|run| run.request() == Request::ShutDown)
    }

    fn left_specimen(&self, views_planned: u32) -> Option<SpecimenStatus> {
        left_specimen(self.capillary(), self.publisher.status().specimen.as_ref(), views_planned)
    }

    fn nothing_stands_in_the_way(&self) -> Result<(), Refusal> {
        faults::stands_in_the_way(&self.state().faults, self.devices.lost())
    }

    /// The wells of the current run of which only the numbers are missing.
    fn accepted(&self) -> VecDeque<PlannedWell> {
        let run = self.run.as_ref().map(RunInProgress::record);
        run.map_or_else(VecDeque::new, |record| recovery::accepted(&self.outbox.store().run_folder(&record.id), record))
    }

    /// Whether the run measures larvae without a valid bead gate.
    fn lacks_gate(&self) -> bool {
        let newest = gate::calibration(&self.config, self.mode).and_then(|c| c.gate);
        self.run.as_ref().is_some_and(|run| gate::lacking(newest.as_ref(), &run.record().method, self.mode).is_some())
    }
}

// Publishing and writing.
impl Running {
    /// Makes a transition of the state table. Every state on the way is published as a revision of its own.
    pub fn go(&self, trigger: Trigger) {
        self.go_with(trigger, |_| ());
    }

    /// As `go`, with a change that is published in the same revision as the first state.
    pub fn go_with(&self, trigger: Trigger, change: impl FnOnce(&mut Status)) {
        let from = self.publisher.status().state;
        let Some(path) = state::next(from, trigger) else {
            tracing::error!(?from, ?trigger, "no such transition");
            return self.publish(change);
        };
        let mut change = Some(change);
        for &to in path {
            let change = change.take();
            self.publish(|s| {
                s.state = to;
                if let Some(change) = change {
                    change(s);
                }
            });
        }
        if let Some(change) = change {
            self.publish(change);
        }
    }

    /// Publishes a change and everything that follows from it as one revision.
    pub fn publish(&self, change: impl FnOnce(&mut Status)) {
        let parts = Parts {
            state: self.outbox.state(),
            run: self.run.as_ref(),
            loader: &self.loader,
            lost: self.devices.lost(),
            is_checked: self.devices.are_checked(),
            no_room: self.room.lacking(),
            is_failing: self.outbox.is_failing(),
            calibration: self.calibration.as_ref(),
            life: self.life,
            now: jiff::Timestamp::now(),
        };
        self.publisher.publish(|s| {
            change(s);
            parts.derive(s);
        });
    }

    /// Records an event of the current run, or of no run.
    pub fn event(&mut self, well: Option<&str>, data: EventData) {
        self.event_shown(well, data, |_| ());
    }

    /// Shows an event before it is written: if the disk hangs, clients must still see a fault or a state.
    fn event_shown(&mut self, well: Option<&str>, data: EventData, show: impl FnOnce(&Self)) {
        let run = self.run.as_ref().map(|run| run.record().id.as_str());
        self.outbox.happened(run, well, data);
        show(self);
        self.write();
    }

    fn write(&mut self) {
        let written = self.outbox.flush();
        self.keep(written);
    }

    /// Writes a run's record, after all earlier events.
    fn save(&mut self, record: RunRecord) {
        self.outbox.save(record);
        self.write();
    }

    /// Writes the event of a command. If the disk refuses it, the command has no effect.
    fn promise(&mut self, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        let run = self.run.as_ref().map(|run| run.record().id.as_str());
        self.outbox.promise(run, well, data)
    }

    /// Handles a failed write: it holds the run. The motors stop first, then the fault is raised. What could not be written is shown all
    /// the same, and the plate is not removable.
    pub fn keep(&mut self, written: Result<(), StoreError>) {
        let Err(error) = written else { return };
        tracing::error!(%error, "not stored");
        self.publisher.log().tally().store_refused();
        let works = self.works();
        if works {
            self.ask(Request::Halt);
        }
        // The fault is written after the failed write. A second failure raises no new fault.
        if !self.outbox.set_failing(true) {
            self.raise(&error.into());
        }
        if works && HOLDABLE.contains(&self.publisher.status().state) {
            self.go(Trigger::Hold);
        }
    }

    /// Tries a failed disk again. What is not on disk yet is written first.
    pub fn try_the_store(&mut self) {
        if !self.outbox.is_failing() || self.works() || !room::is_worth_a_retry(self.outbox.store()) {
            return;
        }
        let written = match &self.run {
            Some(run) => self.outbox.promise_with(run.record(), EventData::StoreRegained),
            None => self.outbox.promise(None, None, EventData::StoreRegained),
        };
        if let Err(error) = written {
            tracing::warn!(%error, "the disk does not take writes yet");
            return;
        }
        self.outbox.set_failing(false);
        self.fault_over(Fault::is_of_storage, "the disk takes writes again", |_| ());
        self.resume_by_itself();
    }
}

// Faults and devices.
impl Running {
    pub fn raise(&mut self, error: &RunError) {
        let raised = fault::of(self.state().faults.newest() + 1, error);
        let lost = fault::lost_device(error);
        if let Some(lost) = lost {
            self.devices.lose(lost);
        }
        self.event_shown(None, EventData::FaultRaised(raised), |d| {
            d.publish(|s| match lost {
                Some(Device::Camera) => s.hardware.camera.connected = false,
                Some(Device::Rotation | Device::Pictures) => s.hardware.lose_axes(),
                None => {}
            });
        });
    }

    /// Clears the faults that are over, then shows the change.
    fn fault_over(&mut self, is_over: impl Fn(&Fault) -> bool, why: &str, change: impl FnOnce(&mut Status)) {
        let seq = self.state().faults.open().iter().filter(|f| is_over(f)).map(|f| f.seq).collect();
        self.event(None, EventData::FaultsCleared(FaultsCleared { seq, why: why.to_owned() }));
        self.publish(change);
    }

    pub fn acknowledge(&mut self, seq: u64) -> Result<(), Refusal> {
        if let Some((known, ends)) = faults::acknowledge(&self.state().faults, seq)? {
            self.promise(None, EventData::FaultAcknowledged(known))?;
            if ends {
                self.publish(|_| ());
            }
        }
        Ok(())
    }

    /// Aborts the run. The motors have stopped already. No run starts before an operator acknowledges the fault.
    pub fn emergency_stopped(&mut self) -> Result<(), Refusal> {
        self.emergency_pressed();
        self.outbox.on_disk()
    }

    /// Handles the emergency stop once, however often it was pressed.
    pub fn emergency_pressed(&mut self) {
        if !self.publisher.halt().take() {
            return;
        }
        if !faults::is_open(&self.state().faults, fault_table::EMERGENCY_STOP.code) {
            let (seq, since) = (self.state().faults.newest() + 1, jiff::Timestamp::now().to_string());
            let fault = Fault::new(seq, &fault_table::EMERGENCY_STOP, fault_table::EMERGENCY_STOP.meaning.into(), since);
            self.event_shown(None, EventData::FaultRaised(fault), |d| d.publish(|_| ()));
        }
        let state = self.publisher.status().state;
        if self.run.is_some() && state != State::Aborting {
            self.abort();
        } else if self.run.is_none() && state != State::Aborted {
            self.go(Trigger::Abort);
            self.go(Trigger::MotorsStopped);
        }
    }

    /// Shows whether the camera is lost. During a run the worker reopens a lost camera by itself, or ends.
    pub fn show_camera(&self) {
        let is_lost = self.devices.camera_is_lost();
        if self.publisher.status().hardware.camera.connected == is_lost {
            self.publish(|s| s.hardware.camera.connected = !is_lost);
        }
    }

    /// Shows whether the index holds all that is on disk.
    fn show_index(&self) {
        let trouble = self.outbox.store().index_trouble();
        if self.publisher.status().hardware.index_trouble != trouble {
            if trouble.is_some() {
                self.publisher.log().tally().index_failed();
            }
            self.publish(|s| s.hardware.index_trouble = trouble);
        }
    }

    /// Shows whether notices reach their receiver.
    fn show_notices(&self) {
        let found = self.notices.as_ref().map(Notices::status);
        if self.publisher.status().notices != found {
            self.publish(|s| s.notices = found);
        }
    }

    /// Publishes a revision when the calibration or the bead gate becomes too old.
    fn calibration_ages(&mut self) {
        if self.calibration.as_mut().is_some_and(|c| c.grows_too_old(jiff::Timestamp::now())) {
            self.publish(|_| ());
        }
    }

    /// Checks the free space between runs, which other programs also use.
    pub fn look_for_room(&mut self) {
        let lacking = if self.run.is_none() { room::look(&self.config, self.outbox.store()) } else { None };
        if self.room.note(lacking) {
            self.publish(|_| ());
        }
    }

    /// Checks the devices between runs.
    pub fn look(&mut self) {
        if self.devices.at_rest().is_none() {
            return;
        }
        if self.devices.camera_is_lost() {
            self.lose(Device::Camera, DeviceError::ControlLost);
        }
        self.devices.begin_look();
    }

    pub fn task_done(&mut self, done: Done) {
        match done {
            Done::Searched(found) => self.searched(found),
            Done::Preflight(seen, request) => {
                let PreflightRequest { plan, answer } = *request;
                if let Some(taken) = seen.intervention().and_then(intervention) {
                    self.find(taken);
                }
                let store = self.outbox.store();
                let known = preflight::Known {
                    status: &self.publisher.status(),
                    mode: self.mode,
                    gate: self.calibration.as_ref().and_then(|c| c.gate.as_ref()),
                    plate_handed_over: self.state().plate.handed_over(),
                    free_bytes: store.free_bytes(),
                    budget: room::budget(&self.config, store),
                };
                let checks = preflight::checks(&self.config, &plan, &seen, &known);
                // Publish first: when the client reads the answer, a run can be accepted again.
                self.publish(|_| ());
                reply(answer, Ok(checks));
            }
        }
        self.go_on_if_it_may();
    }

    pub fn searched(&mut self, found: DevicesFound) {
        let was_lost = self.devices.lost().is_some();
        let outputs = found.outputs.iter().cloned().map(OutputStatus::from).collect::<Vec<_>>();
        for finding in findings(found) {
            self.find(finding);
        }
        if !outputs.is_empty() && outputs != self.publisher.status().hardware.outputs {
            self.publish(|s| s.hardware.outputs = outputs);
        }
        let seen = self.devices.at_rest().and_then(|instrument| instrument.sampler.sees_specimen());
        self.read_wire(seen);
        // A run that this loss has held may continue.
        if was_lost && self.devices.lost().is_none() {
            self.resume_by_itself();
        }
    }

    fn find(&mut self, finding: Finding) {
        match finding {
            Finding::There(device) => self.find_again(device),
            Finding::Lost(device, error) => self.lose(device, error),
            Finding::Stands(code, error) => {
                if !faults::is_open(&self.state().faults, code) {
                    self.raise(&error.into());
                }
            }
        }
    }

    /// Raises the fault of a device that was lost between runs, once.
    fn lose(&mut self, device: Device, error: DeviceError) {
        if !self.devices.has_lost(device) {
            self.raise(&error.into());
        }
    }

    fn find_again(&mut self, device: Device) {
        let identity = self.devices.at_rest().map(|instrument| instrument.rig.rotation.identity().to_owned()).unwrap_or_default();
        let connected = |s: &mut Status| match device {
            Device::Camera => s.hardware.camera.connected = true,
            Device::Rotation | Device::Pictures => s.hardware.find_axes(&identity),
        };
        if self.devices.find(device) {
            self.fault_over(|fault| device.is_all_of(fault), device.is_back(), connected);
        }
        // A controller that was held when the port was opened sends its version only once it is free.
        if device == Device::Rotation && self.publisher.status().hardware.rotation.identity.as_deref() != Some(&identity) {
            self.publish(connected);
        }
    }

    /// Reads the sampler's sensor for a specimen in the capillary, while there is no run and the capillary should be empty.
    fn read_wire(&mut self, seen: Option<bool>) {
        let Some(seen) = seen.filter(|_| self.run.is_none() && self.capillary().inside().is_none()) else { return };
        let reading = self.loader.read_wire(seen);
        if reading.is_news {
            self.publish(|_| ());
        }
        if reading.unexpected {
            self.find(Finding::Stands(fault_table::SAMPLER_FAILED.code, DeviceError::Unasked));
        }
    }
}

// Commands.
impl Running {
    pub fn command(&mut self, command: Command) {
        match command {
            Command::PutRun { id, plan, answer } => reply(answer, self.put_run(&id, plan)),
            Command::Steer { id, towards, answer } => reply(answer, self.steer(&id, towards)),
            Command::EmergencyStop { answer } => reply(answer, self.emergency_stopped()),
            Command::Acknowledge { seq, answer } => reply(answer, self.acknowledge(seq)),
            Command::Loaded { run, well, loaded: true, answer } => reply(answer, self.loaded(&run, &well)),
            Command::Loaded { run, well, loaded: false, answer } => reply(answer, self.unloaded(&run, &well)),
            Command::Handoff { plate, answer } => reply(answer, self.handoff(plate)),
            Command::EndHandoff { end, answer } => reply(answer, self.end_handoff(end)),
            Command::Preflight { plan, answer } => self.preflight(plan, answer),
        }
    }

    fn put_run(&mut self, id: &str, plan: RunPlan) -> Result<Accepted, Refusal> {
        commands::is_named_well(id)?;
        let store = self.outbox.store();
        if let Some(known) = store.run(id).map_err(Refusal::from)? {
            return if known.plan == plan { Ok(Accepted::Same) } else { Err(Refusal::OtherPlan { id: id.to_owned() }) };
        }
        if store.reader().was_accepted(id).unwrap_or(false) {
            return Err(Refusal::Pruned { id: id.to_owned() });
        }
        plan.check(&self.config.methods).map_err(Refusal::InvalidPlan)?;
        gate::refuses(&self.config, self.mode, &plan).map_or(Ok(()), |mistake| Err(Refusal::InvalidPlan(vec![mistake])))?;
        let status = self.publisher.status();
        commands::is_startable(self.run.is_some(), status.state)?;
        self.nothing_stands_in_the_way()?;
        if let Some(left) = self.loader.has_to_take_out(self.capillary()) {
            return Err(capillary_full(status.run.as_ref().map(|newest| newest.id.as_str()), left));
        }
        commands::is_of_this_plate(&plan, &self.state().plate)?;
        let method = self.config.methods.get(&plan.method).cloned().ok_or_else(|| commands::unknown_method(&plan))?;
        if self.devices.at_rest().is_none() {
            return Err(Refusal::Busy);
        }
        room::fits(&self.config, self.outbox.store(), preflight::needed_bytes(&self.config, &method, plan.plate_map.len()))?;
        self.start(id, plan, method)?;
        Ok(Accepted::Created)
    }

    fn steer(&mut self, id: &str, towards: Towards) -> Result<(), Refusal> {
        let status = self.publisher.status();
        if !self.is(id) {
            let stored = self.outbox.store().run(id).map_err(Refusal::from)?;
            return commands::steer_ended(id, towards, stored, status.run.as_ref().map(|r| r.id.as_str()), status.state);
        }
        if !commands::steer(towards, status.state)? {
            return Ok(());
        }
        match towards {
            Towards::Abort => {
                self.abort();
                self.outbox.on_disk()
            }
            Towards::Stop => self.stop(),
            Towards::Hold => self.hold(status.state),
            Towards::Unhold => self.unhold(ResumedBy::Operator),
        }
    }

    fn loader_message<'a>(&'a self, run: &'a str, well: &'a str, status: &'a Status) -> LoaderMessage<'a> {
        let newest = status.run.as_ref().map(|newest| (newest.id.as_str(), newest.outcome));
        let wanted = self.run.as_ref().map(RunInProgress::handling);
        LoaderMessage { run, well, newest, capillary: self.capillary(), wanted }
    }

    /// The run that an event of the loader belongs to. `None` if the run was pruned: its folder must not be created again.
    fn run_of_event<'a>(&self, run: &'a str) -> Option<&'a str> {
        self.outbox.store().run_folder(run).is_dir().then_some(run)
    }

    fn loaded(&mut self, run: &str, well: &str) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let Some(loaded) = self.loader_message(run, well, &status).loaded()? else { return Ok(()) };
        self.outbox.promise(self.run_of_event(run), Some(well), EventData::WellLoaded(loaded))?;
        let waited = self.run.as_mut().map(|run| run.handling_mut().brought());
        match waited {
            Some(Waited::ForIt) if status.state == State::Suspended => {
                self.loader.say_loaded(well);
                self.go(Trigger::Loaded);
            }
            Some(Waited::ForTheFormer) if status.state == State::Suspended => {
                self.go(Trigger::Loaded);
                self.proceed();
            }
            // In a held run it waits for the continuation, and is not brought again. In a run that ends it stays inside.
            Some(_) => self.publish(|_| ()),
            None => {
                let views_planned = self.outbox.store().run(run).ok().flatten().map_or(0, |record| record.method.asd);
                let left = self.left_specimen(views_planned);
                self.publish(|s| s.specimen = left);
            }
        }
        Ok(())
    }

    fn unloaded(&mut self, run: &str, well: &str) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let worked_on = status.specimen.as_ref().filter(|s| self.works() && s.phase != api::Phase::Eject).map(|s| s.well.as_str());
        if !self.loader_message(run, well, &status).unloaded(worked_on)? {
            return Ok(());
        }
        let was_kept = self.capillary().brought() == Some(well);
        self.outbox.promise(self.run_of_event(run), Some(well), EventData::WellUnloaded)?;
        if was_kept && !self.loader.brings_again() {
            self.give_up(well, "somebody took its specimen out, and the sampler brings none twice");
        }
        let waited = self.run.as_mut().is_some_and(|run| run.handling_mut().taken_out(well));
        let at_rest = self.run.is_none();
        let change = |s: &mut Status| drop(s.specimen.take_if(|_| at_rest));
        if waited && status.state == State::Suspended {
            self.go_with(Trigger::Loaded, change);
            self.proceed();
        } else {
            self.publish(change);
        }
        Ok(())
    }

    fn surroundings<'a>(&'a self, status: &'a Status) -> Surroundings<'a> {
        Surroundings { state: status.state, has_run: self.run.is_some(), capillary: self.capillary(), is_failing: self.outbox.is_failing() }
    }

    /// Announces that a plate will be moved. Returns what must happen first.
    pub fn handoff(&mut self, plate: Handoff) -> Result<HandoffNeeds, Refusal> {
        let status = self.publisher.status();
        if self.surroundings(&status).announce(&self.state().plate, &plate)? {
            self.promise(None, EventData::PlateAnnounced(plate.clone()))?;
            self.publish(|_| ());
        }
        Ok(HandoffNeeds { intent: plate.intent.into(), needs: self.surroundings(&status).needs(), barcode: plate.barcode })
    }

    pub fn end_handoff(&mut self, end: HandoffEnd) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let Some(data) = self.surroundings(&status).end(&self.state().plate, end)? else { return Ok(()) };
        self.promise(None, data)?;
        self.publish(|_| ());
        Ok(())
    }

    /// Checks everything that a run of this plan needs. The check uses the instrument, so it is refused during a run.
    pub fn preflight(&mut self, plan: RunPlan, answer: oneshot::Sender<Result<Vec<api::Check>, Refusal>>) {
        let sound = plan.check(&self.config.methods).map_err(Refusal::InvalidPlan);
        let accepted = sound.and_then(|()| commands::is_startable(self.run.is_some(), self.publisher.status().state));
        if let Err(refusal) = accepted {
            return reply(answer, Err(refusal));
        }
        let deadline = std::time::Duration::from_millis(self.config.acquisition.grab_deadline_ms.into());
        match self.devices.begin_preflight(Box::new(PreflightRequest { plan, answer }), deadline, self.publisher.halt()) {
            // Shows that no run is accepted during the check.
            Ok(()) => self.publish(|_| ()),
            Err(request) => reply(request.answer, Err(Refusal::Busy)),
        }
    }
}

// The life cycle of a run.
impl Running {
    /// Writes the acceptance of the run to the journal, then starts the worker.
    fn start(&mut self, id: &str, plan: RunPlan, method: Method) -> Result<(), StoreError> {
        let calibration = gate::calibration(&self.config, self.mode);
        let record = RunRecord {
            instrument: Some(self.identity.clone()),
            calibration: calibration.clone(),
            ..RunRecord::new(id, plan, method, self.mode, self.config.empty_capillary.as_deref())
        };
        // A driven sampler ejects this specimen before the first well.
        let left = self.capillary().inside().map(str::to_owned);
        let accepted = EventData::RunAccepted(RunAccepted {
            plate_barcode: record.plan.plate_barcode.clone(),
            method: record.plan.method.clone(),
            left_in_capillary: left.clone(),
        });
        // Write what waits for the disk first.
        self.outbox.flush()?;
        if let Err(refused) = self.outbox.promise_with(&record, accepted) {
            // The run is not accepted. If the same request comes again, it must not be answered as known.
            if let Err(error) = self.outbox.store().forget_run(id) {
                tracing::error!(%error, "a run that was refused is still on disk");
            }
            return Err(refused);
        }
        let status = run_status(&record);
        self.loader.begin_run();
        self.devices.begin_run();
        let mut run = RunInProgress::new(record);
        if let Some(left) = left {
            run.handling_mut().remove(&left, false);
        }
        self.run = Some(run);
        self.launch();
        self.calibration = calibration;
        self.go_with(Trigger::Start, |s| {
            s.run = Some(status);
            s.specimen = None;
        });
        Ok(())
    }

    /// Starts a worker with the instrument for the wells that are left.
    fn launch(&mut self) {
        let lacks_gate = self.lacks_gate();
        let accepted = self.accepted();
        // A specimen that a plate-loader brought is reported through the interlock.
        let inside = self.capillary().brought().filter(|_| !self.loader.fills_capillary()).map(str::to_owned);
        let (Some(run), Some(instrument)) = (&mut self.run, self.devices.take()) else {
            tracing::error!("there is no run, or no instrument for it");
            return;
        };
        let (wells, eject_first) = (run.wells_left(&accepted), run.handling_mut().hand_to_worker());
        let record = run.record();
        let work = Work::begin(instrument, self.loader.cleared_interlock(), self.publisher.halt(), |cancel, pause, progress| RunContext {
            config: self.config.clone(),
            identity: self.identity.clone(),
            mode: self.mode,
            run: record.id.clone(),
            plate: record.plan.plate_barcode.clone(),
            wells,
            eject_first,
            inside,
            method_name: record.plan.method.clone(),
            method: record.method.clone(),
            folder: self.outbox.store().run_folder(&record.id),
            cancel,
            pause,
            progress,
        });
        run.set_lacks_gate(lacks_gate);
        run.launch(work);
    }

    fn ask(&mut self, what: Request) {
        self.run.iter_mut().for_each(|run| run.ask(what));
    }

    /// Holds the run for an operator. This hold stays when other causes of a hold are over.
    fn hold(&mut self, state: State) -> Result<(), Refusal> {
        if self.is_held_by_operator() {
            return Ok(());
        }
        self.promise(None, EventData::RunHoldRequested)?;
        if matches!(state, State::Holding | State::Held) {
            self.publish(|_| ());
            return Ok(());
        }
        self.ask(Request::Hold);
        self.go(Trigger::Hold);
        if self.has_idle_run() {
            self.rest(false);
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), Refusal> {
        self.promise(None, EventData::RunStopRequested)?;
        self.ask(Request::Stop);
        self.go(Trigger::Stop);
        if self.has_idle_run() {
            self.end_run();
        }
        Ok(())
    }

    /// Aborts the run even if the disk fails. The event is written as soon as possible.
    fn abort(&mut self) {
        self.ask(Request::Abort);
        self.go(Trigger::Abort);
        self.event(None, EventData::RunAbortRequested);
        if self.has_idle_run() {
            self.end_run();
        }
    }

    /// Continues a held run, once the causes of the hold are over.
    pub fn unhold(&mut self, by: ResumedBy) -> Result<(), Refusal> {
        self.nothing_stands_in_the_way()?;
        let Some(run) = &mut self.run else { return Ok(()) };
        if self.devices.at_rest().is_none() {
            return Err(Refusal::Busy);
        }
        self.outbox.promise_with(run.record(), EventData::RunResumed(RunResumed { by }))?;
        run.set_may_go_on(false);
        let status = run_status(run.record());
        self.go_with(Trigger::Unhold, |s| s.run = Some(status));
        self.proceed();
        Ok(())
    }

    /// The step after Unholding: wait for the loader, measure the next well, or end the run.
    fn proceed(&mut self) {
        self.recover();
        let accepted = self.accepted();
        let Some(run) = &self.run else { return };
        if run.handling().take_out().is_some() {
            self.go(Trigger::WaitForLoader);
        } else if self.devices.at_rest().is_none() {
            // A device was lost while the run waited for the loader. The run continues once the device is found.
            self.rest(true);
        } else if run.wells_left(&accepted).is_empty() && run.handling().eject_first().is_none() {
            self.finish();
        } else {
            self.launch();
        }
    }

    /// Every cause of the hold is over. The run continues by itself if its method allows it and no operator holds it.
    fn resume_by_itself(&mut self) {
        let known = self.outbox.state().run.as_ref();
        if let Some(run) = &mut self.run {
            run.set_may_go_on(resume::is_automatic(run, known));
        }
        self.go_on_if_it_may();
    }

    /// Continues the run now, or when the background task returns the instrument.
    fn go_on_if_it_may(&mut self) {
        let may = self.run.as_ref().is_some_and(RunInProgress::may_go_on) && !self.is_held_by_operator();
        if !may || self.publisher.status().state != State::Held {
            return;
        }
        match self.unhold(ResumedBy::Instrument) {
            // Tried again when the task returns the instrument, or when the disk accepts writes.
            Ok(()) | Err(Refusal::Busy | Refusal::Store { .. }) => {}
            Err(refusal) => {
                tracing::warn!(%refusal, "the run stays held");
                self.run.iter_mut().for_each(|run| run.set_may_go_on(false));
                self.publish(|_| ());
            }
        }
    }

    pub fn worker_ended(&mut self, (instrument, end): (Instrument, RunEnd)) {
        self.devices.give_back(instrument);
        let Some(run) = &mut self.run else { return };
        match run.joined(end) {
            AfterWork::Finish => self.finish(),
            AfterWork::End(error) => {
                if let Some(error) = error {
                    tracing::error!(%error, "the run failed while it was being ended");
                }
                self.end_run();
            }
            AfterWork::Rest => self.rest(false),
            AfterWork::Fault(error) => {
                let fate = match worker::keeps_specimen(&error) {
                    false => Fate::PoseLost,
                    // A stock VAST cannot take up a specimen twice.
                    true if self.devices.steps_through_a_list() => Fate::BroughtAgain,
                    true => Fate::Stays,
                };
                if matches!(error, RunError::Store(_)) {
                    self.outbox.set_failing(true);
                }
                self.raise(&error);
                self.interrupt_specimens(&error.to_string(), fate);
                self.rest(true);
            }
            AfterWork::Halted => {
                self.interrupt_specimens("the run could not be stored", Fate::PoseLost);
                self.rest(true);
            }
            AfterWork::Abort => self.abort(),
        }
    }

    /// Decides for each specimen in progress: its well ends, it is kept, or it is requested again.
    pub fn interrupt_specimens(&mut self, reason: &str, fate: Fate) {
        let accepted = self.accepted();
        let Some(run) = &self.run else { return };
        let policy = run.record().method.policy.interrupted;
        let (by_loader, brings_again) = (self.loader.fills_capillary(), self.loader.brings_again());
        let known = self.state().run.as_ref();
        let found = known.map_or_else(Vec::new, |known| interruptions(run, known, &accepted, brings_again, fate));
        for interruption in found {
            let Some(run) = &mut self.run else { return };
            let well = &interruption.well;
            if interruption.remove {
                run.handling_mut().remove(well, by_loader);
            }
            if interruption.course == Course::LacksNumbers {
                continue;
            }
            if interruption.course == Course::GivenUp && run.give_up(well, reason) {
                seal_well(self.outbox.store(), &run.record().id, well);
            }
            let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept: interruption.course == Course::Kept };
            self.event(Some(well), EventData::SpecimenInterrupted(interrupted));
        }
        // A specimen whose well is done may still be inside, if the sampler could not eject it.
        if let Some(run) = self.run.as_mut().filter(|_| !by_loader) {
            run.handling_mut().remove_what_is_stuck(snapshot::capillary(self.outbox.state()));
        }
    }

    /// Ends a well whose specimen cannot be measured any more.
    fn give_up(&mut self, well: &str, reason: &str) {
        let Some(run) = &mut self.run else { return };
        if !run.give_up(well, reason) {
            return;
        }
        let (record, policy) = (run.record().clone(), run.record().method.policy.interrupted);
        seal_well(self.outbox.store(), &record.id, well);
        let status = run_status(&record);
        self.save(record);
        let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept: false };
        self.event_shown(Some(well), EventData::SpecimenInterrupted(interrupted), |d| d.publish(|s| s.run = Some(status)));
    }

    /// Goes to Held from any state of a run. The worker has returned the instrument.
    fn rest(&mut self, by_fault: bool) {
        let state = self.publisher.status().state;
        if state == State::Stopping {
            // A requested end comes first.
            return self.end_run();
        }
        if state != State::Holding {
            self.go(Trigger::Hold);
        }
        let Some(run) = &mut self.run else { return };
        run.rests();
        let record = run.record().clone();
        let status = run_status(&record);
        let cause = faults::cause_of_hold(&self.state().faults, by_fault);
        let by = if by_fault { HeldBy::Fault } else { HeldBy::Operator };
        self.save(record);
        let held = RunHeld { by, code: Some(cause.code), cause: Some(cause.words) };
        self.event_shown(None, EventData::RunHeld(held), |d| d.go_with(Trigger::Rested, |s| s.run = Some(status)));
    }

    /// Completes a run after its last well, once the missing numbers are computed.
    fn finish(&mut self) {
        self.go(Trigger::WellsDone);
        self.recover();
        if !self.is_delayed(Continuation::Finish) {
            self.close();
        }
    }

    /// Ends the run as requested, once the numbers of released specimens are computed.
    fn end_run(&mut self) {
        if self.leaves_run() {
            // The next start finds what a crash leaves. It computes numbers that are missing.
            return self.forget_run();
        }
        self.recover();
        if !self.is_delayed(Continuation::End) {
            self.end_now();
        }
    }

    /// Whether `then` must wait for numbers that are being computed.
    fn is_delayed(&mut self, then: Continuation) -> bool {
        self.run.as_mut().is_some_and(|run| run.numbers_mut().delay(then))
    }

    /// Closes a completed run. It ends once this is on disk, and is held until then.
    fn close(&mut self) {
        let Some(run) = &self.run else { return };
        let record = run.finished();
        self.close_folder(&record.id);
        if let Err(error) = self.outbox.promise_with(&record, ended(&record)) {
            self.keep(Err(error));
            return self.rest(true);
        }
        self.forget_run();
        let change = self.over(&record);
        self.go_with(Trigger::Recorded, change);
    }

    /// Ends a run that was stopped or aborted, or that ends with the daemon.
    pub fn end_now(&mut self) {
        let Some(run) = &self.run else { return };
        let (asked, record) = (run.request(), run.ended());
        self.close_folder(&record.id);
        self.save(record.clone());
        self.event(None, ended(&record));
        self.forget_run();
        let change = self.over(&record);
        match asked {
            Request::Abort => self.go_with(Trigger::MotorsStopped, change),
            Request::Stop if !self.life.is_stopping() => self.go_with(Trigger::Joined, change),
            // The daemon ends later, when all threads are joined.
            _ => self.publish(change),
        }
    }

    /// Seals the open recordings of the run, and stores the bead gate if it measured enough beads.
    fn close_folder(&self, run: &str) {
        seal_run(self.outbox.store(), run);
        gate::keep(&self.config, &self.outbox.store().run_folder(run));
    }

    fn forget_run(&mut self) {
        self.run = None;
        self.room.note(room::look(&self.config, self.outbox.store()));
    }

    /// The end of a run and everything that follows from it, as one change of the status.
    fn over(&mut self, record: &RunRecord) -> impl FnOnce(&mut Status) + use<> {
        self.calibration = gate::calibration(&self.config, self.mode);
        let (status, left) = (run_status(record), self.left_specimen(record.method.asd));
        |s| {
            s.run = Some(status);
            s.specimen = left;
        }
    }
}

/// The event of a run's end.
fn ended(record: &RunRecord) -> EventData {
    EventData::RunEnded(RunEnded { outcome: record.outcome, wells: WellCounts::of(&record.wells) })
}

// Numbers of released specimens.
impl Running {
    /// Begins to compute missing numbers, unless this is in progress or a worker may use the same frames.
    fn recover(&mut self) {
        if self.run.as_ref().is_none_or(|run| run.works() || run.numbers().are_being_made()) {
            return;
        }
        let wells = self.accepted();
        let lacks_gate = self.lacks_gate();
        self.run.iter_mut().for_each(|run| run.set_lacks_gate(lacks_gate));
        self.recover_next(wells);
    }

    /// Begins with the first well that has attempts left. The wells before it fail.
    fn recover_next(&mut self, mut wells: VecDeque<PlannedWell>) {
        while let (Some(run), Some(planned)) = (&self.run, wells.front()) {
            let folder = self.outbox.store().run_folder(&run.record().id);
            let tried = self.state().run.as_ref().map_or(0, |known| known.recoveries_of(&planned.well));
            let attempt = match recovery::attempt(&folder, planned, tried) {
                Attempt::Begin(attempt) => attempt,
                Attempt::GiveUp(failed) => {
                    wells.pop_front();
                    self.well_recovered(*failed);
                    continue;
                }
            };
            let (well, allowed) = (planned.well.clone(), run.record().method.policy.deadlines_s.of(Phase::Measure));
            tracing::info!(well, attempt, "the numbers of a specimen that was let go are made from its frames");
            // A requested end of the daemon is not a crash, and must not count as a failed attempt.
            if !self.life.is_stopping() {
                self.event(Some(&well), EventData::SpecimenRecovering(RecoveryBegun { attempt }));
            }
            self.run.iter_mut().for_each(|run| run.numbers_mut().begin(std::mem::take(&mut wells), &folder, allowed));
            return;
        }
    }

    pub fn recovered(&mut self, made: Made) {
        let Some((found, wells)) = self.run.as_mut().and_then(|run| run.numbers_mut().take(made)) else { return };
        match found {
            Ok(found) => {
                self.well_recovered(found);
                self.recover_next(wells);
                if self.run.as_ref().is_some_and(|run| !run.numbers().are_being_made()) {
                    match self.take_continuation() {
                        Some(Continuation::Finish) => self.close(),
                        Some(Continuation::End) => self.end_now(),
                        None => {}
                    }
                }
            }
            // As in a live run that cannot write its numbers: the run is held, and they are computed when it continues.
            Err(error) => {
                self.keep(Err(error));
                match self.take_continuation() {
                    Some(Continuation::Finish) => self.rest(true),
                    Some(Continuation::End) => self.end_now(),
                    None => {}
                }
            }
        }
    }

    fn take_continuation(&mut self) -> Option<Continuation> {
        self.run.as_mut().and_then(|run| run.numbers_mut().take_continuation())
    }

    fn well_recovered(&mut self, Recovered { result, times }: Recovered) {
        let Some(run) = &mut self.run else { return };
        let result = run.enter(result);
        let record = run.record().clone();
        // A no-op if the well is closed.
        seal_well(self.outbox.store(), &record.id, &result.well);
        let status = run_status(&record);
        self.save(record);
        let well = result.well.clone();
        self.event(Some(&well), EventData::SpecimenRecovered);
        let done = SpecimenDone { result, times: Some(times), seconds: None };
        self.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| d.publish(|s| s.run = Some(status)));
    }
}

// Progress of the worker.
impl Running {
    pub fn progress(&mut self, progress: Progress) {
        match progress {
            Progress::Ready => self.ready(),
            Progress::WaitingForLoader { well } => self.waits_for_loader(&well),
            Progress::Phase { well, phase, in_capillary } => {
                let Some(views_planned) = self.run.as_ref().map(|run| run.record().method.asd) else { return };
                self.event_shown(Some(&well), EventData::SpecimenPhase(PhaseEntered { phase, in_capillary }), |d| {
                    d.publish(|s| show_phase(s, &well, phase, views_planned));
                });
            }
            Progress::Detected { well, found, live } => {
                self.show(&well, 0, live);
                self.publish(|_| ());
                self.event(Some(&well), EventData::SpecimenDetected(found));
            }
            Progress::TriedAgain { well, attempt, why } => {
                let views_planned = self.run.as_ref().map_or(0, |run| run.record().method.asd);
                self.publish(|s| s.specimen = Some(SpecimenStatus::new(&well, Phase::Position, views_planned)));
                self.event(Some(&well), EventData::SpecimenTriedAgain(AttemptFailed { attempt, why }));
            }
            Progress::View { well, index, closure, achieved_steps, hull_volume_um3, estimate, wait, light, live } => {
                let shown = self.publisher.status().specimen.as_ref().filter(|s| s.well == well).map(|s| s.view);
                // A late view of an earlier specimen is written to the journal and not shown.
                if let Some(before) = shown {
                    self.show(&well, before + u32::from(hull_volume_um3.is_some()), live);
                }
                let position_deg = self.config.steps_per_revolution.angle(Steps(achieved_steps)).to_degrees();
                let view = View { achieved_steps, position_deg, hull_volume_um3, estimate, wait, light };
                self.publish(|s| show_view(s, &well, &view));
                let view = ViewTaken { index, closure, achieved_steps, hull_volume_um3, estimate };
                self.event(Some(&well), EventData::ViewTaken(view));
            }
            Progress::Measured { well, glb, end } => {
                // Unless the pictures show the next specimen by now.
                self.publisher.set_live(|l| {
                    if l.shown.as_ref().is_some_and(|shown| shown.well == well) {
                        l.mesh_glb = glb.or(l.mesh_glb.take());
                    }
                });
                self.publish(|s| show_estimate(s, &well, end));
            }
            Progress::Hardware { rotation, translation, outputs, counters, second } => {
                let disk_free_bytes = self.outbox.store().free_bytes();
                self.publish(|s| show_hardware(s, Hardware { rotation, translation, outputs, counters, second, disk_free_bytes }));
            }
            Progress::WellDone { result, seconds, times } => self.well_done(result, seconds, times),
        }
    }

    /// Publishes the newest pictures, with their run and well.
    fn show(&self, well: &str, views: u32, live: Live) {
        let shown = self.run.as_ref().map(|run| Shown { run: run.record().id.clone(), well: well.to_owned(), views });
        self.publisher.set_live(|l| *l = Live { shown, ..live });
    }

    fn ready(&mut self) {
        if matches!(self.publisher.status().state, State::Starting | State::Unholding) {
            self.go_with(Trigger::Ready, |s| {
                s.hardware.camera.connected = true;
                s.hardware.rotation.connected = true;
            });
        }
        self.event(None, EventData::RunStarted);
    }

    fn waits_for_loader(&mut self, well: &str) {
        if self.capillary().brought() == Some(well) {
            // It was brought before the run continued. If a hold has interrupted the wait, the message is withheld: the specimen stays
            // until the run continues again.
            if self.run.as_ref().is_some_and(|run| run.request() == Request::Nothing) {
                self.loader.say_loaded(well);
            }
            return;
        }
        self.run.iter_mut().for_each(|run| run.handling_mut().await_specimen(well));
        self.event_shown(Some(well), EventData::WellAwaited, |d| {
            if d.publisher.status().state == State::Execute {
                d.go(Trigger::WaitForLoader);
            } else {
                d.publish(|_| ());
            }
        });
    }

    /// All files of a well are on disk. The next well may be in progress already.
    fn well_done(&mut self, result: WellStatus, seconds: f64, times: WellTimes) {
        let Some(run) = &mut self.run else { return };
        let result = run.enter(result);
        let record = run.record().clone();
        let (status, views_planned) = (run_status(&record), record.method.asd);
        let next = run.next_well().map(|next| SpecimenStatus::new(next, Phase::Load, views_planned));
        // A plate-loader takes it out before it brings the next one. With a driven sampler, a specimen that is still inside could not be
        // ejected.
        let stuck = self.capillary().inside() == Some(&result.well) && !self.loader.fills_capillary();
        self.save(record);
        let well = result.well.clone();
        let done = SpecimenDone { result, times: Some(times), seconds: Some(seconds) };
        // One revision: counters and phase change together, so that no reader sees a gap between two wells.
        self.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| {
            d.publish(|s| show_done(s, status, &well, next.filter(|_| !stuck)));
        });
    }
}
