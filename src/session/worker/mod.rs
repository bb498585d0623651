//! The blocking half of a run. It owns the rig during the run, works well by well, and reports its progress to the driver.
//!
//! ```text
//!  rig thread     load ─> position ─> detect ─> revolve ──────────> verdict ─> eject ─> wash ─> load ─> position ...
//!                                                  │ views             ^  │ accepted              │
//!  specimen thread                                 └─> store, carve ───┘  └─> surface, measures ──┘ done before the next one is measured
//! ```

mod clock;
mod estimator;
mod optics;
mod retry;
mod science;
mod skip;
mod specimen;
mod turn;
mod watch;
mod well;

pub use clock::add_timings;
pub use optics::OpticsFault;
pub use retry::keeps_specimen;
pub use science::CLOSING;
pub use watch::Overrun;

use super::{Instrument, Live, OutputStatus, RotationStatus, TranslationStatus, placing};
use crate::api::VolumeWait;
use crate::config::Config;
use carved_core::pipeline::{Pipeline, PipelineError, SpecimenRecord};
use carved_core::profile::{Detection, Profile};
use carved_core::quality::{RecentOpacities, TurnFinding};
use carved_devices::acquisition::{AcquisitionError, RevolutionPlan, SweepPlan};
use carved_devices::cancel::CancelToken;
use carved_devices::outputs;
use carved_devices::sampler::{Expected, NextWell, Upcoming};
use carved_devices::{DeviceError, Position, Rig, StreamCounters};
use carved_records::{
    InstrumentIdentity, LedgerEntry, Light, LiveEstimate, Method, Mode, Phase, PicturesOfWells, PlannedWell, SamePictures, SpecimenKind,
    SpecimenOutcome, WellStatus, WellTimes, is_well,
};
use carved_store::{Recording, RecordingReader, RigRecord, SecondRecord, StoreError};
use science::Science;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc::Sender;

/// Progress messages of the worker. Only the driver changes status and journal.
pub enum Progress {
    /// The camera is armed. Wells follow.
    Ready,
    WaitingForLoader {
        well: String,
    },
    Phase {
        well: String,
        phase: Phase,
        in_capillary: bool,
    },
    /// The detection frame, on which the well is judged. It replaces what was shown of the previous specimen.
    Detected {
        well: String,
        /// `None` if the frame cannot be judged.
        found: Option<Detection>,
        live: Live,
    },
    /// Another attempt at the specimen begins with a new reference.
    TriedAgain {
        well: String,
        /// The number of the failed attempt, from 1.
        attempt: u32,
        why: String,
    },
    View {
        well: String,
        index: u32,
        closure: bool,
        achieved_steps: i64,
        hull_volume_um3: Option<f64>,
        estimate: LiveEstimate,
        /// Why there is no estimate yet.
        wait: Option<VolumeWait>,
        light: Option<Light>,
        /// `None` while more views wait than can be drawn.
        live: Option<Live>,
    },
    /// The finished surface for the page, and the numbers. Another specimen may be in the capillary by now.
    Measured {
        well: String,
        glb: Option<Arc<Vec<u8>>>,
        end: LiveEstimate,
        /// Median blur of its views, px. `None` where they do not show it.
        blur_px: Option<f64>,
    },
    /// All files of this well are on disk. The next well may be in progress already.
    WellDone {
        result: WellStatus,
        /// How long the well used the rig.
        seconds: f64,
        times: WellTimes,
    },
    Hardware {
        rotation: RotationStatus,
        translation: Option<TranslationStatus>,
        outputs: Vec<OutputStatus>,
        counters: StreamCounters,
        second: Option<StreamCounters>,
    },
}

/// How the worker ended.
pub enum RunEnd {
    AllWells,
    /// The worker ended after a specimen, as requested. Wells are left.
    Paused,
    Cancelled,
    Failed(RunError),
}

/// Ends a run that cannot be continued. The cause is the instrument or the disk, never a specimen.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Overrun(#[from] Overrun),
    #[error("second camera: {0}")]
    Second(DeviceError),
    /// The pictures are unusable because of the instrument.
    #[error("well {well}: {fault}")]
    Optics { well: String, fault: OpticsFault },
    /// The specimen does not turn while the axis reports that it does.
    #[error("well {well}: {finding}")]
    NotTurning { well: String, finding: TurnFinding },
    /// The computer starts no thread.
    #[error("the specimen's thread could not be started: {0}. Look which program uses all threads or all memory of this computer")]
    NoThread(std::io::Error),
    #[error("the specimen thread ended without a result; see the log")]
    SpecimenThread,
}

