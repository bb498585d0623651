//! Open faults: raised, and not over.

use crate::{EventData, Fault, FaultEnd};

/// The open faults, oldest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenFaults {
    open: Vec<Fault>,
    newest: u64,
}

impl OpenFaults {
    /// The open faults, oldest first.
    pub fn open(&self) -> &[Fault] {
        &self.open
    }

    /// Number of the newest fault. 0 before the first one.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Continues the numbers after `newest`, even if this fault is not remembered.
    pub fn number_from(&mut self, newest: u64) {
        self.newest = self.newest.max(newest);
    }

    pub(super) fn apply(&mut self, event: &EventData) {
        match event {
            EventData::FaultRaised(fault) => {
                self.number_from(fault.seq);
                self.open.push(fault.clone());
            }
            // An acknowledged fault is closed, unless it ends with its cause.
            EventData::FaultAcknowledged(known) => self.open.retain(|f| f.seq != known.seq || f.ends_by_itself()),
            EventData::FaultsCleared(over) => self.open.retain(|f| !over.seq.contains(&f.seq)),
            // These faults ask for a retry, which happens now.
            EventData::RunAccepted(_) | EventData::RunResumed(_) => self.open.retain(|f| f.operator_required),
            // Causes that end by themselves, and those that end with a start, are checked again after it.
            // A lost axis stays: when it answers, a person is told that it was away.
            EventData::DaemonStarted(_) => {
                self.open.retain(|f| matches!(f.end(), FaultEnd::Acknowledgement) || f.ends_by_itself() && !f.lets_run_go_on());
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault_table::{self, FaultCode};
    use crate::{DaemonStarted, FaultAcknowledged, FaultsCleared, Mode, ResumedBy, RunResumed};

    fn after(events: &[EventData]) -> Vec<u64> {
        let mut faults = OpenFaults::default();
        for event in events {
            faults.apply(event);
        }
        faults.open().iter().map(|f| f.seq).collect()
    }

    fn raised(seq: u64, code: &FaultCode) -> EventData {
        EventData::FaultRaised(Fault::new(seq, code, String::new(), String::new()))
    }

    fn acknowledged(seq: u64) -> EventData {
        EventData::FaultAcknowledged(FaultAcknowledged { seq, code: String::new(), by: None, from: None })
    }

    fn started() -> EventData {
        EventData::DaemonStarted(DaemonStarted { version: String::new(), mode: Mode::Simulated })
    }

    #[test]
    fn a_fault_is_open_until_somebody_acknowledges_it_or_its_cause_is_over() {
        let stop = raised(1, &fault_table::EMERGENCY_STOP);
        let lost = raised(2, &fault_table::CAMERA_LOST);
        let all = [stop, lost];
        assert_eq!(after(&all), [1, 2]);
        assert_eq!(after(&[&all[..], &[acknowledged(1)]].concat()), [2]);
        assert_eq!(after(&[&all[..], &[acknowledged(2)]].concat()), [1, 2], "it ends with its cause");
        let cleared = EventData::FaultsCleared(FaultsCleared { seq: vec![2], why: String::new() });
        assert_eq!(after(&[&all[..], &[cleared]].concat()), [1]);
        assert_eq!(after(&[&all[..], &[started()]].concat()), [1], "after a start the camera is looked for anew");
    }

    #[test]
    fn what_asks_to_be_tried_again_is_over_once_it_is() {
        let suspect = raised(1, &fault_table::ROTATION_SUSPECT);
        let resumed = EventData::RunResumed(RunResumed { by: ResumedBy::Operator, name: None, from: None });
        assert_eq!(after(std::slice::from_ref(&suspect)), [1]);
        assert!(after(&[suspect.clone(), resumed]).is_empty());
        assert!(after(&[suspect, started()]).is_empty());
    }

    #[test]
    fn what_asks_for_a_start_is_over_after_it() {
        for code in [&fault_table::CAMERA_REFUSED, &fault_table::SETUP_UNUSABLE] {
            assert_eq!(after(&[raised(1, code)]), [1]);
            assert!(after(&[raised(1, code), started()]).is_empty(), "{}: it is raised again if its cause lasts", code.code);
        }
    }
}
