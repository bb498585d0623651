//! A run from its acceptance to its outcome: its record, the work on it, and what becomes of it when the work ends.
//!
//! ```text
//! launch ──► Work (has the instrument) ──► joined ──► AfterWork: finish, end, rest, fault, halted, abort
//!               ▲
//! ask ── Request: hold < halt < stop < abort < shut-down; the highest one counts
//! ```
//! What its events say of it is in [`RunState`](carved_records::RunState).

use super::super::gate;
use super::super::halt::Halt;
use super::super::worker::{self, Instrument, Progress, RunContext, RunEnd, RunError};
use super::handling::Handling;
use super::recovery::{Made, Numbers};
use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_devices::sampler::LoaderInterlock;
use carved_records::{EndRequest, PlannedWell, RunOutcome, SpecimenOutcome, WellStatus};
use carved_store::RunRecord;
use std::collections::VecDeque;
use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle};

/// What becomes of the run once its worker has ended; the later one counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Request {
    Nothing,
    Hold,
    /// By a fault.
    Halt,
    Stop,
    Abort,
    ShutDown,
}

/// What the driver does once a worker has ended.
#[derive(Debug)]
pub(super) enum AfterWork {
    /// All wells are done.
    Finish,
    /// The run ends as it was asked to; with the error, if the worker met one meanwhile.
    End(Option<RunError>),
    /// An operator holds it, between two specimens.
    Rest,
    /// An error holds it.
    Fault(RunError),
    /// A write that failed has cut the specimen short.
    Halted,
    /// An emergency stop has cancelled it, past the mailbox.
    Abort,
}

/// A run that has no outcome yet.
pub(super) struct RunInProgress {
    record: RunRecord,
    /// None while it is held, or waits for a specimen to be taken out.
    work: Option<Work>,
    numbers: Numbers,
    handling: Handling,
    request: Request,
    /// A fault has cancelled its worker, whatever else was asked for since.
    halted: bool,
    /// Everything that held it is over: it goes on as soon as the instrument is free.
    may_go_on: bool,
    /// Its larvae are measured without a valid bead gate.
    lacks_gate: bool,
}

impl RunInProgress {
    /// A run that nothing was asked of.
    pub fn new(record: RunRecord) -> Self {
        Self {
            record,
            work: None,
            numbers: Numbers::default(),
            handling: Handling::default(),
            request: Request::Nothing,
            halted: false,
            may_go_on: false,
            lacks_gate: false,
        }
    }

    pub fn record(&self) -> &RunRecord {
        &self.record
    }

    /// Whether a worker has the instrument.
    pub fn works(&self) -> bool {
        self.work.is_some()
    }

    pub fn request(&self) -> Request {
        self.request
    }

    pub fn may_go_on(&self) -> bool {
        self.may_go_on
    }

    /// Notes whether everything that held it is over.
    pub fn set_may_go_on(&mut self, may_go_on: bool) {
        self.may_go_on = may_go_on;
    }

    /// Notes whether its larvae are measured without a valid bead gate.
    pub fn set_lacks_gate(&mut self, lacks_gate: bool) {
        self.lacks_gate = lacks_gate;
    }

    pub fn handling(&self) -> &Handling {
        &self.handling
    }

    pub fn handling_mut(&mut self) -> &mut Handling {
        &mut self.handling
    }

    pub fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    pub fn numbers_mut(&mut self) -> &mut Numbers {
        &mut self.numbers
    }

    /// Notes how the run is to end, and passes it to the worker: after its specimen, or at once.
    pub fn ask(&mut self, what: Request) {
        self.request = self.request.max(what);
        self.halted |= what == Request::Halt;
        if let Some(work) = &self.work {
            work.obey(what);
        }
    }

    /// Takes up what was asked of it in an earlier life of the daemon.
    pub fn recall(&mut self, end: Option<EndRequest>) {
        self.request = match end {
            Some(EndRequest::Abort) => Request::Abort,
            Some(EndRequest::Stop) => Request::Stop,
            None => Request::Nothing,
        };
    }

