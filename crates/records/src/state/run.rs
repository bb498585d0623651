//! The state of one run.

use super::Specimens;
use crate::{EventBody, EventData, HeldBy, Phase, ResumedBy};
use std::collections::{BTreeMap, BTreeSet};

/// The cause of a hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HoldCause {
    /// A fault's code, `operator`, `restart`, or `fault` if the fault is unknown.
    pub code: String,
    /// The cause as text.
    pub words: String,
}

impl HoldCause {
    /// The run is held by an operator.
    pub fn operator() -> Self {
        Self { code: "operator".into(), words: "An operator asked for it.".into() }
    }

    /// The run is held by an unknown fault.
    pub fn fault() -> Self {
        Self { code: "fault".into(), words: "A fault held it that is over by now.".into() }
    }

    fn power_cut() -> Self {
        let words = "The computer was restarted while the run was under way. The axis may have lost its power too, and the capillary may have turned.";
        Self { code: "restart".into(), words: words.into() }
    }

    fn restart() -> Self {
        Self { code: "restart".into(), words: "The daemon ended while the run was under way, and was started again.".into() }
    }
}

/// A requested end before the last well. The higher one wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EndRequest {
    /// After the current specimen.
    Stop,
    /// With the daemon. A daemon that is killed before the run has ended leaves it to the next start.
    Interrupt,
    /// At once.
    Abort,
}

/// The state of one run that follows from its events.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunState {
    id: String,
    specimens: Specimens,
    held_by_operator: bool,
    held_by: Option<HoldCause>,
    holds: BTreeMap<String, u32>,
    resumed_by_itself: u32,
    waits_for_operator: bool,
    recoveries: BTreeMap<String, u32>,
    /// By well and by the step in which they ended.
    ended_processes: BTreeMap<(String, Phase), u32>,
    is_asked_to_end: bool,
    end_request: Option<EndRequest>,
    /// The newest step of each well.
    steps: BTreeMap<String, Phase>,
    taken_out: BTreeSet<String>,
    to_redo: BTreeSet<String>,
    /// The start of the computer in which a process was last at the run.
    kernel_boot_id: Option<String>,
}

impl RunState {
    /// A run of which only the name is known.
    pub fn new(id: &str) -> Self {
        Self { id: id.to_owned(), ..Self::default() }
    }

    /// A run that was just accepted. `left`: the well of an earlier run whose specimen is still in the capillary.
    pub(super) fn accepted(id: &str, left: Option<&str>) -> Self {
        Self { specimens: Specimens::of_new_run(left), ..Self::new(id) }
    }

    /// Name of the run.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Where its specimens are.
    pub fn specimens(&self) -> &Specimens {
        &self.specimens
    }

    /// Whether an operator holds the run. Then only an operator can continue it.
    pub fn is_held_by_operator(&self) -> bool {
        self.held_by_operator
    }

    /// The last cause of a hold. `None` after the run has continued.
    pub fn held_by(&self) -> Option<&HoldCause> {
        self.held_by.as_ref()
    }

    /// How often this cause has held the run since a well was done.
    pub fn times_held_by(&self, code: &str) -> u32 {
        self.holds.get(code).copied().unwrap_or_default()
    }

    /// How often the run has continued by itself since a well was done.
    pub fn resumed_by_itself(&self) -> u32 {
        self.resumed_by_itself
    }

    /// Whether there was a fault since the last continuation after which only an operator continues the run, also once it is acknowledged.
    pub fn waits_for_operator(&self) -> bool {
        self.waits_for_operator
    }

    /// Number of attempts at the numbers of a well in which the daemon crashed.
    pub fn recoveries_of(&self, well: &str) -> u32 {
        self.recoveries.get(well).copied().unwrap_or_default()
    }

    /// The step on the specimen of this well in which most processes ended that nobody had asked to end, and how many. A picture ends each
    /// process in the same step, a person in any. A process that ended with the computer, as by a power cut, does not count.
    pub fn processes_ended_in(&self, well: &str) -> Option<(Phase, u32)> {
        let of_well = self.ended_processes.iter().filter(|((of, _), _)| of == well);
        of_well.map(|((_, phase), times)| (*phase, *times)).max_by_key(|(_, times)| *times)
    }

    /// The wells whose specimens were taken out while the sampler was at work. They count as out when no work is in progress.
    pub fn taken_out(&self) -> &BTreeSet<String> {
        &self.taken_out
    }

    /// The wells that are to be measured again, and were not begun since that was requested: they have no outcome, and their files are those
    /// of an earlier attempt.
    pub fn to_redo(&self) -> &BTreeSet<String> {
        &self.to_redo
    }

