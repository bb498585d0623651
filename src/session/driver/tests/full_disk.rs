//! A disk that is full from its k-th operation on, until there is room again, for every k of a short run.
//!
//! ```text
//! run of two wells ── operation k: full ──► halted ──► held ──► room ──► store.regained ──► continues ──► Complete
//!                                             └─ aborted, still full ──► room, or the daemon's end ──► on disk all the same
//! ```

use super::super::{checks, course};
use super::bench::{Bench, RUN, bench, count, indexed, journalled, on_this_thread, plan, scratch};
use crate::session::handle::{SessionHandle, Towards};
use crate::session::worker::{Progress, RunEnd};
use crate::session::{Departure, State, Status};
use carved_records::{EventData, Phase, RunOutcome};
use carved_store::testing::trace as disk_trace;
use std::path::Path;

const WELLS: [&str; 2] = ["A01", "A02"];

/// The status shows Complete or a removable plate only once everything is on disk.
fn is_true(root: &Path, status: &Status) {
    if status.state == State::Complete || status.plate.removable {
        let kinds: Vec<String> = journalled(root).into_iter().map(|e| e.body.data.kind().to_owned()).collect();
        assert!(kinds.iter().any(|kind| kind == "run.ended"), "{:?}, removable: {}: {kinds:?}", status.state, status.plate.removable);
        let run = std::fs::read(root.join("runs").join(RUN).join("run.json")).unwrap();
        let run: serde_json::Value = serde_json::from_slice(&run).unwrap();
        assert!(!run["outcome"].is_null(), "{:?}, removable: {}: {run}", status.state, status.plate.removable);
    }
}

fn witness(root: &Path, handle: &SessionHandle) -> impl Fn() + 'static {
    let (root, handle) = (root.to_owned(), handle.clone());
    move || is_true(&root, &handle.status())
}

/// A message of the loader. If the disk refuses it, it is sent again once there is room.
fn say(b: &mut Bench, well: &str, loaded: bool) {
    if let Err(refusal) = b.loaded(well, loaded) {
        assert!(format!("{refusal:?}").contains("full: true"), "{well}, loaded: {loaded}: {refusal:?}");
        disk_trace::make_room();
        b.loaded(well, loaded).unwrap();
    }
    b.inside = loaded.then(|| well.to_owned());
}

/// Loads a specimen. Returns `false` if the run is cancelled meanwhile.
fn bring(b: &mut Bench, well: &str) -> bool {
    if !b.phase(well, Phase::Load, false) {
        return false;
    }
    if b.d.loader.fills_capillary() {
        if !b.report(Progress::WaitingForLoader { well: well.into() }) {
            return false;
        }
        say(b, well, true);
    }
    b.phase(well, Phase::Position, true)
}

fn take_out(b: &mut Bench, well: &str) -> bool {
    if !b.phase(well, Phase::Eject, true) {
        return false;
    }
    if b.d.loader.fills_capillary() {
        say(b, well, false);
        return true;
    }
    b.phase(well, Phase::Wash, false)
}

/// The progress of a worker for the wells that are left. Returns `false` if the run is cancelled meanwhile.
fn work(b: &mut Bench) -> bool {
    if !b.report(Progress::Ready) {
        return false;
    }
    if let Some(well) = b.inside.clone()
        && !take_out(b, &well)
    {
        return false;
    }
    let record = b.d.run.as_ref().unwrap().record().clone();
    let mut before = None;
    for well in record.wells.iter().filter(|w| w.outcome.is_none()).map(|w| w.well.as_str()) {
        // The numbers of the previous specimen were computed meanwhile.
        if !(bring(b, well) && before.replace(well).is_none_or(|before| b.done(before)) && take_out(b, well)) {
            return false;
        }
    }
    before.is_none_or(|last| b.done(last))
}

/// If the run is held with a specimen in the capillary, the driver knows it and has it removed first.
fn is_remembered(b: &Bench, when: &str) {
    let shown = b.status().specimen.filter(|s| s.in_capillary).map(|s| s.well);
    assert_eq!(shown, b.inside, "{when}: shown");
    assert_eq!(b.d.must_leave_first(), b.inside.as_deref(), "{when}: taken out first");
    assert!(!b.status().plate.removable, "{when}");
}

