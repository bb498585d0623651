//! The queue of plates: what clients change, and what a start finds. The rules are those of `PlateQueue`; here its plans are checked, and it
//! is shown.

use super::super::handle::{Accepted, QueueChange, QueueRefusal, Refusal};
use super::commands;
use super::driver_state::DriverState;
use super::faults;
use crate::api::QueuedPlate;
use carved_records::{EventData, Fault, RunPlan, fault_table};
use carved_store::Store;

/// Carries out a change, and shows the queue.
///
/// # Errors
/// The plan has mistakes, its run exists, the change does not fit the queue, or the disk refuses it. Then nothing has changed.
pub(super) fn change(d: &mut DriverState, change: QueueChange) -> Result<Accepted, Refusal> {
    let mut accepted = Accepted::Same;
    match change {
        QueueChange::Put { run, plan } => {
            commands::check_run_name(&run)?;
            plan.check(&d.config.methods).map_err(Refusal::InvalidPlan)?;
            if d.outbox.store().run(&run).map_err(Refusal::from)?.is_some() {
                let why = format!("run {run} is on disk already, so its plate is not queued again. Give the new run another name");
                return Err(Refusal::Queue { why, kind: QueueRefusal::Conflict });
            }
            if d.outbox.store().reader().was_accepted(&run).unwrap_or(false) {
                return Err(Refusal::Pruned { id: run });
            }
            if d.queue.put(&run, plan)? {
                accepted = Accepted::Created;
            }
        }
        QueueChange::Remove { run } => d.queue.remove(&run)?,
        QueueChange::Order { runs } => d.queue.order(&runs)?,
    }
    show(d);
    Ok(accepted)
}

/// The plan of the plate that waits for this run.
pub(super) fn plan_of(d: &DriverState, run: &str) -> Result<RunPlan, Refusal> {
    let unknown = || carved_store::QueueError::Unknown { run: run.to_owned() };
    Ok(d.queue.get(run).map(|plate| plate.plan.clone()).ok_or_else(unknown)?)
}

/// Takes the plate out whose run has begun, and shows the queue.
pub(super) fn take_out(d: &mut DriverState, begun: &str) {
    take_begun(d, |_, run| run == begun);
}

fn take_begun(d: &mut DriverState, has_begun: impl Fn(&Store, &str) -> bool) {
    let store = d.outbox.store();
    if let Err(error) = d.queue.take_begun(|run| has_begun(store, run)) {
        // Nothing is lost: the next start leaves these plates out again, because their runs are on disk.
        tracing::warn!(%error, "the plate that has begun is still in the file of the queue");
    }
    show(d);
}

/// Restores the queue that the previous process left.
pub(super) fn restore(d: &mut DriverState) {
    if let Some(why) = d.queue.unreadable().map(str::to_owned)
        && !faults::is_open(&d.state().faults, fault_table::QUEUE_UNREADABLE.code)
    {
        let (seq, since) = (d.state().faults.newest() + 1, jiff::Timestamp::now().to_string());
        d.event(None, EventData::FaultRaised(Fault::new(seq, &fault_table::QUEUE_UNREADABLE, why, since)));
    }
    // A start that was not accepted has no record any more: it was removed before.
    take_begun(d, |store, run| store.run(run).is_ok_and(|known| known.is_some()) || store.reader().was_accepted(run).unwrap_or(false));
}

fn show(d: &DriverState) {
    let plates = d.queue.plates().iter();
    let shown = plates
        .map(|plate| QueuedPlate {
            run: plate.run.clone(),
            plate_barcode: plate.plan.plate_barcode.clone(),
            method: plate.plan.method.clone(),
            operator: plate.plan.operator.clone(),
            wells: u32::try_from(plate.plan.plate_map.len()).unwrap_or(u32::MAX),
            trouble: plate.plan.check(&d.config.methods).err().and_then(|mistakes| Some(mistakes.into_iter().next()?.detail)),
        })
        .collect();
    d.publish(|s| s.queue = shown);
}
