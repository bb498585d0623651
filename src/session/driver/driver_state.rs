//! The driver's parts together, and the two things that all its work is made of: an event or record is written, and a revision of the status
//! is published. Nothing here decides what a run does next.

use super::super::handle::{Publisher, Refusal};
use super::super::preflight::Blurs;
use super::super::state::{self, HOLDABLE, Machine, Trigger};
use super::super::worker::RunError;
use super::super::{State, Status, fault, gate};
use super::devices::Devices;
use super::loader::Loader;
use super::outbox::Outbox;
use super::released;
use super::room::{self, DiskRoom, DiskSpeed};
use super::run::{Request, RunInProgress};
use super::sealing::seal_run;
use super::snapshot::{self, Parts, run_status, show_left};
use super::{Departure, Driver, Life, faults};
use crate::api::NoticesStatus;
use crate::config::Config;
use crate::notify::Notices;
use carved_core::quality::RecentOpacities;
use carved_records::{
    Asked, CalibrationStatus, Device, Event, EventData, Fault, FaultsCleared, InstrumentIdentity, InstrumentState, Mode, PlannedWell,
    RunState, Specimens, Work,
};
use carved_store::{PlateQueue, RunRecord, StoreError};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// The parts of the driver.
pub(super) struct DriverState {
    pub(super) config: Arc<Config>,
    pub(super) identity: InstrumentIdentity,
    pub(super) mode: Mode,
    pub(super) publisher: Publisher,
    notices: Option<Notices>,
    pub(super) outbox: Outbox,
    /// The plates that wait for their turn.
    pub(super) queue: PlateQueue,
    pub(super) devices: Devices,
    pub(super) loader: Loader,
    room: DiskRoom,
    /// The rig's newest calibration, as of the last lookup.
    pub(super) speed: DiskSpeed,
    pub(super) calibration: Option<CalibrationStatus>,
    pub(super) blurs: Blurs,
    /// How opaque the newest larvae were. The worker adds them.
    pub(super) opacities: Arc<Mutex<RecentOpacities>>,
    pub(super) run: Option<RunInProgress>,
    /// The newest run once it has ended, or is left to the next start.
    past_run: Option<RunRecord>,
    pub(super) life: Life,
    machine: Machine,
    /// What keeps the index from being written, as of the last heartbeat.
    index_trouble: Option<String>,
}

impl DriverState {
    pub fn new(driver: Driver) -> Self {
        let Driver { config, mode, store, journal, publisher, instrument, identity, interlock, notices, heartbeat } = driver;
        let loader = Loader::new(interlock, instrument.sampler.as_ref());
        let mut devices = Devices::new(instrument);
        devices.aim(publisher.halt());
        // The tail of the journal is not enough: most events are views, and after some dozen wells it no longer names the plate.
        let remembered = store.remembered().unwrap_or_else(|error| {
            tracing::error!(%error, "the journal cannot be read; its newest events are all that is remembered");
            publisher.tail().iter().map(|event| Event::clone(event)).collect()
        });
        Self {
            queue: store.queue(),
            outbox: Outbox::new(store, journal, publisher.log(), InstrumentState::after(&remembered)),
            loader,
            devices,
            config,
            identity,
            mode,
            publisher,
            notices,
            room: DiskRoom::default(),
            speed: DiskSpeed::of(heartbeat.disk().clone()),
            calibration: None,
            blurs: Blurs::default(),
            opacities: Arc::default(),
            run: None,
            past_run: None,
            life: Life::Starting,
            machine: Machine::default(),
            index_trouble: None,
        }
    }

    /// Whether no run and no background task is in progress.
    pub fn is_at_rest(&self) -> bool {
        self.run.is_none() && !self.devices.are_busy()
    }

    /// Writes the daemon's last event, and tries once more to write what is not on disk.
    pub fn final_report(&mut self) -> Result<(), StoreError> {
        let stopped = self.commit(None, EventData::DaemonStopped);
        if self.outbox.waiting() > 0 {
            tracing::error!(waiting = self.outbox.waiting(), "the daemon ends with events and records that the disk did not take");
        }
        stopped
    }

    /// The state that follows from the events.
    pub fn state(&self) -> &InstrumentState {
        self.outbox.state()
    }

    /// The specimens of the current or newest run.
    pub fn specimens(&self) -> &Specimens {
        snapshot::specimens(self.state())
    }

    /// What the run does now.
    pub fn work(&self) -> Work {
        snapshot::work(self.run.as_ref())
    }

