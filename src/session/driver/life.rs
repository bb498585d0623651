//! The life of a run: begun, held and let go on, stopped, aborted; how it comes to rest and ends is in `ends`.
//!
//! ```text
//! start ──► launch ──► worker ──► worker_ended ─┬─ all wells ──► finish ──► Complete
//!             ▲                                 ├─ paused, failed ──► rest ──► Held ──┐
//!             │                                 └─ stop, abort, shut-down ──► end_run │
//!             └──────────── unhold (operator, or by itself) ◄─────────────────────────┘
//! ```

use super::super::state::Trigger;
use super::super::worker::{self, Instrument, RunContext, RunEnd};
use super::super::{Plate, Refusal, State, Status, gate};
use super::Running;
use super::active::{Active, Request, Work};
use super::ends::Fate;
use super::publish::run_status;
use carved_devices::cancel::CancelToken;
use carved_records::{EndRequest, EventData, LoadedBy, Method, ResumedBy, RunAccepted, RunInterrupted, RunPlan, RunResumed, RunState};
use carved_store::{RunRecord, StoreError};
use tokio::sync::mpsc;

impl Running {
    /// Journals the run, then lets the worker go.
    pub(super) fn start(&mut self, id: &str, plan: RunPlan, method: Method) -> Result<(), StoreError> {
        let calibration = self.calibration();
        let record = RunRecord {
            calibration: calibration.clone(),
            ..RunRecord::new(id, plan, method, self.mode, self.config.empty_capillary.as_deref())
        };
        // What is left in the capillary here is taken out by a driven sampler before the first well.
        let left = self.capillary().inside().map(str::to_owned);
        let accepted = EventData::RunAccepted(RunAccepted {
            plate_barcode: record.plan.plate_barcode.clone(),
            method: record.plan.method.clone(),
            left_in_capillary: left.clone(),
        });
        // What waits for the disk comes first.
        self.flush()?;
        if let Err(refused) = self.store.save_run(&record).and_then(|()| self.promise_of(Some(id), None, accepted)) {
            // Not accepted: the same request must not read as known when it comes again.
            if let Err(error) = self.store.forget_run(id) {
                tracing::error!(%error, "a run that was refused is still on disk");
            }
            return Err(refused);
        }
        let status = run_status(&record);
        let barcode = record.plan.plate_barcode.clone();
        self.unasked = false;
        self.instrument.iter_mut().for_each(|instrument| instrument.sampler.begin_run());
        self.active = Some(Active { eject_first: left, ..Active::new(record) });
        self.launch();
        self.go_with(Trigger::Start, |s| {
            s.calibration = calibration;
            s.run = Some(status);
            s.specimen = None;
            s.plate = Plate { barcode: Some(barcode), present: true, ..Plate::default() };
        });
        Ok(())
    }

    /// Gives the instrument to a worker for the wells that are left.
    fn launch(&mut self) {
        let lacks_gate = self.lacks_gate();
        let accepted = self.accepted();
        // A loader's is told through the gate.
        let inside = self.capillary().brought().filter(|_| !self.loaded_from_outside).map(str::to_owned);
        let (Some(active), Some(instrument)) = (&mut self.active, self.instrument.take()) else {
            tracing::error!("there is no run, or no instrument for it");
            return;
        };
        self.gate.clear();
        let record = &active.record;
        let is_left = |well: &str| accepted.iter().all(|accepted| accepted.well != well);
        let wells = record.plan.plate_map.iter().zip(&record.wells).filter(|(_, w)| w.outcome.is_none() && is_left(&w.well));
        let (cancel, pause) = (CancelToken::default(), CancelToken::default());
        let stop = instrument.rig.rotation.stop_handle();
        self.publisher.halt().aim(stop.clone(), cancel.clone());
        let (progress_in, progress) = mpsc::channel(64);
        let context = RunContext {
            config: self.config.clone(),
            mode: self.mode,
            run: record.id.clone(),
            wells: wells.map(|(planned, _)| planned.clone()).collect(),
            eject_first: active.eject_first.take(),
            inside,
            method_name: record.plan.method.clone(),
            method: record.method.clone(),
            folder: self.store.run_folder(&record.id),
            cancel: cancel.clone(),
            pause: pause.clone(),
            progress: progress_in,
        };
        let worker = tokio::task::spawn_blocking(move || worker::run(instrument, &context));
        active.request = Request::Nothing;
        active.halted = false;
        active.lacks_gate = lacks_gate;
        active.work = Some(Work { cancel, pause, stop, worker, progress });
    }

