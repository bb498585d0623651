//! What the driver believes, and its way to the disk.
//!
//! ```text
//! happened, save ──► state ──► waiting ──► flush ──► journal, run.json ──► readers of the event log
//!                                 ▲           │
//!                                 └───────────┘ the disk refuses: a fault, and no run; tried again with the next write, with each
//!                                               beat, and once more before the daemon ends
//! promise ──► flush ──► journal ──► state, event log; or the command is refused and nothing has happened
//! ```
//! Nothing else changes the state. A start that reads the journal therefore believes the same.

use super::super::{EventLog, Refusal};
use super::faults;
use carved_records::{EventBody, EventData, InstrumentState, RunState};
use carved_store::{Journal, RunRecord, Store, StoreError};
use std::collections::VecDeque;
use std::sync::Arc;

/// A write that the disk has not accepted yet.
enum Unwritten {
    Event(Box<EventBody>),
    Run(Box<RunRecord>),
}

/// What the driver believes, and what of it is not on disk yet.
pub(super) struct Outbox {
    store: Store,
    journal: Journal,
    log: Arc<EventLog>,
    state: InstrumentState,
    /// Oldest first.
    waiting: VecDeque<Unwritten>,
    is_failing: bool,
}

impl Outbox {
    /// `state`: what the journal says. Events that are on disk are appended to `log`.
    pub fn new(store: Store, journal: Journal, log: Arc<EventLog>, mut state: InstrumentState) -> Self {
        state.faults.number_from(journal.last_fault());
        // A run is known once it is taken up or shown again, from its own file.
        state.run = None;
        Self { store, journal, log, state, waiting: VecDeque::new(), is_failing: false }
    }

    /// What the driver believes.
    pub fn state(&self) -> &InstrumentState {
        &self.state
    }

    /// The data folder.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Makes a run of an earlier life of the daemon the newest one.
    pub fn recall(&mut self, run: RunState) {
        self.state.run = Some(run);
    }

    /// It has happened, whenever the disk accepts it.
    pub fn happened(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) {
        let body = carved_store::now(run, well, data);
        self.state.apply(&body);
        self.waiting.push_back(Unwritten::Event(Box::new(body)));
    }

    /// A run's record is to be written behind all that happened before.
    pub fn save(&mut self, record: RunRecord) {
        self.waiting.push_back(Unwritten::Run(Box::new(record)));
    }

    /// Writes what waits, as far as the disk accepts it.
    ///
    /// # Errors
    /// The first write that the disk refused. It still waits, and all behind it.
    pub fn flush(&mut self) -> Result<(), StoreError> {
        while let Some(next) = self.waiting.front() {
            match next {
                Unwritten::Event(body) => self.log.push(self.journal.write(body)?),
                Unwritten::Run(record) => self.store.save_run(record)?,
            }
            self.waiting.pop_front();
        }
        Ok(())
    }

    /// Writes behind all that waits what counts only once it is on disk.
    ///
    /// # Errors
    /// What the disk refused: it has not happened.
    pub fn promise(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        self.flush()?;
        let event = self.journal.write(&carved_store::now(run, well, data))?;
        self.state.apply(&event.body);
        self.log.push(event);
        Ok(())
    }

    /// The same for an event of a run, with the run's record in front of it.
    ///
    /// # Errors
    /// What the disk refused: the event has not happened.
    pub fn promise_with(&mut self, record: &RunRecord, data: EventData) -> Result<(), StoreError> {
        self.flush()?;
        self.store.save_run(record)?;
        self.promise(Some(&record.id), None, data)
    }

    /// A write failed, and what is shown is not all on disk.
    pub fn is_failing(&self) -> bool {
        self.is_failing
    }

    /// Notes whether writes fail; returns whether they did before.
    pub fn set_failing(&mut self, is_failing: bool) -> bool {
        std::mem::replace(&mut self.is_failing, is_failing)
    }

    /// The number of events and records that are not on disk.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The answer to a command that was carried out whatever the disk did.
    ///
    /// # Errors
    /// Something is not on disk yet.
    pub fn on_disk(&self) -> Result<(), Refusal> {
        if self.waiting.is_empty() { Ok(()) } else { Err(faults::of_the_disk(&self.state.faults).unwrap_or(Refusal::Busy)) }
    }

    #[cfg(test)]
    pub fn waiting_events(&self) -> impl Iterator<Item = &EventBody> {
        self.waiting.iter().filter_map(|waits| match waits {
            Unwritten::Event(body) => Some(&**body),
            Unwritten::Run(_) => None,
        })
    }
}
