//! The queries of a start, and the update of an index that is behind.

use super::*;
use crate::journal;
use carved_records::Event;

/// With an index and without.
#[test]
fn what_lies_before_the_newest_events_is_remembered_where_it_still_means_something() {
    let dir = tempfile::tempdir().unwrap();
    let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    let words = [
        ("plate.loaded", None, json!({"barcode": "P-0"})),
        ("plate.unloaded", None, json!({"barcode": "P-0"})),
        ("plate.loaded", None, json!({"barcode": "P-1"})),
        ("run.accepted", Some("r1"), json!({"plate_barcode": "P", "method": "m"})),
        ("fault.raised", Some("r1"), fault(1)),
        ("fault.raised", Some("r1"), fault(2)),
        ("fault.acknowledged", Some("r1"), json!({"seq": 1})),
        ("plate.announced", None, json!({"intent": "unload", "barcode": "P-1"})),
        ("specimen.unasked", None, json!({"there": false})),
        ("specimen.unasked", None, json!({"there": true})),
    ];
    for (kind, run, data) in words {
        say(&mut journal, kind, run, data);
    }
    for _ in 0..20 {
        say(&mut journal, "view.taken", Some("r1"), json!(null));
        say(&mut journal, "specimen.phase", Some("r1"), json!(null));
    }
    let ids = |events: Vec<Event>| events.into_iter().map(|e| e.id).collect::<Vec<_>>();
    let newest: Vec<u64> = (1..=3).map(|nth| 44 + 2 * nth).collect();
    assert_eq!(ids(store.index.remembered(3).unwrap()), [&[3, 4, 6, 8, 10][..], &newest].concat());
    let by_lines = journal::remembered(&dir.path().join("events.jsonl"), 3).unwrap();
    assert_eq!(ids(by_lines), [&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10][..], &newest].concat());
    for _ in 0..3 {
        say(&mut journal, "daemon.started", None, json!(null));
    }
    let newest = [51, 52, 53];
    assert_eq!(ids(store.index.remembered(3).unwrap()), [&[3, 4, 6, 8, 10][..], &newest].concat(), "the plate of the newest run is inside");
    let of_run = store.events_of("r1").unwrap();
    assert!(of_run.len() == 24 && of_run.iter().all(|e| e.body.data.kind() != "view.taken"), "{}", of_run.len());
}

/// A refresh reads every run folder. After a failure it is not tried again with each event of a run.
#[test]
fn an_index_that_stays_behind_is_left_alone_for_a_while() {
    let dir = tempfile::tempdir().unwrap();
    let (store, mut journal, _) = Claim::on(dir.path()).and_then(Store::open).unwrap();
    let other = connect(&dir.path().join(FILE)).unwrap();
    other.execute_batch("ALTER TABLE events RENAME TO elsewhere").unwrap();
    for kind in ["a", "b"] {
        say(&mut journal, kind, None, json!(null));
    }
    other.execute_batch("ALTER TABLE elsewhere RENAME TO events").unwrap();
    say(&mut journal, "c", None, json!(null));
    assert!(store.index_trouble().is_some(), "it was tried again at once");
    store.index.state.lock().unwrap().again = std::time::Instant::now();
    say(&mut journal, "d", None, json!(null));
    assert_eq!((store.index_trouble(), count(dir.path(), "events")), (None, 4));
}
