//! The blocking half of a run: it owns the rig while the run lasts, well by well, and tells the driver what it does.
//!
//! ```text
//!            rig thread                              specimen thread
//! load ─> reference ─> detect ─> revolve ──(entry, frame)──> store ─> profile ─> carve ─> live picture
//!                                   │ the axis moves on                              └─> surface ─> measures
//!                                   └─ closure view at 360 deg
//! ```

use super::{
    Live, Mode, Phase, PlannedWell, ReferenceStatus, RotationStatus, SpecimenKind, SpecimenOutcome, TranslationStatus, WellStatus,
};
use super::{live, placing};
use crate::acquisition::{self, AcquisitionError, LedgerEntry, Light, PlanError, RevolutionPlan, SinkClosed};
use crate::cancel::CancelToken;
use crate::config::{Config, Method};
use crate::device::sampler::{Expected, Sampler};
use crate::device::{Camera, DeviceError, Position, Rig, StreamCounters};
use crate::export;
use crate::frame::RawFrame;
use crate::pipeline::{Pipeline, PipelineError};
use crate::store::{self, MEASUREMENT, MeasurementFile, Recording, RecordingWriter, RigRecord, SecondRecord, StoreError};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::Sender;

/// The devices and who fills the capillary.
pub struct Instrument {
    pub rig: Rig,
    /// A second camera, triggered per view after the rig's.
    pub second: Option<Box<dyn Camera>>,
    pub sampler: Box<dyn Sampler>,
}

/// What the worker tells the driver; the driver alone changes status and journal.
pub enum Progress {
    /// The camera is armed, wells follow.
    Ready,
    WaitingForLoader {
        well: String,
    },
    Phase {
        well: String,
        phase: Phase,
        in_capillary: bool,
    },
    /// The frame on which the well is judged; what was shown before belongs to another specimen.
    Detected {
        live: Live,
    },
    View {
        well: String,
        index: u32,
        closure: bool,
        achieved_steps: i64,
        volume_um3: Option<f64>,
        light: Option<Light>,
        live: Live,
    },
    /// The finished surface, for the page.
    Model {
        glb: Arc<Vec<u8>>,
    },
    WellDone {
        result: WellStatus,
        seconds: f64,
        /// Where the loader takes specimens out, only the loader knows when.
        in_capillary: bool,
    },
    Hardware {
        rotation: RotationStatus,
        translation: Option<TranslationStatus>,
        counters: StreamCounters,
        second: Option<StreamCounters>,
    },
}

/// How the worker ended.
pub enum RunEnd {
    AllWells,
    /// It was asked to end after the specimen under way, and wells are left.
    Paused,
    Cancelled,
    Failed(RunError),
}

/// What ends a whole run: the instrument or the disk, never one specimen.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("second camera: {0}")]
    Second(DeviceError),
    #[error("the specimen thread ended without a result; see the log")]
    SpecimenThread,
}

/// Everything a run needs besides the instrument.
pub struct RunContext {
    pub config: Arc<Config>,
    pub mode: Mode,
    pub run: String,
    /// The wells still to do, in order.
    pub wells: Vec<PlannedWell>,
    /// A well whose specimen an earlier life of the daemon may have left in the capillary: it is taken out before anything else.
    pub eject_first: Option<String>,
    pub method_name: String,
    pub method: Method,
    pub folder: PathBuf,
    pub cancel: CancelToken,
    /// Ends the run once the specimen under way is done; the motors are not stopped.
    pub pause: CancelToken,
    pub progress: Sender<Progress>,
}

/// How often a specimen that is not all in view is carried along before it is taken as it lies.
const PLACINGS: u32 = 2;

/// One view on its way from the rig to the science.
struct View {
    entry: LedgerEntry,
    frame: RawFrame,
    second: Option<RawFrame>,
}

