//! Plates that wait for their turn: what begins them, what does not, and what a restart or a full disk leaves of them.

use super::super::*;
use super::bench::{Bench, bench, on_this_thread, plan, scratch};
use crate::session::handle::{Accepted, QueueChange, QueueRefusal, Refusal};
use crate::session::worker::{Progress, RunEnd};
use carved_records::{Handoff, HandoffEnd, HandoffIntent, RunPlan};
use carved_store::testing::trace as disk_trace;
use std::path::Path;

fn of(barcode: &str) -> RunPlan {
    RunPlan { plate_barcode: barcode.into(), ..plan(&["A01"]) }
}

impl Bench {
    fn change(&mut self, change: QueueChange) -> Result<Accepted, Refusal> {
        self.ask(|answer| Command::Queue { change, answer })
    }

    fn queue(&mut self, run: &str, barcode: &str) -> Result<Accepted, Refusal> {
        self.change(QueueChange::Put { run: run.into(), plan: of(barcode) })
    }

    fn next(&mut self, barcode: &str) -> Result<(String, Accepted), Refusal> {
        self.ask(|answer| Command::NextPlate { barcode: barcode.into(), answer })
    }

    fn queued(&self) -> Vec<String> {
        self.status().queue.into_iter().map(|plate| plate.run).collect()
    }

    fn current(&self) -> Option<String> {
        self.d.run.as_ref().map(|run| run.record().id.clone())
    }

    /// The run under way ends with all its wells measured.
    async fn finish(&mut self) {
        self.report(Progress::Ready);
        self.done("A01");
        self.ends(RunEnd::AllWells).await;
        assert_eq!(self.current(), None);
    }
}

/// A bench with two plates in the queue.
fn with_two(root: &Path) -> Bench {
    let mut b = bench(root, false);
    assert_eq!(b.queue("n-1", "P-1"), Ok(Accepted::Created));
    assert_eq!(b.queue("n-2", "P-2"), Ok(Accepted::Created));
    b
}

fn is_of(refused: &Refusal, wanted: QueueRefusal) -> bool {
    matches!(refused, Refusal::Queue { kind, .. } if *kind == wanted)
}

#[test]
fn plates_begin_in_their_turn_and_only_by_their_own_barcode() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = with_two(dir.path());
        assert_eq!(b.queued(), ["n-1", "n-2"]);
        let refused = b.next("P-2").unwrap_err();
        assert!(is_of(&refused, QueueRefusal::OtherPlate) && refused.to_string().contains("P-1"), "{refused}");
        assert_eq!((b.current(), b.queued().len()), (None, 2), "nothing has begun, and nothing is lost");
        assert_eq!(b.next("P-1"), Ok(("n-1".into(), Accepted::Created)));
        assert_eq!((b.current().as_deref(), b.queued()), (Some("n-1"), vec!["n-2".to_owned()]));
        assert_eq!(b.next("P-1"), Ok(("n-1".into(), Accepted::Same)), "a repeat");
        let early = b.next("P-2").unwrap_err();
        assert!(matches!(early, Refusal::WrongState { .. }), "{early}");
        assert_eq!(b.queued(), ["n-2"]);
        b.finish().await;
        // The plate of the run that has ended is still in its place.
        let still = b.next("P-1").unwrap_err();
        assert!(is_of(&still, QueueRefusal::OtherPlate), "{still}");
        assert_eq!(b.next("P-2"), Ok(("n-2".into(), Accepted::Created)));
        b.finish().await;
        assert!(is_of(&b.next("P-2").unwrap_err(), QueueRefusal::Empty));
    });
}

#[test]
fn a_start_that_is_refused_leaves_the_plate_in_the_queue() {
    let dir = scratch();
    let mut b = with_two(dir.path());
    b.ask(|answer| Command::Handoff { plate: Handoff { intent: HandoffIntent::Load, barcode: "P-7".into() }, answer }).unwrap();
    assert!(matches!(b.next("P-1"), Err(Refusal::HandoffOpen { .. })));
    b.ask(|answer| Command::EndHandoff { end: HandoffEnd::Completed, answer }).unwrap();
    assert!(matches!(b.next("P-1"), Err(Refusal::OtherBarcode { .. })), "another plate was handed over");
    assert_eq!((b.current(), b.queued()), (None, vec!["n-1".to_owned(), "n-2".into()]));
}

#[test]
fn a_queued_run_begins_in_its_turn_only_and_a_known_run_is_not_queued() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = with_two(dir.path());
        let by_name = b.ask(|answer| Command::PutRun { id: "n-2".into(), plan: of("P-2"), answer });
        assert_eq!(by_name, Err(Refusal::Queued { id: "n-2".into() }));
        b.next("P-1").unwrap();
        // With its own plan or with another one.
        for barcode in ["P-1", "P-9"] {
            assert!(is_of(&b.queue("n-1", barcode).unwrap_err(), QueueRefusal::Conflict));
        }
        assert!(matches!(b.queue("n/1", "P-9"), Err(Refusal::InvalidPlan(_))));
        let method = RunPlan { method: "fast".into(), ..of("P-9") };
        assert!(matches!(b.change(QueueChange::Put { run: "n-9".into(), plan: method }), Err(Refusal::InvalidPlan(_))));
        assert!(is_of(&b.queue("n-9", "P-2").unwrap_err(), QueueRefusal::Conflict));
        assert_eq!(b.queued(), ["n-2"]);
    });
}

