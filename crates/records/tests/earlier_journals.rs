//! Journals that earlier builds wrote are read in full.

#![allow(clippy::unwrap_used)] // a test may panic

use carved_records::{Event, EventData, InstrumentState, Phase, RunState, SpecimenOutcome, kind};
use serde_json::{Value, json};
use std::collections::BTreeSet;

const JOURNAL: &str = include_str!("data/loader-crash/events.jsonl");
const WITH_FAULTS: &str = include_str!("data/faults/events.jsonl");

fn events_of(journal: &str) -> Vec<Event> {
    journal.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn events() -> Vec<Event> {
    events_of(JOURNAL)
}

#[test]
fn every_line_is_understood_and_written_again_as_it_was() {
    for (line, event) in [JOURNAL, WITH_FAULTS].iter().flat_map(|journal| journal.lines().zip(events_of(journal))) {
        assert!(!matches!(event.body.data, EventData::Other { .. }), "{line}");
        let was: Value = serde_json::from_str(line).unwrap();
        let mut now = serde_json::to_value(&event).unwrap();
        take_newer_keys(&mut now, &was);
        assert_eq!(now, was);
    }
}

/// A journal that is taken away, or a kind that is renamed, would leave lines untested.
#[test]
fn every_kind_that_an_earlier_build_wrote_is_in_a_kept_journal() {
    let events: Vec<Event> = [JOURNAL, WITH_FAULTS].iter().flat_map(|journal| events_of(journal)).collect();
    let kept: BTreeSet<&str> = events.iter().map(|event| event.body.data.kind()).collect();
    let missing: Vec<&str> = kind::ALL.iter().copied().filter(|kind| !kept.contains(kind)).collect();
    assert_eq!(missing, NOT_KEPT);
}

/// The kinds of which no line of an earlier build is kept. A kind that is new goes here.
const NOT_KEPT: &[&str] = &[
    kind::WELL_TAKEN_OUT,
    kind::WELL_SKIPPED,
    kind::WELL_REDO_REQUESTED,
    kind::WELL_NOTED,
    kind::SPECIMEN_TRIED_AGAIN,
    kind::SPECIMEN_UNASKED,
];

/// The state of the run and of the instrument, by the names of the accessors.
fn described(state: &InstrumentState) -> Value {
    let of_run = |run: &RunState| {
        let specimens = run.specimens();
        let wells = ["A01", "A02", "A03"];
        let times_held_by = ["operator", "restart", "disk_full", "camera_lost", "rotation_lost"].map(|code| run.times_held_by(code));
        json!({
            "id": run.id(), "begun": specimens.begun(), "end_request": run.end_request().map(|end| format!("{end:?}")),
            "inside": specimens.inside(), "asked_for": specimens.asked_for(), "brought": specimens.continued_with(),
            "has_held": wells.map(|well| specimens.has_held(well)),
            "is_held_by_operator": run.is_held_by_operator(), "held_by": run.held_by().map(|cause| [&cause.code, &cause.words]),
            "times_held_by": times_held_by, "resumed_by_itself": run.resumed_by_itself(),
            "recoveries_of": wells.map(|well| run.recoveries_of(well)),
        })
    };
    let (plate, faults) = (&state.plate, &state.faults);
    // Of a specimen that is not begun, so the time plays no part.
    let waits = state.paces.remaining("standard", None, 1, jiff::Timestamp::UNIX_EPOCH);
    json!({
        "run": state.run.as_ref().map(of_run),
        "plate": {
            "inside": plate.inside(), "handed_over": plate.handed_over(), "open": plate.open(), "ended": plate.ended().map(|end| format!("{end:?}")),
        },
        "faults": { "open": faults.open().iter().map(|fault| &fault.code).collect::<Vec<_>>(), "newest": faults.newest() },
        "a_specimen_takes_s": waits.map(|eta| [eta.p50, eta.p90]),
    })
}

/// `states.jsonl` has the state after some events, by their number, and before each start of the daemon.
#[test]
fn the_states_that_follow_are_those_of_the_kept_file() {
    let events = events_of(WITH_FAULTS);
    let mut state = InstrumentState::default();
    let mut found = Vec::new();
    for (i, event) in events.iter().enumerate() {
        state.apply(&event.body);
        let is_last = events.get(i + 1).is_none_or(|next| matches!(next.body.data, EventData::DaemonStarted(_)));
        let is_kept = matches!(
            event.body.data,
            EventData::RunHeld(_)
                | EventData::RunResumed(_)
                | EventData::RunEnded(_)
                | EventData::RunInterrupted(_)
                | EventData::SpecimenRecovering(_)
        );
        if is_last || is_kept {
            found.push(json!({ "after": event.id, "state": described(&state) }));
        }
    }
    let kept: Vec<Value> = include_str!("data/faults/states.jsonl").lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for (found, kept) in found.iter().zip(&kept) {
        assert_eq!(found, kept);
    }
    assert_eq!(found.len(), kept.len());
}

/// Removes the keys that the journal's build did not know. They say nothing about its events, so they are null. Data without any key were null.
fn take_newer_keys(now: &mut Value, was: &Value) {
    if was.is_null() && *now == json!({}) {
        *now = Value::Null;
    }
    if let (Some(now), Some(was)) = (now.as_object_mut(), was.as_object()) {
        now.retain(|key, value| was.contains_key(key) || !value.is_null());
        for (key, value) in now {
            take_newer_keys(value, &was[key]);
        }
    }
}

#[test]
fn the_state_that_follows_is_the_one_in_which_the_daemon_was_killed() {
    let state = InstrumentState::after(&events());
    let run = state.run.unwrap();
    assert_eq!((run.id(), run.specimens().begun(), run.specimens().inside()), ("old-1", vec!["B01"], Some("B01")));
    assert_eq!((run.specimens().continued_with(), run.specimens().asked_for(), run.is_held_by_operator()), (None, None, false));
    assert_eq!((state.plate.inside(), state.plate.open(), state.faults.open().len()), (Some("OLD-1"), None, 0));
    // Three wells were measured: the fourth takes about as long.
    let now = "2026-11-22T19:20:00Z".parse().unwrap();
    let eta = state.paces.remaining("standard", None, 1, now).unwrap();
    assert!((0.5..120.0).contains(&eta.p50), "{eta:?}");
    let done = events().into_iter().filter_map(|event| match event.body.data {
        EventData::SpecimenDone(done) => done.result.outcome,
        _ => None,
    });
    assert_eq!(done.collect::<Vec<_>>(), [SpecimenOutcome::Succeeded; 3]);
    let last = events().into_iter().rev().find_map(|event| match event.body.data {
        EventData::SpecimenPhase(entered) => Some((entered.phase, entered.in_capillary)),
        _ => None,
    });
    assert_eq!(last, Some((Phase::Revolve, true)));
}
