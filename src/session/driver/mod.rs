//! The driver: the only part that changes state. It takes commands and the worker's progress, writes the journal, then publishes.
//!
//! ```text
//!            commands ─────────┐                    ┌──► Outbox: journal (synced) ──► state, events
//!                              ▼                    │
//!  worker ──► progress ──► DriverState (one thread) ┼──► snapshot: one revision of the status
//!  numbers ────────────────────┤                    │
//!  look, preflight ────────────┘   asks its parts   └──► a worker for the wells that are left
//! ```
//! Each part owns its state. Its decisions are tested without threads and without a disk. What reads or writes the disk has its own files:
//! `outbox` (events and records), `released` (recordings without numbers), `sealing` (checksums), `start` (what a start reads) and `room`
//! (free space).
//!
//! | part | what it owns or decides |
//! |---|---|
//! | `Outbox` | the state that follows from the events, also where each specimen is; which events and records are not on disk yet |
//! | `Machine` (`../state.rs`) | the state of the instrument, in PackML words |
//! | `RunInProgress` (`run.rs`) | a run's record, its worker and its highest request; what follows when the worker ends |
//! | `Numbers` (`recovery.rs`) | numbers that are computed from the stored frames of released specimens, and the step that waits for them |
//! | `Devices` | who uses the instrument, which devices are lost, the device checks between runs |
//! | `Loader` | who fills the capillary; the channel to a waiting worker; what a message of the loader means |
//! | `DiskRoom` (`room.rs`) | whether the smallest run would fit |
//! | `commands`, `faults` | rules: which command is accepted, which fault prevents a run |
//! | `PlateQueue` (of the store) | the plates that wait for their turn, and which one is next |
//! | `plates`, `interrupt` | rules: plate handovers, what happens to interrupted specimens |
//! | `resume`, `start` | rules: when a held run continues, what a start restores |
//! | `snapshot`, `progress` | what a revision of the status shows |
//!
//! The decisions of the parts are carried out in this order of files. Each file calls those to its right only:
//!
//! ```text
//! mod ──► restart   what a start restores        ─┬─► course ──► missing ─┬─► driver_state ──► the parts
//!         requests  what clients ask for          │   a run,     numbers  │   all parts: writes events,
//!         checks    devices, disk and index, by   │   until its  that are │   publishes revisions
//!                   itself with each heartbeat   ─┘   outcome    missing  │
//!         reports   what the worker reports      ─────────────────────────┘
//! ```
//! A [`RunInProgress`](run::RunInProgress) exists from the acceptance of the run to its outcome. It has a worker, which uses the
//! instrument. It has no worker while the run is held.

mod checks;
mod commands;
mod course;
mod devices;
mod driver_state;
mod faults;
mod interrupt;
mod loader;
mod missing;
mod outbox;
mod people;
mod plates;
mod progress;
mod queue;
mod recovery;
mod released;
mod reports;
mod requests;
mod restart;
mod resume;
mod room;
mod run;
mod sealing;
mod snapshot;
mod start;
#[cfg(test)]
mod tests;

use super::Instrument;
use super::handle::{Command, Publisher};
use super::heartbeat::{self, Heartbeat};
use super::state::Trigger;
use super::{Plate, State, Status, search};
use crate::api::InstrumentIdentity;
use crate::config::Config;
use crate::notify::Notices;
use carved_devices::sampler::LoaderInterlock;
use carved_records::Mode;
use carved_store::{Journal, Store, StoreError};
use driver_state::DriverState;
use run::{Message, next_message};
use std::future::Future;
use std::sync::Arc;
use tokio::sync::mpsc;

/// The parts that the driver is made of. `run` consumes it.
pub struct Driver {
    pub config: Arc<Config>,
    pub mode: Mode,
    pub store: Store,
    pub journal: Journal,
    pub publisher: Publisher,
    pub instrument: Instrument,
    pub identity: carved_records::InstrumentIdentity,
    /// Receives the loader's message, on a rig that a plate-loader fills.
    pub interlock: LoaderInterlock,
    /// `None` if the configuration names no receiver of notices.
    pub notices: Option<Notices>,
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

/// What becomes of a run in progress when the daemon ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Departure {
    /// It ends `interrupted`.
    EndsRun,
    /// It keeps its place for the next start, which continues it as after a crash.
    LeavesRun,
}