    /// The well whose specimen must leave before a worker begins.
    pub fn must_leave_first(&self) -> Option<&str> {
        self.specimens().must_leave_first(self.loader.loaded_by())
    }

    pub fn is(&self, run: &str) -> bool {
        self.run.as_ref().is_some_and(|r| r.record().id == run)
    }

    pub fn works(&self) -> bool {
        self.run.as_ref().is_some_and(RunInProgress::works)
    }

    /// Whether the run has no worker.
    pub fn has_idle_run(&self) -> bool {
        self.run.as_ref().is_some_and(|r| !r.works())
    }

    pub fn is_held_by_operator(&self) -> bool {
        self.state().run.as_ref().is_some_and(RunState::is_held_by_operator)
    }

    pub fn waits_for_operator(&self) -> bool {
        self.state().run.as_ref().is_some_and(RunState::waits_for_operator)
    }

    /// Whether the daemon ends without ending the run. An abort comes first.
    pub fn leaves_run(&self) -> bool {
        self.life == Life::Stopping(Departure::LeavesRun) && self.run.as_ref().is_some_and(|run| run.request() == Request::ShutDown)
    }

    /// Requests the abort of the run that this daemon leaves to the next one, which ends it.
    pub fn abort_left_run(&mut self, asked: Asked) {
        let is_left = self.life == Life::Stopping(Departure::LeavesRun);
        if let Some(run) = self.past_run.as_ref().filter(|run| is_left && run.outcome.is_none()) {
            self.outbox.record(Some(&run.id), None, EventData::RunAbortRequested(asked));
            self.write();
        }
    }

    /// The newest run, in progress or past.
    pub fn newest_run(&self) -> Option<&RunRecord> {
        self.run.as_ref().map(RunInProgress::record).or(self.past_run.as_ref())
    }

    /// Replaces the record of the newest run, which has ended.
    pub fn set_past_run(&mut self, record: RunRecord) {
        self.past_run = Some(record);
    }

    /// Shows the specimen that is left in the capillary.
    pub fn show_left_specimen(&self) {
        let views_planned = self.newest_run().map_or(0, |newest| newest.method.asd);
        self.publish(|s| show_left(s, self.specimens(), views_planned));
    }

    pub fn check_faults(&self) -> Result<(), Refusal> {
        faults::check_faults(&self.state().faults, self.devices.lost())
    }

    /// The wells of the current run of which only the numbers are missing.
    pub fn accepted(&self) -> VecDeque<PlannedWell> {
        let run = self.run.as_ref().map(RunInProgress::record);
        run.map_or_else(VecDeque::new, |record| released::accepted(&self.outbox.store().run_folder(&record.id), record))
    }

    /// Whether the run measures larvae without a valid bead gate.
    pub fn lacks_gate(&self) -> bool {
        let newest = gate::calibration(&self.config, self.mode).and_then(|c| c.gate);
        self.run.as_ref().is_some_and(|run| gate::lacking(newest.as_ref(), &run.record().method, self.mode).is_some())
    }

    /// The state of the instrument.
    pub fn machine(&self) -> State {
        self.machine.state()
    }

    /// Restores the state in which the newest run has ended, with what is published in the same revision.
    pub fn restore(&mut self, state: State, change: impl FnOnce(&mut Status)) {
        self.machine.enter(state);
        self.publish(change);
    }

    /// Makes a transition of the state table. Every state on the way is published as a revision of its own.
    pub fn transition(&mut self, trigger: Trigger) {
        self.transition_with(trigger, |_| ());
    }

