//! The specimen thread. It stores and carves the views of the rig thread, judges the turn, and measures the specimen while the next one is
//! brought.
//!
//! ```text
//! View ─> store ─> profile ─> carve ─> live picture
//! Turned ──────> calibrate ─> TurnVerdict                  the larva is still in the capillary
//! Accepted ────> on disk ─> surface ─> measures ─> files   the larva is taken out meanwhile
//! Out ─────────> timings, checksums ─> WellDone
//! ```

use super::clock::{StageClock, TIMINGS, Timings};
use super::estimator::LiveEstimator;
use super::optics::Blind;
use super::{OpticsFault, Progress, RunContext, RunError, optics_fault};
use crate::session::{live, numbers};
use carved_core::frame::RawFrame;
use carved_core::pipeline::{Pipeline, PipelineError, SpecimenRecord, TurnVerdict};
use carved_core::reconstruction::is_seen_around;
use carved_core::surface::Mesh;
use carved_devices::rotation::RotationDriver;
use carved_records::{LedgerEntry, Light, Phase, PlannedWell, SamePictures, SpecimenOutcome, ViewOrder, WellStatus, WellTimes};
use carved_store::{self, MeasurementFile, RecordingWriter};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// A message of the rig thread.
#[allow(clippy::large_enum_variant, reason = "nearly all of them are views")]
pub enum Work {
    View {
        entry: LedgerEntry,
        frame: RawFrame,
        second: Option<RawFrame>,
    },
    /// All views are sent. The rig thread waits for a verdict.
    Turned,
    /// No view follows, and the specimen is measured. Answered once the turn is durable.
    Accepted {
        kept: Sender<()>,
    },
    /// The specimen was released. Contains the times of its well so far, and how long the well used the rig, s.
    Out {
        times: WellTimes,
        seconds: f64,
    },
}

/// How the thread ended.
pub enum Ended {
    /// The well's result was reported.
    Told,
    /// There is no number. Contains the reason.
    Failed(String),
    /// The rig thread dropped the numbers.
    Dropped,
}

/// What becomes of the numbers of a well. It is decided once, before the first of their files is written: a well that has failed gets none.
#[derive(Debug, Clone, Default)]
pub struct Decision(Arc<AtomicU8>);

impl Decision {
    const WRITES: u8 = 1;
    const GIVEN_UP: u8 = 2;

    fn decide(&self, to: u8) -> bool {
        self.0.compare_exchange(0, to, Ordering::AcqRel, Ordering::Acquire).is_ok()
    }

    /// Decides that the numbers are written. False if they are given up.
    pub fn begin_to_write(&self) -> bool {
        self.decide(Self::WRITES)
    }

    /// Whether the numbers are written.
    pub fn is_to_write(&self) -> bool {
        self.0.load(Ordering::Acquire) == Self::WRITES
    }

    /// Decides that the numbers are given up. False if they are being written.
    pub fn give_up(&self) -> bool {
        self.decide(Self::GIVEN_UP)
    }

    /// Has the thread report nothing any more, although it may be writing.
    pub fn silence(&self) {
        self.0.store(Self::GIVEN_UP, Ordering::Release);
    }
}

/// One turn of one specimen.
pub struct Specimen {
    pub context: Arc<RunContext>,
    pub planned: PlannedWell,
    pub pipeline: Pipeline,
    pub writer: RecordingWriter,
    /// Frames of the second camera.
    pub seconds: Vec<(LedgerEntry, RawFrame)>,
    pub stages: StageClock,
    /// The numbers are not needed any more. Views are only stored.
    pub unwanted: Arc<AtomicBool>,
    /// Whether this thread writes and reports the well's numbers, or the rig thread has given them up.
    pub decision: Decision,
    /// Estimates of the volume during the turn.
    pub estimator: LiveEstimator,
    /// The rule has ended the turn. The rig thread goes to the closure view.
    pub enough: Arc<AtomicBool>,
    pub blind: Blind,
    /// When a view was drawn last.
    pub drawn: Option<Instant>,
}

/// Shortest time between two drawn views while others wait.
const BETWEEN_DRAWINGS: Duration = Duration::from_millis(250);

/// How the turn ended.
enum Turn {
    Accepted,
    Failed(String),
    Dropped,
}

impl Specimen {
    /// Works through the messages of the rig thread. The recording is closed on every way out.
    pub fn run(mut self, work: &Receiver<Work>, verdicts: &Sender<TurnVerdict>) -> Result<Ended, RunError> {
        let ended = match self.follow(work, verdicts) {
            Ok(Turn::Accepted) => return self.measured(work),
            Ok(Turn::Failed(why)) => Ok(Ended::Failed(why)),
            Ok(Turn::Dropped) => Ok(Ended::Dropped),
            Err(e) => Err(e),
        };
        let closed = self.writer.close();
        let ended = ended?;
        closed?;
        Ok(ended)
    }