/// Life cycle of the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Life {
    /// The state that the previous process left is not restored yet.
    Starting,
    Up,
    /// The daemon ends once all threads are joined.
    Stopping(Departure),
}

impl Life {
    fn is_stopping(self) -> bool {
        matches!(self, Self::Stopping(_))
    }
}

impl Driver {
    /// The first snapshot after a start of the daemon.
    pub fn first_status(mode: Mode, boot_id: String) -> Status {
        Status {
            schema: "carved.status/1".into(),
            revision: 1,
            boot_id,
            server_time: String::new(),
            uptime_s: 0.0,
            version: env!("CARGO_PKG_VERSION").into(),
            instrument: InstrumentIdentity::default(),
            mode,
            ready: false,
            not_ready_reason: Some(Status::STARTING.into()),
            state: State::Idle,
            doing: "Starting.".into(),
            pending: super::Pending::default(),
            plate: Plate::default(),
            queue: Vec::new(),
            run: None,
            specimen: None,
            hardware: super::HardwareStatus::default(),
            notices: None,
            calibration: None,
            faults: Vec::new(),
        }
    }

    /// Serves commands until `shutdown`. Then the motors stop, the record is closed or left open, and all threads are joined. `at_rest` is
    /// called once nothing is in progress. What it returns resolves when no client can reach the daemon any more. Until then every
    /// emergency stop is written to the journal and answered.
    pub async fn run<F: Future<Output = ()>>(
        self,
        mut mailbox: mpsc::Receiver<Command>,
        shutdown: impl Future<Output = Departure>,
        at_rest: impl FnOnce() -> F,
    ) -> Result<(), DriverError> {
        let (heartbeat, halt) = (self.heartbeat.clone(), self.publisher.halt().clone());
        heartbeat.disk().of_this_thread();
        let mut d = DriverState::new(self);
        restart::first_report(&mut d);
        tokio::pin!(shutdown);
        let mut beat = tokio::time::interval(heartbeat::INTERVAL);
        let mut look = tokio::time::interval(search::LOOK);
        // A command that ended a picture at rest, until the instrument is back.
        let mut waiting = None;
        loop {
            if d.life.is_stopping() && d.is_at_rest() {
                let reported = d.final_report();
                requests::take_last(&mut d, &mut mailbox, at_rest()).await;
                d.transition(Trigger::Joined);
                return Ok(reported?);
            }
            tokio::select! {
                biased;
                // Not only through the mailbox: the client may disconnect before its command is queued. Also while the daemon ends: the
                // next one must know it.
                () = halt.pressed() => requests::emergency_pressed(&mut d),
                departure = &mut shutdown, if !d.life.is_stopping() => course::shut_down(&mut d, departure),
                message = next_message(&mut d.run) => match message {
                    Message::Progress(progress) => reports::progress(&mut d, progress),
                    Message::Recovered(ended) => course::recovered(&mut d, ended),
                    Message::Ended(ended) => course::worker_ended(&mut d, ended.map_err(|_| DriverError::WorkerPanicked)?),
                },
                done = d.devices.done() => {
                    checks::task_done(&mut d, done.map_err(|_| DriverError::WorkerPanicked)?);
                    if let Some(command) = waiting.take() {
                        requests::command(&mut d, command);
                    }
                }
                _ = beat.tick() => {
                    heartbeat.beat();
                    checks::beat(&mut d);
                }
                _ = look.tick(), if d.run.is_some() => {
                    d.show_camera();
                    d.show_rotation();
                }
                // Commands wait for a device check: a run needs the instrument. The check takes milliseconds if no device is lost. If one
                // is lost, commands do not wait, because no run can start.
                Some(command) = mailbox.recv(), if waiting.is_none() && !d.devices.are_looked_at() => {
                    if d.devices.end_picture() {
                        waiting = Some(command);
                    } else {
                        requests::command(&mut d, command);
                    }
                }
            }
        }
    }
}