/// Why a well has no number.
enum WellEnd {
    Measured {
        flags: Vec<String>,
        estimator: String,
        volume_um3: f64,
        volume_sd_um3: Option<f64>,
        area_um2: f64,
        area_sd_um2: Option<f64>,
        field_volume_um3: f64,
        field_area_um2: f64,
        diameter_um: Option<f64>,
        signal_per_nl: Option<f64>,
        reference: Option<Box<ReferenceStatus>>,
    },
    Skipped(&'static str),
    Failed(String),
}

/// Runs all wells and gives the instrument back.
pub fn run(mut instrument: Instrument, context: &RunContext) -> (Instrument, RunEnd) {
    let end = match context.all_wells(&mut instrument) {
        Ok(ControlFlow::Continue(())) => RunEnd::AllWells,
        Ok(ControlFlow::Break(())) if context.cancel.is_cancelled() => RunEnd::Cancelled,
        Ok(ControlFlow::Break(())) => RunEnd::Paused,
        // A stop that was asked for shows as a device error on its way out; it is no fault.
        Err(_) if context.cancel.is_cancelled() => RunEnd::Cancelled,
        Err(e) => RunEnd::Failed(e),
    };
    if !matches!(end, RunEnd::AllWells | RunEnd::Paused) {
        instrument.rig.rotation.stop_handle().stop();
    }
    // One that is lost is taken apart when it is opened again.
    if !instrument.rig.camera.is_lost()
        && let Err(error) = instrument.rig.camera.disarm()
    {
        tracing::warn!(%error, "the camera did not disarm");
    }
    if let Some(second) = instrument.second.as_mut().filter(|second| !second.is_lost())
        && let Err(error) = second.disarm()
    {
        tracing::warn!(%error, "the second camera did not disarm");
    }
    context.hardware(&mut instrument);
    (instrument, end)
}

impl RunContext {
    fn tell(&self, progress: Progress) {
        // Without a driver nobody could end this run any more: it ends itself.
        if self.progress.blocking_send(progress).is_err() {
            self.cancel.cancel();
        }
    }

    fn phase(&self, well: &str, phase: Phase, in_capillary: bool) {
        self.tell(Progress::Phase { well: well.to_owned(), phase, in_capillary });
    }

    fn hardware(&self, instrument: &mut Instrument) {
        let rig = &mut instrument.rig;
        let (referenced, position_steps) = match rig.rotation.position() {
            Position::Referenced { steps, .. } => (true, Some(steps)),
            Position::Unknown | Position::Suspect { .. } => (false, None),
        };
        self.tell(Progress::Hardware {
            rotation: RotationStatus {
                identity: Some(rig.rotation.identity().to_owned()),
                connected: true,
                referenced,
                can_stop: Some(rig.rotation.capabilities().can_stop),
                position_steps: position_steps.map(|s| s.0),
                position_deg: position_steps.map(|s| self.config.steps_per_revolution.angle(s).to_degrees()),
            },
            translation: self.translation(rig),
            counters: rig.camera.counters(),
            second: instrument.second.as_ref().map(|second| second.counters()),
        });
    }

    /// Of the axis along the capillary, where the rig has one.
    fn translation(&self, rig: &mut Rig) -> Option<TranslationStatus> {
        let settings = self.config.translation.as_ref()?;
        let position = rig.rotation.linear().map(|axis| axis.position());
        Some(TranslationStatus::new(rig.rotation.identity(), position, |steps| settings.um(steps)))
    }

    fn plan(&self) -> Result<RevolutionPlan, PlanError> {
        RevolutionPlan::new(self.method.asd, self.config.steps_per_revolution, self.method.order)
    }

    fn deadline(&self) -> Duration {
        Duration::from_millis(self.config.acquisition.grab_deadline_ms.into())
    }

