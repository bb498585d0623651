//! From frames to numbers: the one path that live runs, replays and offline measurements share.
//!
//! ```text
//! RawFrame + omega ─> Picture ─> Profile ─> carver ─> live volume      per view, in any order
//!                                           │ └─> surface ─> measures  after the last view
//!                                           └─ calibrated, carved again, for the live volume: where whoever drives it has time
//! ```
//! The same frames and angles give the same bytes of numbers.

use crate::calibration::{Calibration, PoseOffset, ViewState};
use crate::carver::Leaves;
use crate::fins::Fin;
use crate::frame::RawFrame;
use crate::geometry::{Camera, GridError, Projection, VoxelGrid};
use crate::measure::facing::Facing;
use crate::measure::shape::Shape;
use crate::measure::{Fallback, Measurement};
use crate::profile::{
    Detection, EmptyCapillary, FinBorders, Mask, Picture, Polygon, Profile, ProfileError, ProfileQuality, SegmentSettings, Segmenters,
    Walls,
};
use crate::quality::{
    CalibrationOff, ClosureOff, ClosureSd, Estimate, FlagFacts, OFF_REFERENCES, Quality, QualitySettings, Spoiled, TurnFacts, ViewStrip,
    add_raised, flags, spoiled, views_needed,
};
use crate::reconstruction::{
    Calibrated, CalibrationRecord, HullModel, Judged, LiveVolume, Model, NotCalibrated, Reconstruction, ReconstructionError,
    ReconstructionSettings, TurnModel,
};
use crate::surface::Mesh;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Everything the numbers depend on beside the frames and their angles.
#[derive(Debug, Clone, PartialEq)]
pub struct PipelineSettings {
    /// The rig's camera.
    pub camera: Camera,
    /// The voxels.
    pub grid: VoxelGrid,
    /// Number of views of the turn; the tolerance is a share of it.
    pub planned_views: u32,
    /// How a frame is segmented.
    pub segment: SegmentSettings,
    /// The picture of the empty capillary that every frame is compared with. `None` where there is none.
    pub empty_capillary: Option<Arc<EmptyCapillary>>,
    /// How the model is made and calibrated.
    pub reconstruction: ReconstructionSettings,
    /// Limits of the checks.
    pub quality: QualitySettings,
    /// Whether the specimen is a bead, to which a sphere is fitted.
    pub sphere: bool,
}

/// The result of one view.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ViewRecord {
    /// Number of the view in the plan; 0 is the view at 0 deg.
    pub index: u32,
    /// Angle of the capillary from the ledger's achieved steps, rad.
    pub omega: f64,
    /// Whether the view counts in the model.
    pub used: bool,
    /// Why it does not count. `None` for a view that counts.
    pub reason: Option<String>,
    /// Pixels inside the profile. `None` without a profile.
    pub area_px: Option<usize>,
    /// That area over the median of the neighbouring views' (two to either side around the turn). A profile changes little from
    /// view to view, unless one of them is wrong.
    #[serde(default)]
    pub area_ratio: Option<f64>,
    /// Figures of the profile. `None` without a profile.
    pub quality: Option<ProfileQuality>,
    /// What was detected in the frame. `None` where it could not be segmented.
    #[serde(default)]
    pub detection: Option<Detection>,
    /// The walls of the capillary relative to the rig's calibration. `None` where the frame could not be segmented.
    #[serde(default)]
    pub walls: Option<WallRecord>,
    /// Shift of the profile down the image against the turn's camera, px. `None` for a view that does not count, or without
    /// calibration.
    #[serde(default)]
    pub dy_px: Option<f64>,
    /// Root of the mean square distance between its edges and those that all other views make expected, px. `None` without
    /// calibration.
    #[serde(default)]
    pub residual_px: Option<f64>,
    /// Area of the hull that no view misses (VRV) projected into this view, um^2 at the axis. `None` without calibration.
    #[serde(default)]
    pub vrv_area_um2: Option<f64>,
    /// That area over the profile's, %. `None` without calibration.
    #[serde(default)]
    pub overlap_percent: Option<f64>,
    /// Where the view sees the fins of [`SpecimenRecord::fins`], point by point: `[u, v]`, px to a tenth. Empty for a view that does not
    /// count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fins_px: Vec<Vec<[f64; 2]>>,
}