    /// Whether the run's larvae are measured without a bead gate that stands.
    pub(super) fn lacks_gate(&self) -> bool {
        let newest = self.calibration().and_then(|c| c.gate);
        self.active.as_ref().is_some_and(|active| gate::lacking(newest.as_ref(), &active.record.method, self.mode).is_some())
    }

    /// Notes how the run is to end, and tells the worker: after its specimen, or at once.
    pub(super) fn ask(&mut self, what: Request) {
        let Some(active) = &mut self.active else { return };
        active.request = active.request.max(what);
        active.halted |= what == Request::Halt;
        let Some(work) = &active.work else { return };
        match what {
            Request::Nothing => {}
            Request::Hold | Request::Stop => {
                work.pause.cancel();
                self.gate.give_up();
            }
            // Motors first; the worker then ends by itself.
            Request::Halt => {
                work.cancel.cancel();
                work.stop.end_motion();
            }
            Request::Abort | Request::ShutDown => {
                work.cancel.cancel();
                work.stop.stop();
            }
        }
    }

    /// An operator's hold, which outlasts what else holds the run.
    pub(super) fn hold(&mut self, state: State) -> Result<(), Refusal> {
        if self.is_held_by_operator() {
            return Ok(());
        }
        self.promise(None, EventData::RunHoldRequested)?;
        if matches!(state, State::Holding | State::Held) {
            self.publish(|_| ());
            return Ok(());
        }
        self.ask(Request::Hold);
        self.go(Trigger::Hold);
        if self.active.as_ref().is_some_and(|a| a.work.is_none()) {
            self.rest(false);
        }
        Ok(())
    }

    pub(super) fn stop(&mut self) -> Result<(), Refusal> {
        self.promise(None, EventData::RunStopRequested)?;
        self.ask(Request::Stop);
        self.go(Trigger::Stop);
        if self.active.as_ref().is_some_and(|a| a.work.is_none()) {
            self.end_run();
        }
        Ok(())
    }

    /// Whatever the disk says: it is told as soon as it can be.
    pub(super) fn abort(&mut self) {
        self.ask(Request::Abort);
        self.go(Trigger::Abort);
        self.event(None, EventData::RunAbortRequested);
        if self.active.as_ref().is_some_and(|a| a.work.is_none()) {
            self.end_run();
        }
    }

    /// Lets a held run go on, once what held it is over.
    pub(super) fn unhold(&mut self, by: ResumedBy) -> Result<(), Refusal> {
        self.nothing_stands_in_the_way()?;
        let Some(active) = &self.active else { return Ok(()) };
        if self.instrument.is_none() {
            return Err(Refusal::Busy);
        }
        let record = active.record.clone();
        self.flush()?;
        self.store.save_run(&record)?;
        self.promise(None, EventData::RunResumed(RunResumed { by }))?;
        let status = run_status(&record);
        if let Some(active) = &mut self.active {
            active.may_go_on = false;
        }
        self.go_with(Trigger::Unhold, |s| s.run = Some(status));
        self.proceed();
        Ok(())
    }

    /// On from Unholding: to the loader, to the next well, or to the end.
    pub(super) fn proceed(&mut self) {
        self.recover();
        let accepted = self.accepted();
        let Some(active) = &self.active else { return };
        let has_its_frames = |well: &str| accepted.iter().any(|accepted| accepted.well == well);
        let nothing_to_do = active.record.wells.iter().all(|w| w.outcome.is_some() || has_its_frames(&w.well));
        if active.take_out.is_some() {
            self.go(Trigger::WaitForLoader);
        } else if self.instrument.is_none() {
            // A device went away while the loader was waited for; who finds it again lets the run go on.
            self.rest(true);
        } else if nothing_to_do && active.eject_first.is_none() {
            self.finish();
        } else {
            self.launch();
        }
    }

    /// What held the run is over: it goes on by itself where its method says so and no operator holds it.
    pub(super) fn resume_by_itself(&mut self) {
        let may_go_on = self.resumes_by_itself();
        self.active.iter_mut().for_each(|active| active.may_go_on = may_go_on);
        self.go_on_if_it_may();
    }

    /// At once, or when the background task that has the instrument is done.
    pub(super) fn go_on_if_it_may(&mut self) {
        let may = self.active.as_ref().is_some_and(|a| a.may_go_on) && !self.is_held_by_operator();
        if !may || self.publisher.status().state != State::Held {
            return;
        }
        match self.unhold(ResumedBy::Instrument) {
            // Who has the instrument gives it back; a disk that did not take it is asked again.
            Ok(()) | Err(Refusal::Busy | Refusal::Store { .. }) => {}
            Err(refusal) => {
                tracing::warn!(%refusal, "the run stays held");
                self.active.iter_mut().for_each(|active| active.may_go_on = false);
                self.publish(|_| ());
            }
        }
    }

