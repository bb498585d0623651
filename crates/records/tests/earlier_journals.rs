//! Journals that earlier builds wrote are read in full.

#![allow(clippy::unwrap_used)] // a test may panic

use carved_records::{Event, EventData, InstrumentState, Phase, SpecimenOutcome};

const JOURNAL: &str = include_str!("data/loader-crash/events.jsonl");

fn events() -> Vec<Event> {
    JOURNAL.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn every_line_is_understood_and_written_again_as_it_was() {
    for (line, event) in JOURNAL.lines().zip(events()) {
        assert!(!matches!(event.body.data, EventData::Other { .. }), "{line}");
        let was: serde_json::Value = serde_json::from_str(line).unwrap();
        let mut now = serde_json::to_value(&event).unwrap();
        take_newer_keys(&mut now, &was);
        assert_eq!(now, was);
    }
}

/// Removes the keys that the journal's build did not know. They say nothing about its events, so they are null.
fn take_newer_keys(now: &mut serde_json::Value, was: &serde_json::Value) {
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
    assert_eq!((run.id(), run.begun(), run.capillary().inside()), ("old-1", &["B01".to_owned()][..], Some("B01")));
    assert_eq!((run.capillary().brought(), run.capillary().asked_for(), run.is_held_by_operator()), (None, None, false));
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