/// The walls in one frame as a ruler for the rig, in the column of the principal point. The walls are the same glass in every
/// frame: what changes is the rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WallRecord {
    /// Distance of the inner wall lines, um by the calibrated scale across.
    pub bore_um: f64,
    /// Middle of the bore below the calibrated axis, px.
    pub shift_px: f64,
    /// Tilt of the bore less the calibrated one, deg. Positive when the right end is lower.
    pub tilt_deg: f64,
}

impl WallRecord {
    fn of(walls: &Walls, camera: &Camera) -> Self {
        Self {
            bore_um: walls.bore_px(camera.ux) / camera.ky,
            shift_px: walls.middle_v(camera.ux) - camera.uy,
            tilt_deg: walls.tilt_deg() - camera.gamma.to_degrees(),
        }
    }
}

/// The view at 0 deg compared with the view at 360 deg. Lost steps and a specimen that moved show only here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClosureRecord {
    /// Intersection over union of the two profiles.
    pub iou: f64,
    /// Shift of the profile's centroid, px: along the capillary and across it.
    pub shift_px: [f64; 2],
    /// The specimen's pose at 360 deg less that at 0 deg, by the model of the turn. `None` where the model does not give it.
    #[serde(default, rename = "lie")]
    pub pose_offset: Option<PoseOffset>,
}

impl ClosureRecord {
    /// The numbers for the checks: those of the model, or else the shift of the centroid.
    fn off(&self) -> ClosureOff {
        ClosureOff {
            overlap: self.iou,
            along_px: self.pose_offset.map_or(self.shift_px[0], |l| l.along_px),
            across_px: self.pose_offset.map_or(self.shift_px[1], |l| l.across_px),
            turn_deg: self.pose_offset.map(|l| l.turn_rad.to_degrees()),
            sd: self.pose_offset.and_then(|l| l.sd).map(|sd| ClosureSd {
                along_px: sd.along_px,
                across_px: sd.across_px,
                turn_deg: sd.turn_rad.to_degrees(),
            }),
        }
    }
}

/// The numbers of a specimen, with what they rest on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpecimenRecord {
    /// Volume, area and size.
    pub measurement: Measurement,
    /// Shape of the mesh that is kept.
    #[serde(default)]
    pub shape: Option<Shape>,
    /// Which views show a larva's back, belly and sides. `None` for a bead, and where the shape does not determine a back.
    #[serde(default)]
    pub facing: Option<Facing>,
    /// The free edges of the fins that the views agree on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fins: Vec<Fin>,
    /// The views, by number.
    pub views: Vec<ViewRecord>,
    /// The closure view. `None` where it or the view at 0 deg has no profile.
    pub closure: Option<ClosureRecord>,
    /// Calibration of the turn. `None` where it is measured with the rig's camera.
    #[serde(default)]
    pub calibration: Option<CalibrationRecord>,
    /// Why it is measured with the rig's camera although calibration is on.
    #[serde(default)]
    pub uncalibrated: Option<String>,
    /// Every number that is compared with a limit of the method.
    #[serde(default)]
    pub quality: Option<Quality>,
    /// Flags: `bad_view` (a view does not count), `clipped_left`, `clipped_right`, `outside_box`, `moved`, `closure_undecided` (the
    /// closure is over a limit, but by less than two standard deviations), `no_closure` (the
    /// view at 360 deg has no profile, so that a specimen that moved would show only in the residuals), `dead_looking` (opaque
    /// throughout in most views), `blur_mismatch` (the frames are not as sharp as configured), `few_views`, `nonconvex` (the
    /// voxels are trusted), `fins_unseen` (a long specimen with fins shorter than half its length: see [`Spread::volume_fins_unseen_um3`](crate::measure::Spread)), `uncalibrated` (measured with the rig's camera), `calibration_gate` (another axis leaves a larger
    /// hull: the views do not quite agree), `wrong_steps` (the capillary did not turn as far as the ledger says), and those of
    /// [`Quality`]: `unusable_views`, `residual`, `overlap`, `uncertain`, `calibration_off`, `volume_off_references`,
    /// `area_off_references`.
    pub flags: Vec<String>,
}