    fn follow(&mut self, work: &Receiver<Work>, verdicts: &Sender<TurnVerdict>) -> Result<Turn, RunError> {
        let mut next = work.recv().ok();
        loop {
            if let Some(Work::View { entry, .. }) = &next
                && let Some(same) = self.context.record_picture(entry, &self.planned.well)
            {
                return Ok(Turn::Failed(why_failed(&same)));
            }
            match next.take() {
                Some(Work::View { entry, frame, second }) => match self.view(entry, &frame, second, || work.try_recv().ok())? {
                    Ok(waiting) => next = waiting,
                    Err(e) => return Ok(Turn::Failed(e.to_string())),
                },
                Some(Work::Turned) => {
                    if let Some(fault) = self.blind.at_end(self.writer.recording().ledger.carved().count()) {
                        return Err(optics_fault(&self.planned, fault));
                    }
                    if self.context.method.order == ViewOrder::Sweep {
                        self.writer.name_missing()?;
                    }
                    if self.enough.load(Ordering::Acquire)
                        && let Err(e) = self.ended_early()?
                    {
                        return Ok(Turn::Failed(e.to_string()));
                    }
                    let pipeline = &mut self.pipeline;
                    let verdict = self.stages.calibrate.time(|| pipeline.judge());
                    // The receiver is dropped if the run was cancelled.
                    let _gone = verdicts.send(verdict);
                }
                Some(Work::Accepted { kept }) => {
                    self.writer.accept()?;
                    // The receiver is dropped if the rig thread has ended.
                    let _gone = kept.send(());
                    return Ok(Turn::Accepted);
                }
                Some(Work::Out { .. }) | None => return Ok(Turn::Dropped),
            }
            next = next.or_else(|| work.recv().ok());
        }
    }

    /// Stores, profiles and carves one view, refines the live model if nothing is `waiting`, and reports. Returns the message that was
    /// waiting.
    fn view<T>(
        &mut self,
        entry: LedgerEntry,
        frame: &RawFrame,
        second: Option<RawFrame>,
        waiting: impl FnOnce() -> Option<T>,
    ) -> Result<Result<Option<T>, PipelineError>, RunError> {
        let Self { planned, pipeline, writer, stages, estimator, blind, .. } = self;
        // A fault of the instrument is returned as such. Any other error fails only this well.
        let failed = |e| match OpticsFault::of_pipeline(e) {
            Ok(fault) => Err(optics_fault(planned, fault)),
            Err(e) => Ok(Err(e)),
        };
        let LedgerEntry { view: index, retake, closure, omega, light, .. } = entry;
        let achieved_steps = entry.achieved_steps.0;
        if let Some(second) = second {
            writer.add_second(&entry, &second)?;
            self.seconds.retain(|(taken, _)| taken.view != index);
            self.seconds.push((entry.clone(), second));
        }
        if self.unwanted.load(Ordering::Acquire) || self.context.cancel.is_cancelled() {
            stages.store.time(|| writer.add_view(entry, frame))?;
            return Ok(Ok(waiting()));
        }
        let StageClock { store, profile, .. } = stages;
        let (stored, seen) = rayon::join(|| store.time(|| writer.add_view(entry, frame)), || profile.time(|| pipeline.look(frame)));
        stored?;
        let seen = match seen {
            Ok(seen) => seen,
            Err(e) => return failed(e),
        };
        if closure {
            pipeline.observe_closure(&seen);
        } else {
            let light = light.unwrap_or_else(|| Light::of(frame));
            if let Some(fault) = blind.take(index, &light, &seen.profile, self.context.method.asd) {
                return Err(optics_fault(planned, fault));
            }
            let carved = stages
                .carve
                .time(|| if retake > 0 { pipeline.replace(index, omega, &seen) } else { pipeline.observe(index, omega, &seen) });
            if let Err(e) = carved {
                return failed(e);
            }
            // Where another program turns the capillary, the specimen is gone before anybody could look: the end of the turn judges it.
            if !matches!(self.context.config.rotation, RotationDriver::Folder(_))
                && let Some(finding) = pipeline.still()
            {
                return Err(RunError::NotTurning { well: planned.well.clone(), finding });
            }
        }
        if let (Ok(profile), false) = (&seen.profile, closure)
            && profile.mask.area_px() > 0
        {
            stages.store.time(|| writer.add_profile(index, &profile.mask))?;
        }
        // While no view waits, there is time to calibrate. A view that arrives meanwhile waits in the queue, and the axis keeps turning.
        let waiting = waiting();
        let rule = &self.context.method.early_stop;
        let has_time = waiting.is_none() && !closure;
        let refines = has_time && pipeline.is_refinable();
        // If the rule may end the turn, every estimate of the rule is made, whether or not a view waits.
        let asked = !closure && retake == 0 && rule.asks(pipeline.live().views) && (rule.enabled || has_time);
        if refines || asked {
            let found = if refines { stages.refine.time(|| pipeline.refine()) } else { stages.estimate.time(|| pipeline.estimate()) };
            estimator.take(found, found.is_some_and(|e| !pipeline.is_hollow(&e)));
            if asked && estimator.is_enough() {
                self.enough.store(true, Ordering::Release);
            }
        }
        let hull_volume_um3 = (!closure && retake == 0).then(|| pipeline.live().volume_um3);
        let (well, estimate) = (self.planned.well.clone(), estimator.known());
        let wait = estimator.wait(is_seen_around(writer.recording().ledger.carved().map(|entry| entry.omega)));
        // The pictures are for people. Views that come faster than they can be drawn share one.
        let is_drawn = waiting.is_none() || closure || self.drawn.is_none_or(|at| at.elapsed() >= BETWEEN_DRAWINGS);
        let live = is_drawn.then(|| stages.live.time(|| live::of_view(&seen, &pipeline.live_mesh())));
        if is_drawn {
            self.drawn = Some(Instant::now());
        }
        self.context.report(Progress::View { well, index, closure, achieved_steps, hull_volume_um3, estimate, wait, light, live });
        Ok(Ok(waiting))
    }