    fn all_wells(&self, instrument: &mut Instrument) -> Result<ControlFlow<()>, RunError> {
        instrument.rig.camera.arm()?;
        if let Some(second) = &mut instrument.second {
            second.arm().map_err(RunError::Second)?;
        }
        self.tell(Progress::Ready);
        if let Some(well) = &self.eject_first {
            self.phase(well, Phase::Eject, true);
            instrument.sampler.eject(instrument.rig.rotation.as_mut(), well, &self.cancel)?;
            self.phase(well, Phase::Eject, false);
        }
        for planned in &self.wells {
            if self.cancel.is_cancelled() || self.pause.is_cancelled() {
                return Ok(ControlFlow::Break(()));
            }
            let began = Instant::now();
            let Some(end) = self.well(instrument, planned)? else { return Ok(ControlFlow::Break(())) };
            let mut result = WellStatus::pending(planned);
            match end {
                WellEnd::Measured {
                    flags,
                    estimator,
                    volume_um3,
                    volume_sd_um3,
                    area_um2,
                    area_sd_um2,
                    field_volume_um3,
                    field_area_um2,
                    diameter_um,
                    signal_per_nl,
                    reference,
                } => {
                    result.end(SpecimenOutcome::Succeeded, None);
                    result.flags = flags;
                    result.estimator = Some(estimator);
                    result.volume_um3 = Some(volume_um3);
                    result.volume_sd_um3 = volume_sd_um3;
                    result.area_um2 = Some(area_um2);
                    result.area_sd_um2 = area_sd_um2;
                    result.field_volume_um3 = Some(field_volume_um3);
                    result.field_area_um2 = Some(field_area_um2);
                    result.diameter_um = diameter_um;
                    result.signal_per_nl = signal_per_nl;
                    result.reference = reference;
                }
                WellEnd::Skipped(reason) => result.end(SpecimenOutcome::Skipped, Some(reason)),
                WellEnd::Failed(reason) => result.end(SpecimenOutcome::Failed, Some(&reason)),
            }
            self.hardware(instrument);
            let in_capillary = instrument.sampler.waits_for_loader() && result.outcome != Some(SpecimenOutcome::Skipped);
            self.tell(Progress::WellDone { result, seconds: began.elapsed().as_secs_f64(), in_capillary });
        }
        Ok(ControlFlow::Continue(()))
    }

    /// One well from load to eject; nothing where the run was cancelled in it.
    fn well(&self, instrument: &mut Instrument, planned: &PlannedWell) -> Result<Option<WellEnd>, RunError> {
        let well = planned.well.as_str();
        self.phase(well, Phase::Load, false);
        if instrument.rig.rotation.capabilities().trigger_only
            && let Ok(plan) = self.plan()
        {
            // Its list must be there before it takes the specimen up.
            instrument.rig.rotation.announce(&plan.targets())?;
        }
        if instrument.sampler.waits_for_loader() {
            self.tell(Progress::WaitingForLoader { well: well.to_owned() });
        }
        let expected = Expected { well, bead: planned.specimen == SpecimenKind::Bead, dpf: planned.dpf };
        let Some(loaded) = instrument.sampler.load(instrument.rig.rotation.as_mut(), expected, &self.cancel)? else { return Ok(None) };
        self.phase(well, Phase::Position, true);
        instrument.rig.rotation.reference(&self.cancel)?;
        if let Some(translation) = &self.config.translation {
            placing::place(&mut instrument.rig, translation.position_um, &self.cancel)?;
        }
        self.hardware(instrument);
        let rig = &instrument.rig;

        self.phase(well, Phase::Detect, true);
        let recording = Recording::new(
            &self.run,
            planned.clone(),
            self.mode,
            RigRecord {
                name: self.config.rig_name.clone(),
                camera: self.config.optics.clone(),
                pixel_format: self.config.camera.pixel_format(),
                steps_per_revolution: self.config.steps_per_revolution,
                sense: self.config.acquisition.sense,
                empty_capillary_sha256: None,
                rotation_identity: rig.rotation.identity().to_owned(),
                camera_identity: rig.camera.identity().to_owned(),
                second: self.second_record(instrument),
            },
            &self.method_name,
            self.method.clone(),
        );
        let mut writer = RecordingWriter::create(&self.folder.join(well), recording, self.config.empty_capillary.as_deref())?;
        let end = self.judge(instrument, &mut writer, planned, loaded.truth);
        // The record is closed on every way out, a fault's included; the fault is what is told then.
        let closed = writer.close();
        let driven = !instrument.sampler.waits_for_loader();
        if matches!(end, Ok(None) | Err(_)) && driven {
            self.phase(well, Phase::Eject, true);
            match instrument.sampler.eject(instrument.rig.rotation.as_mut(), well, &self.cancel) {
                Ok(()) => self.phase(well, Phase::Eject, false),
                // What ended the run is what is told.
                Err(error) if end.is_err() => tracing::warn!(%error, well, "the specimen is left in the capillary"),
                Err(error) => return Err(error.into()),
            }
        }
        let Some(end) = end? else { return Ok(None) };
        closed?;
        if let Err(error) = instrument.rig.rotation.let_go(&self.cancel) {
            // The specimen is measured; the next reference finds out whether the axis can go on.
            tracing::warn!(%error, well, "the rotation axis did not let the specimen go");
        }
        self.phase(well, Phase::Eject, !matches!(end, WellEnd::Skipped(_)));
        instrument.sampler.eject(instrument.rig.rotation.as_mut(), well, &self.cancel)?;
        Ok(Some(end))
    }

