//! The driver's state, and the queue of events and records that are not on disk yet.
//!
//! ```text
//! record, save ────► state ──► waiting ──► flush ──► journal, run.json ──► readers of the event log
//!                                 ▲           │
//!                                 └───────────┘ the disk refuses: a fault, and no run; tried again with the next write, with each
//!                                               heartbeat, and once more before the daemon ends
//! commit ───► flush ──► journal ──► state, event log; if the disk refuses, the command is refused and has no effect
//! ```
//! After a start, nothing else changes the state. A start that reads the journal therefore gets the same state.

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

/// The driver's state, and what of it is not on disk yet.
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
    /// `state`: the state that follows from the journal. Events that are on disk are appended to `log`.
    pub fn new(store: Store, journal: Journal, log: Arc<EventLog>, mut state: InstrumentState) -> Self {
        state.faults.number_from(journal.last_fault());
        // The run is read from its own file when it is taken up or shown again.
        state.run = None;
        Self { store, journal, log, state, waiting: VecDeque::new(), is_failing: false }
    }

    /// The state that follows from all events, written or not.
    pub fn state(&self) -> &InstrumentState {
        &self.state
    }

    /// The data folder.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Restores the newest run, from before the restart of the daemon.
    pub fn recall(&mut self, run: RunState) {
        self.state.run = Some(run);
    }

    /// Applies an event that has happened, and queues it for the disk.
    pub fn record(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) {
        let body = carved_store::now(run, well, data);
        self.state.apply(&body);
        self.waiting.push_back(Unwritten::Event(Box::new(body)));
    }

    /// Queues a run's record, behind all earlier events.
    pub fn save(&mut self, record: RunRecord) {
        self.waiting.push_back(Unwritten::Run(Box::new(record)));
    }

    /// Writes the queue, as far as the disk accepts it.
    ///
    /// # Errors
    /// The first write that the disk refused. It stays in the queue, with everything behind it.
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

    /// Writes the queue and then an event that takes effect only once it is on disk.
    ///
    /// # Errors
    /// The disk refused the write, and the event has no effect.
    pub fn commit(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        self.flush()?;
        let event = self.journal.write(&carved_store::now(run, well, data))?;
        self.state.apply(&event.body);
        self.log.push(event);
        Ok(())
    }

    /// As `commit`, for an event of a run. The run's record is written before the event.
    ///
    /// # Errors
    /// The disk refused the write, and the event has no effect.
    pub fn commit_with(&mut self, record: &RunRecord, data: EventData) -> Result<(), StoreError> {
        self.commit_of(record, None, data)
    }

    /// As `commit_with`, for an event of a well.
    pub fn commit_of_well(&mut self, record: &RunRecord, well: &str, data: EventData) -> Result<(), StoreError> {
        self.commit_of(record, Some(well), data)
    }

    fn commit_of(&mut self, record: &RunRecord, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        self.flush()?;
        self.store.save_run(record)?;
        self.commit(Some(&record.id), well, data)
    }

    /// Syncs the journal again, to see how fast the disk is. An error is that of the next write.
    pub fn probe(&mut self) {
        if let Err(error) = self.journal.probe() {
            tracing::debug!(%error, "the disk's speed is not seen");
        }
    }

    /// Whether a write failed and the published state is not all on disk.
    pub fn is_failing(&self) -> bool {
        self.is_failing
    }

    /// Sets whether writes fail. Returns whether they failed before.
    pub fn set_failing(&mut self, is_failing: bool) -> bool {
        std::mem::replace(&mut self.is_failing, is_failing)
    }

    /// The number of events and records that are not on disk.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The answer to a command that took effect even if the disk failed.
    ///
    /// # Errors
    /// Some events or records are not on disk yet.
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