    /// The requested end.
    pub fn end_request(&self) -> Option<EndRequest> {
        self.end_request
    }

    /// Applies an event of this run.
    pub fn apply(&mut self, event: &EventBody) {
        let well = event.well.as_deref();
        match (&event.data, well) {
            (EventData::RunHoldRequested(_), _) => self.held_by_operator = true,
            (EventData::RunStopRequested(_), _) => self.end_request = self.end_request.max(Some(EndRequest::Stop)),
            (EventData::RunAbortRequested(_), _) => self.end_request = self.end_request.max(Some(EndRequest::Abort)),
            (EventData::RunHeld(held), _) => {
                let cause = match (held.code.clone(), held.cause.clone()) {
                    (Some(code), Some(words)) => HoldCause { code, words },
                    // An early journal says only who holds the run.
                    _ if held.by == HeldBy::Operator => HoldCause::operator(),
                    _ => HoldCause::fault(),
                };
                *self.holds.entry(cause.code.clone()).or_default() += 1;
                self.held_by = Some(cause);
            }
            (EventData::RunResumed(resumed), _) => {
                (self.held_by, self.held_by_operator, self.waits_for_operator) = (None, false, false);
                self.resumed_by_itself = if resumed.by == ResumedBy::Instrument { self.resumed_by_itself + 1 } else { 0 };
            }
            (EventData::FaultRaised(fault), _) => self.waits_for_operator |= !fault.lets_run_go_on() && !fault.is_tried_again(),
            (EventData::RunAccepted(accepted), _) => self.kernel_boot_id.clone_from(&accepted.kernel_boot_id),
            (EventData::RunInterrupted(interrupted), _) => {
                let is_other_boot = self.kernel_boot_id.is_some()
                    && interrupted.kernel_boot_id.is_some()
                    && self.kernel_boot_id != interrupted.kernel_boot_id;
                self.kernel_boot_id.clone_from(&interrupted.kernel_boot_id);
                // Its power was off, and very probably that of the axis too.
                self.waits_for_operator |= is_other_boot;
                self.held_by.get_or_insert_with(if is_other_boot { HoldCause::power_cut } else { HoldCause::restart });
                let is_asked_to_end = std::mem::take(&mut self.is_asked_to_end);
                if is_other_boot {
                    // Nothing that was read ended the process. A picture that ends the computer too waits for the operator each time.
                    self.recoveries.clear();
                } else if !is_asked_to_end {
                    for (well, _) in self.specimens.worked_on() {
                        if let Some(step) = self.steps.get(well) {
                            *self.ended_processes.entry((well.to_owned(), *step)).or_default() += 1;
                        }
                    }
                }
            }
            (EventData::SpecimenPhase(entered), Some(well)) => {
                self.steps.insert(well.to_owned(), entered.phase);
                self.to_redo.remove(well);
            }
            // It gets as many attempts as at first.
            (EventData::WellRedoRequested(_), Some(well)) => {
                self.to_redo.insert(well.to_owned());
                self.recoveries.remove(well);
                self.ended_processes.retain(|(of, _), _| of != well);
            }
            (EventData::WellTakenOut, Some(well)) => drop(self.taken_out.insert(well.to_owned())),
            (EventData::WellUnloaded, Some(well)) => drop(self.taken_out.remove(well)),
            (EventData::SpecimenRecovering(_), Some(well)) => *self.recoveries.entry(well.to_owned()).or_default() += 1,
            // The disk failed or the daemon was asked to end, so the attempts do not count as crashes.
            (EventData::StoreRegained, _) => self.recoveries.clear(),
            (EventData::DaemonStopping(stopping), _) => {
                self.recoveries.clear();
                self.is_asked_to_end = true;
                if stopping.ends_run {
                    self.end_request = self.end_request.max(Some(EndRequest::Interrupt));
                }
            }
            (EventData::SpecimenDone(_), Some(well)) => {
                self.resumed_by_itself = 0;
                self.holds.clear();
                self.recoveries.remove(well);
                self.to_redo.remove(well);
            }
            _ => {}
        }
        // Last: an interruption counts the specimens that were worked on before it.
        self.specimens.apply(event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Asked;
    use crate::fault_table::{self, FaultCode};
    use crate::{DaemonStopping, Event, Fault, FaultAcknowledged, InstrumentState};
    use crate::{
        Interrupted, LoadedBy, PhaseEntered, PlannedWell, RunAccepted, RunHeld, RunInterrupted, RunResumed, SpecimenDone,
        SpecimenInterrupted, SpecimenKind, WellLoaded, WellStatus,
    };

    fn event(well: Option<&str>, data: EventData) -> EventBody {
        EventBody { time: "2026-01-01T00:00:00Z".into(), run: Some("r".into()), well: well.map(Into::into), data }
    }

    fn phase(well: &str, phase: Phase, in_capillary: bool) -> EventBody {
        event(Some(well), EventData::SpecimenPhase(PhaseEntered { phase, in_capillary }))
    }

    fn done(well: &str) -> EventBody {
        let result = WellStatus::pending(&PlannedWell::new(well, SpecimenKind::Larva, None));
        event(Some(well), EventData::SpecimenDone(Box::new(SpecimenDone { result, times: None, seconds: None })))
    }

    fn loaded(well: &str) -> EventBody {
        event(Some(well), EventData::WellLoaded(WellLoaded { in_place_of: None }))
    }

    fn unloaded(well: &str) -> EventBody {
        event(Some(well), EventData::WellUnloaded)
    }

    fn interrupted(well: &str, kept: bool) -> EventBody {
        let data = SpecimenInterrupted { reason: "x".into(), policy: Interrupted::Redo, kept };
        event(Some(well), EventData::SpecimenInterrupted(data))
    }

    fn restart(loaded_by: LoadedBy) -> EventBody {
        event(
            None,
            EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by: Some(loaded_by), kernel_boot_id: None }),
        )
    }

