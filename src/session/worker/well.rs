//! One well from load to wash, on the rig thread.
//!
//! ```text
//! load ─> position ─> detect ─> turn ─────────────────────> eject ─> wash ─> next well
//!   │        ^           │        │ retried, by policy        │
//!   │        └───────────┴────────┘                           └── its numbers are computed meanwhile
//!   └── the numbers of the previous well are computed until here
//! ```

use super::clock::of_device;
use super::science::Science;
use super::specimen::Work;
use super::turn::Attempt;
use super::watch::within;
use super::{OpticsFault, Progress, RunError, WellEnd, Worker, optics_fault, retry, skip};
use crate::session::{Instrument, Live, live, placing};
use carved_core::frame::RawFrame;
use carved_core::pipeline::{Pipeline, PipelineError, SegmentedFrame};
use carved_devices::DeviceError;
use carved_devices::acquisition;
use carved_devices::outputs;
use carved_devices::sampler::Loaded;
use carved_records::{Light, Phase, PlannedWell, SpecimenOutcome, WellStatus, WellTimes};
use carved_store::{RecordingWriter, set_aside};
use std::ops::ControlFlow;
use std::time::Instant;

/// Maximum number of moves that bring a specimen into view. After them it is measured as it lies.
const PLACINGS: u32 = 2;
/// Reasons to skip a well that leave the capillary without a specimen.
const WITHOUT_SPECIMEN: [&str; 3] = ["empty", "bubble", "debris"];

/// The verdict on a well from its detection frame.
enum Judged {
    Worth,
    Not(WellEnd),
    Cancelled,
}

impl Worker {
    /// Runs one well. Breaks if the run was cancelled or paused in it. `before`: the computation of the previous well, which is awaited
    /// once the specimen is loaded. On return it is the computation of this well.
    pub fn well(&mut self, planned: &PlannedWell, before: &mut Option<Science>) -> Result<ControlFlow<()>, RunError> {
        let began = Instant::now();
        let mut times = WellTimes::default();
        self.context.check_measurable(planned)?;
        let Some(Loaded { truth }) = self.load(planned, &mut times)? else { return Ok(ControlFlow::Break(())) };
        // At most one computation runs beside the next specimen.
        let settled = self.context.settle(before);
        let is_out = self.context.specimen_out.is_cancelled();
        let end = settled.and_then(|()| if is_out { Ok(Attempt::Cancelled) } else { self.tries(planned, truth.as_ref(), &mut times) });
        let end = match end {
            Ok(Attempt::Accepted(science)) => {
                let out = self.take_out(planned, true, &mut times);
                if out.is_ok() {
                    let seconds = began.elapsed().as_secs_f64();
                    // If the thread has ended, `settle` reports its result.
                    let _gone = science.send(Work::Out { times, seconds });
                }
                *before = Some(*science);
                self.context.hardware(&mut self.instrument);
                return out.map(ControlFlow::Continue);
            }
            Ok(Attempt::Ended(end)) => end,
            // `Again` is only returned if another attempt follows.
            Ok(Attempt::Cancelled | Attempt::Again(_)) => return self.cut_short(planned, &mut times).map(|()| ControlFlow::Break(())),
            Err(e) if retry::keeps_specimen(&e) => {
                // Where another program stores pictures, nothing of this rig holds a specimen.
                let is_outside = self.instrument.rig.rotation.capabilities().outside;
                let kept = if is_outside { "the pictures of this well are read again" } else { "the specimen stays in the capillary" };
                tracing::warn!(well = %planned.well, error = %e, "{kept}");
                return Err(e);
            }
            Err(e) => {
                if let Err(error) = self.cut_short(planned, &mut times) {
                    tracing::error!(%error, well = %planned.well, "the specimen of a well that failed is not ejected");
                }
                return Err(e);
            }
        };
        let mut result = WellStatus::pending(planned);
        let has_specimen = match &end {
            WellEnd::Skipped(reason) => {
                result.end(SpecimenOutcome::Skipped, Some(reason));
                !WITHOUT_SPECIMEN.contains(reason)
            }
            WellEnd::Failed(reason) => {
                result.end(SpecimenOutcome::Failed, Some(reason));
                true
            }
        };
        let out = self.take_out(planned, has_specimen, &mut times);
        self.context.hardware(&mut self.instrument);
        // The result is valid even if the specimen could not be taken out. The well is not begun again.
        self.context.report(Progress::WellDone { result, seconds: began.elapsed().as_secs_f64(), times });
        out.map(ControlFlow::Continue)
    }

