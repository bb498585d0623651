//! The driver: the one place that changes anything. It takes commands and the worker's progress, journals, then publishes.
//!
//! ```text
//!            commands ─────────┐                    ┌──► Outbox: journal (synced) ──► state, events
//!                              ▼                    │
//!  worker ──► progress ──► Running (one thread) ────┼──► snapshot: one revision of the status
//!  numbers ────────────────────┤                    │
//!  look, preflight ────────────┘   asks its parts   └──► a worker for the wells that are left
//! ```
//! A part owns its state, and its decisions are tested without threads and without a disk. The `Outbox` is the exception: its work is
//! the disk.
//!
//! | part | what it owns or decides |
//! |---|---|
//! | `Outbox` | the state that follows from events, and what of it is not on disk yet |
//! | `RunInProgress` (`run.rs`) | a run's record, its worker, what was asked of it; what follows when the worker ends |
//! | `Handling` | which specimens the loader or the sampler is to move for the run |
//! | `Numbers` (`recovery.rs`) | numbers that are made from the frames of specimens that are gone, and what waits for them |
//! | `Devices` | who has the instrument, which devices are lost, the looks at them between runs |
//! | `Loader` | who fills the capillary, and the way to a worker that waits; what a message of the loader means |
//! | `DiskRoom` (`room.rs`) | whether the smallest run would fit |
//! | `commands`, `faults`, `plates`, `interrupt`, `resume`, `start` | rules: which command is accepted, what stands in the way, what becomes of a specimen, when a held run goes on |
//! | `snapshot`, `progress` | what a revision shows |
//!
//! `running.rs` carries out what the parts decide, in the order in which it is written and shown. A [`RunInProgress`](run::RunInProgress) exists from its acceptance to its outcome. It
//! has a worker, which has the instrument, or none while it is held.

mod commands;
mod devices;
mod faults;
mod handling;
mod interrupt;
mod loader;
mod outbox;
mod plates;
mod progress;
mod recovery;
mod resume;
mod room;
mod run;
mod running;
mod sealing;
mod snapshot;
mod start;
#[cfg(test)]
mod tests;

use super::handle::{Command, Publisher};
use super::heartbeat::{self, Heartbeat};
use super::state::Trigger;
use super::worker::Instrument;
use super::{Plate, State, Status, search};
use crate::config::Config;
use carved_devices::sampler::LoaderInterlock;
use carved_records::Mode;
use carved_store::{Journal, Store, StoreError};
use run::{Message, next_message};
use running::Running;
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
    /// Where the loader's message goes, on a rig that is loaded from outside.
    pub interlock: LoaderInterlock,
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

/// Where the daemon is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Life {
    /// What an earlier life left has not been looked at yet.
    Starting,
    Up,
    /// It ends once everything is joined.
    Stopping,
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
            mode: mode.into(),
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
            if d.life == Life::Stopping && d.is_at_rest() {
                d.go(Trigger::Joined);
                return Ok(d.final_report()?);
            }
            tokio::select! {
                biased;
                () = &mut shutdown, if d.life != Life::Stopping => d.shut_down(),
                // Not only by the mailbox: who pressed it may have hung up before the command was in.
                () = halt.pressed(), if d.life != Life::Stopping => d.emergency_pressed(),
                message = next_message(&mut d.run) => match message {
                    Message::Progress(progress) => d.progress(progress),
                    Message::Recovered(ended) => d.recovered(ended),
                    Message::Ended(ended) => d.worker_ended(ended.map_err(|_| DriverError::WorkerPanicked)?),
                },
                done = d.devices.done() => d.task_done(done.map_err(|_| DriverError::WorkerPanicked)?),
                _ = beat.tick() => {
                    heartbeat.beat();
                    d.beat();
                }
                _ = look.tick(), if d.run.is_some() => d.show_camera(),
                // A look at devices that are there takes milliseconds, and a run needs them; without them there is no run.
                command = mailbox.recv(), if d.life != Life::Stopping && !d.devices.are_looked_at() => {
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