    fn second_record(&self, instrument: &Instrument) -> Option<SecondRecord> {
        let (second, configured) = instrument.second.as_ref().zip(self.config.second.as_ref())?;
        Some(SecondRecord { optics: configured.optics.clone(), identity: second.identity().to_owned() })
    }

    /// Looks what is in the capillary, and takes a specimen through its revolution.
    fn judge(
        &self,
        instrument: &mut Instrument,
        writer: &mut RecordingWriter,
        planned: &PlannedWell,
        truth: Option<serde_json::Value>,
    ) -> Result<Option<WellEnd>, RunError> {
        let rig = &mut instrument.rig;
        let mut detected = acquisition::grab(rig.camera.as_mut(), self.deadline(), &self.cancel)?;
        for _ in 0..PLACINGS {
            match self.out_of_view_um(planned, &detected.frame) {
                Some(by_um) if placing::shift(rig, by_um)? => {
                    detected = acquisition::grab(rig.camera.as_mut(), self.deadline(), &self.cancel)?;
                }
                _ => break,
            }
        }
        writer.add_detection(&detected.frame, truth)?;
        self.hardware(instrument);
        if self.cancel.is_cancelled() {
            return Ok(None);
        }
        let looked = self.pipeline(planned).and_then(|pipeline| {
            let seen = pipeline.look(&detected.frame)?;
            Ok((pipeline, seen))
        });
        let (pipeline, seen) = match looked {
            Ok(looked) => looked,
            Err(e) => return Ok(Some(WellEnd::Failed(e.to_string()))),
        };
        self.tell(Progress::Detected { live: Live { frame_jpg: live::jpeg(&seen.picture), ..Live::default() } });
        match seen.profile {
            Ok(p) => match p.detection.skip_reason() {
                Some(reason) => {
                    tracing::info!(well = %planned.well, reason, detection = ?p.detection, "the well is skipped");
                    Ok(Some(WellEnd::Skipped(reason)))
                }
                None => self.revolve(instrument, writer, planned, pipeline),
            },
            // A frame that cannot be judged is not taken for an empty well: the revolution decides.
            Err(_) => self.revolve(instrument, writer, planned, pipeline),
        }
    }

    /// How far the axis is to carry the capillary along for more of the specimen to be seen; nothing where it cannot be.
    fn out_of_view_um(&self, planned: &PlannedWell, frame: &RawFrame) -> Option<f64> {
        let sense = self.config.translation?.sense;
        let seen = self.pipeline(planned).and_then(|pipeline| pipeline.look(frame)).ok()?;
        let shift_px = placing::shift_px(&seen.profile.ok()?)?;
        tracing::info!(well = %planned.well, shift_px, "the specimen is not all in view");
        Some(sense.sign() * shift_px / self.config.optics.kx)
    }

