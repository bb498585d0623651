//! Faults: raised, over by themselves, acknowledged; and what they keep from running.

use super::super::fault;
use super::super::state::{HOLDABLE, Trigger};
use super::super::worker::RunError;
use super::super::{Refusal, State, Status};
use super::{Request, Running};
use carved_records::{Device, EventData, Fault, FaultAcknowledged, FaultsCleared, fault_table};
use carved_store::StoreError;

/// Free space below which a disk that was full is not tried again, bytes: a few frames and their record.
const ROOM_BYTES: u64 = 64 << 20;

impl Running {
    /// A write that fails holds the run: motors first, then the fault. What could not be written is shown all the same, and the
    /// plate is not called removable.
    pub(super) fn keep(&mut self, written: Result<(), StoreError>) {
        let Err(error) = written else { return };
        tracing::error!(%error, "not stored");
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if works {
            self.ask(Request::Halt);
        }
        // What is raised is written behind what failed; a second failure adds nothing.
        if !self.outbox.set_failing(true) {
            self.raise(&error.into());
        }
        if works && HOLDABLE.contains(&self.publisher.status().state) {
            self.go(Trigger::Hold);
        }
    }

    /// A fault of the run under way.
    pub(super) fn fault(&mut self, error: &RunError) {
        if matches!(error, RunError::Store(_)) {
            self.outbox.set_failing(true);
        }
        self.raise(error);
    }

    pub(super) fn raise(&mut self, error: &RunError) {
        let raised = fault::of(self.state().faults.newest() + 1, error);
        let lost = fault::lost_device(error);
        if let Some(lost) = lost.filter(|lost| !self.lost.contains(lost)) {
            self.lost.push(lost);
        }
        self.event_shown(None, EventData::FaultRaised(raised), |d| {
            d.publish(|s| match lost {
                Some(Device::Camera) => s.hardware.camera.connected = false,
                Some(Device::Rotation) => s.hardware.lose_axes(),
                None => {}
            });
        });
    }

    /// Takes out of the list what is over, in one revision with what shows that it is.
    pub(super) fn fault_over(&mut self, is_over: impl Fn(&Fault) -> bool, why: &str, change: impl FnOnce(&mut Status)) {
        let seq = self.state().faults.open().iter().filter(|f| is_over(f)).map(|f| f.seq).collect();
        self.event(None, EventData::FaultsCleared(FaultsCleared { seq, why: why.to_owned() }));
        self.publish(change);
    }

    /// A disk that failed is tried until it takes writes; what is not on it yet goes first.
    pub(super) fn try_the_store(&mut self) {
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if !self.outbox.is_failing() || works || self.store.free_bytes().is_some_and(|free| free < ROOM_BYTES) {
            return;
        }
        let written = self
            .flush()
            .and_then(|()| self.active.as_ref().map_or(Ok(()), |active| self.store.save_run(&active.record)))
            .and_then(|()| self.promise(None, EventData::StoreRegained));
        if let Err(error) = written {
            tracing::warn!(%error, "the disk does not take writes yet");
            return;
        }
        self.outbox.set_failing(false);
        self.fault_over(Fault::is_of_storage, "the disk takes writes again", |_| ());
        self.resume_by_itself();
    }

    /// Refuses what cannot run: a device is away, or a fault waits for somebody.
    pub(super) fn nothing_stands_in_the_way(&self) -> Result<(), Refusal> {
        if let Some(lost) = self.lost.first() {
            return Err(Refusal::DeviceLost { why: lost.way_out().to_owned() });
        }
        match self.state().faults.open().iter().find(|f| f.operator_required) {
            Some(f) if f.is_of_storage() => self.disk_fault().map_or(Ok(()), Err),
            Some(f) => Err(Refusal::FaultStands { seq: f.seq, code: f.code.clone(), message: f.message.clone() }),
            None => Ok(()),
        }
    }

    pub(super) fn acknowledge(&mut self, seq: u64) -> Result<(), Refusal> {
        let newest = self.state().faults.newest();
        let Some(fault) = self.state().faults.open().iter().find(|f| f.seq == seq) else {
            // Over already, by itself or by somebody's word.
            return if (1..=newest).contains(&seq) { Ok(()) } else { Err(Refusal::UnknownFault { seq, newest }) };
        };
        let (code, goes_with_its_cause) = (fault.code.clone(), fault.ends_by_itself());
        self.promise(None, EventData::FaultAcknowledged(FaultAcknowledged { seq, code }))?;
        if !goes_with_its_cause {
            self.publish(|_| ());
        }
        Ok(())
    }

    /// The motors have been told already. What runs is aborted, and nothing runs again before somebody has acknowledged it.
    pub(super) fn emergency_stopped(&mut self) -> Result<(), Refusal> {
        self.emergency_pressed();
        self.on_disk()
    }

    /// Once for all who pressed it until now.
    pub(super) fn emergency_pressed(&mut self) {
        if !self.publisher.halt().take() {
            return;
        }
        let latched = self.state().faults.open().iter().any(|f| f.code == fault_table::EMERGENCY_STOP.code);
        if !latched {
            let (seq, since) = (self.state().faults.newest() + 1, jiff::Timestamp::now().to_string());
            let fault = Fault::new(seq, &fault_table::EMERGENCY_STOP, fault_table::EMERGENCY_STOP.meaning.into(), since);
            self.event_shown(None, EventData::FaultRaised(fault), |d| d.publish(|_| ()));
        }
        let state = self.publisher.status().state;
        if self.active.is_some() && state != State::Aborting {
            self.abort();
        } else if self.active.is_none() && state != State::Aborted {
            self.go(Trigger::Abort);
            self.go(Trigger::MotorsStopped);
        }
    }
}
