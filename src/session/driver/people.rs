//! What people say about single wells: a held run leaves one out or measures it again, and any run keeps remarks.
//!
//! ```text
//! skip ── held, no outcome ──► outcome skipped; what is inside must leave first
//! redo ── held, has outcome ─► no outcome; its files become those of an earlier attempt, and its exclusion was said of that one
//! note ── any run ───────────► run.json and the event; the numbers stay
//! ```
//! The record is written before its event. A crash between the two leaves a request that was carried out and has no event. The event of a
//! redo comes first: the next start writes the record and moves the files, if the process ended before that.

use super::super::State;
use super::super::handle::{Refusal, Said, Towards};
use super::commands;
use super::driver_state::DriverState;
use super::snapshot::run_status;
use carved_records::{EventData, PlannedWell, RunState, SaidBy, SpecimenDone, SpecimenOutcome, WellNote, WellStatus};
use carved_store::{RunClaim, RunRecord, set_aside};

pub(super) fn said(d: &mut DriverState, run: &str, well: &str, said: Said) -> Result<(), Refusal> {
    let mistakes = match &said {
        Said::Skip(says) | Said::Redo(says) => says.mistakes(),
        Said::Note(note) => note.mistakes(),
    };
    if !mistakes.is_empty() {
        return Err(Refusal::InvalidSaying(mistakes));
    }
    match said {
        Said::Skip(says) => skip(d, run, well, says),
        Said::Redo(says) => redo(d, run, well, says),
        Said::Note(note) => self::note(d, run, well, note),
    }
}

fn not_now(run: &str, well: &str, why: &str) -> Refusal {
    Refusal::WellNotNow { run: run.to_owned(), well: well.to_owned(), why: why.to_owned() }
}

/// The entry of a well in the run, which is held.
fn held<'a>(d: &'a DriverState, run: &str, well: &str) -> Result<&'a WellStatus, Refusal> {
    let state = d.machine();
    let Some(current) = d.run.as_ref().filter(|current| current.record().id == run) else {
        let stored = d.outbox.store().run(run).map_err(Refusal::from)?;
        let newest = d.newest_run().map(|newest| newest.id.as_str());
        return Err(commands::steer_ended(run, Towards::Unhold, stored, newest, state)
            .err()
            .unwrap_or_else(|| not_now(run, well, "the run has ended")));
    };
    if state != State::Held || current.works() {
        return Err(Refusal::WrongState { state, accepted_in: vec![State::Held] });
    }
    let found = current.record().wells.iter().find(|status| status.well == well);
    found.ok_or_else(|| not_now(run, well, "the run has no such well"))
}

fn skip(d: &mut DriverState, run: &str, well: &str, says: SaidBy) -> Result<(), Refusal> {
    match held(d, run, well)?.outcome {
        Some(SpecimenOutcome::Skipped) => return Ok(()),
        Some(_) => return Err(not_now(run, well, "it has an outcome already. Exclude it from statistics instead")),
        None => {}
    }
    if d.accepted().iter().any(|accepted| accepted.well == well) {
        return Err(not_now(run, well, "its views are taken, and its numbers are being computed. Exclude it from statistics instead"));
    }
    if d.specimens().of(well).state().may_come() {
        return Err(not_now(run, well, "the sampler may still bring its specimen. Let the run go on, or report it as out"));
    }
    let reason = format!("skipped by {}: {}", says.by, says.reason);
    change(d, well, EventData::WellSkipped(says), |status| status.end(SpecimenOutcome::Skipped, Some(&reason)))?;
    let Some(result) = d.run.as_mut().and_then(|current| current.change(well, |status| status.clone())) else { return Ok(()) };
    let done = SpecimenDone { result, times: None, seconds: None };
    d.event_shown(Some(well), EventData::SpecimenDone(Box::new(done)), show);
    Ok(())
}