    /// A worker has the instrument from now on. What was asked of an earlier one is over.
    pub fn launch(&mut self, work: Work) {
        self.request = Request::Nothing;
        self.halted = false;
        self.work = Some(work);
    }

    /// The worker has ended.
    pub fn joined(&mut self, end: RunEnd) -> AfterWork {
        self.work = None;
        self.handling.worker_ended();
        after_work(end, self.request, self.halted)
    }

    /// It is held: whatever waited for the end of the work is asked anew.
    pub fn rests(&mut self) {
        self.numbers.forget_continuation();
        self.may_go_on = false;
    }

    /// Wells without outcome, but for those that only lack their numbers.
    pub fn wells_left(&self, accepted: &VecDeque<PlannedWell>) -> Vec<PlannedWell> {
        let open = self.record.plan.plate_map.iter().zip(&self.record.wells).filter(|(_, w)| w.outcome.is_none());
        let left = open.filter(|(_, w)| accepted.iter().all(|accepted| accepted.well != w.well));
        left.map(|(planned, _)| planned.clone()).collect()
    }

    /// The first well without outcome.
    pub fn next_well(&self) -> Option<&str> {
        self.record.wells.iter().find(|w| w.outcome.is_none()).map(|w| w.well.as_str())
    }

    /// Enters the result of a well, with its flag where the beads are missing; returns the result as it was entered.
    pub fn enter(&mut self, mut result: WellStatus) -> WellStatus {
        gate::flag(&mut result, self.lacks_gate);
        if let Some(slot) = self.record.wells.iter_mut().find(|w| w.well == result.well) {
            slot.clone_from(&result);
        }
        result
    }

    /// Ends a well whose specimen cannot be measured any more; false where it has an outcome.
    pub fn give_up(&mut self, well: &str, reason: &str) -> bool {
        let slot = self.record.wells.iter_mut().find(|w| w.well == well && w.outcome.is_none());
        slot.map(|slot| slot.end(SpecimenOutcome::Interrupted, Some(reason))).is_some()
    }

    /// The record of the run after its last well.
    pub fn finished(&self) -> RunRecord {
        let mut record = self.record.clone();
        record.end(RunOutcome::of_wells(&record.wells));
        record
    }

    /// The record of the run as it was asked to end before its last well.
    pub fn ended(&self) -> RunRecord {
        let mut record = self.record.clone();
        let (left, reason) = match self.request {
            Request::Abort => (SpecimenOutcome::Aborted, "the run was aborted"),
            Request::Stop => (SpecimenOutcome::Aborted, "the run was stopped before this well"),
            _ => (SpecimenOutcome::Interrupted, "the daemon was stopped"),
        };
        for well in record.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end(left, Some(reason));
        }
        record.end(match self.request {
            Request::Abort => RunOutcome::Aborted,
            Request::Stop => RunOutcome::of_stopped(&record.wells),
            _ => RunOutcome::Interrupted,
        });
        record
    }

    #[cfg(test)]
    pub fn record_mut(&mut self) -> &mut RunRecord {
        &mut self.record
    }

    #[cfg(test)]
    pub fn work_mut(&mut self) -> &mut Option<Work> {
        &mut self.work
    }
}

fn after_work(end: RunEnd, request: Request, halted: bool) -> AfterWork {
    // Whoever asked for the end gets it, also where the last well was done in the same moment.
    let at_once = matches!(request, Request::Abort | Request::ShutDown);
    let over = at_once || request == Request::Stop && matches!(end, RunEnd::AllWells | RunEnd::Paused);
    match end {
        RunEnd::Failed(error) if over => AfterWork::End(Some(error)),
        _ if over => AfterWork::End(None),
        RunEnd::AllWells if request != Request::Halt => AfterWork::Finish,
        RunEnd::Failed(error) => AfterWork::Fault(error),
        RunEnd::Paused if request == Request::Hold => AfterWork::Rest,
        // Also where it was to stop after its specimen: the stop follows once it rests.
        _ if request == Request::Halt || request == Request::Stop && halted => AfterWork::Halted,
        _ => AfterWork::Abort,
    }
}

