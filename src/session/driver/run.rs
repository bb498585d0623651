//! A run from its acceptance to its outcome: its record, its worker, and what follows when the worker ends.
//!
//! ```text
//! launch ──► Work (has the instrument) ──► joined ──► AfterWork: finish, end, rest, fault, halted, abort
//!               ▲
//! ask ── Request: hold < halt < stop < shut-down < abort; the highest one wins
//! ```
//! The state of a run that follows from its events is in [`RunState`](carved_records::RunState).

use super::super::Instrument;
use super::super::gate;
use super::super::halt::Halt;
use super::super::worker::{self, Progress, RunContext, RunEnd, RunError};
use super::recovery::{Made, Numbers};
use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_devices::sampler::LoaderInterlock;
use carved_records::{EndRequest, PlannedWell, RunOutcome, SpecimenOutcome, WellStatus};
use carved_store::RunRecord;
use jiff::Timestamp;
use std::collections::VecDeque;
use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle};

/// A request to pause or end the run, in ascending order of priority. The highest request wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Request {
    Nothing,
    Hold,
    /// A fault interrupts the run.
    Halt,
    Stop,
    ShutDown,
    /// Also while the daemon ends.
    Abort,
}

/// What the driver does after a worker ended.
#[derive(Debug)]
pub(super) enum AfterWork {
    /// All wells are done.
    Finish,
    /// The run ends as requested. Contains the error if the worker failed at the same time.
    End(Option<RunError>),
    /// The run is held by an operator, between two specimens.
    Rest,
    /// The run is held by an error.
    Fault(RunError),
    /// A write failed, and the specimen was interrupted.
    Halted,
    /// An emergency stop cancelled the worker directly, not through the mailbox.
    Abort,
}

/// A run that has no outcome yet.
pub(super) struct RunInProgress {
    record: RunRecord,
    /// `None` while the run is held, or waits for a specimen to be taken out.
    work: Option<Work>,
    numbers: Numbers,
    request: Request,
    /// A fault has cancelled the worker. It stays set when a higher request follows.
    halted: bool,
    /// Every cause of the hold is over. The run continues as soon as the instrument is free.
    may_go_on: bool,
    /// When the held run tries again by itself.
    tries_again_at: Option<Timestamp>,
    /// The run measures larvae without a valid bead gate.
    lacks_gate: bool,
}

impl RunInProgress {
    /// A run without requests.
    pub fn new(record: RunRecord) -> Self {
        Self {
            record,
            work: None,
            numbers: Numbers::default(),
            request: Request::Nothing,
            halted: false,
            may_go_on: false,
            tries_again_at: None,
            lacks_gate: false,
        }
    }

    pub fn record(&self) -> &RunRecord {
        &self.record
    }

    /// The record of a run that is over, or left to the next start.
    pub fn into_record(self) -> RunRecord {
        self.record
    }

    /// Whether a worker uses the instrument.
    pub fn works(&self) -> bool {
        self.work.is_some()
    }

    pub fn request(&self) -> Request {
        self.request
    }

    pub fn may_go_on(&self) -> bool {
        self.may_go_on
    }

    /// Sets whether every cause of the hold is over.
    pub fn set_may_go_on(&mut self, may_go_on: bool) {
        self.may_go_on = may_go_on;
    }

    /// When the held run tries again by itself. `None` where it waits for a person or for the end of a cause.
    pub fn tries_again_at(&self) -> Option<Timestamp> {
        self.tries_again_at
    }

    /// Sets when the held run tries again by itself.
    pub fn set_tries_again_at(&mut self, at: Option<Timestamp>) {
        self.tries_again_at = at;
    }

    /// Sets whether the run measures larvae without a valid bead gate.
    pub fn set_lacks_gate(&mut self, lacks_gate: bool) {
        self.lacks_gate = lacks_gate;
    }

    pub fn numbers(&self) -> &Numbers {
        &self.numbers
    }

    pub fn numbers_mut(&mut self) -> &mut Numbers {
        &mut self.numbers
    }

    /// Ends the work at the present specimen, which somebody has taken out.
    pub fn specimen_out(&self) {
        self.work.iter().for_each(|work| work.specimen_out.cancel());
    }

