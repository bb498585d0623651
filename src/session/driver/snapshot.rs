//! The parts of a snapshot that follow from the driver's parts. They are computed again for each revision.

use super::super::{Pending, Refusal, RunStatus, SpecimenStatus, State, Status, sentence};
use super::loader::{Left, Loader};
use super::plates::{Surroundings, to_be_taken_out};
use super::resume;
use super::run::{Request, RunInProgress};
use super::{Departure, Life};
use crate::api;
use carved_records::{CalibrationStatus, Device, Fault, InstrumentState, Phase, RunState, Specimens, WellCounts, Work};
use carved_store::RunRecord;
use jiff::Timestamp;

/// The driver's parts, as a snapshot reads them.
pub(super) struct Parts<'a> {
    /// The state of the instrument.
    pub machine: State,
    pub state: &'a InstrumentState,
    pub run: Option<&'a RunInProgress>,
    pub loader: &'a Loader,
    /// The device that has been lost longest.
    pub lost: Option<Device>,
    /// A plan is being checked on the instrument.
    pub is_checked: bool,
    /// Why the smallest run would not fit on the disk. `None` if it would.
    pub no_room: Option<&'a str>,
    /// Some events or records are not on disk yet.
    pub is_failing: bool,
    /// The rig's newest calibration.
    pub calibration: Option<&'a CalibrationStatus>,
    pub life: Life,
    pub now: Timestamp,
}

impl Parts<'_> {
    /// Sets every field that follows from the parts and from the rest of the snapshot.
    pub fn derive(&self, s: &mut Status) {
        let specimens = specimens(self.state);
        s.state = self.machine;
        s.pending = self.pending();
        let under = resume::under_fault(self.run, self.state.run.as_ref(), &self.state.faults);
        s.faults = self.state.faults.open().iter().map(|fault| api::Fault::of(fault, under)).collect();
        s.calibration = self.calibration.cloned();
        if let Some(specimen) = &mut s.specimen {
            specimen.in_capillary = specimens.of(&specimen.well).state().is_inside();
        }
        if let Some(run) = &mut s.run {
            self.derive_run(s.state, s.specimen.as_ref(), run);
        }
        s.plate.barcode = self.state.plate.inside().map(str::to_owned);
        s.plate.present = self.state.plate.handed_over().is_some();
        let requests = specimens.requests(self.loader.situation(work(self.run)));
        s.plate.take_out = requests.take_out.map(str::to_owned);
        s.plate.bring = requests.bring.map(str::to_owned);
        let surroundings = Surroundings {
            state: s.state,
            has_run: self.run.is_some(),
            specimens,
            has_unexpected: self.state.stranger.is_inside(),
            is_failing: self.is_failing,
        };
        let keeps_plate = surroundings.needs();
        // During a start a run may still be restored.
        s.plate.removable = self.life != Life::Starting && s.plate.barcode.is_some() && keeps_plate.is_none();
        s.plate.needs = match self.run {
            Some(run) => {
                surroundings.unexpected().filter(|_| !run.works()).or_else(|| needs(s.plate.take_out.as_deref(), s.plate.bring.as_deref()))
            }
            None => keeps_plate,
        };
        s.not_ready_reason = self.not_ready();
        s.ready = s.not_ready_reason.is_none();
        s.doing = sentence::of(s);
    }

    fn pending(&self) -> Pending {
        let asked = self.run.map_or(Request::Nothing, RunInProgress::request);
        Pending {
            hold: self.run.is_some_and(RunInProgress::works) && matches!(asked, Request::Hold | Request::Halt),
            stop: self.life != Life::Stopping(Departure::LeavesRun)
                && (self.life.is_stopping() || matches!(asked, Request::Stop | Request::ShutDown)),
            abort: asked == Request::Abort,
        }
    }

    fn derive_run(&self, state: State, specimen: Option<&SpecimenStatus>, shown: &mut RunStatus) {
        let (known, faults) = (self.state.run.as_ref(), &self.state.faults);
        let is_held = state == State::Held;
        shown.held_by_operator = self.run.is_some() && known.is_some_and(RunState::is_held_by_operator);
        shown.goes_on_by_itself =
            (is_held || state == State::Holding) && self.run.is_some_and(|run| resume::goes_on_by_itself(run, known, faults));
        shown.hold = self.run.filter(|_| is_held).and_then(|run| resume::hold(run, known, faults));
        if let Some(run) = self.run {
            let begun = known.map_or_else(Vec::new, |known| known.specimens().begun());
            let recovering = run.numbers().wells().filter(|well| !begun.contains(well)).count();
            let waiting = shown.wells.pending.saturating_sub((begun.len() + recovering) as u32);
            let under_way = specimen.map(|specimen| specimen.well.as_str());
            shown.eta_s = self.state.paces.remaining(&run.record().plan.method, under_way, waiting, self.now);
        }
    }

    /// Why a run would be refused now. `None` if it would be accepted.
    fn not_ready(&self) -> Option<String> {
        match self.life {
            Life::Stopping(_) => return Some(Status::ENDING.into()),
            Life::Starting => return Some(Status::STARTING.into()),
            Life::Up => {}
        }
        let stands = self.state.faults.open().iter().find(|f: &&Fault| f.operator_required);
        let left = self.loader.keeps_run_out(specimens(self.state));
        let lost = self.lost.map(|lost| lost.way_out().to_owned());
        lost.or_else(|| stands.map(|f| format!("a fault stands: {}", f.plainly())))
            .or_else(|| self.run.map(|_| "a run is under way".into()))
            .or_else(|| left.map(Left::words).map(|(what, remedy)| format!("{what}; {remedy}")))
            .or_else(|| self.state.plate.open().map(|open| format!("plate {} is being handed over", open.barcode)))
            .or_else(|| self.is_checked.then(|| Refusal::Busy.to_string()))
            .or_else(|| self.no_room.map(str::to_owned))
    }
}