#[test]
fn plates_are_changed_ordered_and_removed_also_during_a_run() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = with_two(dir.path());
        b.next("P-1").unwrap();
        b.queue("n-3", "P-3").unwrap();
        b.change(QueueChange::Order { runs: vec!["n-3".into(), "n-2".into()] }).unwrap();
        let changed = RunPlan { operator: "lee".into(), ..of("P-2") };
        assert_eq!(b.change(QueueChange::Put { run: "n-2".into(), plan: changed.clone() }), Ok(Accepted::Same));
        assert_eq!(b.queued(), ["n-3", "n-2"]);
        assert_eq!(b.status().queue[1].operator, "lee");
        assert_eq!(b.ask(|answer| Command::Queued { run: "n-2".into(), answer }), Ok(changed));
        b.change(QueueChange::Remove { run: "n-3".into() }).unwrap();
        assert!(is_of(&b.change(QueueChange::Remove { run: "n-1".into() }).unwrap_err(), QueueRefusal::Unknown), "it has begun");
        assert!(is_of(&b.change(QueueChange::Order { runs: vec!["n-3".into()] }).unwrap_err(), QueueRefusal::Conflict));
        assert_eq!(b.queued(), ["n-2"]);
    });
}

/// The process ends at every operation on the disk, while plates are queued and one begins.
#[test]
fn a_crash_at_any_moment_loses_no_plate_and_begins_none_twice() {
    on_this_thread(async {
        for k in 0.. {
            let dir = scratch();
            let mut b = with_two(dir.path());
            disk_trace::die(k);
            let queued = b.queue("n-3", "P-3");
            let begun = b.next("P-1");
            let is_whole = !disk_trace::was_full();
            drop(b);
            disk_trace::end();
            let mut b = bench(dir.path(), false);
            let has_begun = b.status().run.is_some();
            // A run whose acceptance is on disk has begun, also if the process ended before its answer.
            assert!(has_begun || begun.is_err(), "{k}: {begun:?}");
            // So is a plate that was queued.
            let has_third = queued.is_ok() || b.queued().contains(&"n-3".to_owned());
            let mut wanted = vec!["n-1".to_owned(), "n-2".into(), "n-3".into()];
            wanted.retain(|run| (run != "n-1" || !has_begun) && (run != "n-3" || has_third));
            assert_eq!(b.queued(), wanted, "{k}: {queued:?} {begun:?}");
            if !has_begun {
                assert_eq!(b.next("P-1"), Ok(("n-1".into(), Accepted::Created)), "{k}");
            }
            if is_whole {
                assert!(k > 6 && has_begun, "{k} operations on the disk");
                return;
            }
        }
    });
}

/// The disk refuses everything from an operation on, also the removal of what was written, until it takes writes again. Then the plate is
/// reported again, or the other one is put before it.
#[test]
fn a_plate_whose_start_the_disk_refused_waits_until_it_begins() {
    on_this_thread(async {
        for [then, left] in [["1", "2"], ["2", "1"]] {
            let mut refused = 0;
            for k in 0.. {
                let dir = scratch();
                let mut b = with_two(dir.path());
                disk_trace::die(k);
                let first = b.next("P-1");
                let is_whole = !disk_trace::was_full();
                disk_trace::make_room();
                if first.is_err() {
                    refused += 1;
                    assert_eq!((b.current(), b.queued()), (None, vec!["n-1".to_owned(), "n-2".into()]), "{k}");
                    b.change(QueueChange::Order { runs: vec![format!("n-{then}"), format!("n-{left}")] }).unwrap();
                    assert_eq!(b.next(&format!("P-{then}")), Ok((format!("n-{then}"), Accepted::Created)), "{k}: {first:?}");
                    assert_eq!((b.current(), b.queued()), (Some(format!("n-{then}")), vec![format!("n-{left}")]), "{k}: {first:?}");
                }
                disk_trace::end();
                if is_whole {
                    assert!(refused > 2, "{refused} of {k} operations on the disk");
                    break;
                }
            }
        }
    });
}

#[test]
fn a_queue_that_cannot_be_read_is_a_fault_and_its_file_stays() {
    let dir = scratch();
    drop(with_two(dir.path()));
    let path = dir.path().join("queue.json");
    let torn = std::fs::read_to_string(&path).unwrap().replace("\"plates\"", "\"plate\"");
    std::fs::write(&path, &torn).unwrap();
    for _start in 0..2 {
        let mut b = bench(dir.path(), false);
        let status = b.status();
        let codes: Vec<&str> = status.faults.iter().map(|fault| fault.code.as_str()).collect();
        assert_eq!((codes, status.queue.len()), (vec!["queue_unreadable"], 0), "raised once");
        assert!(status.faults[0].message.contains("queue.json"), "{}", status.faults[0].message);
        assert!(b.queue("n-9", "P-9").is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), torn);
    }
    std::fs::remove_file(&path).unwrap();
    let mut b = bench(dir.path(), false);
    assert!(b.status().ready, "{:?}", b.status().faults);
    assert_eq!(b.queue("n-9", "P-9"), Ok(Accepted::Created));
}

#[test]
fn a_plate_whose_method_is_gone_says_so() {
    let dir = scratch();
    drop(with_two(dir.path()));
    let path = dir.path().join("queue.json");
    let text = std::fs::read_to_string(&path).unwrap().replacen("\"standard\"", "\"retired\"", 1);
    std::fs::write(&path, text).unwrap();
    let mut b = bench(dir.path(), false);
    let queue = b.status().queue;
    assert!(queue[0].trouble.as_ref().is_some_and(|why| why.contains("retired")) && queue[1].trouble.is_none(), "{queue:?}");
    assert!(matches!(b.next("P-1"), Err(Refusal::InvalidPlan(_))));
    assert_eq!(b.queued(), ["n-1", "n-2"]);
}