/// The journal, the run's own journal, the index and `run.json` agree. Each event is there once.
fn is_whole(b: &Bench, root: &Path, outcome: RunOutcome, when: &str) {
    let events = journalled(root);
    let kinds: Vec<&str> = events.iter().map(|e| e.body.data.kind()).collect();
    assert!(events.iter().map(|e| e.id).eq(1..=events.len() as u64), "{when}");
    assert_eq!(indexed(b), events, "{when}");
    let of_run: Vec<_> = events.iter().filter(|e| e.body.run.as_deref() == Some(RUN)).cloned().collect();
    assert_eq!(journalled(&root.join("runs").join(RUN)), of_run, "{when}");
    for once in ["run.accepted", "run.ended"] {
        assert_eq!(count(&events, once), 1, "{when}: {once}: {kinds:?}");
    }
    let (mut raised, mut cleared): (Vec<u64>, Vec<u64>) = (Vec::new(), Vec::new());
    for event in &events {
        match &event.body.data {
            EventData::FaultRaised(fault) => raised.push(fault.seq),
            EventData::FaultsCleared(over) => cleared.extend(&over.seq),
            _ => {}
        }
    }
    assert_eq!(raised, cleared, "{when}: {kinds:?}");
    let run = b.d.outbox.store().run(RUN).unwrap().unwrap();
    assert_eq!((run.outcome, b.status().run.unwrap().outcome), (Some(outcome), Some(outcome)), "{when}");
    for well in &run.wells {
        let done = events.iter().filter(|e| e.body.data.kind() == "specimen.done" && e.body.well.as_ref() == Some(&well.well)).count();
        assert_eq!(done, usize::from(well.outcome == Some(carved_records::SpecimenOutcome::Succeeded)), "{when}: {kinds:?}");
    }
    assert!(b.d.outbox.waiting() == 0 && b.status().faults.is_empty(), "{when}: {:?}", b.status().faults);
}

/// Puts the run. Makes room on the disk if the run is refused.
fn accept(b: &mut Bench, when: &str) {
    let Err(refusal) = b.put_run(&plan(&WELLS)) else { return };
    assert!(format!("{refusal:?}").contains("full: true"), "{when}: {refusal:?}");
    disk_trace::make_room();
    assert_eq!(b.put_run(&plan(&WELLS)), Ok(crate::session::Accepted::Created), "{when}");
}

fn outlasts(loaded_from_outside: bool) {
    for at in 0.. {
        let (dir, when) = (scratch(), format!("full from operation {at} on"));
        let mut was_full = false;
        on_this_thread(async {
            let mut b = bench(dir.path(), loaded_from_outside);
            disk_trace::fill(at, witness(dir.path(), &b.handle));
            accept(&mut b, &when);
            while b.d.run.is_some() {
                let end = if work(&mut b) { RunEnd::AllWells } else { RunEnd::Cancelled };
                b.ends(end).await;
                if b.d.run.is_none() {
                    break;
                }
                assert_eq!(b.status().state, State::Held, "{when}");
                is_remembered(&b, &when);
                let refused = b.steer(Towards::Unhold).unwrap_err();
                assert!(format!("{refused:?}").contains("full: true"), "{when}: {refused:?}");
                disk_trace::make_room();
                b.beat().await;
                // The run waits for the loader, and continues once the specimen is out.
                if let Some(well) = b.inside.clone().filter(|_| !b.works()) {
                    say(&mut b, &well, false);
                }
            }
            was_full = disk_trace::was_full();
            disk_trace::end();
            assert_eq!(b.status().state, State::Complete, "{when}");
            assert!(b.status().plate.removable, "{when}");
            is_whole(&b, dir.path(), RunOutcome::Succeeded, &when);
        });
        if !was_full {
            assert!(at > 80, "the disk was asked only {at} times");
            return;
        }
    }
}

#[test]
fn a_run_outlasts_a_disk_that_is_full_from_any_operation_on() {
    outlasts(false);
}

#[test]
fn so_does_one_whose_specimens_a_loader_brings() {
    outlasts(true);
}

