//! From every state that any sequence of commands, faults, crashes and restarts leads to, the polled status leads on: a loader and an operator
//! who know nothing else get the plate out and a run of the next one accepted. `CARVED_WALKS` sets the number of walks.

use super::super::run::{Request, RunInProgress};
use super::super::*;
use super::bench::{Bench, RUN, on_this_thread, plan, scratch};
use super::replayed::{Sampling, Step, WELLS, accepts, bench, recovers, sampling, step, takes, thread_ends};
use crate::api::NextCommand;
use crate::session::handle::{Accepted, Refusal, Towards};
use crate::session::worker::{Progress, RunEnd, RunError};
use carved_records::{Asked, Handoff, HandoffEnd, HandoffIntent, Phase};
use carved_store::testing::trace as disk_trace;
use proptest::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const NEXT_PLATE: &str = "P-2";
/// Steps of loader, operator and instrument, within which the next plate must be measured.
const STEPS: usize = 250;

/// What the status says must be true, and it must say what leads on.
fn names_a_way_on(b: &Bench) -> Result<(), String> {
    let status = b.status();
    let open = |seq: u64| status.faults.iter().find(|fault| fault.seq == seq);
    let ends_by_itself = |seq: u64| b.d.state().faults.open().iter().any(|fault| fault.seq == seq && fault.ends_by_itself());
    let hold = status.run.as_ref().and_then(|run| run.hold.as_ref());
    if status.state == State::Held {
        let Some(hold) = hold else { return Err("it does not say why the run is held".into()) };
        let goes_on = status.run.as_ref().is_some_and(|run| run.goes_on_by_itself);
        match hold.next_command {
            Some(NextCommand::Acknowledge) if hold.fault_seq.is_none_or(|seq| open(seq).is_none() || ends_by_itself(seq)) => {
                return Err("the fault to acknowledge does not end with that".into());
            }
            Some(NextCommand::Unhold) if b.d.check_faults().is_err() => return Err("unhold would be refused".into()),
            None if !goes_on && !status.faults.iter().any(|fault| fault.ends_by_itself) => {
                return Err("it waits for a command and does not name it".into());
            }
            _ => {}
        }
    }
    if b.d.run.is_none() && b.d.life == Life::Up {
        let says = status.plate.needs.is_some() || !status.faults.is_empty();
        if status.plate.barcode.is_some() && !status.plate.removable && !says {
            return Err("it does not say what keeps the plate".into());
        }
        if status.plate.removable && status.plate.needs.is_some() {
            return Err("the plate is removable, and something is needed first".into());
        }
    }
    Ok(())
}

/// The specimen that a worker is at, and how many of its stages are over.
type At = Option<(String, usize)>;

/// The instrument does the next thing: a worker with its specimen, or the driver by itself.
async fn instrument_works(b: &mut Bench, at: &mut At) {
    if !b.works() {
        if !recovers(b).await {
            b.beat().await;
        }
        return;
    }
    let end = match b.d.run.as_ref().map_or(Request::Nothing, RunInProgress::request) {
        Request::Nothing => None,
        // After the specimen.
        Request::Hold | Request::Stop => at.as_ref().is_none_or(|(_, stage)| *stage == 0).then_some(RunEnd::Paused),
        Request::Halt | Request::ShutDown | Request::Abort => Some(RunEnd::Cancelled),
    };
    if let Some(end) = end {
        *at = None;
        return b.ends(end).await;
    }
    if matches!(b.status().state, State::Starting | State::Unholding) {
        b.report(Progress::Ready);
        return;
    }
    let by_loader = b.d.loader.fills_capillary();
    let brought = b.d.specimens().continued_with().map(str::to_owned);
    let Some((well, stage)) = at.as_mut() else {
        if let Some(left) = b.d.must_leave_first().filter(|_| !by_loader).map(str::to_owned) {
            b.phase(&left, Phase::Eject, true);
            b.phase(&left, Phase::Wash, false);
            return;
        }
        let accepted = b.d.accepted();
        let Some(planned) = b.d.run.as_ref().and_then(|run| run.wells_left(&accepted).into_iter().next()) else {
            return b.ends(RunEnd::AllWells).await;
        };
        let is_kept = !by_loader && brought.as_ref() == Some(&planned.well);
        if !is_kept {
            b.phase(&planned.well, Phase::Load, false);
        }
        if by_loader {
            b.report(Progress::WaitingForLoader { well: planned.well.clone() });
        }
        *at = Some((planned.well, 0));
        return;
    };
    if *stage == 0 && by_loader && brought.as_ref() != Some(well) {
        return;
    }
    let (well, done) = (well.clone(), *stage);
    *stage += 1;
    match done {
        0 => drop(b.phase(&well, Phase::Position, true)),
        1 => drop(b.phase(&well, Phase::Revolve, true)),
        2 => {
            b.phase(&well, Phase::Reconstruct, true);
            // As the worker does, it begins without the files of an earlier attempt.
            let _none = std::fs::remove_dir_all(b.d.outbox.store().run_folder(RUN).join(&well));
            let planned = WELLS.iter().position(|planned| *planned == well).unwrap_or_default();
            if let Err(refused) = accepts(b, planned) {
                *at = None;
                b.ends(RunEnd::Failed(RunError::Store(refused))).await;
            }
        }
        3 => drop(b.phase(&well, Phase::Eject, true)),
        4 if !by_loader => drop(b.phase(&well, Phase::Wash, false)),
        4 => {}
        _ => {
            *at = None;
            b.done(&well);
        }
    }
}

