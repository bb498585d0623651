//! Numbers that are missing: those of specimens that were released before their numbers were on disk.

use super::driver_state::DriverState;
use super::recovery::{self, Attempt, Continuation};
use super::released::Recovered;
use super::sealing::seal_well;
use super::snapshot::run_status;
use carved_records::{EventData, Phase, PlannedWell, RecoveryBegun, SpecimenDone};
use std::collections::VecDeque;

/// Begins to compute missing numbers, unless this is in progress or a worker may use the same frames.
pub(super) fn recover(d: &mut DriverState) {
    if d.run.as_ref().is_none_or(|run| run.works() || run.numbers().are_being_made()) {
        return;
    }
    let wells = d.accepted();
    let lacks_gate = d.lacks_gate();
    d.run.iter_mut().for_each(|run| run.set_lacks_gate(lacks_gate));
    recover_next(d, wells);
}

/// Begins with the first well that has attempts left. The wells before it fail.
pub(super) fn recover_next(d: &mut DriverState, mut wells: VecDeque<PlannedWell>) {
    while let (Some(run), Some(planned)) = (&d.run, wells.front()) {
        let folder = d.outbox.store().run_folder(&run.record().id);
        let tried = d.state().run.as_ref().map_or(0, |known| known.recoveries_of(&planned.well));
        let attempt = match recovery::attempt(&folder, planned, tried) {
            Attempt::Begin(attempt) => attempt,
            Attempt::GiveUp(failed) => {
                wells.pop_front();
                well_recovered(d, *failed);
                continue;
            }
        };
        let (well, allowed) = (planned.well.clone(), run.record().method.policy.deadlines_s.of(Phase::Measure));
        tracing::info!(well, attempt, "the numbers of a specimen that was let go are made from its frames");
        // A requested end of the daemon is not a crash, and must not count as a failed attempt.
        if !d.life.is_stopping() {
            d.event(Some(&well), EventData::SpecimenRecovering(RecoveryBegun { attempt }));
        }
        d.run.iter_mut().for_each(|run| run.numbers_mut().begin(std::mem::take(&mut wells), &folder, allowed));
        return;
    }
}

pub(super) fn take_continuation(d: &mut DriverState) -> Option<Continuation> {
    d.run.as_mut().and_then(|run| run.numbers_mut().take_continuation())
}

pub(super) fn well_recovered(d: &mut DriverState, Recovered { result, times }: Recovered) {
    let Some(run) = &mut d.run else { return };
    let result = run.enter(result);
    let record = run.record().clone();
    // A no-op if the well is closed.
    seal_well(d.outbox.store(), &record.id, &result.well);
    let status = run_status(&record);
    d.save(record);
    let well = result.well.clone();
    d.event(Some(&well), EventData::SpecimenRecovered);
    let done = SpecimenDone { result, times: Some(times), seconds: None };
    d.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| d.publish(|s| s.run = Some(status)));
}