    /// Loads the specimen. Returns what is known of it, or `None` if the run was cancelled or paused first, or somebody has taken the
    /// specimen out.
    fn load(&mut self, planned: &PlannedWell, times: &mut WellTimes) -> Result<Option<Loaded>, RunError> {
        let Self { context, instrument: Instrument { rig, sampler, .. } } = self;
        let well = planned.well.as_str();
        context.phase(well, Phase::Load, false);
        let list = if rig.rotation.capabilities().trigger_only { Some(context.plan(planned)?.targets()) } else { None };
        let expected = context.expected(planned);
        let is_inside = context.inside.as_deref() == Some(well);
        let stop = rig.rotation.stop_handle();
        let began = Instant::now();
        let loaded = within(Phase::Load, context.allowed(Phase::Load), &context.specimen_out, &stop, |cancel| {
            let axis = rig.rotation.as_mut();
            if let Some(stops) = &list {
                // Before the specimen is requested: the axis reads its list when it takes up the specimen.
                axis.announce(stops)?;
            }
            if sampler.waits_for_loader() {
                context.report(Progress::WaitingForLoader { well: well.to_owned() });
            }
            let there = if is_inside { sampler.go_on(axis, expected, cancel) } else { sampler.load(axis, expected, cancel) };
            there.map_err(RunError::from)
        });
        times.phase(Phase::Load, began.elapsed());
        match loaded {
            // The end of a load because its specimen is out is no fault.
            Err(RunError::Device(DeviceError::Stopped)) if context.specimen_out.is_cancelled() => Ok(None),
            loaded => loaded,
        }
    }

    /// Tries a specimen in the capillary as often as the policy allows.
    fn tries(&mut self, planned: &PlannedWell, truth: Option<&serde_json::Value>, times: &mut WellTimes) -> Result<Attempt, RunError> {
        // An axis that follows a position list cannot take up a specimen twice.
        let once = self.instrument.rig.rotation.capabilities().trigger_only;
        let retries = if once { 0 } else { self.context.method.policy.retries };
        loop {
            times.attempts += 1;
            let last = times.attempts > retries;
            let why = match self.attempt(planned, truth, times, last) {
                Ok(Attempt::Again(why)) => why,
                Err(e) if !last && !self.context.cancel.is_cancelled() && retry::may_be_tried_again(&e) => e.to_string(),
                Err(e) if !self.context.cancel.is_cancelled() && retry::costs_its_well_only(&e) => {
                    return Ok(Attempt::Ended(WellEnd::Failed(e.to_string())));
                }
                done => return done,
            };
            tracing::warn!(well = %planned.well, attempt = times.attempts, why, "the specimen is tried again");
            self.context.report(Progress::TriedAgain { well: planned.well.clone(), attempt: times.attempts, why });
        }
    }

    fn attempt(
        &mut self,
        planned: &PlannedWell,
        truth: Option<&serde_json::Value>,
        times: &mut WellTimes,
        last: bool,
    ) -> Result<Attempt, RunError> {
        self.position(planned, times)?;
        let ended = self.light_up(times).and_then(|()| self.pictures(planned, truth, times, last));
        self.light_down();
        ended
    }

    /// Switches on the outputs that the pictures need. This comes after the reference, which may reset the controller.
    fn light_up(&mut self, times: &mut WellTimes) -> Result<(), RunError> {
        let Self { context, instrument } = self;
        of_device(times, || outputs::views_on(instrument.rig.rotation.as_mut(), &context.cancel))?;
        if instrument.rig.rotation.outputs().is_some() {
            context.hardware(instrument);
        }
        Ok(())
    }