    fn after(events: &[EventBody]) -> RunState {
        let mut run = RunState::new("r");
        for event in events {
            run.apply(event);
        }
        run
    }

    fn inside(events: &[EventBody]) -> Option<String> {
        after(events).specimens().inside().map(str::to_owned)
    }

    #[test]
    fn the_specimen_under_way_is_the_one_that_was_begun_and_not_done() {
        let a = [phase("A01", Phase::Load, false), phase("A01", Phase::Revolve, true)];
        assert_eq!((after(&a).specimens().begun(), inside(&a).as_deref()), (vec!["A01"], Some("A01")));
        let done = [&a[..], &[done("A01")]].concat();
        assert!(after(&done).specimens().begun().is_empty());
        let next = [&done[..], &[phase("A02", Phase::Load, false)]].concat();
        assert_eq!((after(&next).specimens().begun(), inside(&next).as_deref()), (vec!["A02"], Some("A01")));
        // The numbers of the first specimen are computed while the second one is brought.
        let both = [&a[..], &[phase("A01", Phase::Wash, false), phase("A02", Phase::Load, false)]].concat();
        assert_eq!(after(&both).specimens().begun(), ["A01", "A02"]);
        let brought = [&next[..], &[loaded("A02")]].concat();
        assert_eq!(inside(&brought).as_deref(), Some("A02"));
        assert_eq!(inside(&[&brought[..], &[unloaded("A02")]].concat()), None);
    }

    /// A loader is asked again for an awaited specimen, but not for one that was measured or ejected since.
    #[test]
    fn after_a_restart_a_loader_is_asked_again_for_what_was_only_waited_for() {
        let awaited = [phase("A01", Phase::Load, false), loaded("A01")];
        let gone = [&awaited[..], &[phase("A01", Phase::Measure, true), phase("A01", Phase::Eject, true), unloaded("A01")]].concat();
        let next = [&gone[..], &[phase("A02", Phase::Load, false)]].concat();
        let begun = |events: &[EventBody]| {
            let state = after(&[events, &[restart(LoadedBy::Loader)]].concat());
            state.specimens().begun().into_iter().map(str::to_owned).collect::<Vec<_>>()
        };
        assert!(begun(&awaited).is_empty());
        assert_eq!((begun(&gone), begun(&next)), (vec!["A01".to_owned()], vec!["A01".to_owned()]));
        assert!(begun(&[&next[..], &[done("A01")]].concat()).is_empty());
    }

    /// A driven sampler may have brought the specimen that was begun last, if no later phase of it is known.
    #[test]
    fn after_a_restart_a_sampler_is_taken_to_have_brought_what_was_begun_last() {
        let restarted = |events: &[EventBody]| inside(&[events, &[restart(LoadedBy::Sampler)]].concat());
        assert_eq!(restarted(&[phase("A01", Phase::Load, false)]).as_deref(), Some("A01"));
        assert_eq!(restarted(&[phase("A01", Phase::Eject, true), done("A01")]).as_deref(), Some("A01"));
        assert_eq!(restarted(&[phase("A01", Phase::Revolve, true), done("A01"), phase("A01", Phase::Wash, false)]), None);
        // A01 was ejected, and only its numbers are missing. The sampler may have brought A02, and still has over a second restart.
        let measured = [phase("A01", Phase::Measure, true), phase("A01", Phase::Wash, false)];
        assert_eq!(restarted(&measured), None);
        let next = [&measured[..], &[phase("A02", Phase::Load, false), restart(LoadedBy::Sampler), interrupted("A02", false)]].concat();
        assert_eq!(restarted(&next).as_deref(), Some("A02"));
        let kept = [phase("A01", Phase::Revolve, true), interrupted("A01", true)];
        let state = after(&[&kept[..], &[restart(LoadedBy::Sampler)]].concat());
        assert_eq!((state.specimens().inside(), state.specimens().continued_with()), (Some("A01"), Some("A01")));
    }

