//! How a change is told: journalled, then published as one revision whose derived parts are computed anew.

use super::super::state::{self, Trigger};
use super::super::{Hold, Pending, Refusal, RunStatus, SpecimenStatus, State, Status, sentence};
use super::recovery::Recovery;
use super::{Active, BackgroundTask, Request, Running};
use carved_records::{Fault, Phase, Resume, RunState, WellCounts};
use carved_store::RunRecord;

/// A run that has gone on this often without finishing a well waits for a person: something is wrong that comes back.
const RESUMED_BY_ITSELF: u32 = 3;

impl Running {
    /// Follows the state table; every state on the way is published as a revision of its own.
    pub(super) fn go(&self, trigger: Trigger) {
        self.go_with(trigger, |_| ());
    }

    /// As `go`, with a change that comes with the first state and in the same revision.
    pub(super) fn go_with(&self, trigger: Trigger, change: impl FnOnce(&mut Status)) {
        let from = self.publisher.status().state;
        let Some(path) = state::next(from, trigger) else {
            tracing::error!(?from, ?trigger, "no such transition");
            return self.publish(change);
        };
        let mut change = Some(change);
        for &to in path {
            let change = change.take();
            self.publish(|s| {
                s.state = to;
                if let Some(change) = change {
                    change(s);
                }
            });
        }
        if let Some(change) = change {
            self.publish(change);
        }
    }

    pub(super) fn publish(&self, change: impl FnOnce(&mut Status)) {
        self.publisher.publish(|s| {
            change(s);
            self.derive(s);
        });
    }

    /// What follows from the rest.
    fn derive(&self, s: &mut Status) {
        let asked = self.active.as_ref().map_or(Request::Nothing, |a| a.request);
        let works = self.active.as_ref().is_some_and(|a| a.work.is_some());
        s.pending = Pending {
            hold: works && matches!(asked, Request::Hold | Request::Halt),
            stop: self.stopping || asked == Request::Stop,
            abort: asked == Request::Abort,
        };
        s.faults = self.state().faults.open().to_vec();
        if let Some(specimen) = &mut s.specimen {
            specimen.in_capillary = self.capillary().inside() == Some(&specimen.well);
        }
        if let Some(run) = &mut s.run {
            run.held_by_operator = self.active.is_some() && self.is_held_by_operator();
            run.goes_on_by_itself = matches!(s.state, State::Holding | State::Held) && self.goes_on_by_itself(&s.faults);
            run.hold = if s.state == State::Held { self.hold_of(&s.faults, run.goes_on_by_itself) } else { None };
        }
        (s.plate.take_out, s.plate.bring) = self.wanted();
        s.plate.needs = needs(s.plate.take_out.as_deref(), s.plate.bring.as_deref());
        // Everything of it is on disk, and only who takes a specimen out knows that it is out. A start may yet take a run up.
        let over = !self.starting && self.active.is_none() && self.capillary().inside().is_none() && !self.unasked;
        s.plate.removable = over && s.plate.barcode.is_some() && !self.outbox.is_failing();
        s.not_ready_reason = self.not_ready(s);
        s.ready = s.not_ready_reason.is_none();
        if let (Some(active), Some(run)) = (&self.active, &mut s.run) {
            let begun = self.state().run.as_ref().map_or(&[][..], RunState::begun);
            let recovering = active.recovery.iter().flat_map(Recovery::wells).filter(|well| !begun.iter().any(|b| b == well)).count();
            let waiting = run.wells.pending.saturating_sub((begun.len() + recovering) as u32);
            let shown = s.specimen.as_ref().map(|specimen| specimen.well.as_str());
            run.eta_s = self.state().paces.remaining(&active.record.plan.method, shown, waiting, jiff::Timestamp::now());
        }
        s.doing = sentence::of(s);
    }

    pub(super) fn is_held_by_operator(&self) -> bool {
        self.state().run.as_ref().is_some_and(RunState::is_held_by_operator)
    }

    /// Whether the run's method lets it go on once what holds it is over; not for ever where no well gets done.
    pub(super) fn resumes_by_itself(&self) -> bool {
        let resumed = self.state().run.as_ref().map_or(0, RunState::resumed_by_itself);
        resumed < RESUMED_BY_ITSELF && self.active.as_ref().is_some_and(|a| a.record.method.policy.resume == Resume::Automatic)
    }