    /// Ends the turn early: the number of planned views becomes the number of carved views.
    fn ended_early(&mut self) -> Result<Result<(), PipelineError>, RunError> {
        let views = self.writer.recording().ledger.carved().count() as u32;
        if views >= self.context.method.asd || self.writer.recording().ended_after_views.is_some() {
            return Ok(Ok(()));
        }
        tracing::info!(well = %self.planned.well, views, "the volume is known well enough: the turn ends early");
        self.writer.end_after(views)?;
        Ok(self.pipeline.end_early())
    }

    /// Measures, waits until the specimen is out, closes the recording and reports the result.
    fn measured(self, work: &Receiver<Work>) -> Result<Ended, RunError> {
        let Self { context, planned, pipeline, mut writer, seconds, mut stages, decision, estimator, .. } = self;
        let began = Instant::now();
        let mut result = WellStatus::pending(&planned);
        let found = stages.surface.time(|| pipeline.finish());
        if !decision.begin_to_write() {
            tracing::warn!(well = planned.well, "the numbers came after they were given up, and are not written");
            return Ok(Ended::Told);
        }
        let same = found.as_ref().ok().and_then(|(_, record)| context.record_outlines(record, &planned.well));
        let numbers = match (found, same) {
            (Ok(_), Some(same)) => {
                result.end(SpecimenOutcome::Failed, Some(&why_failed(&same)));
                Ok(())
            }
            (Ok((mesh, record)), None) => {
                let blur_px = record.blur_px();
                written(&context, &mut writer, &mesh, record, &seconds, &mut result).map(|glb| {
                    context.report(Progress::Measured { well: planned.well, glb, end: estimator.end(&result), blur_px });
                })
            }
            (Err(e), _) => {
                result.end(SpecimenOutcome::Failed, Some(&e.to_string()));
                Ok(())
            }
        };
        let took = began.elapsed();
        let (mut times, seconds) = match work.recv() {
            Ok(Work::Out { times, seconds }) => (times, seconds),
            // The specimen could not be taken out. This ends the run, but the well keeps its numbers.
            _ => (WellTimes::default(), took.as_secs_f64()),
        };
        times.phase(Phase::Measure, took);
        let timed = writer.add_json(TIMINGS, &Timings { stages: &stages, well: &times });
        let closed = writer.close();
        numbers?;
        timed?;
        closed?;
        if decision.is_to_write() {
            context.report(Progress::WellDone { result, seconds, times });
        }
        Ok(Ended::Told)
    }
}

/// Why a well has no numbers that has the pictures of another one.
fn why_failed(same: &SamePictures) -> String {
    format!("{same}. Find out which of them they show, and measure the other again")
}

/// Computes the fluorescence, writes the files of a measured specimen and its result. Returns its model for the page.
fn written(
    context: &RunContext,
    writer: &mut RecordingWriter,
    mesh: &Mesh,
    record: SpecimenRecord,
    seconds: &[(LedgerEntry, RawFrame)],
    result: &mut WellStatus,
) -> Result<Option<Arc<Vec<u8>>>, RunError> {
    let second = context.config.second.as_ref().filter(|_| !seconds.is_empty());
    let fluorescence = second.and_then(|s| {
        carved_store::fluorescence(mesh, &record.measurement, &s.optics, seconds.iter().map(|(entry, frame)| (entry, frame)))
    });
    if let Some(opacity) = record.opacity() {
        context.opacities.lock().unwrap_or_else(PoisonError::into_inner).add(opacity);
    }
    let file = MeasurementFile { fluorescence, ..MeasurementFile::new(writer.recording(), &context.config.references, record) };
    let glb = numbers::write(writer, mesh, &file)?;
    numbers::end_well(result, &file, context.method.asd);
    Ok(glb)
}