/// Everything a run needs besides the instrument.
#[derive(Clone)]
pub struct RunContext {
    pub config: Arc<Config>,
    pub identity: InstrumentIdentity,
    pub mode: Mode,
    pub run: String,
    /// Barcode of the plate.
    pub plate: String,
    /// The wells that are left, in order.
    pub wells: Vec<PlannedWell>,
    /// A well whose specimen may be left in the capillary from before a restart. It is ejected first.
    pub eject_first: Option<String>,
    /// A well whose specimen is already in the capillary of a driven sampler. It is not brought again.
    pub inside: Option<String>,
    /// A well for which a driven sampler was asked before its load was cut short. Its specimen may be in the capillary already.
    pub asked_before: Option<String>,
    pub method_name: String,
    pub method: Method,
    pub folder: PathBuf,
    pub cancel: CancelToken,
    /// Ends the run after the current specimen. The motors do not stop.
    pub pause: CancelToken,
    /// Ends the work at the present specimen, which somebody has taken out. Its well is not measured.
    pub specimen_out: CancelToken,
    pub progress: Sender<Progress>,
    /// The pictures of the wells so far.
    pub pictures: Arc<Mutex<PicturesOfWells>>,
    /// How opaque the larvae were that the daemon measured last, in this run and before it.
    pub opacities: Arc<Mutex<RecentOpacities>>,
}

/// The rig thread.
struct Worker {
    context: Arc<RunContext>,
    instrument: Instrument,
}

/// Why a well has no numbers.
enum WellEnd {
    Skipped(&'static str),
    Failed(String),
}

fn optics_fault(planned: &PlannedWell, fault: OpticsFault) -> RunError {
    RunError::Optics { well: planned.well.clone(), fault }
}

/// Runs all wells and returns the instrument.
pub fn run(instrument: Instrument, context: &RunContext) -> (Instrument, RunEnd) {
    context.know_earlier_pictures();
    let mut worker = Worker { context: Arc::new(context.clone()), instrument };
    let mut numbers = None;
    let ended = worker.all_wells(&mut numbers);
    // After an intervention by hand the axis has stopped already.
    let stops = ended.as_ref().is_err_and(|e| !retry::is_intervention(e));
    if stops || context.cancel.is_cancelled() {
        worker.instrument.rig.rotation.stop_handle().end_motion();
    }
    // The numbers of an accepted specimen are computed and stored, however the run ends.
    let settled = context.settle(&mut numbers);
    let ended = match (ended, settled) {
        (Ok(flow), settled) => settled.map(|()| flow),
        (Err(first), settled) => {
            if let Err(error) = settled {
                tracing::error!(%error, "the numbers of the specimen before are not all on disk either");
            }
            Err(first)
        }
    };
    let end = match ended {
        Ok(ControlFlow::Continue(())) => RunEnd::AllWells,
        Ok(ControlFlow::Break(())) if !context.cancel.is_cancelled() => RunEnd::Paused,
        // A requested stop shows as a device error. It is not a fault.
        Ok(ControlFlow::Break(())) => RunEnd::Cancelled,
        Err(error) if context.cancel.is_cancelled() => {
            tracing::warn!(%error, "the last word of a run that was cancelled");
            RunEnd::Cancelled
        }
        Err(e) => RunEnd::Failed(e),
    };
    (worker.disarmed(), end)
}

impl Worker {
    fn all_wells(&mut self, numbers: &mut Option<Science>) -> Result<ControlFlow<()>, RunError> {
        self.instrument.rig.camera.arm()?;
        if let Some(second) = &mut self.instrument.second {
            second.arm().map_err(RunError::Second)?;
        }
        self.context.report(Progress::Ready);
        // A daemon that was killed may have left a light on.
        outputs::views_off(self.instrument.rig.rotation.as_mut());
        if let Some(well) = self.context.eject_first.clone() {
            self.eject(&well, true, &mut WellTimes::default())?;
        }
        if self.instrument.rig.rotation.capabilities().outside {
            // The wait for the first picture may be long.
            self.context.hardware(&mut self.instrument);
        }
        let context = Arc::clone(&self.context);
        let mut waiting: Vec<&PlannedWell> = context.wells.iter().collect();
        while !waiting.is_empty() {
            let next = match self.next_of(&waiting)? {
                NextWell::At(at) => at.min(waiting.len() - 1),
                NextWell::NoMore => {
                    self.context.skip_all(&waiting);
                    break;
                }
                NextWell::Cancelled => return Ok(ControlFlow::Break(())),
            };
            if self.well(waiting.remove(next), numbers)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// The next well, in the order of the sampler.
    fn next_of(&mut self, waiting: &[&PlannedWell]) -> Result<NextWell, RunError> {
        let Self { context, instrument } = self;
        let is_ended = || context.cancel.is_cancelled() || context.pause.is_cancelled();
        if is_ended() {
            return Ok(NextWell::Cancelled);
        }
        let wells: Vec<Expected> = waiting.iter().map(|planned| context.expected(planned)).collect();
        if let Some(at) = wells.iter().position(|expected| context.inside.as_deref() == Some(expected.well)) {
            return Ok(NextWell::At(at));
        }
        Ok(instrument.sampler.next_well(&Upcoming { run: &context.run, plate: &context.plate, wells: &wells }, &is_ended)?)
    }

    /// Disarms the cameras and returns the instrument.
    fn disarmed(mut self) -> Instrument {
        // A lost camera is closed when it is opened again.
        if !self.instrument.rig.camera.is_lost()
            && let Err(error) = self.instrument.rig.camera.disarm()
        {
            tracing::warn!(%error, "the camera did not disarm");
        }
        if let Some(second) = self.instrument.second.as_mut().filter(|second| !second.is_lost())
            && let Err(error) = second.disarm()
        {
            tracing::warn!(%error, "the second camera did not disarm");
        }
        self.context.hardware(&mut self.instrument);
        self.instrument
    }
}

impl RunContext {
    /// What the sampler needs to know about a well.
    fn expected<'a>(&self, planned: &'a PlannedWell) -> Expected<'a> {
        let well = planned.well.as_str();
        let asked_before = self.asked_before.as_deref() == Some(well);
        Expected { well, bead: planned.specimen == SpecimenKind::Bead, dpf: planned.dpf, asked_before }
    }