/// Loader and operator do what the status says. `true` once the run of the next plate is accepted.
async fn follows(b: &mut Bench, at: &mut At) -> Result<bool, String> {
    names_a_way_on(b)?;
    let status = b.status();
    let run = status.run.clone();
    let is_open = run.as_ref().is_some_and(|run| run.outcome.is_none());
    let said = |what: &str, answer: Result<(), Refusal>| answer.map(|()| false).map_err(|refusal| format!("{what}: {refusal}"));
    // Before the specimen, because the instrument may use it.
    if is_open && b.works() && status.plate.needs.is_none() {
        instrument_works(b, at).await;
        return Ok(false);
    }
    if let (Some(run), Some(well)) = (&run, &status.plate.take_out) {
        let id = run.id.clone();
        return said("take out", b.ask(|answer| Command::Loaded { run: id, well: well.clone(), loaded: false, answer }));
    }
    if let (Some(run), Some(well)) = (&run, &status.plate.bring) {
        let id = run.id.clone();
        return said("bring", b.ask(|answer| Command::Loaded { run: id, well: well.clone(), loaded: true, answer }));
    }
    let hold = run.as_ref().and_then(|run| run.hold.as_ref());
    match hold.and_then(|hold| hold.next_command.map(|command| (command, hold.fault_seq))) {
        Some((NextCommand::Acknowledge, Some(seq))) => return said("acknowledge", requests::acknowledge(&mut b.d, seq, Asked::default())),
        Some((NextCommand::Acknowledge, None)) => return Err("which fault?".into()),
        Some((NextCommand::Unhold, _)) => return said("unhold", b.steer(Towards::Unhold)),
        None => {}
    }
    if let Some(fault) = status.faults.iter().find(|fault| !is_open && fault.operator_required && !fault.ends_by_itself) {
        return said("acknowledge", requests::acknowledge(&mut b.d, fault.seq, Asked::default()));
    }
    // A cause that ends by itself, numbers that are computed, or a run that ends.
    if is_open || status.faults.iter().any(|fault| fault.ends_by_itself) {
        instrument_works(b, at).await;
        return Ok(false);
    }
    let move_plate = |b: &mut Bench, intent, barcode: &str| {
        let needs = requests::handoff(&mut b.d, Handoff { intent, barcode: barcode.into() }).map_err(|refusal| refusal.to_string())?.needs;
        match needs {
            Some(needs) => Err(format!("the status does not say {needs:?}")),
            None => said("hand over", requests::end_handoff(&mut b.d, HandoffEnd::Completed)),
        }
    };
    match &status.plate.barcode {
        Some(barcode) if barcode == NEXT_PLATE && status.ready => {
            let plan = carved_records::RunPlan { plate_barcode: NEXT_PLATE.into(), ..plan(&["A01"]) };
            let answer = b.ask(|answer| Command::PutRun { id: "r2".into(), plan, answer });
            if answer == Ok(Accepted::Created) { Ok(true) } else { Err(format!("the next run: {answer:?}")) }
        }
        Some(barcode) if barcode != NEXT_PLATE && status.plate.removable => move_plate(b, HandoffIntent::Unload, barcode),
        None => move_plate(b, HandoffIntent::Load, NEXT_PLATE),
        Some(_) => Err("it neither needs anything nor lets the plate go".into()),
    }
}

fn walk(sampling: Sampling, steps: &[Step]) {
    on_this_thread(async {
        let (dir, axis_answers) = (scratch(), Arc::new(AtomicBool::new(true)));
        let mut b = bench(dir.path(), sampling, &axis_answers);
        let (mut is_dying, mut at) = (false, At::None);
        disk_trace::begin(None);
        for (number, step) in steps.iter().enumerate() {
            match *step {
                Step::DiesAt(at) => {
                    disk_trace::die(at);
                    is_dying = true;
                }
                Step::DiskFails(_) | Step::DiskHasRoom if is_dying => {}
                Step::Ready | Step::Awaits(_) | Step::Enters(..) | Step::Accepts(_) | Step::Done(_) if b.works() => {
                    instrument_works(&mut b, &mut at).await;
                }
                _ => takes(&mut b, &axis_answers, step).await,
            }
            if !b.works() || matches!(step, Step::WorkerEnds(_)) {
                at = None;
            }
            if is_dying && disk_trace::was_full() || matches!(step, Step::Crash | Step::ShutDown(_)) {
                let _lost = thread_ends(&mut b).await;
                drop(b);
                disk_trace::begin(None);
                (is_dying, at) = (false, None);
                b = bench(dir.path(), sampling, &axis_answers);
            }
            if let Err(why) = names_a_way_on(&b) {
                panic!("{why}, after step {number} of {sampling:?} {steps:?}: {:?}", b.status());
            }
        }
        // Cables are in and the disk has room. What is left to do, the status says.
        disk_trace::begin(None);
        axis_answers.store(true, Ordering::SeqCst);
        let mut is_there = false;
        let mut way = Vec::new();
        for _ in 0..STEPS {
            way.push(b.status().doing);
            match follows(&mut b, &mut at).await {
                Ok(there) => is_there = there,
                Err(why) => panic!("{why}, after {sampling:?} {steps:?}, then {way:#?}: {:?}", b.status()),
            }
            if is_there {
                break;
            }
        }
        assert!(is_there, "no way to the next plate after {sampling:?} {steps:?}, then {way:#?}: {:?}", b.status());
        disk_trace::end();
        drop(thread_ends(&mut b).await);
    });
}

fn walks() -> u32 {
    std::env::var("CARVED_WALKS").ok().and_then(|walks| walks.parse().ok()).unwrap_or(256)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: walks(), max_shrink_iters: 300, ..ProptestConfig::default() })]

    #[test]
    fn every_state_says_what_leads_to_the_next_plate(
        sampling in sampling(),
        steps in proptest::collection::vec(step(), 1..50),
    ) {
        walk(sampling, &steps);
    }
}