    #[test]
    fn a_load_that_was_cut_short_is_remembered_until_its_specimen_comes_or_is_late() {
        let load = [phase("A01", Phase::Load, false), interrupted("A01", false)];
        let asked = |then: &[EventBody]| {
            let state = after(&[&load[..], then, &[restart(LoadedBy::Sampler)]].concat());
            (state.specimens().unknown().map(str::to_owned), state.specimens().of("A01").state().is_worked_on())
        };
        assert_eq!(asked(&[]), (Some("A01".into()), false));
        assert_eq!(asked(&[phase("A01", Phase::Load, false)]), (Some("A01".into()), false));
        let failed = Fault::new(7, &fault_table::SAMPLER_FAILED, String::new(), String::new());
        assert_eq!(asked(&[event(None, EventData::FaultRaised(failed))]), (None, false));
        assert_eq!(asked(&[unloaded("A01")]), (None, false));
        // It has come, and was ejected before any work on it.
        let ejected = [phase("A01", Phase::Load, false), phase("A01", Phase::Eject, true), phase("A01", Phase::Wash, false)];
        assert_eq!(asked(&ejected), (None, true));
    }

    #[test]
    fn a_specimen_stays_inside_while_the_next_is_awaited_until_somebody_says_otherwise() {
        let awaited = [phase("A01", Phase::Eject, true), done("A01"), phase("A02", Phase::Load, false)];
        assert_eq!(inside(&awaited).as_deref(), Some("A01"));
        assert_eq!(after(&awaited).specimens().begun(), ["A02"], "the one inside is measured");
        let then = |last: EventBody| inside(&[&awaited[..], &[last]].concat());
        assert_eq!(then(unloaded("A01")), None);
        assert_eq!(then(loaded("A02")).as_deref(), Some("A02"));
        assert_eq!(then(phase("A01", Phase::Eject, false)), None, "the frame shows that nothing was there");
    }

    #[test]
    fn a_run_begins_with_what_an_earlier_one_left_inside() {
        let accepted =
            RunAccepted { plate_barcode: "P".into(), method: "m".into(), left_in_capillary: Some("H12".into()), ..RunAccepted::default() };
        let events = [Event { id: 1, body: event(None, EventData::RunAccepted(accepted)) }];
        let run = InstrumentState::after(&events).run.unwrap();
        assert_eq!((run.id(), run.specimens().inside(), run.specimens().has_held("H12")), ("r", Some("H12"), true));
    }

    #[test]
    fn what_the_loader_was_asked_for_and_what_it_brought_is_known_until_work_on_it_begins() {
        let awaited = [phase("A01", Phase::Load, false), event(Some("A01"), EventData::WellAwaited)];
        let of = |events: &[EventBody]| after(events).specimens().clone();
        assert_eq!((of(&awaited).asked_for(), of(&awaited).continued_with()), (Some("A01"), None));
        let brought = [&awaited[..], &[loaded("A01")]].concat();
        // The run continues with the loaded specimen, without a request.
        let again = [&brought[..], &[phase("A01", Phase::Load, false)]].concat();
        for events in [&brought, &again] {
            assert_eq!((of(events).asked_for(), of(events).continued_with(), of(events).inside()), (None, Some("A01"), Some("A01")));
        }
        assert_eq!(of(&[&brought[..], &[phase("A01", Phase::Position, true)]].concat()).continued_with(), None);
        assert_eq!(of(&[&brought[..], &[unloaded("A01")]].concat()).continued_with(), None);
    }

    /// After two crashes, the second start must not count the specimen that the first one ejected as begun.
    #[test]
    fn an_attempt_that_was_thrown_out_is_over() {
        let resumed = event(None, EventData::RunResumed(RunResumed { by: ResumedBy::Operator, name: None, from: None }));
        let revolve = phase("A01", Phase::Revolve, true);
        let ejected = [phase("A01", Phase::Eject, true), phase("A01", Phase::Eject, false)];
        let state = after(&[&[revolve, interrupted("A01", false), resumed][..], &ejected].concat());
        assert_eq!((state.specimens().begun(), state.specimens().inside(), state.specimens().has_held("A01")), (Vec::new(), None, true));
    }

