//! The turn of one specimen on the rig thread: the views, the verdict on them, and the retakes.
//!
//! ```text
//! revolve ──> verdict ──┬─ a few views do not fit ──> retaken at their stops ─> verdict
//!                       ├─ the specimen has moved ──> another attempt, from the reference
//!                       └─ otherwise ───────────────> accepted: it may leave, its numbers are computed meanwhile
//! ```

use super::retry::retaken_most;
use super::science::{NoVerdict, Science};
use super::specimen::{Ended, Work};
use super::watch::within;
use super::{RunError, WellEnd, Worker};
use crate::session::Instrument;
use carved_core::frame::RawFrame;
use carved_core::pipeline::{Pipeline, TurnVerdict};
use carved_devices::acquisition::{self, AcquisitionError, Next, RevolutionPlan, SinkClosed};
use carved_records::{LedgerEntry, Phase, PlannedWell, WellTimes};
use carved_store::{RecordingWriter, StoreError};
use std::time::{Duration, Instant};

/// How an attempt at a specimen ended.
pub enum Attempt {
    /// Its numbers are being computed.
    Accepted(Box<Science>),
    Ended(WellEnd),
    /// Another attempt may succeed. Contains the reason.
    Again(String),
    Cancelled,
}

impl Worker {
    /// Takes a specimen through its turn. On the `last` attempt it is measured even if it has moved.
    pub fn turn(
        &mut self,
        planned: &PlannedWell,
        pipeline: Pipeline,
        mut writer: RecordingWriter,
        times: &mut WellTimes,
        last: bool,
    ) -> Result<Attempt, RunError> {
        let plan = match self.context.plan(planned) {
            Ok(plan) => plan,
            Err(e) => {
                writer.close()?;
                return Err(e);
            }
        };
        writer.add_references(&self.context.config.references)?;
        let science = Science::start(&self.context, planned, pipeline, writer)?;
        match self.verdict(planned, &plan, &science, times, last) {
            Ok(_) if self.context.specimen_out.is_cancelled() => {
                science.close()?;
                Ok(Attempt::Cancelled)
            }
            Ok(None) => {
                self.context.phase(&planned.well, Phase::Measure, true);
                match science.accept() {
                    Ok(()) => Ok(Attempt::Accepted(Box::new(science))),
                    Err(SinkClosed) => ended(science),
                }
            }
            Ok(Some(why)) => {
                science.close()?;
                Ok(Attempt::Again(why))
            }
            // The thread's result says why it no longer receives views.
            Err(RunError::Acquisition(AcquisitionError::SinkClosed { .. })) => ended(science),
            // The thread is still busy with the overrun step. It is detached.
            Err(RunError::Overrun(e)) if e.phase == Phase::Reconstruct => Err(e.into()),
            Err(e) => {
                let closed = science.close();
                // The thread may still write, so there must not be another attempt at this well.
                if let Err(hangs @ RunError::Store(StoreError::Unclosed { .. })) = closed {
                    return Err(hangs);
                }
                if self.context.cancel.is_cancelled() {
                    return Ok(Attempt::Cancelled);
                }
                if let Err(error) = closed {
                    tracing::error!(%error, well = %planned.well, "the record of a turn that failed is not closed");
                }
                Err(e)
            }
        }
    }

    /// Takes the views and their verdict. Returns why the specimen needs another attempt, or `None`.
    fn verdict(
        &mut self,
        planned: &PlannedWell,
        plan: &RevolutionPlan,
        science: &Science,
        times: &mut WellTimes,
        last: bool,
    ) -> Result<Option<String>, RunError> {
        self.take(planned, plan, science, times, None)?;
        let mut verdict = self.judged(planned, science, times)?;
        if verdict.moved && !last {
            return Ok(Some("the specimen was not where it began when its turn was over".into()));
        }
        let can = self.instrument.rig.rotation.capabilities();
        // The stops of the axis have another zero than the angles of a sweep.
        let can_go_back = !can.trigger_only && !can.outside && self.context.sweep(planned)?.is_none();
        let few = (1..=retaken_most(plan.asd())).contains(&verdict.spoiled.len());
        if can_go_back && !verdict.moved && few {
            tracing::info!(well = %planned.well, views = ?verdict.spoiled, "views that do not belong are taken again");
            // The view at 360 deg comes last. It shows whether the specimen is still in place.
            let again: Vec<u32> = verdict.spoiled.iter().map(|spoiled| spoiled.view).chain([plan.asd()]).collect();
            self.take(planned, plan, science, times, Some(&again))?;
            verdict = self.judged(planned, science, times)?;
        }
        for spoiled in &verdict.spoiled {
            tracing::warn!(well = %planned.well, view = spoiled.view, why = spoiled.reason, "a view spoils the model");
        }
        Ok(None)
    }