/// The worker of a run, as the driver holds it.
pub(super) struct Work {
    cancel: CancelToken,
    pause: CancelToken,
    stop: StopHandle,
    interlock: LoaderInterlock,
    worker: JoinHandle<(Instrument, RunEnd)>,
    progress: mpsc::Receiver<Progress>,
}

impl Work {
    /// Begins on a thread of its own. `context` gets the tokens that cancel and pause it, and where it sends its progress.
    pub fn begin(
        instrument: Instrument,
        interlock: LoaderInterlock,
        halt: &Halt,
        context: impl FnOnce(CancelToken, CancelToken, mpsc::Sender<Progress>) -> RunContext,
    ) -> Self {
        let (cancel, pause) = (CancelToken::default(), CancelToken::default());
        let stop = instrument.rig.rotation.stop_handle();
        halt.aim(stop.clone(), cancel.clone());
        let (progress_in, progress) = mpsc::channel(64);
        let context = context(cancel.clone(), pause.clone(), progress_in);
        let worker = tokio::task::spawn_blocking(move || worker::run(instrument, &context));
        Self { cancel, pause, stop, interlock, worker, progress }
    }

    fn obey(&self, request: Request) {
        match request {
            Request::Nothing => {}
            Request::Hold | Request::Stop => {
                self.pause.cancel();
                self.interlock.give_up();
            }
            // Motors first; the worker then ends by itself.
            Request::Halt => {
                self.cancel.cancel();
                self.stop.end_motion();
            }
            Request::Abort | Request::ShutDown => {
                self.cancel.cancel();
                self.stop.stop();
            }
        }
    }

    #[cfg(test)]
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_cancelled()
    }

    #[cfg(test)]
    pub async fn instrument(&mut self) -> Instrument {
        (&mut self.worker).await.unwrap().0
    }
}

/// However the driver ends, a panic included: motors first, and the worker then ends by itself.
impl Drop for Work {
    fn drop(&mut self) {
        self.cancel.cancel();
        if !self.worker.is_finished() {
            self.stop.stop();
        }
    }
}

/// What a run reports to the driver.
pub(super) enum Message {
    Progress(Progress),
    Ended(Result<(Instrument, RunEnd), JoinError>),
    Recovered(Made),
}