    /// As `transition`, with a change that is published in the same revision as the first state.
    pub fn transition_with(&mut self, trigger: Trigger, change: impl FnOnce(&mut Status)) {
        let from = self.machine();
        let Some(path) = state::next(from, trigger) else {
            tracing::error!(?from, ?trigger, "no such transition");
            return self.publish(change);
        };
        let mut change = Some(change);
        for &to in path {
            let change = change.take();
            self.machine.enter(to);
            self.publish(|s| {
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
        let parts = self.parts();
        self.publisher.publish(|s| {
            change(s);
            parts.derive(s);
        });
    }

    /// As `publish`, unless the change changes nothing.
    pub fn publish_news(&self, change: impl FnOnce(&mut Status)) {
        let parts = self.parts();
        self.publisher.publish_news(change, |s| parts.derive(s));
    }

    fn parts(&self) -> Parts<'_> {
        Parts {
            machine: self.machine(),
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
        }
    }

    /// Records an event of the current run, or of no run.
    pub fn event(&mut self, well: Option<&str>, data: EventData) {
        self.event_shown(well, data, |_| ());
    }

    /// Shows an event before it is written: if the disk hangs, clients must still see a fault or a state.
    pub fn event_shown(&mut self, well: Option<&str>, data: EventData, show: impl FnOnce(&mut Self)) {
        let run = self.run.as_ref().map(|run| run.record().id.as_str());
        self.outbox.record(run, well, data);
        show(self);
        self.write();
    }

    pub fn write(&mut self) {
        let written = self.outbox.flush();
        self.handle_write_error(written);
    }

    /// Writes a run's record, after all earlier events.
    pub fn save(&mut self, record: RunRecord) {
        self.outbox.save(record);
        self.write();
    }

    /// Writes the event of a command. If the disk refuses it, the command has no effect.
    pub fn commit(&mut self, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        let run = self.run.as_ref().map(|run| run.record().id.as_str());
        self.outbox.commit(run, well, data)
    }

    /// Handles a failed write: it holds the run. The motors stop first, then the fault is raised. What could not be written is shown all
    /// the same, and the plate is not removable.
    pub fn handle_write_error(&mut self, written: Result<(), StoreError>) {
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
        if works && HOLDABLE.contains(&self.machine()) {
            self.transition(Trigger::Hold);
        }
    }

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
    pub fn fault_over(&mut self, is_over: impl Fn(&Fault) -> bool, why: &str, change: impl FnOnce(&mut Status)) {
        let seq = self.state().faults.open().iter().filter(|f| is_over(f)).map(|f| f.seq).collect();
        self.event(None, EventData::FaultsCleared(FaultsCleared { seq, why: why.to_owned() }));
        self.publish(change);
    }

    /// Shows whether the camera is lost. During a run the worker reopens a lost camera by itself, or ends.
    pub fn show_camera(&self) {
        let is_lost = self.devices.camera_is_lost();
        self.publish_news(|s| s.hardware.camera.connected = !is_lost);
    }

    /// Shows an axis that has hung up while a worker uses it. The worker ends then, and its fault comes after the numbers that are being
    /// computed. Only a device check shows that the axis is back.
    pub fn show_rotation(&self) {
        if self.devices.rotation_has_hung_up() {
            self.publish_news(|s| s.hardware.lose_axes());
        }
    }

    /// Shows whether the index holds all that is on disk.
    pub fn show_index(&mut self) {
        let trouble = self.outbox.store().index_trouble();
        if self.index_trouble != trouble {
            if trouble.is_some() {
                self.publisher.log().tally().index_failed();
            }
            self.index_trouble.clone_from(&trouble);
            self.publish(|s| s.hardware.index_trouble = trouble);
        }
    }

    /// Shows whether notices reach their receiver.
    pub fn show_notices(&self) {
        let found = self.notices();
        self.publish_news(|s| s.notices = found);
    }

    /// Whether notices reach their receiver. `None` without one.
    pub fn notices(&self) -> Option<NoticesStatus> {
        self.notices.as_ref().map(Notices::status)
    }

    /// Publishes a revision when the calibration or the bead gate becomes too old.
    pub fn calibration_ages(&mut self) {
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

    pub fn ask(&mut self, what: Request) {
        self.run.iter_mut().for_each(|run| run.ask(what));
    }

    /// Seals the open recordings of the run, and stores the bead gate if it measured enough beads.
    pub fn close_folder(&self, run: &str) {
        let store = self.outbox.store();
        store.long_work(|| {
            seal_run(store, run);
            gate::keep(&self.config, &store.run_folder(run));
        });
    }

    /// The run is over, or left to the next start.
    pub fn forget_run(&mut self) {
        self.past_run = self.run.take().map(RunInProgress::into_record);
        self.room.note(room::look(&self.config, self.outbox.store()));
    }

    /// The end of a run and everything that follows from it, as one change of the status.
    pub fn end_of_run(&mut self, record: &RunRecord) -> impl FnOnce(&mut Status) + use<> {
        self.calibration = gate::calibration(&self.config, self.mode);
        let (status, specimens, views_planned) = (run_status(record), self.specimens().clone(), record.method.asd);
        self.past_run = Some(record.clone());
        move |s| {
            s.run = Some(status);
            show_left(s, &specimens, views_planned);
        }
    }
}