/// A requested end is not forgotten, and no start takes the run up again.
#[test]
fn an_abort_on_a_full_disk_is_written_once_there_is_room_or_when_the_daemon_ends() {
    for at in (0..).step_by(3) {
        let mut was_full = false;
        for daemon_ends in [false, true] {
            let (dir, when) = (scratch(), format!("full from operation {at} on, the daemon ends: {daemon_ends}"));
            on_this_thread(async {
                let mut b = bench(dir.path(), false);
                disk_trace::fill(at, witness(dir.path(), &b.handle));
                accept(&mut b, &when);
                if work(&mut b) {
                    // The run was accepted at the second try, or only its end is missing.
                    was_full |= disk_trace::was_full();
                    disk_trace::end();
                    b.ends(RunEnd::AllWells).await;
                } else {
                    let answer = b.steer(Towards::Abort);
                    assert!(format!("{answer:?}").contains("full: true"), "{when}: {answer:?}");
                    b.ends(RunEnd::Cancelled).await;
                    assert_eq!((b.status().state, b.status().plate.removable), (State::Aborted, false), "{when}");
                    disk_trace::make_room();
                    if !daemon_ends {
                        checks::try_the_store(&mut b.d);
                        is_whole(&b, dir.path(), RunOutcome::Aborted, &when);
                    }
                    course::shut_down(&mut b.d, Departure::EndsRun);
                    b.d.final_report().unwrap();
                    was_full |= disk_trace::was_full();
                    disk_trace::end();
                    drop(b);
                    let b = bench(dir.path(), false);
                    assert!(b.d.run.is_none(), "{when}: the aborted run is taken up again");
                    assert_eq!(b.d.outbox.store().run(RUN).unwrap().unwrap().outcome, Some(RunOutcome::Aborted), "{when}");
                    assert_eq!(indexed(&b), journalled(dir.path()), "{when}");
                    for once in ["run.abort_requested", "run.ended"] {
                        assert_eq!(count(&journalled(dir.path()), once), 1, "{when}: {once}");
                    }
                }
            });
        }
        if !was_full {
            return;
        }
    }
}

/// A stop after the specimen was requested, then the full disk interrupts the specimen. The run ends as stopped, not as aborted.
#[test]
fn a_stop_on_a_full_disk_stays_a_stop() {
    for at in 0.. {
        let mut was_full = false;
        for loaded_from_outside in [false, true] {
            let (dir, when) = (scratch(), format!("full from operation {at} on, a loader: {loaded_from_outside}"));
            on_this_thread(async {
                let mut b = bench(dir.path(), loaded_from_outside);
                disk_trace::fill(at, witness(dir.path(), &b.handle));
                accept(&mut b, &when);
                let began = b.report(Progress::Ready) && bring(&mut b, "A01");
                let mut stopped = b.steer(Towards::Stop);
                if stopped.is_err() && began {
                    // The stop was refused, and the worker is still active. The stop is requested again.
                    disk_trace::make_room();
                    stopped = b.steer(Towards::Stop);
                }
                let is_done = began && take_out(&mut b, "A01") && b.done("A01");
                b.ends(if is_done { RunEnd::Paused } else { RunEnd::Cancelled }).await;
                disk_trace::make_room();
                if let Err(refusal) = stopped {
                    assert!(format!("{refusal:?}").contains("full: true"), "{when}: {refusal:?}");
                    assert_eq!(b.status().state, State::Held, "{when}");
                    b.steer(Towards::Stop).unwrap();
                }
                assert_eq!(b.status().state, State::Stopped, "{when}");
                checks::try_the_store(&mut b.d);
                was_full |= disk_trace::was_full();
                disk_trace::end();
                let measured = b.status().run.unwrap().wells.succeeded == 1;
                is_whole(&b, dir.path(), if measured { RunOutcome::Partial } else { RunOutcome::Aborted }, &when);
                let events = journalled(dir.path());
                assert_eq!((count(&events, "run.stop_requested"), count(&events, "run.abort_requested")), (1, 0), "{when}");
                let inside = b.status().specimen.filter(|s| s.in_capillary).map(|s| s.well);
                assert_eq!(inside, b.inside, "{when}: what is inside is known");
            });
        }
        if !was_full {
            assert!(at > 20, "the disk was asked only {at} times");
            return;
        }
    }
}