    pub(super) fn worker_ended(&mut self, (instrument, end): (Instrument, RunEnd)) {
        self.instrument = Some(instrument);
        let Some(active) = &mut self.active else { return };
        active.work = None;
        active.waiting_for = None;
        let (asked, halted) = (active.request, active.halted);
        // Whoever cut it short was told so, also where the last well was done in the same moment.
        let at_once = matches!(asked, Request::Abort | Request::ShutDown);
        let over = at_once || asked == Request::Stop && matches!(end, RunEnd::AllWells | RunEnd::Paused);
        match end {
            _ if over => {
                if let RunEnd::Failed(error) = end {
                    tracing::error!(%error, ?asked, "the run failed while it was being ended");
                }
                self.end_run();
            }
            RunEnd::AllWells if asked != Request::Halt => self.finish(),
            RunEnd::Failed(error) => {
                let fate = match worker::keeps_specimen(&error) {
                    false => Fate::PoseLost,
                    // A stock VAST takes no specimen up twice.
                    true if self.steps_through_a_list() => Fate::BroughtAgain,
                    true => Fate::Stays,
                };
                self.fault(&error);
                self.interrupt_specimen(&error.to_string(), fate);
                self.rest(true);
            }
            RunEnd::Paused if asked == Request::Hold => {
                self.rest(false);
            }
            // Also where it was to stop after its specimen: `rest` then ends it.
            RunEnd::AllWells | RunEnd::Paused | RunEnd::Cancelled if asked == Request::Halt || asked == Request::Stop && halted => {
                self.interrupt_specimen("the run could not be stored", Fate::PoseLost);
                self.rest(true);
            }
            // Nobody asked the driver: the emergency stop has cancelled it, past the mailbox.
            RunEnd::AllWells | RunEnd::Paused | RunEnd::Cancelled => self.abort(),
        }
    }

    fn steps_through_a_list(&self) -> bool {
        self.instrument.as_ref().is_some_and(|instrument| instrument.rig.rotation.capabilities().trigger_only)
    }

    /// Takes up a run that an earlier life of the daemon left open.
    pub(super) fn take_up(&mut self, record: RunRecord, run: RunState) {
        let asd = record.method.asd;
        let (status, barcode) = (run_status(&record), record.plan.plate_barcode.clone());
        let end_request = run.end_request();
        self.outbox.recall(run);
        self.active = Some(Active::new(record));
        let loaded_by = if self.loaded_from_outside { LoadedBy::Loader } else { LoadedBy::Sampler };
        self.event(None, EventData::RunInterrupted(RunInterrupted { found: "at start".into(), loaded_by: Some(loaded_by) }));
        let may_go_on = end_request.is_none() && self.resumes_by_itself();
        // What is there for the run to go on with stays.
        let to_be_taken_out = self.capillary().inside().filter(|inside| self.capillary().brought() != Some(inside)).map(str::to_owned);
        if let Some(active) = &mut self.active {
            // Known before it is shown: who reads in between is not to take the run for one that waits for somebody.
            active.request = match end_request {
                Some(EndRequest::Abort) => Request::Abort,
                Some(EndRequest::Stop) => Request::Stop,
                None => Request::Nothing,
            };
            active.may_go_on = may_go_on;
            *(if self.loaded_from_outside { &mut active.take_out } else { &mut active.eject_first }) = to_be_taken_out;
        }
        let left = self.left_specimen(asd);
        self.go_with(Trigger::TakeUp, |s: &mut Status| {
            s.run = Some(status);
            s.specimen = left;
            s.plate.barcode = Some(barcode);
            s.plate.present = true;
        });
        self.interrupt_specimen("the daemon ended before this specimen was done", Fate::PoseLost);
        if let Some(active) = &self.active {
            // What is given up stays so, whatever comes before the run goes on.
            let (record, status) = (active.record.clone(), run_status(&active.record));
            self.save(record);
            self.publish(|s| s.run = Some(status));
        }
        self.recover();
        match end_request {
            Some(end) => {
                self.go(if end == EndRequest::Stop { Trigger::Stop } else { Trigger::Abort });
                self.end_run();
            }
            None => self.resume_by_itself(),
        }
    }
}
