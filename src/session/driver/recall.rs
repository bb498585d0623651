//! What the newest events of the journal still mean after a start: faults that wait for somebody, the plate inside or on its way, and
//! how far an open run had come. Pure.

use super::super::{Event, Fault, Handoff, HandoffEnd, Phase, RunOutcome, State, kind};
use super::Asked;
use super::faults::ends_by_itself;
use super::life::BY_ITSELF;
use std::collections::{BTreeMap, BTreeSet};

/// How far a run had come when the daemon ended.
#[derive(Debug, Default, PartialEq)]
pub(super) struct RunMemory {
    /// The operator had held it, and nobody had let it go on.
    pub held_by_operator: bool,
    /// What held it when the daemon ended, by code and in words.
    pub held_by: Option<(String, String)>,
    /// How often each cause had held it since a well was done.
    pub holds: BTreeMap<String, u32>,
    /// How often it had gone on by itself since a well was done.
    pub resumed_by_itself: u32,
    /// How often the numbers of a well were begun to be made from its frames since anything came of it.
    pub recoveries: BTreeMap<String, u32>,
    /// The end that somebody had asked for.
    pub asked: Option<Asked>,
    /// The wells whose specimens were begun and have no end, the one that had the rig last.
    pub begun: Vec<String>,
    /// Of those, the ones that were more than waited for: they were in the capillary, wherever they are now.
    pub looked_at: BTreeSet<String>,
    /// The well whose specimen was last said to be in the capillary.
    pub in_capillary: Option<String>,
    /// The well whose specimen the loader was last asked for and has not brought.
    pub asked_for: Option<String>,
    /// The well whose specimen it has brought and with which nothing was done since.
    pub brought: Option<String>,
    /// The wells whose specimens were in the capillary at any time.
    pub been_inside: BTreeSet<String>,
}

impl RunMemory {
    /// The state in which the run ended.
    pub fn rests_in(&self, outcome: Option<RunOutcome>) -> State {
        match (outcome, self.asked) {
            (Some(RunOutcome::Interrupted), _) | (_, Some(Asked::Stop)) => State::Stopped,
            (Some(RunOutcome::Aborted), _) => State::Aborted,
            _ => State::Complete,
        }
    }
}

pub(super) fn run<'a>(events: impl Iterator<Item = &'a Event>, run: &str) -> RunMemory {
    let mut memory = RunMemory::default();
    for event in events.filter(|e| e.run.as_deref() == Some(run)) {
        match (event.kind.as_str(), &event.well) {
            (kind::RUN_ACCEPTED, _) => {
                memory.in_capillary = event.data["left_in_capillary"].as_str().map(str::to_owned);
                memory.been_inside = memory.in_capillary.iter().cloned().collect();
            }
            (kind::RUN_HOLD_REQUESTED, _) => memory.held_by_operator = true,
            (kind::RUN_HELD, _) => {
                if let (Some(code), Some(cause)) = (event.data["code"].as_str(), event.data["cause"].as_str()) {
                    memory.held_by = Some((code.to_owned(), cause.to_owned()));
                    *memory.holds.entry(code.to_owned()).or_default() += 1;
                }
            }
            (kind::RUN_RESUMED, _) => {
                memory.held_by = None;
                memory.held_by_operator = false;
                memory.resumed_by_itself = if event.data["by"] == BY_ITSELF { memory.resumed_by_itself + 1 } else { 0 };
            }
            (kind::RUN_STOP_REQUESTED, _) => memory.asked = memory.asked.max(Some(Asked::Stop)),
            (kind::RUN_ABORT_REQUESTED, _) => memory.asked = memory.asked.max(Some(Asked::Abort)),
            (kind::WELL_AWAITED, Some(well)) => memory.asked_for = Some(well.clone()),
            (kind::WELL_LOADED, Some(well)) => {
                memory.asked_for = None;
                memory.in_capillary = Some(well.clone());
                memory.brought = Some(well.clone());
                memory.been_inside.insert(well.clone());
            }
            (kind::WELL_UNLOADED, Some(well)) => {
                memory.in_capillary.take_if(|inside| inside == well);
                memory.brought.take_if(|brought| brought == well);
                memory.been_inside.insert(well.clone());
            }
            (kind::SPECIMEN_PHASE, Some(well)) => {
                let begun = event.data["phase"] != Phase::Load.name();
                memory.brought.take_if(|brought| begun && brought == well);
                // An attempt that is taken out before a run goes on is none that is under way.
                let taken_out = [Phase::Eject, Phase::Wash].iter().any(|out| event.data["phase"] == out.name());
                if !taken_out && !memory.begun.contains(well) {
                    memory.begun.push(well.clone());
                }
                if begun && !taken_out {
                    memory.looked_at.insert(well.clone());
                }
                // While one is awaited the former may still be inside.
                if event.data["in_capillary"] == true {
                    memory.in_capillary = Some(well.clone());
                    memory.been_inside.insert(well.clone());
                } else if memory.brought.as_ref() != Some(well) {
                    memory.in_capillary.take_if(|inside| inside == well);
                }
            }
            (kind::SPECIMEN_RECOVERING, Some(well)) => *memory.recoveries.entry(well.clone()).or_default() += 1,
            // It was the disk that kept them from being made, or somebody who would not wait.
            (kind::STORE_REGAINED | kind::DAEMON_STOPPING, _) => memory.recoveries.clear(),
            (end @ (kind::SPECIMEN_DONE | kind::SPECIMEN_INTERRUPTED), Some(well)) => {
                if end == kind::SPECIMEN_DONE {
                    memory.resumed_by_itself = 0;
                    memory.holds.clear();
                }
                // A fault of the instrument has left it in the capillary.
                if event.data["kept"] == true {
                    memory.brought = Some(well.clone());
                }
                memory.begun.retain(|begun| begun != well);
                memory.looked_at.remove(well);
            }
            _ => {}
        }
    }
    memory
}