    /// What looks at this well's frames and measures its specimen.
    fn pipeline(&self, planned: &PlannedWell) -> Result<Pipeline, PipelineError> {
        let settings = self.method.pipeline(&self.config.optics, planned.specimen == SpecimenKind::Bead)?;
        Pipeline::new(settings.compared_with(self.config.empty_capillary.as_deref())?)
    }

    fn revolve(
        &self,
        instrument: &mut Instrument,
        writer: &mut RecordingWriter,
        planned: &PlannedWell,
        pipeline: Pipeline,
    ) -> Result<Option<WellEnd>, RunError> {
        let well = planned.well.as_str();
        self.phase(well, Phase::Revolve, true);
        let plan = match self.plan() {
            Ok(plan) => plan,
            Err(e) => return Ok(Some(WellEnd::Failed(e.to_string()))),
        };
        writer.add_references(&self.config.references)?;
        // Room for every view: the axis never waits for the science.
        let (send, views) = sync_channel::<View>(self.method.asd as usize + 1);
        let Instrument { rig, second, .. } = instrument;
        let mut second_failed = None;
        let (revolved, specimen) = std::thread::scope(|scope| {
            let science = scope.spawn(move || self.reconstruct(pipeline, writer, well, &views));
            let revolved = acquisition::revolve(rig, &plan, &self.config.acquisition, &self.cancel, |mut entry, frame| {
                // The axis stands until this has returned.
                let second = second.as_deref_mut().map(|camera| acquisition::grab_second(camera, self.deadline(), &self.cancel));
                let second = second.transpose().map_err(|e| {
                    second_failed = Some(e);
                    SinkClosed
                })?;
                let second = second.map(|(seen, frame)| {
                    entry.second = Some(seen);
                    frame
                });
                send.send(View { entry, frame, second }).map_err(|_| SinkClosed)
            });
            drop(send);
            (revolved, science.join())
        });
        let specimen = specimen.map_err(|_| RunError::SpecimenThread)?;
        if self.cancel.is_cancelled() {
            return Ok(None);
        }
        if let Some(e) = second_failed {
            return Err(RunError::Second(e));
        }
        // Where the specimen thread ended by itself, that is why no more views were taken.
        let end = specimen?;
        match revolved {
            Ok(_) | Err(AcquisitionError::SinkClosed { .. }) => Ok(Some(end)),
            Err(e) => Err(e.into()),
        }
    }

    /// The specimen thread: stores and carves what the rig thread hands on, then measures.
    fn reconstruct(
        &self,
        mut pipeline: Pipeline,
        writer: &mut RecordingWriter,
        well: &str,
        views: &Receiver<View>,
    ) -> Result<WellEnd, RunError> {
        let mut clock = StageClock::default();
        let mut seen = 0;
        let mut next = views.recv().ok();
        let mut seconds = Vec::new();
        while let Some(View { entry, frame, second }) = next {
            if let Some(second) = second {
                writer.add_second(&entry, &second)?;
                seconds.push((entry.clone(), second));
            }
            // While no view waits there is time to calibrate; one that comes meanwhile waits in the queue, and the axis turns on.
            let waiting = match self.take_view(&mut pipeline, writer, well, entry, &frame, &mut clock, || views.try_recv().ok())? {
                Ok(waiting) => waiting,
                Err(e) => return Ok(WellEnd::Failed(e.to_string())),
            };
            seen += 1;
            next = waiting.or_else(|| views.recv().ok());
        }
        if self.cancel.is_cancelled() || seen <= self.method.asd {
            return Ok(WellEnd::Failed("the revolution was cut short".into()));
        }
        self.phase(well, Phase::Reconstruct, true);
        let (mesh, record) = match clock.surface.time(|| pipeline.finish()) {
            Ok(finished) => finished,
            Err(e) => return Ok(WellEnd::Failed(e.to_string())),
        };
        self.phase(well, Phase::Measure, true);
        let mut ply = Vec::new();
        let unit = if self.mode == Mode::Simulated { "um (simulated)" } else { "um" };
        export::write_ply(&mesh, unit, &mut ply).map_err(StoreError::io("encode", Path::new("mesh.ply")))?;
        writer.add_file("mesh.ply", &ply)?;
        if let Some(glb) = live::model(&mesh) {
            writer.add_file("model.glb", &glb)?;
            self.tell(Progress::Model { glb });
        }
        let second = self.config.second.as_ref().filter(|_| !seconds.is_empty());
        let fluorescence = second
            .and_then(|s| store::fluorescence(&mesh, &record.measurement, &s.optics, seconds.iter().map(|(entry, frame)| (entry, frame))));
        let signal_per_nl = fluorescence.as_ref().map(|f| f.signal_per_nl);
        let file = MeasurementFile { fluorescence, ..MeasurementFile::new(writer.recording(), &self.config.references, record) };
        writer.add_json(MEASUREMENT, &file)?;
        let MeasurementFile { record, reference, .. } = file;
        writer.add_json("timings.json", &clock)?;
        let m = &record.measurement;
        Ok(WellEnd::Measured {
            flags: record.flags,
            reference: reference.as_ref().and_then(ReferenceStatus::of).map(Box::new),
            estimator: m.estimator.name().to_owned(),
            volume_um3: m.volume_um3,
            volume_sd_um3: m.volume_sd_um3,
            area_um2: m.area_um2,
            area_sd_um2: m.area_sd_um2,
            field_volume_um3: m.field_volume_um3,
            field_area_um2: m.field_area_um2,
            diameter_um: m.diameter_um,
            signal_per_nl,
        })
    }