    /// Switches the outputs off on every way out of an attempt. A failure does not fail the well: the status shows it, and it is tried
    /// again between runs.
    fn light_down(&mut self) {
        outputs::views_off(self.instrument.rig.rotation.as_mut());
        if !self.context.config.rotation.outputs().is_empty() {
            self.context.hardware(&mut self.instrument);
        }
    }

    /// Detection and turn.
    fn pictures(
        &mut self,
        planned: &PlannedWell,
        truth: Option<&serde_json::Value>,
        times: &mut WellTimes,
        last: bool,
    ) -> Result<Attempt, RunError> {
        let pipeline = self.context.pipeline(planned)?;
        set_aside(&self.context.folder, &planned.well)?;
        let folder = self.context.folder.join(&planned.well);
        let recording = self.context.recording(planned, &self.instrument);
        let mut writer = RecordingWriter::create(&folder, recording, self.context.config.empty_capillary.as_deref())?;
        let ended = match self.detect(planned, &pipeline, &mut writer, truth, times) {
            Ok(Judged::Worth) => return self.turn(planned, pipeline, writer, times, last),
            Ok(Judged::Not(end)) => Ok(Attempt::Ended(end)),
            Ok(Judged::Cancelled) => Ok(Attempt::Cancelled),
            Err(e) => Err(e),
        };
        // Close the recording on every way out. If a fault came first, report that fault.
        let closed = writer.close();
        let ended = ended?;
        closed?;
        Ok(ended)
    }

    fn position(&mut self, planned: &PlannedWell, times: &mut WellTimes) -> Result<(), RunError> {
        let Self { context, instrument: Instrument { rig, .. } } = self;
        context.phase(&planned.well, Phase::Position, true);
        let stop = rig.rotation.stop_handle();
        let began = Instant::now();
        let placed = within(Phase::Position, context.allowed(Phase::Position), &context.cancel, &stop, |cancel| {
            rig.rotation.reference(cancel)?;
            if let Some(translation) = &context.config.translation {
                placing::place(rig, translation.position_um, cancel)?;
            }
            Ok::<_, RunError>(())
        });
        times.device(began.elapsed());
        times.phase(Phase::Position, began.elapsed());
        placed?;
        self.context.hardware(&mut self.instrument);
        Ok(())
    }

    /// Detects what is in the capillary, and brings it into view.
    fn detect(
        &mut self,
        planned: &PlannedWell,
        pipeline: &Pipeline,
        writer: &mut RecordingWriter,
        truth: Option<&serde_json::Value>,
        times: &mut WellTimes,
    ) -> Result<Judged, RunError> {
        self.context.phase(&planned.well, Phase::Detect, true);
        let stop = self.instrument.rig.rotation.stop_handle();
        let context = self.context.clone();
        let began = Instant::now();
        let looked = within(Phase::Detect, context.allowed(Phase::Detect), &context.cancel, &stop, |cancel| {
            self.look(planned, pipeline, times, cancel)
        });
        times.phase(Phase::Detect, began.elapsed());
        let (frame, seen) = looked?;
        writer.add_detection(&frame, truth.cloned())?;
        self.context.hardware(&mut self.instrument);
        if self.context.cancel.is_cancelled() {
            return Ok(Judged::Cancelled);
        }
        let seen = match seen {
            Ok(seen) => seen,
            Err(e) => match OpticsFault::of_pipeline(e) {
                Ok(fault) => return Err(optics_fault(planned, fault)),
                Err(e) => return Ok(Judged::Not(WellEnd::Failed(e.to_string()))),
            },
        };
        let found = seen.profile.as_ref().ok().map(|p| p.detection);
        let live = Live { frame_jpg: live::jpeg(&seen.picture), ..Live::default() };
        self.context.report(Progress::Detected { well: planned.well.clone(), found, live });
        if let Some(fault) = OpticsFault::of_judged(&Light::of(&frame), &seen, pipeline, &self.context.method, self.context.config.bore_um)
        {
            return Err(optics_fault(planned, fault));
        }
        // A frame that the specimen may have spoiled does not count as an empty well. The turn decides.
        let skipped = seen.profile.as_ref().ok().and_then(|p| skip::reason(p, &self.context.method.policy));
        Ok(match skipped {
            Some(reason) => {
                tracing::info!(well = %planned.well, reason, detection = ?found, "the well is skipped");
                Judged::Not(WellEnd::Skipped(reason))
            }
            None => Judged::Worth,
        })
    }