    /// Takes the pictures of the wells that are done, also by an earlier process.
    fn know_earlier_pictures(&self) {
        let Ok(folders) = std::fs::read_dir(&self.folder) else { return };
        let mut pictures = self.pictures.lock().unwrap_or_else(PoisonError::into_inner);
        for name in folders.filter_map(|folder| folder.ok()?.file_name().into_string().ok()) {
            if !is_well(&name) || self.wells.iter().any(|left| left.well == name) {
                continue;
            }
            match RecordingReader::open(&self.folder.join(&name)) {
                Ok(reader) => {
                    drop(pictures.take_all(&reader.recording().ledger, &name));
                    if let Some(file) = reader.closed_numbers() {
                        drop(pictures.take_outlines(&file.record.views, &name));
                    }
                }
                Err(error) => tracing::warn!(well = name, %error, "its pictures are not compared with those of the next wells"),
            }
        }
    }

    /// Takes a picture. Returns the well that has it already, if it is another one.
    fn record_picture(&self, entry: &LedgerEntry, well: &str) -> Option<SamePictures> {
        self.pictures.lock().unwrap_or_else(PoisonError::into_inner).take(entry, well)
    }

    /// Takes the outlines in the views of a well. Returns the well that has them already, if it is another one.
    fn record_outlines(&self, record: &SpecimenRecord, well: &str) -> Option<SamePictures> {
        self.pictures.lock().unwrap_or_else(PoisonError::into_inner).take_outlines(&record.views, well)
    }

    fn report(&self, progress: Progress) {
        // Without a driver nothing else can end this run.
        if self.progress.blocking_send(progress).is_err() {
            self.cancel.cancel();
        }
    }

    fn phase(&self, well: &str, phase: Phase, in_capillary: bool) {
        self.report(Progress::Phase { well: well.to_owned(), phase, in_capillary });
    }

    /// Waits until the numbers of the last accepted specimen are on disk, up to the deadline of the phase.
    fn settle(&self, numbers: &mut Option<Science>) -> Result<(), RunError> {
        numbers.take().map_or(Ok(()), |science| science.settle(self.allowed(Phase::Measure)))
    }

    /// Deadline of a phase.
    fn allowed(&self, phase: Phase) -> Duration {
        self.method.policy.deadlines_s.of(phase)
    }

    fn hardware(&self, instrument: &mut Instrument) {
        let rig = &mut instrument.rig;
        let (referenced, position_steps) = match rig.rotation.position() {
            Position::Referenced { steps, .. } => (true, Some(steps)),
            Position::Unknown | Position::Suspect { .. } => (false, None),
        };
        self.report(Progress::Hardware {
            rotation: RotationStatus {
                identity: Some(rig.rotation.identity().to_owned()),
                connected: !rig.rotation.stop_handle().link().is_lost(),
                referenced,
                can_stop: Some(rig.rotation.capabilities().can_stop),
                outside: rig.rotation.capabilities().outside,
                position_steps: position_steps.map(|s| s.0),
                position_deg: position_steps.map(|s| self.config.steps_per_revolution.angle(s).to_degrees()),
            },
            translation: self.translation(rig),
            outputs: self.outputs(rig),
            counters: rig.camera.counters(),
            second: instrument.second.as_ref().map(|second| second.counters()),
        });
    }