/// The worker's next message, its end only after everything before it; or numbers that were made from frames.
pub(super) async fn next_message(run: &mut Option<RunInProgress>) -> Message {
    let Some(RunInProgress { work, numbers, .. }) = run else { return std::future::pending().await };
    let worker = async {
        let Some(work) = work else { return std::future::pending().await };
        tokio::select! {
            biased;
            Some(progress) = work.progress.recv() => Message::Progress(progress),
            ended = &mut work.worker => Message::Ended(ended),
        }
    };
    tokio::select! {
        message = worker => message,
        made = numbers.made() => Message::Recovered(made),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::config::Config;
    use carved_records::{Mode, RunPlan};
    use std::path::Path;

    /// A run of these wells that nobody works on.
    pub fn run(wells: &[&str]) -> RunInProgress {
        let config = Config::parse(include_str!("../../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
        let wells: Vec<_> = wells.iter().map(|well| serde_json::json!({ "well": well })).collect();
        let plan = serde_json::json!({"plate_barcode": "P-1", "method": "standard", "operator": "kim", "plate_map": wells});
        let plan: RunPlan = serde_json::from_value(plan).unwrap();
        RunInProgress::new(RunRecord::new("r1", plan, config.methods["standard"].clone(), Mode::Simulated, None))
    }

    fn failed() -> RunEnd {
        RunEnd::Failed(RunError::SpecimenThread)
    }

    #[test]
    fn an_end_that_was_asked_for_comes_before_what_the_worker_met() {
        use AfterWork::{Abort, End, Fault, Finish, Halted, Rest};
        for request in [Request::Abort, Request::ShutDown] {
            assert!(matches!(after_work(RunEnd::AllWells, request, false), End(None)));
            assert!(matches!(after_work(failed(), request, true), End(Some(_))));
        }
        // A stop comes after the specimen: one that was cut short by an error is held first.
        assert!(matches!(after_work(RunEnd::Paused, Request::Stop, false), End(None)));
        assert!(matches!(after_work(failed(), Request::Stop, false), Fault(_)));
        assert!(matches!(after_work(RunEnd::Cancelled, Request::Stop, true), Halted));
        assert!(matches!(after_work(RunEnd::Paused, Request::Hold, false), Rest));
        assert!(matches!(after_work(RunEnd::AllWells, Request::Hold, false), Finish));
        assert!(matches!(after_work(RunEnd::AllWells, Request::Halt, true), Halted));
        assert!(matches!(after_work(RunEnd::Cancelled, Request::Stop, false), Abort));
        assert!(matches!(after_work(RunEnd::Cancelled, Request::Nothing, false), Abort));
    }

    #[test]
    fn the_highest_request_counts_and_a_halt_is_remembered() {
        let mut r = run(&["A01"]);
        r.ask(Request::Stop);
        r.ask(Request::Hold);
        assert!(r.request() == Request::Stop && !r.halted);
        r.ask(Request::Halt);
        assert!(r.request() == Request::Stop && r.halted);
        assert!(matches!(r.joined(RunEnd::Cancelled), AfterWork::Halted));
    }

    #[test]
    fn a_well_is_left_until_it_has_an_outcome_or_only_lacks_its_numbers() {
        let mut r = run(&["A01", "A02", "A03"]);
        let accepted = VecDeque::from([r.record().plan.plate_map[1].clone()]);
        let left = |r: &RunInProgress| r.wells_left(&accepted).into_iter().map(|w| w.well).collect::<Vec<_>>();
        assert_eq!(left(&r), ["A01", "A03"]);
        assert!(r.give_up("A01", "it is lost") && !r.give_up("A01", "twice"));
        assert_eq!((left(&r), r.next_well()), (vec!["A03".to_owned()], Some("A02")));
        assert_eq!(r.record().wells[0].reason.as_deref(), Some("it is lost"));
    }

    #[test]
    fn a_run_that_ends_early_ends_its_wells_as_it_was_asked_to() {
        for (request, outcome, of_well) in [
            (Request::Abort, RunOutcome::Aborted, SpecimenOutcome::Aborted),
            (Request::Stop, RunOutcome::Partial, SpecimenOutcome::Aborted),
            (Request::ShutDown, RunOutcome::Interrupted, SpecimenOutcome::Interrupted),
        ] {
            let mut r = run(&["A01", "A02"]);
            let mut done = r.record().wells[0].clone();
            done.end(SpecimenOutcome::Succeeded, None);
            r.enter(done);
            r.ask(request);
            let ended = r.ended();
            assert_eq!((ended.outcome, ended.wells[1].outcome), (Some(outcome), Some(of_well)));
            assert_eq!(ended.wells[0].outcome, Some(SpecimenOutcome::Succeeded));
        }
    }

    #[test]
    fn a_larva_without_beads_is_flagged_when_its_result_is_entered() {
        let mut r = run(&["A01"]);
        let mut done = r.record().wells[0].clone();
        done.end(SpecimenOutcome::Succeeded, None);
        assert!(r.enter(done.clone()).flags.is_empty());
        r.set_lacks_gate(true);
        assert_eq!((r.enter(done).flags, r.record().wells[0].flags.len()), (vec!["bead_gate".to_owned()], 1));
    }
}