/// Why a specimen cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The box or the voxel size.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The reconstruction.
    #[error(transparent)]
    Reconstruction(#[from] ReconstructionError),
    /// A frame is not of the camera's size.
    #[error("the frame is {found_width} x {found_height} px, the rig's camera {width} x {height} px")]
    FrameSize {
        /// Width of the camera's sensor, px.
        width: u32,
        /// Height of the sensor, px.
        height: u32,
        /// Width of the frame, px.
        found_width: u32,
        /// Height of the frame, px.
        found_height: u32,
    },
    /// The picture of the empty capillary cannot be used.
    #[error("the picture of the empty capillary cannot be used: {0}")]
    EmptyCapillary(ProfileError),
    /// Too few views have a profile.
    #[error("{used} of {planned} views gave a profile; {needed} are needed. First reason: {reason}")]
    TooFewViews {
        /// Views with a profile.
        used: usize,
        /// Views planned.
        planned: u32,
        /// Views needed.
        needed: usize,
        /// Why the first of the others has none.
        reason: String,
    },
}

impl PipelineError {
    /// Whether camera, method or grid refuse every specimen, so that this specimen is not the cause.
    pub fn is_of_setup(&self) -> bool {
        match self {
            Self::Grid(_) | Self::FrameSize { .. } | Self::EmptyCapillary(_) => true,
            Self::Reconstruction(e) => matches!(
                e,
                ReconstructionError::Camera(_)
                    | ReconstructionError::MaskSize { .. }
                    | ReconstructionError::CameraInBox { .. }
                    | ReconstructionError::Setting(_)
            ),
            Self::TooFewViews { .. } => false,
        }
    }
}

/// The profile of the closure view.
struct ClosureProfile {
    mask: Mask,
    edge: Vec<Polygon>,
}

/// A measured specimen with all that its numbers come from.
#[derive(Debug, Clone)]
pub struct Finished {
    /// The surface at the sub-pixel outlines, um.
    pub mesh: Mesh,
    /// The numbers.
    pub record: SpecimenRecord,
    /// The voxels that were counted.
    pub hull: HullModel,
}

/// A specimen under reconstruction. Its numbers depend only on the newest take of each view and of the closure view, not on how
/// often or in which order views were taken.
pub struct Pipeline {
    settings: PipelineSettings,
    segmenters: Segmenters,
    reconstruction: Reconstruction,
    views: Vec<ViewRecord>,
    /// The views that carved, in the order of carving.
    carved: Vec<u32>,
    /// The newest profile of view 0. `None` when the newest take of view 0 has no profile.
    first: Option<Mask>,
    /// The newest profile of the view at 360 deg. It is compared with `first` only when the result is requested, so that the
    /// result does not depend on the order of the takes.
    closure: Option<ClosureProfile>,
    /// Result of [`Self::judge`]. `None` once another view was observed.
    calibrated: Option<Calibrated>,
}

/// The state of a turn when all its views are observed, before anything is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct TurnVerdict {
    /// Whether the specimen is not where it was when the turn began.
    pub moved: bool,
    /// The views that spoil the model: those without a profile, and those that do not fit the others.
    pub spoiled: Vec<Spoiled>,
}

/// A frame with its segmentation.
pub struct SegmentedFrame {
    /// The colours of the frame.
    pub picture: Picture,
    /// The profile, or why there is none.
    pub profile: Result<Profile, ProfileError>,
    /// Where borders of fins may be that are too faint for one view.
    pub borders: Option<FinBorders>,
}

impl PipelineSettings {
    /// The same settings, with every frame compared with this frame of the empty capillary. `None` compares with nothing.
    ///
    /// # Errors
    ///
    /// [`PipelineError::EmptyCapillary`] where the frame shows no capillary.
    pub fn compared_with(self, empty: Option<&RawFrame>) -> Result<Self, PipelineError> {
        let capillary = empty.map(|frame| EmptyCapillary::new(Picture::from_frame(frame), &self.segment.walls)).transpose();
        Ok(Self { empty_capillary: capillary.map_err(PipelineError::EmptyCapillary)?.map(Arc::new), ..self })
    }
}

