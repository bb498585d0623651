//! From frames to numbers: the one path that live runs, replays and offline measurements share.
//!
//! ```text
//! RawFrame + omega ─> Picture ─> Profile ─> carver ─> live volume      per view, in any order
//!                                           │ └─> surface ─> measures  after the last view
//!                                           └─ calibrated, carved again, for the live volume: where whoever drives it has time
//! ```
//! The same frames and angles give the same bytes of numbers.

mod error;
mod record;
pub mod standard;

use crate::calibration::{Calibration, ViewState};
use crate::carver::Leaves;
use crate::flag::StoredFlag;
use crate::frame::RawFrame;
use crate::geometry::{BoxUm, Camera, Projection, VoxelGrid};
use crate::inside::{Eyes, Lit, Shade, SwimBladder, Trunk};
use crate::measure::facing::Facing;
use crate::measure::shape::{Body, Shape};
use crate::measure::{Fallback, Measurement, extents};
use crate::parallel::join;
use crate::profile::{
    Columns, Detection, EmptyCapillary, FinBorders, Kind, Mask, Picture, Polygon, Profile, ProfileError, SegmentSettings, Segmenters,
};
use crate::quality::{
    CalibrationOff, Estimate, FlagFacts, Quality, QualitySettings, Spoiled, TurnFacts, TurnFinding, Turning, ViewStrip, flags, spoiled,
    views_needed,
};
use crate::reconstruction::{
    Calibrated, CalibrationRecord, HullModel, Judged, LiveVolume, Model, NotCalibrated, Reconstruction, ReconstructionSettings, TurnModel,
};
use crate::statistics::upper_median;
use crate::surface::Mesh;
pub use error::PipelineError;
use record::compare_areas;
pub use record::{ClosureRecord, SpecimenRecord, ViewRecord, WallRecord};
use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Widths of the bore by the scale of the camera, as a share of that of the glass, at which the scale may be right. The glass is seldom measured:
/// capillaries of 500 to 800 um are taken for one of 600. Pictures binned by two have 0.5, and the next objective has 0.5 or 2.
const BORE_SHARE: RangeInclusive<f64> = 0.62..=1.6;

/// Most views of a turn in which organs are looked for, evenly chosen from all: more take more time. An odd number avoids opposite views, which
/// show nearly the same light.
const ORGAN_VIEWS_MOST: usize = 27;

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

/// The profile of the view at 0 or at 360 deg.
struct ClosureProfile {
    mask: Mask,
    edge: Vec<Polygon>,
    /// The edges without fins: a fin that only one of the two frames shows is no movement.
    body: Columns,
    picture: Picture,
}

