//! What has happened reaches the disk in its order, now or once the disk takes writes again; what is asked for counts only there.
//!
//! ```text
//! event, save ──► unwritten ──► flush ──► journal, run.json ──► announced
//!                     ▲           │
//!                     └───────────┘ the disk takes nothing: a fault, and no run (`keep`); tried again with the next of them,
//!                                   each beat, and once more before the daemon ends
//! promise ──► flush ──► journal, or the command is refused and nothing has happened
//! ```

use super::super::Refusal;
use super::Running;
use crate::store::{self, RunRecord, StoreError};
use carved_records::{EventBody, EventData, fault_table};

/// What a write that failed keeps from the disk.
pub(super) enum Unwritten {
    Event(EventBody),
    Run(Box<RunRecord>),
}

impl Running {
    /// Tells what has happened in the run under way, if there is one.
    pub(super) fn event(&mut self, well: Option<&str>, data: EventData) {
        let run = self.active.as_ref().map(|a| a.record.id.clone());
        self.event_of(run.as_deref(), well, data);
    }

    /// It has happened, whenever the disk takes it.
    pub(super) fn event_of(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) {
        let body = store::now(run, well, data);
        self.state.apply(&body);
        self.write(Unwritten::Event(body));
    }

    /// Writes a run's record, behind all that happened before.
    pub(super) fn save(&mut self, record: RunRecord) {
        self.write(Unwritten::Run(Box::new(record)));
    }

    fn write(&mut self, what: Unwritten) {
        self.unwritten.push_back(what);
        let written = self.flush();
        self.keep(written);
    }

    /// Tells what somebody asks for, which has not happened where it cannot be written.
    pub(super) fn promise(&mut self, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        let run = self.active.as_ref().map(|a| a.record.id.clone());
        self.promise_of(run.as_deref(), well, data)
    }

    pub(super) fn promise_of(&mut self, run: Option<&str>, well: Option<&str>, data: EventData) -> Result<(), StoreError> {
        self.flush()?;
        let event = self.journal.append(run, well, data)?;
        self.state.apply(&event.body);
        self.publisher.announce(event);
        Ok(())
    }

    /// Writes what waits, as far as the disk takes it.
    pub(super) fn flush(&mut self) -> Result<(), StoreError> {
        while let Some(next) = self.unwritten.front() {
            match next {
                Unwritten::Event(body) => self.publisher.announce(self.journal.write(body)?),
                Unwritten::Run(record) => self.store.save_run(record)?,
            }
            self.unwritten.pop_front();
        }
        Ok(())
    }

    /// The answer to a command that was carried out whatever the disk did.
    pub(super) fn on_disk(&self) -> Result<(), Refusal> {
        if self.unwritten.is_empty() { Ok(()) } else { Err(self.disk_fault().unwrap_or(Refusal::Busy)) }
    }

    /// What the disk's fault says, while it stands.
    pub(super) fn disk_fault(&self) -> Option<Refusal> {
        let fault = self.state.faults.open().iter().find(|f| f.is_of_storage())?;
        Some(Refusal::Store { why: fault.message.clone(), full: fault.code == fault_table::DISK_FULL.code })
    }

    /// The daemon's last word, and one more try for what is not on disk.
    pub(super) fn last_word(&mut self) -> Result<(), StoreError> {
        let told = self.promise(None, EventData::DaemonStopped);
        if !self.unwritten.is_empty() {
            tracing::error!(unwritten = self.unwritten.len(), "the daemon ends with events and records that the disk did not take");
        }
        told
    }
}