    /// Takes the detection frame. It is retaken if it cannot be judged, or if the specimen was moved into view.
    fn look(
        &mut self,
        planned: &PlannedWell,
        pipeline: &Pipeline,
        times: &mut WellTimes,
        cancel: &carved_devices::cancel::CancelToken,
    ) -> Result<(RawFrame, Result<SegmentedFrame, PipelineError>), RunError> {
        let Self { context, instrument: Instrument { rig, .. } } = self;
        // At least one retry, whatever the policy says: one bad frame is not a fault of the instrument.
        let (mut retries, mut placings) = (context.method.policy.retries.max(1), PLACINGS);
        loop {
            let frame = of_device(times, || acquisition::grab(rig.camera.as_mut(), context.deadline(), cancel))?.frame;
            let seen = pipeline.look(&frame);
            let again = match seen.as_ref().map(|seen| &seen.profile) {
                Ok(Err(error)) if retries > 0 && !cancel.is_cancelled() => {
                    tracing::info!(well = %planned.well, %error, "the frame cannot be judged; another is taken");
                    retries -= 1;
                    true
                }
                Ok(Ok(profile)) if placings > 0 => {
                    placings -= 1;
                    match context.out_of_view_um(planned, profile) {
                        Some(by_um) => of_device(times, || placing::shift(rig, by_um))?,
                        None => false,
                    }
                }
                _ => false,
            };
            if !again {
                return Ok((frame, seen));
            }
        }
    }

    /// Empties and washes the capillary, as far as the sampler does so.
    fn take_out(&mut self, planned: &PlannedWell, has_specimen: bool, times: &mut WellTimes) -> Result<(), RunError> {
        let well = planned.well.as_str();
        if let Err(error) = self.instrument.rig.rotation.let_go(&self.context.cancel) {
            // The specimen is measured. The next reference shows whether the axis still works.
            tracing::warn!(%error, well, "the rotation axis did not let the specimen go");
        }
        self.eject(well, has_specimen, times)
    }

    /// Ejects a specimen whose well was interrupted, if a sampler is driven.
    fn cut_short(&mut self, planned: &PlannedWell, times: &mut WellTimes) -> Result<(), RunError> {
        if self.instrument.sampler.waits_for_loader() { Ok(()) } else { self.eject(&planned.well, true, times) }
    }

    /// Ejects the specimen, then washes if a sampler is driven. A loader does both by itself.
    pub fn eject(&mut self, well: &str, has_specimen: bool, times: &mut WellTimes) -> Result<(), RunError> {
        let Self { context, instrument: Instrument { rig, sampler, .. } } = self;
        let stop = rig.rotation.stop_handle();
        context.phase(well, Phase::Eject, has_specimen);
        let began = Instant::now();
        let ended = within(Phase::Eject, context.allowed(Phase::Eject), &context.cancel, &stop, |cancel| {
            sampler.eject(rig.rotation.as_mut(), well, cancel).map_err(RunError::from)
        });
        times.phase(Phase::Eject, began.elapsed());
        ended?;
        if sampler.waits_for_loader() {
            return Ok(());
        }
        context.phase(well, Phase::Wash, false);
        let began = Instant::now();
        let ended = within(Phase::Wash, context.allowed(Phase::Wash), &context.cancel, &stop, |cancel| {
            sampler.wash(rig.rotation.as_mut(), well, cancel).map_err(RunError::from)
        });
        times.phase(Phase::Wash, began.elapsed());
        ended
    }
}