    /// Stores, looks at and carves one view, refines the live model where `waiting` has no other view yet, and reports; gives the
    /// view that was waiting.
    #[allow(clippy::too_many_arguments, reason = "what a revolution has, and the view")]
    fn take_view<T>(
        &self,
        pipeline: &mut Pipeline,
        writer: &mut RecordingWriter,
        well: &str,
        entry: LedgerEntry,
        frame: &RawFrame,
        clock: &mut StageClock,
        waiting: impl FnOnce() -> Option<T>,
    ) -> Result<Result<Option<T>, PipelineError>, RunError> {
        let (index, closure, omega, achieved_steps, light) = (entry.view, entry.closure, entry.omega, entry.achieved_steps.0, entry.light);
        clock.store.time(|| writer.add_view(entry, frame))?;
        let seen = match clock.profile.time(|| pipeline.look(frame)) {
            Ok(seen) => seen,
            Err(e) => return Ok(Err(e)),
        };
        if closure {
            pipeline.observe_closure(&seen);
        } else if let Err(e) = clock.carve.time(|| pipeline.observe(index, omega, &seen)) {
            return Ok(Err(e));
        }
        if let (Ok(profile), false) = (&seen.profile, closure)
            && profile.mask.area_px() > 0
        {
            writer.add_profile(index, &profile.mask)?;
        }
        let waiting = waiting();
        if waiting.is_none() && !closure && pipeline.is_refinable() {
            clock.refine.time(|| pipeline.refine());
        }
        let volume_um3 = (!closure).then(|| pipeline.live().volume_um3);
        let live = live::of_view(&seen, &pipeline.live_mesh());
        self.tell(Progress::View { well: well.to_owned(), index, closure, achieved_steps, volume_um3, light, live });
        Ok(Ok(waiting))
    }
}

/// Where the time of a specimen went, per view and for its surface. Kept apart from the numbers, which no clock touches.
#[derive(Debug, Default, serde::Serialize)]
struct StageClock {
    #[serde(rename = "store_ms")]
    store: Times,
    #[serde(rename = "profile_ms")]
    profile: Times,
    #[serde(rename = "carve_ms")]
    carve: Times,
    #[serde(rename = "refine_ms")]
    refine: Times,
    #[serde(rename = "surface_ms")]
    surface: Times,
}

#[derive(Debug, Default, serde::Serialize)]
#[serde(transparent)]
struct Times(Vec<f64>);

impl Times {
    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let result = work();
        self.0.push(began.elapsed().as_secs_f64() * 1e3);
        result
    }
}
