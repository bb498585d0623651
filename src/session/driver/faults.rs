//! Faults: raised, over by themselves, acknowledged; and what they keep from running.

use super::super::fault::{self, Lost, table};
use super::super::state::{HOLDABLE, Trigger};
use super::super::worker::RunError;
use super::super::{Fault, Refusal, State, Status, kind};
use super::{Asked, Running};
use crate::store::StoreError;
use serde_json::json;

/// Category of what a disk did, which is over once the disk takes writes again.
pub(super) const STORAGE: &str = "storage";

/// Free space below which a disk that was full is not tried again, bytes: a few frames and their record.
const ROOM_BYTES: u64 = 64 << 20;

/// Whether a fault ends when its cause does; the others stay until somebody has acknowledged them.
pub(super) fn ends_by_itself(fault: &Fault) -> bool {
    fault.category == STORAGE || [Lost::Camera, Lost::Rotation].iter().any(|device| device.is_all_of(fault))
}

impl Running {
    /// A write that fails holds the run: motors first, then the fault. What could not be written is shown all the same, and the
    /// plate is not called removable.
    pub(super) fn keep(&mut self, written: Result<(), StoreError>) {
        let Err(error) = written else { return };
        tracing::error!(%error, "not stored");
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if works {
            self.ask(Asked::Halt);
        }
        // What is raised is written behind what failed; a second failure adds nothing.
        if !std::mem::replace(&mut self.store_failed, true) {
            self.raise(&error.into());
        }
        if works && HOLDABLE.contains(&self.publisher.status().state) {
            self.go(Trigger::Hold);
        }
    }

    /// A fault of the run under way.
    pub(super) fn fault(&mut self, error: &RunError) {
        if matches!(error, RunError::Store(_)) {
            self.store_failed = true;
        }
        self.raise(error);
    }

    pub(super) fn raise(&mut self, error: &RunError) {
        self.fault_seq += 1;
        let raised = fault::of(self.fault_seq, error);
        let lost = fault::lost_device(error);
        if let Some(lost) = lost.filter(|lost| !self.lost.contains(lost)) {
            self.lost.push(lost);
        }
        let shown = raised.clone();
        self.publish(|s| {
            match lost {
                Some(Lost::Camera) => s.hardware.camera.connected = false,
                Some(Lost::Rotation) => s.hardware.lose_axes(),
                None => {}
            }
            s.faults.push(shown);
        });
        self.event(kind::FAULT_RAISED, None, serde_json::to_value(&raised).unwrap_or_default());
    }

    /// Takes out of the list what is over, in one revision with what shows that it is.
    pub(super) fn fault_over(&mut self, is_over: impl Fn(&Fault) -> bool, why: &str, change: impl FnOnce(&mut Status)) {
        let over: Vec<u64> = self.publisher.status().faults.iter().filter(|f| is_over(f)).map(|f| f.seq).collect();
        self.event(kind::FAULT_CLEARED, None, json!({ "seq": over, "why": why }));
        self.publish(|s| {
            change(s);
            s.faults.retain(|f| !over.contains(&f.seq));
        });
    }

    /// A disk that failed is tried until it takes writes; what is not on it yet goes first.
    pub(super) fn try_the_store(&mut self) {
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        if !self.store_failed || works || self.store.free_bytes().is_some_and(|free| free < ROOM_BYTES) {
            return;
        }
        let written = self
            .flush()
            .and_then(|()| self.active.as_ref().map_or(Ok(()), |active| self.store.save_run(&active.record)))
            .and_then(|()| self.promise(kind::STORE_REGAINED, None, serde_json::Value::Null));
        if let Err(error) = written {
            tracing::warn!(%error, "the disk does not take writes yet");
            return;
        }
        self.store_failed = false;
        self.fault_over(|fault| fault.category == STORAGE, "the disk takes writes again", |_| ());
        self.resume_by_itself();
    }

    /// Refuses what cannot run: a device is away, or a fault waits for somebody.
    pub(super) fn nothing_stands_in_the_way(&self) -> Result<(), Refusal> {
        if let Some(lost) = self.lost.first() {
            return Err(Refusal::DeviceLost { why: lost.way_out().to_owned() });
        }
        let status = self.publisher.status();
        match status.faults.iter().find(|f| f.operator_required) {
            Some(f) if f.category == STORAGE => self.disk_fault().map_or(Ok(()), Err),
            Some(f) => Err(Refusal::FaultStands { seq: f.seq, code: f.code.clone(), message: f.message.clone() }),
            None => Ok(()),
        }
    }

    pub(super) fn acknowledge(&mut self, seq: u64) -> Result<(), Refusal> {
        let status = self.publisher.status();
        let Some(fault) = status.faults.iter().find(|f| f.seq == seq) else {
            // Over already, by itself or by somebody's word.
            return if (1..=self.fault_seq).contains(&seq) { Ok(()) } else { Err(Refusal::UnknownFault { seq, newest: self.fault_seq }) };
        };
        self.promise(kind::FAULT_ACKNOWLEDGED, None, json!({ "seq": seq, "code": fault.code }))?;
        // Somebody knows; but it goes with its cause.
        if !ends_by_itself(fault) {
            self.publish(|s| s.faults.retain(|f| f.seq != seq));
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
        let latched = self.publisher.status().faults.iter().any(|f| f.code == table::EMERGENCY_STOP.code);
        if !latched {
            self.fault_seq += 1;
            let fault = Fault::new(self.fault_seq, &table::EMERGENCY_STOP, table::EMERGENCY_STOP.meaning.into());
            let shown = fault.clone();
            self.publish(|s| s.faults.push(shown));
            self.event(kind::FAULT_RAISED, None, serde_json::to_value(&fault).unwrap_or_default());
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