    #[test]
    fn an_operators_hold_and_an_end_that_was_asked_for_outlast_a_crash() {
        let hold = event(None, EventData::RunHoldRequested(Asked::default()));
        let held =
            event(None, EventData::RunHeld(RunHeld { by: HeldBy::Operator, code: Some("operator".into()), cause: Some("x".into()) }));
        let resumed = event(None, EventData::RunResumed(RunResumed { by: ResumedBy::Operator, name: None, from: None }));
        let state = after(&[hold.clone(), phase("A01", Phase::Load, false), held.clone()]);
        assert_eq!((state.is_held_by_operator(), state.times_held_by("operator"), state.specimens().begun()), (true, 1, Vec::new()));
        assert_eq!(state.held_by().map(|cause| cause.code.as_str()), Some("operator"));
        let state = after(&[hold, held, resumed]);
        assert_eq!((state.is_held_by_operator(), state.held_by()), (false, None));
        for (by, code) in [(HeldBy::Operator, "operator"), (HeldBy::Fault, "fault")] {
            let early = after(&[event(None, EventData::RunHeld(RunHeld { by, code: None, cause: None }))]);
            assert_eq!(early.held_by().map(|cause| cause.code.as_str()), Some(code), "an early journal");
        }
        let ends =
            [event(None, EventData::RunAbortRequested(Asked::default())), event(None, EventData::RunStopRequested(Asked::default()))];
        assert_eq!(after(&ends).end_request(), Some(EndRequest::Abort));
    }

    /// A specimen on which the daemon crashes each time must not be begun without limit.
    #[test]
    fn going_on_by_itself_is_counted_over_crashes_until_a_well_is_done() {
        let resumed = |by| event(None, EventData::RunResumed(RunResumed { by, name: None, from: None }));
        let twice = [resumed(ResumedBy::Instrument), resumed(ResumedBy::Instrument)];
        assert_eq!(after(&twice).resumed_by_itself(), 2);
        assert_eq!(after(&[&twice[..], &[resumed(ResumedBy::Operator)]].concat()).resumed_by_itself(), 0);
        assert_eq!(after(&[&twice[..], &[done("A01")]].concat()).resumed_by_itself(), 0);
    }

    #[test]
    fn a_fault_that_an_operator_has_to_end_keeps_the_run_waiting_until_somebody_continues_it() {
        let raised = |code: &FaultCode| event(None, EventData::FaultRaised(Fault::new(7, code, String::new(), String::new())));
        let acknowledged =
            event(None, EventData::FaultAcknowledged(FaultAcknowledged { seq: 7, code: String::new(), by: None, from: None }));
        let resumed = event(None, EventData::RunResumed(RunResumed { by: ResumedBy::Operator, name: None, from: None }));
        let waits = |events: &[EventBody]| after(events).waits_for_operator();
        assert!(!waits(&[raised(&fault_table::CAMERA_LOST)]) && !waits(&[raised(&fault_table::DISK_FULL)]));
        for code in
            [&fault_table::ROTATION_LOST, &fault_table::ROTATION_INTERVENTION, &fault_table::ROTATION_SUSPECT, &fault_table::SETUP_UNUSABLE]
        {
            assert!(waits(&[raised(code), acknowledged.clone(), restart(LoadedBy::Loader)]), "{}", code.code);
            assert!(!waits(&[raised(code), acknowledged.clone(), resumed.clone()]), "{}", code.code);
        }
    }

    #[test]
    fn the_request_that_ends_a_run_sooner_wins() {
        let stop = event(None, EventData::RunStopRequested(Asked::default()));
        let ends = event(None, EventData::DaemonStopping(DaemonStopping { ends_run: true }));
        let abort = event(None, EventData::RunAbortRequested(Asked::default()));
        let asked = |events: &[EventBody]| after(events).end_request();
        assert_eq!(asked(&[stop.clone(), ends.clone()]), Some(EndRequest::Interrupt));
        assert_eq!(asked(&[ends.clone(), stop]), Some(EndRequest::Interrupt));
        assert_eq!(asked(&[abort, ends]), Some(EndRequest::Abort));
    }

    #[test]
    fn events_of_another_run_change_nothing() {
        let mut state = InstrumentState { run: Some(RunState::new("q")), ..InstrumentState::default() };
        let before = state.clone();
        state.apply(&event(None, EventData::RunStopRequested(Asked::default())));
        assert_eq!(state, before);
    }
}
