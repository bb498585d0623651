//! The driver: the one place that changes anything. It takes commands and the worker's progress, journals, then publishes.
//!
//! ```text
//!            commands ─────────┐                    ┌──► journal (synced) ──► status, events
//!  loader, faults, life, plate │                    │
//!                              ▼                    │
//!  worker ──► progress ──► Running (one thread) ────┤
//!  recovery ───────────────────┤                    │
//!  search, preflight ──────────┘   owns the run     └──► life: worker for the wells that are left
//! ```
//! A run is [`Active`] from its acceptance to its outcome. It has a worker, which has the instrument, or none while it is held.

mod active;
mod background;
mod commands;
mod devices;
mod ends;
mod faults;
mod life;
mod loader;
mod outbox;
mod plates;
mod progress;
mod publish;
mod recovery;
mod sealing;
mod start;
#[cfg(test)]
mod tests;

use super::handle::{Command, Publisher};
use super::heartbeat::{self, Heartbeat};
use super::state::Trigger;
use super::worker::Instrument;
use super::{Plate, State, Status, search};
use crate::config::Config;
use active::{Active, Message, Request, next_message};
use background::BackgroundTask;
use carved_devices::Link;
use carved_devices::cancel::CancelToken;
use carved_devices::sampler::LoaderGate;
use carved_records::{Capillary, Device, Event, EventData, InstrumentState, Mode, RunState};
use carved_store::{Journal, Store, StoreError};
use outbox::Outbox;
use std::future::Future;
use std::sync::Arc;
use tokio::sync::mpsc;

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
    pub heartbeat: Heartbeat,
}

/// Why the driver ended.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the thread that runs the rig panicked; its motors were stopped as it unwound")]
    WorkerPanicked,
}

#[allow(clippy::struct_excessive_bools, reason = "four facts that do not exclude one another")]
struct Running {
    config: Arc<Config>,
    mode: Mode,
    store: Store,
    outbox: Outbox,
    publisher: Publisher,
    gate: LoaderGate,
    /// Whether the loader fills the capillary.
    loaded_from_outside: bool,
    /// Whether a specimen that was taken out can be brought again.
    brings_again: bool,
    /// At rest while there is no worker and no task.
    instrument: Option<Instrument>,
    active: Option<Active>,
    /// A specimen that no run asked for is in the capillary, by the sampler's wire.
    unasked: bool,
    /// Why not even one well would fit on the disk.
    no_room: Option<String>,
    /// Devices that do not answer any more; nothing runs without them.
    lost: Vec<Device>,
    /// Whether the camera is there, wherever the instrument is now.
    camera: Link,
    /// A look at the devices without a run, which has the instrument.
    task: Option<BackgroundTask>,
    /// What an earlier life left is not looked at yet.
    starting: bool,
    stopping: bool,
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
        let (heartbeat, halt) = (self.heartbeat.clone(), self.publisher.halt().clone());
        let mut d = Running::new(self);
        d.first_report();
        tokio::pin!(shutdown);
        let mut beat = tokio::time::interval(heartbeat::INTERVAL);
        let mut look = tokio::time::interval(search::LOOK);
        loop {
            if d.stopping && d.active.is_none() && d.task.is_none() {
                d.go(Trigger::Joined);
                return Ok(d.final_report()?);
            }
            tokio::select! {
                biased;
                () = &mut shutdown, if !d.stopping => d.shut_down(),
                // Not only by the mailbox: who pressed it may have hung up before its word was in.
                () = halt.pressed(), if !d.stopping => d.emergency_pressed(),
                word = next_message(&mut d.active) => match word {
                    Message::Progress(progress) => d.progress(progress),
                    Message::Recovered(ended) => d.recovered(ended),
                    Message::Ended(ended) => d.worker_ended(ended.map_err(|_| DriverError::WorkerPanicked)?),
                },
                done = background::ended(&mut d.task) => d.task_done(done.map_err(|_| DriverError::WorkerPanicked)?),
                _ = beat.tick() => {
                    heartbeat.beat();
                    d.beat();
                }
                _ = look.tick(), if d.active.is_some() => d.show_camera(),
                // A look at devices that are there takes milliseconds, and a run needs them; without them there is no run.
                command = mailbox.recv(), if !d.stopping && !d.is_looking() => {
                    match command {
                        Some(command) => d.command(command),
                        // Every handle is gone: nobody can ask for anything any more, not even for an end.
                        None => d.shut_down(),
                    }
                }
            }
        }
    }
}

impl Running {
    fn new(driver: Driver) -> Self {
        let Driver { config, mode, store, journal, publisher, instrument, gate, heartbeat: _ } = driver;
        publisher.halt().aim(instrument.rig.rotation.stop_handle(), CancelToken::default());
        // The journal's tail alone would forget a plate within some dozen wells: most of it are views.
        let remembered = store.remembered().unwrap_or_else(|error| {
            tracing::error!(%error, "the journal cannot be read; its newest events are all that is remembered");
            publisher.tail().iter().map(|event| Event::clone(event)).collect()
        });
        Self {
            outbox: Outbox::new(journal, InstrumentState::after(&remembered)),
            loaded_from_outside: instrument.sampler.waits_for_loader(),
            brings_again: instrument.sampler.brings_again(),
            camera: instrument.rig.camera.link(),
            instrument: Some(instrument),
            config,
            mode,
            store,
            publisher,
            gate,
            active: None,
            unasked: false,
            no_room: None,
            lost: Vec::new(),
            task: None,
            starting: true,
            stopping: false,
        }
    }

    /// What the events say.
    fn state(&self) -> &InstrumentState {
        self.outbox.state()
    }

    /// What is in the capillary, as far as is known: in the run under way, or since the newest one.
    fn capillary(&self) -> &Capillary {
        const NOTHING: &Capillary = &Capillary::empty();
        self.state().run.as_ref().map_or(NOTHING, RunState::capillary)
    }

    fn beat(&mut self) {
        self.calibration_ages();
        self.show_index();
        if !self.stopping {
            // Before the look: that has the instrument for a moment, and a run that goes on needs it.
            self.try_the_store();
            self.look();
            self.look_for_room();
        }
    }

    fn shut_down(&mut self) {
        self.stopping = true;
        self.ask(Request::ShutDown);
        self.go(Trigger::ShutDown);
        if self.active.is_some() {
            self.event(None, EventData::DaemonStopping);
        }
        if self.active.as_ref().is_some_and(|a| a.work.is_none()) {
            self.end_run();
        }
    }

    fn is(&self, run: &str) -> bool {
        self.active.as_ref().is_some_and(|a| a.record.id == run)
    }
}