impl ClosureProfile {
    fn of(profile: &Profile, picture: &Picture) -> Self {
        let body = Columns::from_outlines(&profile.body, profile.mask.width(), profile.mask.height());
        Self { mask: profile.mask.clone(), edge: profile.edge.clone(), body, picture: picture.clone() }
    }
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
    /// The views that carved, compared with each other.
    turning: Turning,
    /// The light that passed the specimen in the views that carved, in the order of carving.
    shades: Vec<Option<Shade>>,
    /// The newest profile of view 0. `None` when the newest take of view 0 has no profile.
    first: Option<ClosureProfile>,
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
            turning: Turning::default(),
            shades: Vec::new(),
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
            self.first = frame.profile.as_ref().ok().filter(|p| p.mask.area_px() > 0).map(|p| ClosureProfile::of(p, &frame.picture));
        }
        match &frame.profile {
            Ok(p) if p.mask.area_px() == 0 => record.reason = Some("no specimen in the frame".into()),
            Ok(p) => {
                let leaves = Leaves { left: p.detection.is_clipped_left(), right: p.detection.is_clipped_right() };
                volume_um3 =
                    self.reconstruction.observe_outlines(&p.mask, &p.edge, &p.body, frame.borders.as_ref(), omega, leaves)?.volume_um3;
                record.used = true;
                self.carved.push(index);
                self.shades.push(Shade::of(&frame.picture, &p.mask));
                self.turning.observe(index, omega, &frame.picture, p, self.settings.camera.ux);
                record.area_px = Some(p.mask.area_px());
                record.quality = Some(p.quality);
                record.outline = if self.settings.sphere { None } else { self.turning.coarse_outline(index) };
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
        self.closure = frame.profile.as_ref().ok().map(|p| ClosureProfile::of(p, &frame.picture));
    }

    /// The profile of the closure view. `None` also if its picture is that of view 0 again: a copy shows nothing of the end of the turn,
    /// and no camera takes the same noise twice.
    fn last(&self) -> Option<&ClosureProfile> {
        let is_copy = |last: &ClosureProfile| self.first.as_ref().is_some_and(|first| first.picture == last.picture);
        self.closure.as_ref().filter(|last| !is_copy(last))
    }

    /// The closure view against view 0. `None` when either has no profile.
    fn closure(&self) -> Option<ClosureRecord> {
        let (first, last) = (self.first.as_ref()?, self.last()?);
        let shift_px = first.mask.centroid().zip(last.mask.centroid()).map_or([0.0; 2], |(a, b)| [b[0] - a[0], b[1] - a[1]]);
        Some(ClosureRecord { iou: first.body.iou(&last.body), shift_px, pose_offset: None })
    }

    /// Replaces a view by a newer take of it.
    ///
    /// # Errors
    /// As [`Self::observe`].
    pub fn replace(&mut self, index: u32, omega: f64, frame: &SegmentedFrame) -> Result<f64, PipelineError> {
        if let Some(at) = self.carved.iter().position(|view| *view == index) {
            self.reconstruction.take_back(at)?;
            self.carved.remove(at);
            self.shades.remove(at);
        }
        self.views.retain(|v| v.index != index);
        self.turning.forget(index);
        self.observe(index, omega, frame)
    }

    /// The stretch of the views so far in which the specimen stands still while the angles change. `None` where it turns.
    pub fn still(&mut self) -> Option<TurnFinding> {
        self.turning.still()
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
        if closure.is_none() {
            self.closure = None;
        }
        if let (Some(last), Some(first)) = (&self.closure, self.carved.iter().position(|view| *view == 0)) {
            self.reconstruction.observe_closure(&last.mask, &last.edge, first);
        }
        let calibrated = self.calibrated.take().unwrap_or_else(|| self.reconstruction.calibrate());
        let finned = self.reconstruction.finned(calibrated, self.settings.sphere);
        let (middle_v, sphere) = (self.turning.middle_v(), self.settings.sphere);
        let (of_calibration, model) = join(
            || if sphere { Vec::new() } else { self.reconstruction.turn_findings(&finned, &self.carved, middle_v) },
            || self.reconstruction.measure(&finned, middle_v, sphere),
        );
        // The cause before its consequences.
        let mut turn_findings = self.turning.findings();
        turn_findings.extend(of_calibration);
        let TurnModel { model, fallback, hull, calibration, projections, reprojected_areas, closure: pose_offset, fins, ends_um } = model?;
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
        let quality = self.quality(found, closure.as_ref(), &model.measurement).with_turn(&turn_findings);
        let flags = self.flags(&quality, &model, fallback.as_ref(), calibration.as_ref().ok(), closure.is_some());
        let mut shape = Shape::of(&model.mesh);
        if let (Some(body), Some([left, right]), Some(surface)) = (&mut shape.body, ends_um, extents(&model.mesh)) {
            body.reach([surface.min[0] - left, right - surface.max[0]]);
        }
        let taken: Vec<(u32, f64)> = self.views.iter().map(|v| (v.index, v.omega)).collect();
        let camera = found.map_or(&self.settings.camera, |c| &c.camera);
        let (eyes, bladder) = self.organs(&projections, &model.mesh, shape.body.as_ref(), StoredFlag::is_bound(&flags)).unzip();
        let facing = if self.settings.sphere { None } else { Facing::of(&shape, eyes.as_ref(), camera, &taken) };
        let record = SpecimenRecord {
            measurement: model.measurement,
            shape: Some(shape),
            facing,
            eyes,
            bladder,
            fins,
            views: self.views,
            closure,
            calibration: calibration.as_ref().ok().map(CalibrationRecord::from),
            uncalibrated: calibration.as_ref().err().filter(|why| **why != NotCalibrated::NotAsked).map(ToString::to_string),
            quality: Some(quality),
            turn_findings,
            flags,
        };
        Ok(Finished { mesh: model.mesh, record, hull })
    }

    /// Eyes and swim bladder, by the views that count. `None` for a bead. `is_bound`: a part of the larva was not measured.
    fn organs(&self, projections: &[Projection], mesh: &Mesh, body: Option<&Body>, is_bound: bool) -> Option<(Eyes, SwimBladder)> {
        if self.settings.sphere {
            return None;
        }
        let is_used = |index: u32| self.views.iter().any(|v| v.index == index && v.used);
        // By number, so that the result does not depend on the order in which the views came.
        let mut carved: Vec<_> = self.carved.iter().zip(projections).zip(&self.shades).collect();
        carved.sort_by_key(|((index, _), _)| **index);
        let views: Vec<Lit> = carved
            .into_iter()
            .filter(|((index, _), _)| is_used(**index))
            .filter_map(|((_, projection), shade)| Some(Lit { projection, shade: shade.as_ref()? }))
            .collect();
        let most = views.len().min(ORGAN_VIEWS_MOST);
        let views: Vec<Lit> = (0..most).map(|i| views[i * views.len() / most]).collect();
        let around = extents(mesh)?;
        let around = BoxUm { min: around.min, max: around.max };
        let eyes = Eyes::find(&views, &around, body.and_then(Body::left), body.and_then(Body::axis_at_head));
        let trunk = body.map(|body| Trunk {
            centres: body.stations.iter().map(|station| station.centre_um).collect(),
            radii_um: body.stations.iter().map(|station| (station.area_um2 / PI).sqrt()).collect(),
            has_head: body.head.end.is_some(),
            back: body.dorsal.direction,
            is_bound,
        });
        let bladder = SwimBladder::find(&views, trunk.as_ref(), &eyes);
        Some((eyes, bladder))
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

    /// Whether more than half of the views that carved surely show something else than one specimen. An opaque bead looks like a bubble.
    fn shows_not_one(&self) -> bool {
        let is_other =
            |found: &Detection| found.skip_reason().is_some() && (!self.settings.sphere || matches!(found.kind, Kind::Empty | Kind::Two));
        let carved = self.views.iter().filter(|v| self.carved.contains(&v.index));
        2 * carved.filter_map(|v| v.detection.as_ref()).filter(|found| is_other(found)).count() > self.carved.len()
    }

    /// Whether the scale of the camera contradicts the bore of its glass. The bore is that of most views.
    fn is_off_scale(&self) -> bool {
        let bores_um: Vec<f64> = self.views.iter().filter_map(|v| Some(v.walls.as_ref()?.bore_um)).collect();
        let glass = self.settings.camera.glass.as_ref().filter(|_| !bores_um.is_empty());
        glass.is_some_and(|glass| !BORE_SHARE.contains(&(upper_median(bores_um) / (2.0 * glass.bore_radius_um))))
    }

    /// The flags of the specimen, by what is known of its turn.
    fn flags(
        &self,
        quality: &Quality,
        model: &Model,
        fallback: Option<&Fallback>,
        calibration: Option<&Judged>,
        has_closure: bool,
    ) -> Vec<StoredFlag> {
        let clipped = |side: fn(&Detection) -> bool| {
            self.views.iter().any(|v| self.carved.contains(&v.index) && v.detection.as_ref().is_some_and(side))
        };
        let facts = FlagFacts {
            has_bad_view: self.views.iter().any(|v| !v.used),
            is_clipped: [clipped(Detection::is_clipped_left), clipped(Detection::is_clipped_right)],
            touches_box: model.touches_box,
            is_not_one: self.shows_not_one(),
            is_off_scale: self.is_off_scale(),
            has_moved: calibration.is_some_and(|judged| judged.calibration.moved.is_some()),
            is_sphere: self.settings.sphere,
            has_closure,
            is_nonconvex: fallback.is_some_and(Fallback::is_nonconvex),
            is_uncertain: fallback.is_some_and(|why| !why.is_nonconvex()),
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