/// Faults that nobody has acknowledged and that do not end by themselves.
pub(super) fn standing_faults<'a>(events: impl Iterator<Item = &'a Event>) -> Vec<Fault> {
    let mut standing: Vec<Fault> = Vec::new();
    for event in events {
        match event.kind.as_str() {
            kind::FAULT_RAISED => standing.extend(serde_json::from_value::<Fault>(event.data.clone())),
            kind::FAULT_ACKNOWLEDGED => standing.retain(|f| event.data["seq"] != f.seq),
            kind::FAULT_CLEARED => {
                standing.retain(|f| !event.data["seq"].as_array().is_some_and(|over| over.iter().any(|seq| *seq == f.seq)));
            }
            _ => {}
        }
    }
    standing.retain(|f| f.operator_required && !ends_by_itself(f));
    standing
}

/// The plate that was handed over and not taken away again.
pub(super) fn plate_inside<'a>(events: impl Iterator<Item = &'a Event>) -> Option<String> {
    let mut inside = None;
    for event in events {
        match event.kind.as_str() {
            kind::PLATE_LOADED => inside = event.data["barcode"].as_str().map(str::to_owned),
            kind::PLATE_UNLOADED => inside = None,
            _ => {}
        }
    }
    inside
}

/// A handover that was announced and not ended, and how the newest one ended otherwise.
pub(super) fn handoff<'a>(events: impl Iterator<Item = &'a Event>) -> (Option<Handoff>, Option<HandoffEnd>) {
    let mut newest = (None, None);
    for event in events {
        match event.kind.as_str() {
            kind::PLATE_ANNOUNCED => newest = (serde_json::from_value(event.data.clone()).ok(), None),
            kind::PLATE_LOADED | kind::PLATE_UNLOADED => newest = (None, Some(HandoffEnd::Completed)),
            // A run is taken of a plate that is there: an older store may lack the word.
            kind::RUN_ACCEPTED if newest.0.is_some() => newest = (None, None),
            kind::PLATE_HANDOFF_ABORTED => newest = (None, Some(HandoffEnd::Aborted)),
            _ => {}
        }
    }
    newest
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn event(kind: &str, well: Option<&str>, data: Value) -> Event {
        Event { id: 1, time: "2026-01-01T00:00:00Z".into(), kind: kind.into(), run: Some("r".into()), well: well.map(Into::into), data }
    }

    fn phase(well: &str, phase: Phase, in_capillary: bool) -> Event {
        event("specimen.phase", Some(well), json!({ "phase": phase, "in_capillary": in_capillary }))
    }

    fn of(events: &[Event]) -> RunMemory {
        run(events.iter(), "r")
    }

    #[test]
    fn the_specimen_under_way_is_the_one_that_was_begun_and_not_done() {
        let a = [phase("A01", Phase::Load, false), phase("A01", Phase::Revolve, true)];
        let memory = of(&a);
        assert_eq!((&memory.begun[..], memory.in_capillary.as_deref()), (&["A01".to_owned()][..], Some("A01")));
        let done = [&a[..], &[event("specimen.done", Some("A01"), Value::Null)]].concat();
        assert!(of(&done).begun.is_empty());
        let next = [&done[..], &[phase("A02", Phase::Load, false)]].concat();
        assert_eq!((of(&next).begun, of(&next).in_capillary.as_deref()), (vec!["A02".to_owned()], Some("A01")));
        // The numbers of the first are made while the second is brought.
        let both = [&a[..], &[phase("A01", Phase::Wash, false), phase("A02", Phase::Load, false)]].concat();
        assert_eq!(of(&both).begun, ["A01", "A02"]);
        let loaded = [&next[..], &[event("well.loaded", Some("A02"), Value::Null)]].concat();
        assert_eq!(of(&loaded).in_capillary.as_deref(), Some("A02"));
        let out = [&loaded[..], &[event("well.unloaded", Some("A02"), Value::Null)]].concat();
        assert_eq!(of(&out).in_capillary, None);
    }

    /// A loader is asked again for what it was only waited for, never for what was looked at and taken out since.
    #[test]
    fn a_specimen_that_was_looked_at_is_told_from_one_that_is_waited_for() {
        let awaited = [phase("A01", Phase::Load, false), event("well.loaded", Some("A01"), Value::Null)];
        assert!(of(&awaited).looked_at.is_empty());
        let unloaded = event("well.unloaded", Some("A01"), Value::Null);
        let gone = [&awaited[..], &[phase("A01", Phase::Measure, true), phase("A01", Phase::Eject, true), unloaded]].concat();
        let next = [&gone[..], &[phase("A02", Phase::Load, false)]].concat();
        for events in [&gone, &next] {
            let memory = of(events);
            assert_eq!((memory.looked_at, memory.in_capillary), (BTreeSet::from(["A01".to_owned()]), None));
            assert!(memory.begun.contains(&"A01".to_owned()));
        }
        let done = [&next[..], &[event("specimen.done", Some("A01"), Value::Null)]].concat();
        assert!(of(&done).looked_at.is_empty());
    }

    #[test]
    fn a_specimen_stays_inside_while_the_next_is_awaited_until_either_word_on_it() {
        let awaited =
            [phase("A01", Phase::Eject, true), event("specimen.done", Some("A01"), Value::Null), phase("A02", Phase::Load, false)];
        assert_eq!(of(&awaited).in_capillary.as_deref(), Some("A01"));
        assert_eq!(of(&awaited).begun, ["A02"], "the one inside is measured");
        let then = |last: Event| of(&[&awaited[..], &[last]].concat()).in_capillary;
        assert_eq!(then(event("well.unloaded", Some("A01"), Value::Null)), None);
        assert_eq!(then(event("well.loaded", Some("A02"), Value::Null)).as_deref(), Some("A02"));
        assert_eq!(then(phase("A01", Phase::Eject, false)), None, "the frame shows that nobody was there");
        let left = [event("run.accepted", None, json!({ "left_in_capillary": "H12" }))];
        assert_eq!(of(&left).in_capillary.as_deref(), Some("H12"));
    }

    #[test]
    fn what_the_loader_was_asked_for_and_what_it_has_brought_is_remembered_until_it_is_worked_on() {
        let awaited = [phase("A01", Phase::Load, false), event("well.awaited", Some("A01"), Value::Null)];
        assert_eq!((of(&awaited).asked_for.as_deref(), of(&awaited).brought), (Some("A01"), None));
        let loaded = [&awaited[..], &[event("well.loaded", Some("A01"), Value::Null)]].concat();
        // The run goes on: it is loaded already, and nobody is asked.
        let again = [&loaded[..], &[phase("A01", Phase::Load, false)]].concat();
        for events in [&loaded, &again] {
            let memory = of(events);
            assert_eq!((memory.asked_for, memory.brought.as_deref(), memory.in_capillary.as_deref()), (None, Some("A01"), Some("A01")));
        }
        assert_eq!(of(&[&loaded[..], &[phase("A01", Phase::Position, true)]].concat()).brought, None);
        assert_eq!(of(&[&loaded[..], &[event("well.unloaded", Some("A01"), Value::Null)]].concat()).brought, None);
    }

    #[test]
    fn an_ended_run_is_shown_in_the_state_in_which_it_ended() {
        let stop = event("run.stop_requested", None, Value::Null);
        let abort = event("run.abort_requested", None, Value::Null);
        let rests = |events: &[Event], outcome| of(events).rests_in(Some(outcome));
        assert_eq!(rests(&[], RunOutcome::Partial), State::Complete);
        assert_eq!(rests(std::slice::from_ref(&stop), RunOutcome::Partial), State::Stopped);
        assert_eq!(rests(std::slice::from_ref(&stop), RunOutcome::Aborted), State::Stopped, "stopped before its first number");
        assert_eq!(rests(&[stop, abort.clone()], RunOutcome::Aborted), State::Aborted);
        assert_eq!(rests(&[abort], RunOutcome::Interrupted), State::Stopped, "a signal came before");
        assert_eq!(rests(&[], RunOutcome::Interrupted), State::Stopped);
    }

    /// Crashed twice: the second start must not take the specimen that the first one threw out for one that was begun.
    #[test]
    fn an_attempt_that_was_thrown_out_is_over() {
        let events = [
            phase("A01", Phase::Revolve, true),
            event("specimen.interrupted", Some("A01"), Value::Null),
            event("run.resumed", None, Value::Null),
            phase("A01", Phase::Eject, true),
            phase("A01", Phase::Eject, false),
        ];
        assert_eq!(of(&events), RunMemory { been_inside: BTreeSet::from(["A01".to_owned()]), ..RunMemory::default() });
    }

    #[test]
    fn an_operators_hold_and_an_end_that_was_asked_for_outlast_a_crash() {
        let hold = event("run.hold_requested", None, Value::Null);
        assert!(of(std::slice::from_ref(&hold)).held_by_operator);
        assert!(!of(&[hold, event("run.resumed", None, Value::Null)]).held_by_operator);
        let ends = [event("run.abort_requested", None, Value::Null), event("run.stop_requested", None, Value::Null)];
        assert_eq!(of(&ends).asked, Some(Asked::Abort));
        assert_eq!(run(ends.iter(), "other"), RunMemory::default());
    }

    /// A specimen on which the daemon dies each time must not be begun for ever.
    #[test]
    fn going_on_by_itself_is_counted_over_crashes_until_a_well_is_done() {
        let resumed = |by: &str| event("run.resumed", None, json!({ "by": by }));
        let twice = [resumed(BY_ITSELF), resumed(BY_ITSELF)];
        assert_eq!(of(&twice).resumed_by_itself, 2);
        assert_eq!(of(&[&twice[..], &[resumed("operator")]].concat()).resumed_by_itself, 0);
        assert_eq!(of(&[&twice[..], &[event("specimen.done", Some("A01"), Value::Null)]].concat()).resumed_by_itself, 0);
    }

    #[test]
    fn an_emergency_stop_stands_until_it_is_acknowledged_and_a_lost_device_does_not() {
        let stop = Fault::new(7, &crate::session::fault::table::EMERGENCY_STOP, "pressed".into());
        let lost = Fault { seq: 8, code: "camera_lost".into(), category: "camera".into(), ..stop.clone() };
        let raised = [
            event("fault.raised", None, serde_json::to_value(&stop).unwrap()),
            event("fault.raised", None, serde_json::to_value(&lost).unwrap()),
        ];
        assert_eq!(standing_faults(raised.iter()), [stop]);
        let seen_to = [&raised[..], &[event("fault.acknowledged", None, json!({"seq": 7}))]].concat();
        assert_eq!(standing_faults(seen_to.iter()), []);
    }

    #[test]
    fn a_plate_is_inside_from_its_handover_until_it_is_taken_away() {
        let events = [event("plate.loaded", None, json!({"barcode": "P-1"})), event("plate.unloaded", None, json!({"barcode": "P-1"}))];
        assert_eq!(plate_inside(events[..1].iter()).as_deref(), Some("P-1"));
        assert_eq!(plate_inside(events.iter()), None);
    }
}
