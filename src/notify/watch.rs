//! Which revisions of the status are worth a notice. No clock and no network.

use super::notice::{EventName, Notice};
use crate::api::{RunStatus, State, Status};

/// What was noticed before.
#[derive(Debug, Default)]
pub(super) struct Watch {
    /// A run without an outcome that the status has shown.
    open: Option<String>,
    is_held: bool,
    /// The run waits for a person.
    waits: bool,
    /// The newest fault that needed a person.
    fault: u64,
    /// Number of notices so far.
    made: u64,
}

/// The run, if it is held and nobody has requested its end.
fn held(status: &Status) -> Option<&RunStatus> {
    let is_ending = status.pending.stop || status.pending.abort;
    status.run.as_ref().filter(|run| run.outcome.is_none() && status.state == State::Held && !is_ending)
}

/// Whether a person has to do something: about a fault, or because the run does not continue by itself.
pub fn needs_somebody(status: &Status) -> bool {
    status.faults.iter().any(|fault| fault.operator_required) || held(status).is_some_and(|run| !run.goes_on_by_itself)
}

impl Watch {
    /// The notices that this revision is worth.
    pub fn see(&mut self, status: &Status) -> Vec<Notice> {
        let mut events = Vec::new();
        let run = status.run.as_ref();
        let ended = run.filter(|run| run.outcome.is_some() && self.open.as_deref() == Some(run.id.as_str()));
        events.extend(ended.map(|_| EventName::RunEnded));
        if ended.is_some() {
            self.open = None;
        }
        if let Some(run) = run.filter(|run| run.outcome.is_none()) {
            self.open = Some(run.id.clone());
        }
        let (is_held, waits) = (held(status).is_some(), held(status).is_some_and(|run| !run.goes_on_by_itself));
        let is_new_hold = is_held && !self.is_held;
        events.extend(is_new_hold.then_some(EventName::RunHeld));
        let newest = status.faults.iter().filter(|fault| fault.operator_required).map(|fault| fault.seq).max().unwrap_or(0);
        // The notice of a hold says by itself whether the run waits for a person.
        let is_needed = newest > self.fault || waits && !self.waits;
        events.extend((is_needed && !is_new_hold).then_some(EventName::PersonNeeded));
        (self.is_held, self.waits, self.fault) = (is_held, waits, self.fault.max(newest));
        events.into_iter().map(|event| self.notice(event, status)).collect()
    }

    fn notice(&mut self, event: EventName, status: &Status) -> Notice {
        self.made += 1;
        Notice::new(event, status, needs_somebody(status), self.made)
    }
}

#[cfg(test)]
mod tests {
    use super::super::notice::tests::status;
    use super::*;
    use crate::api::{Fault, RunOutcome, WellCounts};
    use carved_records::{Fault as Recorded, FaultCode, RunUnderFault, fault_table};

    fn run(outcome: Option<RunOutcome>, goes_on_by_itself: bool) -> RunStatus {
        RunStatus {
            id: "r1".into(),
            external_id: None,
            method: "standard".into(),
            operator: "kim".into(),
            wells: WellCounts::default(),
            results: Vec::new(),
            started: String::new(),
            ended: None,
            eta_s: None,
            outcome,
            held_by_operator: false,
            goes_on_by_itself,
            hold: None,
        }
    }

    fn fault(seq: u64, code: &FaultCode, run: RunUnderFault) -> Fault {
        Fault::of(&Recorded::new(seq, code, "found".into(), String::new()), run)
    }

    fn of(state: State, run: Option<RunStatus>, faults: Vec<Fault>) -> Status {
        Status { state, run, faults, ..status() }
    }

    #[test]
    fn each_hold_each_call_for_a_person_and_each_end_is_noticed_once() {
        use EventName::{PersonNeeded, RunEnded, RunHeld};
        use State::{Complete, Execute, Held, Holding, Idle};
        let (open, alone, over) = (run(None, false), run(None, true), run(Some(RunOutcome::Succeeded), false));
        // The same fault calls for a person once the run does not go on by itself any more.
        let [late, waits] = [RunUnderFault::GoesOnByItself, RunUnderFault::Waits].map(|run| fault(1, &fault_table::CAMERA_NO_FRAME, run));
        let stop = fault(2, &fault_table::EMERGENCY_STOP, RunUnderFault::Waits);
        assert!(!late.operator_required && waits.operator_required && stop.operator_required);
        let script: Vec<(Status, Vec<EventName>, bool)> = vec![
            // After a start the last run is shown again.
            (of(Complete, Some(over.clone()), vec![]), vec![], false),
            (of(Execute, Some(open.clone()), vec![]), vec![], false),
            (of(Holding, Some(alone.clone()), vec![late.clone()]), vec![], false),
            (of(Held, Some(alone.clone()), vec![late.clone()]), vec![RunHeld], false),
            (of(Held, Some(alone), vec![late]), vec![], false),
            (of(Held, Some(open.clone()), vec![waits]), vec![PersonNeeded], true),
            (of(Execute, Some(open.clone()), vec![]), vec![], false),
            (of(Held, Some(open.clone()), vec![]), vec![RunHeld], true),
            (of(Execute, Some(open.clone()), vec![]), vec![], false),
            (of(Holding, Some(open.clone()), vec![stop.clone()]), vec![PersonNeeded], true),
            (of(Held, Some(open), vec![stop.clone()]), vec![RunHeld], true),
            (of(Complete, Some(over.clone()), vec![stop]), vec![RunEnded], true),
            (of(Complete, Some(over), vec![]), vec![], false),
            (of(Idle, None, vec![]), vec![], false),
        ];
        let (mut watch, mut ids) = (Watch::default(), std::collections::BTreeSet::new());
        for (i, (status, expected, needs)) in script.into_iter().enumerate() {
            let notices = watch.see(&status);
            assert_eq!(notices.iter().map(|notice| notice.event).collect::<Vec<_>>(), expected, "step {i}");
            assert_eq!(needs_somebody(&status), needs, "step {i}");
            assert!(notices.into_iter().all(|notice| ids.insert(notice.id)), "step {i}");
        }
    }

    #[test]
    fn what_still_stands_after_a_restart_is_noticed_again() {
        let open = Some(run(None, false));
        let stands = of(State::Held, open, vec![fault(2, &fault_table::EMERGENCY_STOP, RunUnderFault::None)]);
        for _boot in 0..2 {
            assert_eq!(Watch::default().see(&stands).len(), 1);
        }
    }
}