    /// Notes a request and passes it to the worker. A hold or a stop takes effect after the current specimen, the others at once.
    pub fn ask(&mut self, what: Request) {
        self.request = self.request.max(what);
        self.halted |= what == Request::Halt;
        if let Some(work) = &self.work {
            work.obey(what);
        }
    }

    /// Restores a request that was made before the daemon restarted.
    pub fn recall(&mut self, end: Option<EndRequest>) {
        self.request = match end {
            Some(EndRequest::Abort) => Request::Abort,
            Some(EndRequest::Stop) => Request::Stop,
            Some(EndRequest::Interrupt) => Request::ShutDown,
            None => Request::Nothing,
        };
    }

    /// Stores a new worker, which has the instrument. Requests to the previous worker are cleared.
    pub fn launch(&mut self, work: Work) {
        self.request = Request::Nothing;
        self.halted = false;
        self.tries_again_at = None;
        self.work = Some(work);
    }

    /// The worker ended. Returns what the driver does next.
    pub fn joined(&mut self, end: RunEnd) -> AfterWork {
        self.work = None;
        after_work(end, self.request, self.halted)
    }

    /// The run is held. Clears what waited for the end of the work. It is requested again later.
    pub fn rests(&mut self) {
        self.numbers.forget_continuation();
        self.may_go_on = false;
    }

    /// Wells without outcome, without those of which only the numbers are missing.
    pub fn wells_left(&self, accepted: &VecDeque<PlannedWell>) -> Vec<PlannedWell> {
        let open = self.record.plan.plate_map.iter().zip(&self.record.wells).filter(|(_, w)| w.outcome.is_none());
        let left = open.filter(|(_, w)| accepted.iter().all(|accepted| accepted.well != w.well));
        left.map(|(planned, _)| planned.clone()).collect()
    }

    /// The first well without outcome.
    pub fn next_well(&self) -> Option<&str> {
        self.record.wells.iter().find(|w| w.outcome.is_none()).map(|w| w.well.as_str())
    }

    /// Enters the result of a well. Flags it if the bead gate is missing. Returns the entered result.
    pub fn enter(&mut self, mut result: WellStatus) -> WellStatus {
        gate::flag(&mut result, self.lacks_gate);
        if let Some(slot) = self.record.wells.iter_mut().find(|w| w.well == result.well) {
            // A remark may be older than the numbers.
            result.set_note(slot.note.take());
            slot.clone_from(&result);
        }
        result
    }

    /// Ends a well whose specimen is not measured any more, with the number of its stored views. Returns `false` if the well has an
    /// outcome already.
    pub fn give_up(&mut self, well: &str, outcome: SpecimenOutcome, reason: &str, views: u32) -> bool {
        let slot = self.record.wells.iter_mut().find(|w| w.well == well && w.outcome.is_none());
        slot.map(|slot| slot.end_early(outcome, reason, views)).is_some()
    }

    /// Changes a well of the record at a person's word. `None` if the run has no such well.
    pub fn change<T>(&mut self, well: &str, change: impl FnOnce(&mut WellStatus) -> T) -> Option<T> {
        self.record.wells.iter_mut().find(|w| w.well == well).map(change)
    }

    /// Takes back a change of the record that the disk has refused.
    pub fn restore(&mut self, before: RunRecord) {
        self.record = before;
    }

    /// The record of the run after its last well.
    pub fn finished(&self) -> RunRecord {
        let mut record = self.record.clone();
        record.end(RunOutcome::of_wells(&record.wells));
        record
    }

