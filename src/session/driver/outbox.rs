//! What the driver believes, and its way to the disk.
//!
//! ```text
//! event, save ──► state ──► waiting ──► flush ──► journal, run.json ──► announced
//!                              ▲           │
//!                              └───────────┘ the disk takes nothing: a fault, and no run (`keep`); tried again with the next of them,
//!                                            each beat, and once more before the daemon ends
//! promise ──► flush ──► journal ──► state, announced; or the command is refused and nothing has happened
//! ```
//! Nothing else changes the state. A start that reads the journal therefore believes the same.

use super::super::Refusal;
use super::Running;
use crate::session::handle::Publisher;
use carved_records::{EventBody, EventData, InstrumentState, RunState, fault_table};
use carved_store::{self, Journal, RunRecord, Store, StoreError};
use std::collections::VecDeque;

/// What a write that failed keeps from the disk.
enum Unwritten {
    Event(Box<EventBody>),
    Run(Box<RunRecord>),
}

/// What the driver believes, and what of it is not on disk yet.
pub(super) struct Outbox {
    journal: Journal,
    state: InstrumentState,
    /// Oldest first.
    waiting: VecDeque<Unwritten>,
    is_failing: bool,
}

impl Outbox {
    /// `state`: what the journal says.
    pub fn new(journal: Journal, mut state: InstrumentState) -> Self {
        state.faults.number_from(journal.last_fault());
        // A run is known once it is taken up or shown again, from its own file.
        state.run = None;
        Self { journal, state, waiting: VecDeque::new(), is_failing: false }
    }

    /// What the driver believes.
    pub fn state(&self) -> &InstrumentState {
        &self.state
    }

    /// Makes a run of an earlier life of the daemon the newest one.
    pub fn recall(&mut self, run: RunState) {
        self.state.run = Some(run);
    }

    /// It has happened, whenever the disk takes it.
    fn happened(&mut self, body: EventBody) {
        self.state.apply(&body);
        self.waiting.push_back(Unwritten::Event(Box::new(body)));
    }

    /// Events and records that are not on disk.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    #[cfg(test)]
    pub fn waiting_events(&self) -> impl Iterator<Item = &EventBody> {
        self.waiting.iter().filter_map(|waits| match waits {
            Unwritten::Event(body) => Some(&**body),
            Unwritten::Run(_) => None,
        })
    }

    /// A write failed, and what is shown is not all on disk.
    pub fn is_failing(&self) -> bool {
        self.is_failing
    }

    /// Notes whether writes fail; says whether they did before.
    pub fn set_failing(&mut self, is_failing: bool) -> bool {
        std::mem::replace(&mut self.is_failing, is_failing)
    }

    /// Writes what waits, as far as the disk takes it.
    ///
    /// # Errors
    /// The first write that the disk did not take; it waits still, and all behind it.
    fn flush(&mut self, store: &Store, publisher: &Publisher) -> Result<(), StoreError> {
        while let Some(next) = self.waiting.front() {
            match next {
                Unwritten::Event(body) => publisher.announce(self.journal.write(body)?),
                Unwritten::Run(record) => store.save_run(record)?,
            }
            self.waiting.pop_front();
        }
        Ok(())
    }

    /// Writes behind all that waits what counts only once it is on disk.
    ///
    /// # Errors
    /// What the disk did not take: it has not happened.
    fn promise(&mut self, store: &Store, publisher: &Publisher, body: &EventBody) -> Result<(), StoreError> {
        self.flush(store, publisher)?;
        let event = self.journal.write(body)?;
        self.state.apply(&event.body);
        publisher.announce(event);
        Ok(())
    }
}

impl Running {
    /// Tells what has happened in the run under way, if there is one.
    pub(super) fn event(&mut self, well: Option<&str>, data: EventData) {
        self.event_shown(well, data, |_| ());
    }

    /// Tells what has happened in a run, or in none.
    pub(super) fn event_of(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) {
        self.outbox.happened(carved_store::now(run, well, data));
        self.write();
    }

    /// Shows what has happened before it is written: a disk that hangs must not keep a fault or a state from being seen.
    pub(super) fn event_shown(&mut self, well: Option<&str>, data: EventData, show: impl FnOnce(&Self)) {
        let run = self.active.as_ref().map(|a| a.record.id.clone());
        self.outbox.happened(carved_store::now(run.as_deref(), well, data));
        show(self);
        self.write();
    }

    fn write(&mut self) {
        let written = self.flush();
        self.keep(written);
    }

    /// Writes a run's record, behind all that happened before.
    pub(super) fn save(&mut self, record: RunRecord) {
        self.outbox.waiting.push_back(Unwritten::Run(Box::new(record)));
        self.write();
    }

    /// Tells what somebody asks for, which has not happened where it cannot be written.
    pub(super) fn promise(&mut self, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        let run = self.active.as_ref().map(|a| a.record.id.clone());
        self.promise_of(run.as_deref(), well, data)
    }

    pub(super) fn promise_of(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        self.outbox.promise(&self.store, &self.publisher, &carved_store::now(run, well, data))
    }

    /// Writes what waits, as far as the disk takes it.
    pub(super) fn flush(&mut self) -> Result<(), StoreError> {
        self.outbox.flush(&self.store, &self.publisher)
    }

    /// The answer to a command that was carried out whatever the disk did.
    pub(super) fn on_disk(&self) -> Result<(), Refusal> {
        if self.outbox.waiting() == 0 { Ok(()) } else { Err(self.disk_fault().unwrap_or(Refusal::Busy)) }
    }

    /// What the disk's fault says, while it stands.
    pub(super) fn disk_fault(&self) -> Option<Refusal> {
        let fault = self.state().faults.open().iter().find(|f| f.is_of_storage())?;
        Some(Refusal::Store { why: fault.message.clone(), full: fault.code == fault_table::DISK_FULL.code })
    }

    /// The daemon's last word, and one more try for what is not on disk.
    pub(super) fn final_report(&mut self) -> Result<(), StoreError> {
        let told = self.promise(None, EventData::DaemonStopped);
        if self.outbox.waiting() > 0 {
            tracing::error!(waiting = self.outbox.waiting(), "the daemon ends with events and records that the disk did not take");
        }
        told
    }
}