/// The specimens of the current or newest run.
pub(super) fn specimens(state: &InstrumentState) -> &Specimens {
    const NONE: &Specimens = &Specimens::none();
    state.run.as_ref().map_or(NONE, RunState::specimens)
}

/// What the run does now.
pub(super) fn work(run: Option<&RunInProgress>) -> Work {
    match run {
        Some(run) if run.works() => Work::InProgress,
        Some(_) => Work::Paused,
        None => Work::Over,
    }
}

/// A run, as the status shows it.
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

/// Shows the specimen in the capillary, as between runs. What is shown of it already stays.
pub(super) fn show_left(s: &mut Status, specimens: &Specimens, views_planned: u32) {
    let left = specimens.inside();
    if s.specimen.as_ref().map(|shown| shown.well.as_str()) != left {
        s.specimen = left.map(|well| SpecimenStatus::new(well, Phase::Eject, views_planned));
    }
}

/// The requests to the loader, as text.
fn needs(take_out: Option<&str>, bring: Option<&str>) -> Option<String> {
    let out = take_out.map(to_be_taken_out);
    let bring = bring.map(|well| format!("the specimen of well {well} in the capillary"));
    let both: Vec<String> = out.into_iter().chain(bring).collect();
    (!both.is_empty()).then(|| both.join(", then "))
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::*;
    use crate::session::Driver;
    use carved_devices::sampler::{LoaderInterlock, LoaderSampler};
    use carved_records::{EventBody, EventData, Mode, PhaseEntered, PlateNamed, SensorReading, fault_table};

    fn after(events: &[(Option<&str>, EventData)]) -> InstrumentState {
        let mut state = InstrumentState { run: Some(RunState::new("r1")), ..InstrumentState::default() };
        let loaded = EventData::PlateLoaded(PlateNamed { barcode: "P-1".into() });
        state.apply(&EventBody { time: String::new(), run: None, well: None, data: loaded });
        for (well, data) in events {
            state.apply(&EventBody { time: String::new(), run: Some("r1".into()), well: well.map(Into::into), data: data.clone() });
        }
        state
    }

    fn loader() -> Loader {
        Loader::new(LoaderInterlock::default(), &LoaderSampler::new(LoaderInterlock::default()))
    }

    fn parts<'a>(state: &'a InstrumentState, loader: &'a Loader) -> Parts<'a> {
        Parts {
            machine: State::Idle,
            state,
            run: None,
            loader,
            lost: None,
            is_checked: false,
            no_room: None,
            is_failing: false,
            calibration: None,
            life: Life::Up,
            now: Timestamp::UNIX_EPOCH,
        }
    }

    fn snapshot(parts: &Parts) -> Status {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        parts.derive(&mut s);
        s
    }

    #[test]
    fn the_first_thing_that_keeps_a_run_from_starting_is_the_reason() {
        let (empty, loader) = (after(&[]), loader());
        assert!(snapshot(&parts(&empty, &loader)).ready);
        let fault = Fault::new(1, &fault_table::EMERGENCY_STOP, String::new(), String::new());
        let latched = after(&[(None, EventData::FaultRaised(fault))]);
        let r = run(&["A01"]);
        let all = Parts {
            run: Some(&r),
            lost: Some(Device::Camera),
            is_checked: true,
            no_room: Some("one well: it is full"),
            life: Life::Stopping(Departure::EndsRun),
            ..parts(&latched, &loader)
        };
        let reason = |parts: &Parts| snapshot(parts).not_ready_reason.unwrap();
        assert_eq!(reason(&all), "shutting down");
        let all = Parts { life: Life::Up, ..all };
        assert!(reason(&all).contains("camera is lost"));
        let all = Parts { lost: None, ..all };
        assert!(reason(&all).contains("a fault stands"));
        let all = Parts { state: &empty, ..all };
        assert_eq!(reason(&all), "a run is under way");
        let all = Parts { run: None, ..all };
        assert!(reason(&all).contains("being checked"));
        assert_eq!(reason(&Parts { is_checked: false, ..all }), "one well: it is full");
    }

    #[test]
    fn a_plate_is_removable_once_nothing_of_it_is_inside_or_unwritten() {
        let (empty, loader) = (after(&[]), loader());
        assert!(snapshot(&parts(&empty, &loader)).plate.removable);
        let r = run(&["A01"]);
        for parts in [
            Parts { is_failing: true, ..parts(&empty, &loader) },
            Parts { run: Some(&r), ..parts(&empty, &loader) },
            Parts { life: Life::Starting, ..parts(&empty, &loader) },
        ] {
            assert!(!snapshot(&parts).plate.removable);
        }
        assert!(snapshot(&Parts { is_failing: true, ..parts(&empty, &loader) }).plate.needs.unwrap().contains("disk"));
        let inside = after(&[(Some("A01"), EventData::SpecimenPhase(PhaseEntered { phase: Phase::Eject, in_capillary: true }))]);
        let left = snapshot(&parts(&inside, &loader)).plate;
        assert!(!left.removable && left.take_out.as_deref() == Some("A01") && left.needs.unwrap().contains("A01"));
        let unasked = after(&[(None, EventData::SpecimenUnasked(SensorReading { there: true }))]);
        let plate = snapshot(&parts(&unasked, &loader)).plate;
        assert!(!plate.removable && plate.needs.unwrap().contains("no run asked for"), "nobody knows what is inside");
    }

    #[test]
    fn a_hold_that_waits_for_the_specimen_under_way_is_not_pending_without_a_worker() {
        let (state, loader) = (after(&[]), loader());
        let mut r = run(&["A01"]);
        r.ask(Request::Hold);
        assert_eq!(snapshot(&Parts { run: Some(&r), ..parts(&state, &loader) }).pending, Pending::default());
        r.ask(Request::Abort);
        let pending = snapshot(&Parts { run: Some(&r), ..parts(&state, &loader) }).pending;
        assert!(pending.abort && !pending.stop && !pending.hold);
    }
}