    fn judged(&self, planned: &PlannedWell, science: &Science, times: &mut WellTimes) -> Result<TurnVerdict, RunError> {
        self.context.phase(&planned.well, Phase::Reconstruct, true);
        let began = Instant::now();
        let verdict = science.verdict(self.context.allowed(Phase::Reconstruct), &self.context.cancel);
        times.phase(Phase::Reconstruct, began.elapsed());
        verdict.map_err(|none| match none {
            NoVerdict::Overrun(overrun) => overrun.into(),
            NoVerdict::Cancelled => AcquisitionError::Cancelled { view: self.context.method.asd }.into(),
            NoVerdict::Ended => AcquisitionError::SinkClosed { view: self.context.method.asd }.into(),
        })
    }

    /// Takes all views of the turn, or only those in `again`, and sends them to the specimen thread.
    fn take(
        &mut self,
        planned: &PlannedWell,
        plan: &RevolutionPlan,
        science: &Science,
        times: &mut WellTimes,
        again: Option<&[u32]>,
    ) -> Result<(), RunError> {
        self.context.phase(&planned.well, Phase::Revolve, true);
        let sweep = self.context.sweep(planned)?;
        if let Some(sweep) = &sweep {
            let rig = &mut self.instrument.rig;
            sweep.check(rig.rotation.as_ref(), rig.camera.as_mut())?;
        }
        let Self { context, instrument: Instrument { rig, second, .. } } = self;
        let settings = &context.config.acquisition;
        let stop = rig.rotation.stop_handle();
        let began = Instant::now();
        // An axis that follows a position list, or that another program turns, completes its turn.
        let can = rig.rotation.capabilities();
        let may_end_early = !can.trigger_only && !can.outside;
        let mut second_failed = None;
        let taken = within(Phase::Revolve, context.allowed(Phase::Revolve), &context.cancel, &stop, |cancel| {
            let mut hand_on = |mut entry: LedgerEntry, frame: RawFrame| {
                // At a stop the axis stands still until this returns. A sweep has no second camera.
                let second = second.as_deref_mut().map(|camera| acquisition::grab_second(camera, context.deadline(), cancel));
                let second = second.transpose().map_err(|e| {
                    second_failed = Some(e);
                    SinkClosed
                })?;
                let second = second.map(|(seen, frame)| {
                    entry.second = Some(seen);
                    frame
                });
                times.device(device_time(&entry));
                science.send(Work::View { entry, frame, second })
            };
            match (again, &sweep) {
                (None, Some(sweep)) => acquisition::sweep(rig, sweep, settings, cancel, hand_on).map(drop),
                (None, None) => acquisition::revolve(rig, plan, settings, cancel, |entry, frame| {
                    hand_on(entry, frame)?;
                    Ok(if may_end_early && science.has_enough() { Next::Closure } else { Next::View })
                })
                .map(drop),
                (Some(views), _) => acquisition::retake(rig, plan, settings, cancel, views, hand_on),
            }
            .map_err(RunError::from)
        });
        times.phase(Phase::Revolve, began.elapsed());
        if let Some(e) = second_failed {
            return Err(RunError::Second(e));
        }
        taken?;
        // Features that are not compared with every frame may have been changed between two.
        rig.camera.check_features()?;
        second.as_mut().map_or(Ok(()), |camera| camera.check_features()).map_err(RunError::Second)
    }
}

/// Time of motors, settling and exposures in a view.
fn device_time(entry: &LedgerEntry) -> Duration {
    let second_ms = entry.second.as_ref().map_or(0.0, |second| second.grab_ms);
    Duration::from_secs_f64((entry.moved_ms + entry.settle_ms + entry.grab_ms + second_ms) / 1e3)
}

/// The outcome of a specimen thread that ended by itself.
fn ended(science: Science) -> Result<Attempt, RunError> {
    match science.close()? {
        Ended::Failed(why) => Ok(Attempt::Ended(WellEnd::Failed(why))),
        Ended::Told | Ended::Dropped => Err(RunError::SpecimenThread),
    }
}