impl Pipeline {
    /// A specimen of which nothing is observed yet.
    ///
    /// # Errors
    ///
    /// [`PipelineError::Reconstruction`] for a camera, plan or settings that make no model.
    pub fn new(settings: PipelineSettings) -> Result<Self, PipelineError> {
        let reconstruction =
            Reconstruction::new(&settings.camera, settings.grid, settings.planned_views as usize, settings.reconstruction)?;
        let segmenters = Segmenters::default();
        Ok(Self {
            settings,
            segmenters,
            reconstruction,
            views: Vec::new(),
            carved: Vec::new(),
            first: None,
            closure: None,
            calibrated: None,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &PipelineSettings {
        &self.settings
    }

    /// Segments a frame. Frames are independent of each other, so any number of them may be segmented at once.
    ///
    /// # Errors
    ///
    /// [`PipelineError::FrameSize`] for a frame that is not of the camera's size.
    pub fn look(&self, frame: &RawFrame) -> Result<SegmentedFrame, PipelineError> {
        let camera = &self.settings.camera;
        if (frame.width(), frame.height()) != (camera.width, camera.height) {
            return Err(PipelineError::FrameSize {
                width: camera.width,
                height: camera.height,
                found_width: frame.width(),
                found_height: frame.height(),
            });
        }
        let picture = Picture::from_frame(frame);
        let view = self.segmenters.segment_view(&picture, &self.settings.segment, self.settings.empty_capillary.as_deref());
        let (profile, borders) = view.map_or_else(|error| (Err(error), None), |(profile, borders)| (Ok(profile), borders));
        Ok(SegmentedFrame { picture, profile, borders })
    }

    /// Carves with the view number `index` at angle `omega` (rad), and returns the live volume, um^3. A frame without a profile
    /// is recorded with its reason and not carved.
    ///
    /// # Errors
    ///
    /// [`PipelineError::Reconstruction`] for a view that the reconstruction refuses.
    pub fn observe(&mut self, index: u32, omega: f64, frame: &SegmentedFrame) -> Result<f64, PipelineError> {
        let mut volume_um3 = self.live().volume_um3;
        let mut record = ViewRecord {
            index,
            omega,
            detection: frame.profile.as_ref().ok().map(|p| p.detection),
            walls: frame.profile.as_ref().ok().map(|p| WallRecord::of(&p.walls, &self.settings.camera)),
            ..ViewRecord::default()
        };
        if index == 0 {
            self.first = frame.profile.as_ref().ok().filter(|p| p.mask.area_px() > 0).map(|p| p.mask.clone());
        }
        match &frame.profile {
            Ok(p) if p.mask.area_px() == 0 => record.reason = Some("no specimen in the frame".into()),
            Ok(p) => {
                let leaves = Leaves { left: p.detection.is_clipped_left(), right: p.detection.is_clipped_right() };
                volume_um3 =
                    self.reconstruction.observe_outlines(&p.mask, &p.edge, &p.body, frame.borders.as_ref(), omega, leaves)?.volume_um3;
                record.used = true;
                self.carved.push(index);
                record.area_px = Some(p.mask.area_px());
                record.quality = Some(p.quality);
            }
            Err(e) => record.reason = Some(e.to_string()),
        }
        self.views.push(record);
        self.calibrated = None;
        Ok(volume_um3)
    }

    /// Takes the view at 360 deg. It is compared with view 0 and never carved. A newer take replaces an older one, also when
    /// the newer one has no profile.
    pub fn observe_closure(&mut self, frame: &SegmentedFrame) {
        let profile = frame.profile.as_ref().ok();
        self.closure = profile.map(|p| ClosureProfile { mask: p.mask.clone(), edge: p.edge.clone() });
    }

    /// The closure view against view 0. `None` when either has no profile.
    fn closure(&self) -> Option<ClosureRecord> {
        let (first, last) = (self.first.as_ref()?, &self.closure.as_ref()?.mask);
        let shift_px = first.centroid().zip(last.centroid()).map_or([0.0; 2], |(a, b)| [b[0] - a[0], b[1] - a[1]]);
        Some(ClosureRecord { iou: first.iou(last), shift_px, pose_offset: None })
    }

    /// Replaces a view by a newer take of it.
    ///
    /// # Errors
    /// As [`Self::observe`].
    pub fn replace(&mut self, index: u32, omega: f64, frame: &SegmentedFrame) -> Result<f64, PipelineError> {
        if let Some(at) = self.carved.iter().position(|view| *view == index) {
            self.reconstruction.take_back(at)?;
            self.carved.remove(at);
        }
        self.views.retain(|v| v.index != index);
        self.observe(index, omega, frame)
    }

    /// Calibrates on all views. Returns whether the specimen stayed where it was, and the views that should be taken again.
    /// [`Self::finish`] uses this calibration.
    pub fn judge(&mut self) -> TurnVerdict {
        let limits = &self.settings.quality;
        let calibrated = self.reconstruction.calibrate();
        let mut strip: Vec<ViewStrip> = self.views.iter().map(ViewRecord::strip).collect();
        for (index, state) in self.carved.iter().zip(calibrated.states()) {
            if let Some(view) = strip.iter_mut().find(|v| v.view == *index) {
                view.used = state.bad.is_none();
                view.reason = state.bad.map(|bad| bad.to_string());
                view.residual_px = state.residual_px;
            }
        }
        let is_far = self.closure().is_some_and(|closure| closure.off().is_far(limits));
        let moved = is_far || calibrated.has_moved();
        let spoiled = spoiled(&strip, limits.residual_view_px);
        self.calibrated = Some(calibrated);
        TurnVerdict { moved, spoiled }
    }

    /// The volume after the views so far, corrected for their number. `None` where the views do not determine it. It takes as
    /// long as [`Self::refine`].
    pub fn estimate(&self) -> Option<Estimate> {
        self.reconstruction.estimate(self.settings.sphere)
    }

    /// Ends the turn with the views taken so far, with or without a profile: their number becomes the number of planned views.
    /// Views may still be replaced, so that one without a profile may get one.
    ///
    /// # Errors
    /// [`PipelineError::Reconstruction`] when no view was taken yet.
    pub fn end_early(&mut self) -> Result<(), PipelineError> {
        self.reconstruction.replan(self.views.len())?;
        self.calibrated = None;
        self.settings.planned_views = self.views.len() as u32;
        Ok(())
    }

    /// The hull so far, through the best camera that is known.
    pub fn live(&self) -> LiveVolume {
        self.reconstruction.live()
    }

    /// Whether [`Self::refine`] would improve the live model: enough views have come in since the last time, from enough sides.
    pub fn is_refinable(&self) -> bool {
        self.reconstruction.is_refinable()
    }

    /// Calibrates the live model on the views so far, which takes as long as one or two views. The result of [`Self::finish`]
    /// does not depend on it. Returns what [`Self::estimate`] would.
    pub fn refine(&mut self) -> Option<Estimate> {
        self.reconstruction.refine(self.settings.sphere)
    }

    /// Whether the live hull is so small that the end will not use such an estimate.
    pub fn is_hollow(&self, estimate: &Estimate) -> bool {
        self.reconstruction.is_hollow(estimate)
    }

    /// The live hull as a mesh for display.
    pub fn live_mesh(&self) -> Mesh {
        self.reconstruction.live_mesh()
    }

    /// Makes the surface and the numbers. The record is in the order of the views, whatever order they came in.
    ///
    /// # Errors
    ///
    /// [`PipelineError::TooFewViews`] where too few views have a profile, and [`PipelineError::Reconstruction`] where they
    /// leave no model.
    pub fn finish(self) -> Result<(Mesh, SpecimenRecord), PipelineError> {
        self.finish_with_hull().map(|finished| (finished.mesh, finished.record))
    }

    /// As [`Self::finish`], with the voxels and the cameras that the numbers come from.
    ///
    /// # Errors
    ///
    /// As [`Self::finish`].
    pub fn finish_with_hull(mut self) -> Result<Finished, PipelineError> {
        self.views.sort_by_key(|v| v.index);
        compare_areas(&mut self.views);
        let used = self.reconstruction.hull().live().views;
        let needed = views_needed(self.settings.planned_views);
        if used < needed {
            let reason = self.views.iter().find_map(|v| v.reason.clone()).unwrap_or_else(|| "views are missing".into());
            return Err(PipelineError::TooFewViews { used, planned: self.settings.planned_views, needed, reason });
        }
        let mut closure = self.closure();
        if let (Some(last), Some(first)) = (&self.closure, self.carved.iter().position(|view| *view == 0)) {
            self.reconstruction.observe_closure(&last.mask, &last.edge, first);
        }
        let TurnModel { model, fallback, hull, calibration, projections, reprojected_areas, closure: pose_offset, fins } = {
            let calibrated = self.calibrated.take().unwrap_or_else(|| self.reconstruction.calibrate());
            self.reconstruction.measure(calibrated, self.settings.sphere)?
        };
        if let Ok(found) = &calibration {
            self.judged(&found.calibration.views, &reprojected_areas);
        }
        for (index, projection) in self.carved.iter().zip(&projections) {
            if let Some(record) = self.views.iter_mut().find(|v| v.index == *index && v.used) {
                record.fins_px = fins.iter().map(|fin| fin.seen(projection)).collect();
            }
        }
        if let Some(record) = &mut closure {
            record.pose_offset = pose_offset;
        }
        let found = calibration.as_ref().ok().map(|judged| &judged.calibration);
        let quality = self.quality(found, closure.as_ref(), &model.measurement);
        let flags = self.flags(&quality, &model, fallback.as_ref(), calibration.as_ref().ok(), closure.is_some());
        let shape = Shape::of(&model.mesh);
        let taken: Vec<(u32, f64)> = self.views.iter().map(|v| (v.index, v.omega)).collect();
        let camera = found.map_or(&self.settings.camera, |c| &c.camera);
        let facing = if self.settings.sphere { None } else { Facing::of(&shape, camera, &taken) };
        let record = SpecimenRecord {
            measurement: model.measurement,
            shape: Some(shape),
            facing,
            fins,
            views: self.views,
            closure,
            calibration: calibration.as_ref().ok().map(CalibrationRecord::from),
            uncalibrated: calibration.as_ref().err().filter(|why| **why != NotCalibrated::NotAsked).map(ToString::to_string),
            quality: Some(quality),
            flags,
        };
        Ok(Finished { mesh: model.mesh, record, hull })
    }

    /// Compares the turn with the method's limits.
    fn quality(&self, found: Option<&Calibration>, closure: Option<&ClosureRecord>, measured: &Measurement) -> Quality {
        let strip: Vec<ViewStrip> = self.views.iter().map(ViewRecord::strip).collect();
        let omegas: Vec<f64> = self.views.iter().filter(|v| v.used).map(|v| v.omega).collect();
        let rig = &self.settings.camera;
        let facts = TurnFacts {
            planned_views: self.settings.planned_views as usize,
            omegas: &omegas,
            strip: &strip,
            closure: closure.map(ClosureRecord::off),
            calibration: found.map(|c| CalibrationOff {
                uy_px: c.camera.uy - rig.uy,
                gamma_deg: (c.camera.gamma - rig.gamma).to_degrees(),
                alpha_deg: (c.camera.alpha - rig.alpha).to_degrees(),
                rho_percent: 100.0 * (c.rho - 1.0),
                is_rho_significant: c.is_rho_significant(),
            }),
            scatter_px: measured.estimators.support.as_ref().map(|s| s.residual_um * rig.ky),
            volume_sd_percent: measured.spread.map(|s| 100.0 * s.volume_of_turn_um3() / measured.volume_um3),
        };
        Quality::of(&facts, &self.settings.quality)
    }

    /// The flags of the specimen, by what is known of its turn.
    fn flags(
        &self,
        quality: &Quality,
        model: &Model,
        fallback: Option<&Fallback>,
        calibration: Option<&Judged>,
        has_closure: bool,
    ) -> Vec<String> {
        let clipped = |side: fn(&Detection) -> bool| {
            self.views.iter().any(|v| self.carved.contains(&v.index) && v.detection.as_ref().is_some_and(side))
        };
        let looks_dead: Vec<bool> = self.views.iter().filter(|v| v.used).filter_map(|v| Some(v.detection?.looks_dead())).collect();
        let blurs_px: Vec<f64> = self.views.iter().filter_map(|v| v.quality?.blur_px).collect();
        let facts = FlagFacts {
            has_bad_view: self.views.iter().any(|v| !v.used),
            is_clipped: [clipped(Detection::is_clipped_left), clipped(Detection::is_clipped_right)],
            touches_box: model.touches_box,
            has_moved: calibration.is_some_and(|judged| judged.calibration.moved.is_some()),
            is_sphere: self.settings.sphere,
            has_closure,
            looks_dead: &looks_dead,
            blurs_px: &blurs_px,
            configured_blur_px: self.settings.segment.edge.blur_px,
            is_nonconvex: fallback.is_some_and(Fallback::is_nonconvex),
            misses_fins: model.measurement.misses_fins(),
            vrv: calibration.map(|judged| judged.vrv.verdict),
        };
        flags(&facts, quality)
    }

    /// Stores what the calibration found of the views that carved.
    fn judged(&mut self, states: &[ViewState], reprojected_areas: &[Option<[f64; 2]>]) {
        for ((index, state), again) in self.carved.iter().zip(states).zip(reprojected_areas) {
            if let Some(record) = self.views.iter_mut().find(|v| v.index == *index) {
                record.used = state.bad.is_none();
                record.reason = state.bad.map(|bad| bad.to_string());
                record.dy_px = record.used.then_some(state.dy_px);
                record.residual_px = state.residual_px;
                record.vrv_area_um2 = again.map(|[hull_um2, _]| hull_um2);
                record.overlap_percent = again.map(|[hull_um2, profile_um2]| 100.0 * hull_um2 / profile_um2);
            }
        }
    }
}

impl SpecimenRecord {
    /// Number of each view that counts in the model, and its projection with the calibration of the turn, if there is one. `given` is the
    /// camera of the rig, with which a turn without calibration is measured.
    pub fn projections(&self, given: &Camera) -> Vec<(u32, Projection)> {
        let used = || self.views.iter().filter(|view| view.used);
        // The angles are corrected around the view that is nearest to 0.
        let first = used().map(|view| view.omega).min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
        let projection = |view: &ViewRecord| match &self.calibration {
            None => given.projection(view.omega),
            Some(found) => {
                let camera = Camera { uy: found.psi.uy + view.dy_px.unwrap_or(0.0), ..found.psi.clone() };
                camera.projection(first + found.rho * (view.omega - first))
            }
        };
        used().map(|view| (view.index, projection(view))).collect()
    }
}

impl ViewRecord {
    /// Its entry in the residual strip.
    fn strip(&self) -> ViewStrip {
        ViewStrip {
            view: self.index,
            used: self.used,
            reason: self.reason.clone(),
            residual_px: self.residual_px,
            overlap_percent: self.overlap_percent,
        }
    }
}

impl SpecimenRecord {
    /// Adds the comparison with reference larvae of the same age: volume and area in standard deviations from their mean, and
    /// the number that is allowed.
    pub fn compare_with_references(&mut self, [volume_z, area_z]: [Option<f64>; 2], limit: f64) {
        let quality = self.quality.take().unwrap_or_default().among_references(volume_z, area_z, limit);
        self.flags.retain(|f| !OFF_REFERENCES.contains(&f.as_str()));
        add_raised(&mut self.flags, &quality);
        self.quality = Some(quality);
    }
}

/// Compares the area of each profile with those of its neighbours around the turn. Views without a profile are left out.
fn compare_areas(views: &mut [ViewRecord]) {
    const TO_EITHER_SIDE: usize = 2;
    let areas: Vec<(usize, f64)> = views.iter().enumerate().filter_map(|(at, v)| Some((at, v.area_px? as f64))).collect();
    let n = areas.len();
    // Fewer views would be their own neighbours on the other side.
    if n <= 2 * TO_EITHER_SIDE {
        return;
    }
    for (k, (at, area)) in areas.iter().enumerate() {
        let mut near: [f64; 2 * TO_EITHER_SIDE] = std::array::from_fn(|i| {
            let away = if i < TO_EITHER_SIDE { n - 1 - i } else { i - TO_EITHER_SIDE + 1 };
            areas[(k + away) % n].1
        });
        near.sort_by(f64::total_cmp);
        let median = f64::midpoint(near[TO_EITHER_SIDE - 1], near[TO_EITHER_SIDE]);
        views[*at].area_ratio = Some(area / median);
    }
}