fn redo(d: &mut DriverState, run: &str, well: &str, says: SaidBy) -> Result<(), Refusal> {
    if held(d, run, well)?.outcome.is_none() {
        if d.accepted().iter().any(|accepted| accepted.well == well) {
            return Err(not_now(run, well, "its views are taken, and its numbers are being computed. Ask again when it has an outcome"));
        }
        return Ok(());
    }
    if !d.loader.brings_again() {
        return Err(not_now(run, well, "this sampler brings each specimen once. Measure it in a run of its own"));
    }
    let Some(planned) = d.run.as_ref().and_then(|run| run.record().plan.plate_map.iter().find(|planned| planned.well == well)).cloned()
    else {
        return Err(not_now(run, well, "the run has no such well"));
    };
    d.commit(Some(well), EventData::WellRedoRequested(says))?;
    if let Some(current) = &mut d.run {
        current.change(well, |status| forget(status, &planned));
        let record = current.record().clone();
        d.save(record);
    }
    keep_files(d, run, well);
    show(d);
    d.outbox.on_disk()
}

/// Makes a well that is to be measured again one without an outcome.
fn forget(status: &mut WellStatus, planned: &PlannedWell) {
    let note = status.note.take().map(|note| Box::new(note.measured_again()));
    *status = WellStatus { note, ..WellStatus::pending(planned) };
}

/// Makes the files of a well those of an earlier attempt. If the disk refuses that, the next attempt does it.
fn keep_files(d: &mut DriverState, run: &str, well: &str) {
    let kept = set_aside(&d.outbox.store().run_folder(run), well);
    d.handle_write_error(kept.map(drop));
}

/// Ends the redos of a run in which the previous process ended before their last step.
pub(super) fn end_redos(d: &mut DriverState, known: &RunState, record: &mut RunRecord) {
    let mut is_changed = false;
    for planned in record.plan.plate_map.iter().filter(|planned| known.to_redo().contains(&planned.well)) {
        if let Some(status) = record.wells.iter_mut().find(|status| status.well == planned.well && status.outcome.is_some()) {
            forget(status, planned);
            is_changed = true;
        }
        keep_files(d, &record.id, &planned.well);
    }
    if is_changed {
        d.save(record.clone());
    }
}

fn note(d: &mut DriverState, run: &str, well: &str, note: WellNote) -> Result<(), Refusal> {
    let is_current = d.is(run);
    let mut record = if let Some(newest) = d.newest_run().filter(|newest| newest.id == run) {
        newest.clone()
    } else {
        let newest = d.newest_run().map(|newest| newest.id.clone());
        d.outbox.store().run(run).map_err(Refusal::from)?.ok_or(Refusal::UnknownRun { id: run.to_owned(), newest })?
    };
    // Nobody removes the run meanwhile, and a removed one does not come back as a folder with this file alone.
    let folder = d.outbox.store().run_folder(run);
    let _claim = if is_current { None } else { Some(RunClaim::shared(&folder)?) };
    let before = record.clone();
    let Some(status) = record.wells.iter_mut().find(|status| status.well == well) else {
        return Err(not_now(run, well, "the run has no such well"));
    };
    if status.note.as_ref().is_some_and(|known| known.says_the_same(&note)) {
        return Ok(());
    }
    if is_current {
        change(d, well, EventData::WellNoted(note.clone()), |status| status.set_note(Some(Box::new(note))))?;
        show(d);
        return Ok(());
    }
    status.set_note(Some(Box::new(note.clone())));
    if let Err(refused) = d.outbox.commit_of_well(&record, well, EventData::WellNoted(note)) {
        // The changed one may be on the disk already, and its event is not.
        d.save(before);
        return Err(refused.into());
    }
    if d.newest_run().is_some_and(|newest| newest.id == run) {
        show_past(d, record);
    }
    Ok(())
}

/// Changes a well of the current run, with its event. Without the disk nothing changes.
fn change(d: &mut DriverState, well: &str, event: EventData, change: impl FnOnce(&mut WellStatus)) -> Result<(), Refusal> {
    let Some(current) = &mut d.run else { return Ok(()) };
    let before = current.record().clone();
    current.change(well, change);
    let record = current.record().clone();
    if let Err(refused) = d.outbox.commit_of_well(&record, well, event) {
        current.restore(before.clone());
        // The changed one may be on the disk already.
        d.save(before);
        return Err(refused.into());
    }
    Ok(())
}

fn show(d: &mut DriverState) {
    if let Some(run) = &d.run {
        let status = run_status(run.record());
        d.publish(|s| s.run = Some(status));
    }
}

fn show_past(d: &mut DriverState, record: RunRecord) {
    let status = run_status(&record);
    d.set_past_run(record);
    d.publish(|s| s.run = Some(status));
}
