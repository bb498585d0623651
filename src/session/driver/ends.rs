//! How a run comes to rest: held with what is left of it, or at its end.
//!
//! ```text
//! worker_ended ─┬─ interrupt_specimen ──► rest ──────────────────────────► Held
//!               ├─ finish ──► numbers of specimens that are gone ─► close ► Complete
//!               └─ end_run ─► numbers of specimens that are gone ─► end_now ► Stopped, Aborted
//! ```

use super::super::state::Trigger;
use super::super::{State, Status, gate};
use super::Running;
use super::active::Request;
use super::publish::run_status;
use super::recovery::Continuation;
use carved_records::{
    EventData, HeldBy, HoldCause, Interrupted, RunEnded, RunHeld, RunOutcome, SpecimenInterrupted, SpecimenOutcome, WellCounts,
};
use carved_store::RunRecord;

/// What becomes of a specimen that is under way when its run is cut short.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// Its pose is lost: the method's policy says whether it is begun anew.
    PoseLost,
    /// The instrument is to blame, and the specimen must be brought again.
    BroughtAgain,
    /// The instrument is to blame, and the run goes on with the specimen where it is.
    Stays,
}

impl Running {
    /// The specimen under way has no end: its pose is lost. By the method's policy it is begun anew, or its well is over; unless it was
    /// accepted, which only lacks its numbers. A specimen that has left the capillary of a sampler that brings none twice is given up.
    pub(super) fn interrupt_specimen(&mut self, reason: &str, fate: Fate) {
        let accepted = self.accepted();
        let Some(active) = &self.active else { return };
        let policy = active.record.method.policy.interrupted;
        let mut wells = self.state().run.as_ref().map_or_else(Vec::new, |run| run.begun().to_vec());
        // What the loader has brought is not begun: it stays, and is used when the run goes on.
        wells.retain(|well| self.capillary().brought() != Some(well));
        wells.sort_unstable();
        for well in wells {
            let inside = self.capillary().inside() == Some(&well);
            // One that has not come yet is still to come.
            let came = inside || self.capillary().has_held(&well);
            let Some(active) = &mut self.active else { return };
            let accepted = accepted.iter().any(|accepted| accepted.well == well);
            let kept = fate == Fate::Stays && inside && !accepted;
            let given_up = came && !kept && (!self.brings_again || policy == Interrupted::Skip && fate == Fate::PoseLost);
            if inside && !kept && self.loaded_from_outside {
                active.take_out = Some(well.clone());
            } else if inside && !kept {
                active.eject_first = Some(well.clone());
            }
            if accepted {
                continue;
            }
            if given_up && let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == well && w.outcome.is_none()) {
                slot.end(SpecimenOutcome::Interrupted, Some(reason));
                let run = active.record.id.clone();
                self.seal_well(&run, &well);
            }
            let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept };
            self.event(Some(&well), EventData::SpecimenInterrupted(interrupted));
        }
        // One whose well is done is still there where it could not be taken out.
        let stuck = self.capillary().inside().filter(|inside| !self.loaded_from_outside && self.capillary().brought() != Some(inside));
        let stuck = stuck.map(str::to_owned);
        if let (Some(active), Some(stuck)) = (&mut self.active, stuck) {
            active.eject_first.get_or_insert(stuck);
        }
    }

    /// Ends a well whose specimen cannot be measured any more.
    pub(super) fn give_up(&mut self, well: &str, reason: &str) {
        let Some(active) = &mut self.active else { return };
        let policy = active.record.method.policy.interrupted;
        let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == well && w.outcome.is_none()) else { return };
        slot.end(SpecimenOutcome::Interrupted, Some(reason));
        let record = active.record.clone();
        self.seal_well(&record.id, well);
        let status = run_status(&record);
        self.save(record);
        let interrupted = SpecimenInterrupted { reason: reason.to_owned(), policy, kept: false };
        self.event_shown(Some(well), EventData::SpecimenInterrupted(interrupted), |d| d.publish(|s| s.run = Some(status)));
    }

    /// To Held, from wherever the run was: the worker has handed the instrument back.
    pub(super) fn rest(&mut self, by_fault: bool) {
        let state = self.publisher.status().state;
        if state == State::Stopping {
            // The end that was asked for comes first.
            return self.end_run();
        }
        if state != State::Holding {
            self.go(Trigger::Hold);
        }
        let Some(active) = &mut self.active else { return };
        active.continuation = None;
        active.may_go_on = false;
        let record = active.record.clone();
        let status = run_status(&record);
        let newest = self.state().faults.open().last().filter(|_| by_fault);
        let cause = newest.map_or_else(HoldCause::operator, |f| HoldCause { code: f.code.clone(), words: f.plainly().to_owned() });
        let by = if by_fault { HeldBy::Fault } else { HeldBy::Operator };
        self.save(record);
        let held = RunHeld { by, code: Some(cause.code), cause: Some(cause.words) };
        self.event_shown(None, EventData::RunHeld(held), |d| d.go_with(Trigger::Rested, |s| s.run = Some(status)));
    }

    /// All wells are done, but for numbers that are still made from frames.
    pub(super) fn finish(&mut self) {
        self.go(Trigger::WellsDone);
        self.recover();
        if !self.waits_for_numbers(Continuation::Finish) {
            self.close();
        }
    }

    /// The run ends once that is on disk, and is held until then.
    pub(super) fn close(&mut self) {
        let Some(active) = &self.active else { return };
        let mut record = active.record.clone();
        record.end(RunOutcome::of_wells(&record.wells));
        self.seal_run(&record.id);
        gate::keep(&self.config, &self.store.run_folder(&record.id));
        let told = self.flush().and_then(|()| self.store.save_run(&record));
        let told = told.and_then(|()| self.promise(None, ended(&record)));
        if told.is_err() {
            self.keep(told);
            return self.rest(true);
        }
        self.active = None;
        self.no_room = self.lacks_room();
        self.go_with(Trigger::Recorded, self.over(&record));
    }

    /// Ends the run as it was asked to, once specimens that are gone have their numbers.
    pub(super) fn end_run(&mut self) {
        self.recover();
        if !self.waits_for_numbers(Continuation::End) {
            self.end_now();
        }
    }

    /// Stopped, aborted, or with the daemon.
    pub(super) fn end_now(&mut self) {
        let Some(active) = &self.active else { return };
        let (asked, mut record) = (active.request, active.record.clone());
        let (left, reason) = match asked {
            Request::Abort => (SpecimenOutcome::Aborted, "the run was aborted"),
            Request::Stop => (SpecimenOutcome::Aborted, "the run was stopped before this well"),
            _ => (SpecimenOutcome::Interrupted, "the daemon was stopped"),
        };
        for well in record.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end(left, Some(reason));
        }
        record.end(match asked {
            Request::Abort => RunOutcome::Aborted,
            Request::Stop => RunOutcome::of_stopped(&record.wells),
            _ => RunOutcome::Interrupted,
        });
        self.seal_run(&record.id);
        gate::keep(&self.config, &self.store.run_folder(&record.id));
        self.save(record.clone());
        self.event(None, ended(&record));
        self.active = None;
        self.no_room = self.lacks_room();
        let change = self.over(&record);
        match asked {
            Request::Abort => self.go_with(Trigger::MotorsStopped, change),
            Request::Stop if !self.stopping => self.go_with(Trigger::Joined, change),
            // The daemon's own end follows when everything is joined.
            _ => self.publish(change),
        }
    }

    /// The end of a run and all that follows from it, for one revision.
    pub(super) fn over(&self, record: &RunRecord) -> impl FnOnce(&mut Status) + use<> {
        let (status, calibration, left) = (run_status(record), self.calibration(), self.left_specimen(record.method.asd));
        |s| {
            s.run = Some(status);
            s.calibration = calibration;
            s.specimen = left;
        }
    }
}

/// What the journal says of a run's end.
fn ended(record: &RunRecord) -> EventData {
    EventData::RunEnded(RunEnded { outcome: record.outcome, wells: WellCounts::of(&record.wells) })
}