    /// Whether a held run goes on without anybody's word: nothing holds it but what ends by itself, and its method lets it.
    fn goes_on_by_itself(&self, faults: &[Fault]) -> bool {
        let Some(active) = &self.active else { return false };
        let held_by_something = active.may_go_on || !faults.is_empty();
        held_by_something && !self.is_held_by_operator() && self.resumes_by_itself() && faults.iter().all(Fault::ends_by_itself)
    }

    /// Why the run is held, and what is to be done next: by the same rule by which it goes on.
    fn hold_of(&self, faults: &[Fault], goes_on_by_itself: bool) -> Option<Hold> {
        let active = self.active.as_ref()?;
        let run = self.state().run.as_ref()?;
        let cause = run.held_by()?;
        let times = run.times_held_by(&cause.code).max(1);
        let comes_back = run.resumed_by_itself() > 0 && !self.resumes_by_itself();
        let next_action = match faults.last() {
            Some(fault) => Some(fault.what_to_do.clone()),
            None if goes_on_by_itself || matches!(active.request, Request::Stop | Request::Abort | Request::ShutDown) => None,
            None if comes_back => Some("Find out why it comes back. Then let the run go on.".to_owned()),
            None => Some("Let the run go on when you are ready.".to_owned()),
        };
        Some(Hold { code: cause.code.clone(), cause: cause.words.clone(), times, next_action })
    }

    /// What the loader is asked for: whose specimen to take out, and whose to bring after that.
    fn wanted(&self) -> (Option<String>, Option<String>) {
        let left = self.left_for_the_loader().map(str::to_owned);
        match &self.active {
            Some(Active { waiting_for: Some(next), .. }) => (left, Some(next.clone())),
            Some(active) => (active.take_out.clone(), None),
            None => (left, None),
        }
    }

    /// The well whose specimen is in the capillary and that nobody but the loader takes out: a driven sampler does so itself, before
    /// the next one.
    pub(super) fn left_for_the_loader(&self) -> Option<&str> {
        self.capillary().inside().filter(|_| self.loaded_from_outside)
    }

    /// The specimen that stays shown at rest: the one that is still in the capillary.
    pub(super) fn left_specimen(&self, views_planned: u32) -> Option<SpecimenStatus> {
        let well = self.capillary().inside()?;
        let shown = self.publisher.status().specimen.clone().filter(|shown| shown.well == well);
        Some(shown.unwrap_or_else(|| SpecimenStatus::new(well, Phase::Eject, views_planned)))
    }

    /// Why no run would be taken now.
    fn not_ready(&self, s: &Status) -> Option<String> {
        if self.stopping {
            return Some("shutting down".into());
        }
        if self.starting {
            return Some("starting".into());
        }
        let stands = s.faults.iter().find(|f| f.operator_required);
        let lost = self.lost.first().map(|lost| lost.way_out().to_owned());
        lost.or_else(|| stands.map(|f| format!("a fault stands: {}", f.plainly())))
            .or_else(|| self.active.as_ref().map(|_| "a run is under way".into()))
            .or_else(|| {
                self.left_for_the_loader()
                    .map(|well| format!("the specimen of well {well} is still in the capillary; take it out and say so"))
            })
            .or_else(|| self.state().plate.open().map(|open| format!("plate {} is being handed over", open.barcode)))
            .or_else(|| matches!(self.task, Some(BackgroundTask::Preflight { .. })).then(|| Refusal::Busy.to_string()))
            .or_else(|| self.no_room.clone())
    }
}

/// A run as the status shows it.
pub(super) fn run_status(record: &RunRecord) -> RunStatus {
    RunStatus {
        id: record.id.clone(),
        external_id: record.plan.external_id.clone(),
        method: record.plan.method.clone(),
        operator: record.plan.operator.clone(),
        wells: WellCounts::of(&record.wells),
        results: record.wells.clone(),
        started: record.started.clone(),
        ended: record.ended.clone(),
        eta_s: None,
        held_by_operator: false,
        goes_on_by_itself: false,
        hold: None,
        outcome: record.outcome,
    }
}

/// The same in words.
fn needs(take_out: Option<&str>, bring: Option<&str>) -> Option<String> {
    let out = take_out.map(to_be_taken_out);
    let bring = bring.map(|well| format!("the specimen of well {well} in the capillary"));
    let both: Vec<String> = out.into_iter().chain(bring).collect();
    (!both.is_empty()).then(|| both.join(", then "))
}

pub(super) fn to_be_taken_out(well: &str) -> String {
    format!("the specimen of well {well} to be taken out of the capillary")
}