    /// The record of a run that ends before its last well, as requested. `views`: the number of stored views of a well.
    pub fn ended(&self, views: impl Fn(&str) -> u32) -> RunRecord {
        let mut record = self.record.clone();
        let (left, reason) = match self.request {
            Request::Abort => (SpecimenOutcome::Aborted, "the run was aborted"),
            Request::Stop => (SpecimenOutcome::Aborted, "the run was stopped before this well"),
            _ => (SpecimenOutcome::Interrupted, "the daemon was stopped"),
        };
        for well in record.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end_early(left, reason, views(&well.well));
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
    // A requested end comes first, even if the last well was finished at the same moment.
    let at_once = matches!(request, Request::Abort | Request::ShutDown);
    let over = at_once || request == Request::Stop && matches!(end, RunEnd::AllWells | RunEnd::Paused);
    match end {
        RunEnd::Failed(error) if over => AfterWork::End(Some(error)),
        _ if over => AfterWork::End(None),
        RunEnd::AllWells if request != Request::Halt => AfterWork::Finish,
        RunEnd::Failed(error) => AfterWork::Fault(error),
        RunEnd::Paused if request == Request::Hold => AfterWork::Rest,
        // A stop after the specimen is also possible here. It follows once the run is held.
        _ if request == Request::Halt || request == Request::Stop && halted => AfterWork::Halted,
        _ => AfterWork::Abort,
    }
}

/// The worker of a run, and the handles that control it.
pub(super) struct Work {
    cancel: CancelToken,
    pause: CancelToken,
    specimen_out: CancelToken,
    stop: StopHandle,
    interlock: LoaderInterlock,
    worker: JoinHandle<(Instrument, RunEnd)>,
    progress: mpsc::Receiver<Progress>,
}

impl Work {
    /// Starts the worker on its own thread. `context` receives the token that cancels the worker, the one that pauses it, the one that ends
    /// the work at its specimen, and the progress channel.
    pub fn begin(
        instrument: Instrument,
        interlock: LoaderInterlock,
        halt: &Halt,
        context: impl FnOnce([CancelToken; 3], mpsc::Sender<Progress>) -> RunContext,
    ) -> Self {
        let (cancel, pause) = (CancelToken::default(), CancelToken::default());
        let specimen_out = cancel.child();
        let stop = instrument.rig.rotation.stop_handle();
        halt.aim(stop.clone(), cancel.clone());
        let (progress_in, progress) = mpsc::channel(64);
        let context = context([cancel.clone(), pause.clone(), specimen_out.clone()], progress_in);
        let worker = tokio::task::spawn_blocking(move || worker::run(instrument, &context));
        Self { cancel, pause, specimen_out, stop, interlock, worker, progress }
    }

    fn obey(&self, request: Request) {
        match request {
            Request::Nothing => {}
            Request::Hold | Request::Stop => {
                self.pause.cancel();
                self.interlock.give_up();
            }
            // Stop the motors first. The worker then ends by itself.
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
    pub fn is_specimen_out(&self) -> bool {
        self.specimen_out.is_cancelled()
    }

    #[cfg(test)]
    pub async fn instrument(&mut self) -> Instrument {
        (&mut self.worker).await.unwrap().0
    }
}

/// Stops the motors when the driver ends, also by a panic. The worker then ends by itself.
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

/// The next message of the worker, or numbers that were computed from frames. The end of the worker comes after all its progress.
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
    use carved_core::flag::Flag;
    use carved_records::{Mode, RunPlan};
    use std::path::Path;

    /// A run of these wells without a worker.
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
        // A stop waits for the end of the specimen. If an error interrupts the specimen, the run is held first.
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
        let outcome = SpecimenOutcome::Interrupted;
        assert!(r.give_up("A01", outcome, "it is lost", 13) && !r.give_up("A01", outcome, "twice", 0));
        assert_eq!((left(&r), r.next_well()), (vec!["A03".to_owned()], Some("A02")));
        let given_up = &r.record().wells[0];
        assert_eq!((given_up.reason.as_deref(), given_up.views), (Some("it is lost"), Some(13)));
    }

    #[test]
    fn a_run_that_ends_early_ends_its_wells_as_it_was_asked_to() {
        for (request, outcome, of_well) in [
            (Request::Abort, RunOutcome::Aborted, SpecimenOutcome::Aborted),
            (Request::Stop, RunOutcome::Partial, SpecimenOutcome::Aborted),
            (Request::ShutDown, RunOutcome::Interrupted, SpecimenOutcome::Interrupted),
        ] {
            let mut r = run(&["A01", "A02", "A03"]);
            let mut done = r.record().wells[0].clone();
            done.end(SpecimenOutcome::Succeeded, None);
            r.enter(done);
            r.ask(request);
            let ended = r.ended(|well| if well == "A02" { 8 } else { 0 });
            assert_eq!((ended.outcome, ended.wells[1].outcome), (Some(outcome), Some(of_well)));
            assert_eq!(ended.wells.iter().map(|w| w.views).collect::<Vec<_>>(), [None, Some(8), Some(0)]);
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
        assert_eq!((r.enter(done).flags, r.record().wells[0].flags.len()), (vec![Flag::BeadGate.into()], 1));
    }
}
