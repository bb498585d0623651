//! How a run comes to rest: held with what is left of it, or at its end.
//!
//! ```text
//! worker_ended ─┬─ interrupt_specimen ──► rest ──────────────────────────► Held
//!               ├─ finish ──► numbers of specimens that are gone ─► close ► Complete
//!               └─ end_run ─► numbers of specimens that are gone ─► end_now ► Stopped, Aborted
//! ```

use super::super::state::Trigger;
use super::super::{RunOutcome, SpecimenOutcome, State, Status, gate, kind};
use super::Running;
use super::active::{Asked, Cause};
use super::publish::run_status;
use super::recovery::Then;
use crate::config::Interrupted;
use crate::store::RunRecord;
use serde_json::{Value, json};

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
        let Some(active) = &mut self.active else { return };
        let policy = active.record.method.policy.interrupted;
        let mut wells: Vec<String> = std::mem::take(&mut active.under_way).into_keys().collect();
        // What the loader has brought is not begun: it stays, and is used when the run goes on.
        wells.retain(|well| self.brought.as_ref() != Some(well));
        for well in wells {
            let Some(active) = &mut self.active else { return };
            let inside = self.occupant.as_ref() == Some(&well);
            let accepted = accepted.iter().any(|accepted| accepted.well == well);
            let kept = fate == Fate::Stays && inside && !accepted;
            // One that has not come yet is still to come.
            let came = inside || self.been_inside.contains(&well);
            let given_up = came && !kept && (!self.brings_again || policy == Interrupted::Skip && fate == Fate::PoseLost);
            if kept {
                self.brought = Some(well.clone());
            } else if inside && self.loaded_from_outside {
                active.take_out = Some(well.clone());
            } else if inside {
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
            let data = json!({ "reason": reason, "policy": policy, "kept": kept });
            self.event(kind::SPECIMEN_INTERRUPTED, Some(&well), data);
        }
        // One whose well is done is still there where it could not be taken out.
        let stuck = self.occupant.clone().filter(|inside| !self.loaded_from_outside && self.brought.as_ref() != Some(inside));
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
        self.publish(|s| s.run = Some(status));
        self.event(kind::SPECIMEN_INTERRUPTED, Some(well), json!({ "reason": reason, "policy": policy, "kept": false }));
    }

    /// Between two wells nothing is under way; what the loader brought in the same moment stays until the run goes on.
    pub(super) fn set_down(&mut self) {
        self.active.iter_mut().for_each(|active| active.under_way.clear());
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
        active.then = None;
        active.may_go_on = false;
        let newest = self.publisher.status().faults.last().filter(|_| by_fault).map(|f| (f.code.clone(), f.plainly().to_owned()));
        let cause = newest.map_or_else(Cause::operator, |(code, words)| Cause { code, words });
        *active.holds.entry(cause.code.clone()).or_default() += 1;
        let (code, words) = (cause.code.clone(), cause.words.clone());
        active.cause = Some(cause);
        let record = active.record.clone();
        let status = run_status(&record);
        self.save(record);
        self.go_with(Trigger::Rested, |s| s.run = Some(status));
        self.event(kind::RUN_HELD, None, json!({ "by": if by_fault { "fault" } else { "operator" }, "code": code, "cause": words }));
    }

    /// All wells are done, but for numbers that are still made from frames.
    pub(super) fn finish(&mut self) {
        self.go(Trigger::WellsDone);
        self.recover();
        if !self.waits_for_numbers(Then::Finish) {
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
        let told = told.and_then(|()| self.promise(kind::RUN_ENDED, None, ended(&record)));
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
        if !self.waits_for_numbers(Then::End) {
            self.end_now();
        }
    }

    /// Stopped, aborted, or with the daemon.
    pub(super) fn end_now(&mut self) {
        let Some(active) = &self.active else { return };
        let (asked, mut record) = (active.asked, active.record.clone());
        let (left, reason) = match asked {
            Asked::Abort => (SpecimenOutcome::Aborted, "the run was aborted"),
            Asked::Stop => (SpecimenOutcome::Aborted, "the run was stopped before this well"),
            _ => (SpecimenOutcome::Interrupted, "the daemon was stopped"),
        };
        for well in record.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end(left, Some(reason));
        }
        record.end(match asked {
            Asked::Abort => RunOutcome::Aborted,
            Asked::Stop => RunOutcome::of_stopped(&record.wells),
            _ => RunOutcome::Interrupted,
        });
        self.seal_run(&record.id);
        gate::keep(&self.config, &self.store.run_folder(&record.id));
        self.save(record.clone());
        self.event(kind::RUN_ENDED, None, ended(&record));
        self.active = None;
        self.no_room = self.lacks_room();
        let change = self.over(&record);
        match asked {
            Asked::Abort => self.go_with(Trigger::MotorsStopped, change),
            Asked::Stop if !self.stopping => self.go_with(Trigger::Joined, change),
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
fn ended(record: &RunRecord) -> Value {
    json!({ "outcome": record.outcome, "wells": run_status(record).wells })
}