    /// Status of the axis along the capillary. `None` if the rig has none.
    fn translation(&self, rig: &mut Rig) -> Option<TranslationStatus> {
        let settings = self.config.translation.as_ref()?;
        let position = rig.rotation.linear().map(|axis| axis.position());
        Some(TranslationStatus::new(rig.rotation.identity(), position, |steps| settings.um(steps)))
    }

    /// Status of the controller's outputs. They are unknown while the controller is lost.
    fn outputs(&self, rig: &mut Rig) -> Vec<OutputStatus> {
        let known = rig.rotation.outputs().map(|outputs| outputs.statuses());
        known.unwrap_or_else(|| self.config.rotation.outputs()).into_iter().map(Into::into).collect()
    }

    fn plan(&self, planned: &PlannedWell) -> Result<RevolutionPlan, RunError> {
        let plan = RevolutionPlan::new(self.method.asd, self.config.steps_per_revolution, self.method.order);
        let plan = plan.map_err(|e| optics_fault(planned, e.into()))?;
        Ok(if self.config.repeats_first_view() { plan } else { plan.without_closure() })
    }

    /// The sweep that takes the views; `None` if they are taken at stops.
    fn sweep(&self, planned: &PlannedWell) -> Result<Option<SweepPlan>, RunError> {
        self.config.sweep(&self.method).transpose().map_err(|e| optics_fault(planned, e.into()))
    }

    /// Skips these wells, because no specimen of them comes.
    fn skip_all(&self, wells: &[&PlannedWell]) {
        for planned in wells {
            let mut result = WellStatus::pending(planned);
            result.end(SpecimenOutcome::Skipped, Some(skip::NO_PICTURES));
            self.report(Progress::WellDone { result, seconds: 0.0, times: WellTimes::default() });
        }
    }

    /// Checks before a specimen is brought that the configuration can measure it.
    fn check_measurable(&self, planned: &PlannedWell) -> Result<(), RunError> {
        self.method.clears(&self.config.optics).map_err(|e| optics_fault(planned, e.into()))?;
        self.plan(planned)?;
        self.pipeline(planned).map(drop)
    }

    fn deadline(&self) -> Duration {
        Duration::from_millis(self.config.acquisition.grab_deadline_ms.into())
    }

    /// Processes the frames of this well.
    fn pipeline(&self, planned: &PlannedWell) -> Result<Pipeline, RunError> {
        let settings = self.method.pipeline(&self.config.optics, planned.specimen == SpecimenKind::Bead).map_err(PipelineError::from);
        let compared = settings.and_then(|settings| settings.compared_with(self.config.empty_capillary.as_deref()));
        compared.and_then(Pipeline::new).map_err(|e| optics_fault(planned, OpticsFault::Pipeline(Box::new(e))))
    }

    /// The start of a well's recording.
    fn recording(&self, planned: &PlannedWell, instrument: &Instrument) -> Recording {
        let second = instrument.second.as_ref().zip(self.config.second.as_ref());
        let rig = RigRecord {
            name: self.config.rig_name.clone(),
            camera: self.config.optics.clone(),
            pixel_format: self.config.camera.pixel_format(),
            steps_per_revolution: self.config.steps_per_revolution,
            sense: self.config.acquisition.sense,
            empty_capillary_sha256: None,
            rotation_identity: instrument.rig.rotation.identity().to_owned(),
            camera_identity: instrument.rig.camera.identity().to_owned(),
            camera_features: instrument.rig.camera.features(),
            second: second.map(|(camera, configured)| SecondRecord {
                optics: configured.optics.clone(),
                identity: camera.identity().to_owned(),
                camera_features: camera.features(),
            }),
        };
        let recording = Recording::new(&self.run, planned.clone(), self.mode, rig, &self.method_name, self.method.clone());
        let usual_opacity = self.opacities.lock().unwrap_or_else(PoisonError::into_inner).usual();
        Recording { instrument: Some(self.identity.clone()), usual_opacity, ..recording }
    }

    /// How far to move the capillary along its axis to show more of the specimen, um. `None` if this is not possible or not necessary.
    fn out_of_view_um(&self, planned: &PlannedWell, profile: &Profile) -> Option<f64> {
        let sense = self.config.translation?.sense;
        let shift_px = placing::shift_px(profile)?;
        tracing::info!(well = %planned.well, shift_px, "the specimen is not all in view");
        Some(sense.sign() * shift_px / self.config.optics.kx)
    }
}
