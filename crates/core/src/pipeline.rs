//! From frames to numbers: the one path that live runs, replays and offline measuring share.
//!
//! ```text
//! RawFrame + omega ─> Picture ─> Profile ─> carver ─> live volume      per view, in any order
//!                                           │ └─> surface ─> measures  after the last view
//!                                           └─ calibrated, carved again, for the live volume: where whoever drives it has time
//! ```
//! Pure: the same frames and angles give the same bytes of numbers, whoever asks.

use crate::calibration::{Calibration, Lie, Verdict, ViewState};
use crate::carver::Leaves;
use crate::frame::RawFrame;
use crate::geometry::{Camera, GridError, VoxelGrid};
use crate::measure::Measurement;
use crate::measure::facing::Facing;
use crate::measure::shape::Shape;
use crate::profile::{
    Detection, Mask, Picture, Polygon, Profile, ProfileError, ProfileQuality, Reference, SegmentSettings, Segmenters, Walls,
};
use crate::quality::{
    CalibrationOff, ClosureOff, ClosureSd, Estimate, OFF_REFERENCES, Quality, QualitySettings, Spoiled, TurnFacts, ViewStrip, spoiled,
};
use crate::reconstruction::{
    Calibrated, CalibrationRecord, LiveVolume, NotCalibrated, Reconstruction, ReconstructionError, ReconstructionSettings, TurnModel,
};
use crate::surface::Mesh;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Everything the numbers depend on besides the frames and their angles.
#[derive(Debug, Clone, PartialEq)]
pub struct PipelineSettings {
    pub camera: Camera,
    pub grid: VoxelGrid,
    pub planned_views: u32,
    pub segment: SegmentSettings,
    /// The empty capillary, which every frame is compared with where there is such a picture.
    pub reference: Option<Arc<Reference>>,
    pub reconstruction: ReconstructionSettings,
    pub quality: QualitySettings,
    /// A sphere is fitted to what should be one.
    pub sphere: bool,
}

/// What one view gave.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ViewRecord {
    pub index: u32,
    /// Angle of the capillary from the ledger's achieved steps, rad.
    pub omega: f64,
    /// A view counts or it does not.
    pub used: bool,
    /// Why it does not.
    pub reason: Option<String>,
    /// Pixels inside the profile.
    pub area_px: Option<usize>,
    /// That area over the median of the neighbouring views' (two to either side around the turn): from view to view a
    /// profile changes little, unless one of them is wrong.
    #[serde(default)]
    pub area_ratio: Option<f64>,
    pub quality: Option<ProfileQuality>,
    /// What the frame shows.
    #[serde(default)]
    pub detection: Option<Detection>,
    /// The capillary's walls against the rig's calibration.
    #[serde(default)]
    pub walls: Option<WallRecord>,
    /// The profile's shift down the image against the turn's camera.
    #[serde(default)]
    pub dy_px: Option<f64>,
    /// Between its edges and what all other views make expected, root of the mean square.
    #[serde(default)]
    pub residual_px: Option<f64>,
    /// Of what no view misses (VRV), seen again in this view.
    #[serde(default)]
    pub vrv_area_um2: Option<f64>,
    /// That area over the profile's, %.
    #[serde(default)]
    pub overlap_percent: Option<f64>,
}

/// The walls of one frame as a ruler laid on the rig's calibration, in the column of the principal point. The walls are the
/// same glass in every frame: what changes here is the rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WallRecord {
    /// Between the inner wall lines, by the calibrated scale across.
    pub bore_um: f64,
    /// The bore's middle below the calibrated axis, px.
    pub shift_px: f64,
    /// The bore's tilt less the calibrated one, positive when the right end is lower, degrees.
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

/// The view at 0 deg against the view at 360 deg: lost steps and a specimen that moved show only here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClosureRecord {
    /// Intersection over union of the two profiles.
    pub iou: f64,
    /// Shift of the profile's centroid, px: along the capillary and across it.
    pub shift_px: [f64; 2],
    /// How the specimen lies at 360 deg against how it lay at 0, by the model of the turn.
    #[serde(default)]
    pub lie: Option<Lie>,
}

/// The views' median blur may be off the configured one by this, px: from specimen to specimen it varies by 0.07 px. Each edge is
/// placed at its own frame's blur, so that this says no more than that the focus is not what it was.
const BLUR_MISMATCH_PX: f64 = 0.15;

/// The numbers of a specimen and what they rest on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpecimenRecord {
    pub measurement: Measurement,
    /// Of the kept mesh.
    #[serde(default)]
    pub shape: Option<Shape>,
    /// Which views show a larva's back, belly and sides; nothing of a bead, or where the shape tells no back.
    #[serde(default)]
    pub facing: Option<Facing>,
    pub views: Vec<ViewRecord>,
    pub closure: Option<ClosureRecord>,
    /// Of the turn itself; nothing where it is measured with the rig's camera.
    #[serde(default)]
    pub calibration: Option<CalibrationRecord>,
    /// Why it is measured with the rig's camera, where it should not have been.
    #[serde(default)]
    pub uncalibrated: Option<String>,
    /// Every number that is held against a limit of the method.
    #[serde(default)]
    pub quality: Option<Quality>,
    /// `bad_view`, `clipped_left`, `clipped_right`, `outside_box`, `moved`, `closure_undecided` (the closure view cannot tell whether
    /// the specimen moved beyond a limit), `no_closure` (the view at 360 deg gave no
    /// profile, so that a specimen that moved would show in the residuals only), `dead_looking` (opaque throughout in most
    /// views), `blur_mismatch` (the frames are not as sharp as configured), `few_views`, `nonconvex` (the voxels are trusted), `uncalibrated`
    /// (measured with the rig's camera as it is), `calibration_gate` (another axis leaves a larger hull: views do not quite agree), `wrong_steps` (the capillary did not turn as far as the ledger says),
    /// and those of [`Quality`]: `unusable_views`, `residual`, `overlap`, `uncertain`, `calibration_off`, `volume_off_references`, `area_off_references`.
    pub flags: Vec<String>,
}

#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    #[error(transparent)]
    Grid(#[from] GridError),
    #[error(transparent)]
    Reconstruction(#[from] ReconstructionError),
    #[error("the frame is {found_width} x {found_height} px, the rig's camera {width} x {height} px")]
    FrameSize { width: u32, height: u32, found_width: u32, found_height: u32 },
    #[error("the picture of the empty capillary cannot be used: {0}")]
    Reference(ProfileError),
    #[error("{used} of {planned} views gave a profile; {needed} are needed. First reason: {reason}")]
    TooFewViews { used: usize, planned: u32, needed: usize, reason: String },
}

impl PipelineError {
    /// Whether camera, method or grid refuse every specimen, so that this one is not to blame.
    pub fn is_of_setup(&self) -> bool {
        match self {
            Self::Grid(_) | Self::FrameSize { .. } | Self::Reference(_) => true,
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

/// What the closure view shows.
struct ClosureProfile {
    mask: Mask,
    edge: Vec<Polygon>,
}

/// A specimen under reconstruction. Its numbers depend only on the newest take of each view and of the closure view, not on how
/// often or in which order views were taken again.
pub struct Pipeline {
    settings: PipelineSettings,
    segmenters: Segmenters,
    reconstruction: Reconstruction,
    views: Vec<ViewRecord>,
    /// The views that carved, in the order of carving.
    carved: Vec<u32>,
    /// The newest profile of view 0. `None` when the newest take of view 0 has no profile.
    first: Option<Mask>,
    /// The newest profile of the view at 360 deg. It is compared with `first` only when somebody asks, so that the result does not
    /// depend on the order of the takes.
    closure: Option<ClosureProfile>,
    /// What [`Self::judge`] found, while no view has come in since.
    calibrated: Option<Calibrated>,
}

/// What a turn looks like once all its views are in, before anything is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct TurnVerdict {
    /// The specimen is not where it was when the turn began.
    pub moved: bool,
    /// The views that spoil the model: those without a profile, and those that do not fit the others.
    pub spoiled: Vec<Spoiled>,
}

/// A frame looked at: its colours, and the profile or why there is none.
pub struct Seen {
    pub picture: Picture,
    pub profile: Result<Profile, ProfileError>,
}

impl PipelineSettings {
    /// The same with frames compared with this one of the empty capillary.
    pub fn compared_with(self, empty: Option<&RawFrame>) -> Result<Self, PipelineError> {
        let reference = empty.map(|frame| Reference::new(Picture::from_frame(frame), &self.segment.walls)).transpose();
        Ok(Self { reference: reference.map_err(PipelineError::Reference)?.map(Arc::new), ..self })
    }
}

impl Pipeline {
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

    pub fn settings(&self) -> &PipelineSettings {
        &self.settings
    }

    /// Looks at a frame; independent of every other, so any number may be looked at at once.
    pub fn look(&self, frame: &RawFrame) -> Result<Seen, PipelineError> {
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
        let profile = self.segmenters.segment(&picture, &self.settings.segment, self.settings.reference.as_deref());
        Ok(Seen { picture, profile })
    }

    /// Carves with one view and gives the live volume, um^3. A frame without a profile is left out by name.
    pub fn observe(&mut self, index: u32, omega: f64, seen: &Seen) -> Result<f64, PipelineError> {
        let mut volume_um3 = self.live().volume_um3;
        let mut record = ViewRecord {
            index,
            omega,
            detection: seen.profile.as_ref().ok().map(|p| p.detection),
            walls: seen.profile.as_ref().ok().map(|p| WallRecord::of(&p.walls, &self.settings.camera)),
            ..ViewRecord::default()
        };
        if index == 0 {
            self.first = seen.profile.as_ref().ok().filter(|p| p.mask.area_px() > 0).map(|p| p.mask.clone());
        }
        match &seen.profile {
            Ok(p) if p.mask.area_px() == 0 => record.reason = Some("no specimen in the frame".into()),
            Ok(p) => {
                let leaves = Leaves { left: p.detection.is_clipped_left(), right: p.detection.is_clipped_right() };
                volume_um3 = self.reconstruction.observe(&p.mask, &p.edge, omega, leaves)?.volume_um3;
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

    /// Takes the view at 360 deg, which is compared with view 0 and never carved. A newer take replaces an older one, also when the
    /// newer one has no profile.
    pub fn observe_closure(&mut self, seen: &Seen) {
        let profile = seen.profile.as_ref().ok();
        self.closure = profile.map(|p| ClosureProfile { mask: p.mask.clone(), edge: p.edge.clone() });
    }

    /// The closure view against view 0. `None` when either has no profile.
    fn closure(&self) -> Option<ClosureRecord> {
        let (first, last) = (self.first.as_ref()?, &self.closure.as_ref()?.mask);
        let shift_px = first.centroid().zip(last.centroid()).map_or([0.0; 2], |(a, b)| [b[0] - a[0], b[1] - a[1]]);
        Some(ClosureRecord { iou: first.iou(last), shift_px, lie: None })
    }

    /// Replaces a view by a newer take of it.
    ///
    /// # Errors
    /// As [`Self::observe`].
    pub fn replace(&mut self, index: u32, omega: f64, seen: &Seen) -> Result<f64, PipelineError> {
        if let Some(at) = self.carved.iter().position(|view| *view == index) {
            self.reconstruction.take_back(at)?;
            self.carved.remove(at);
        }
        self.views.retain(|v| v.index != index);
        self.observe(index, omega, seen)
    }

    /// Calibrates on all views and says whether the specimen stayed where it was, and which views are to be taken again;
    /// [`Self::finish`] then need not calibrate anew.
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
        let off = |c: &ClosureRecord| {
            let [along_px, across_px] = c.shift_px.map(f64::abs);
            // Of the centroids, which a fin that one of the two lacks carries by as much as a limit; the model tells it better, in the end.
            c.iou < limits.closure_overlap || along_px > 2.0 * limits.closure_along_px || across_px > 2.0 * limits.closure_across_px
        };
        let moved = self.closure().as_ref().is_some_and(off) || calibrated.has_moved();
        let spoiled = spoiled(&strip, limits.residual_view_px);
        self.calibrated = Some(calibrated);
        TurnVerdict { moved, spoiled }
    }

    /// The volume after the views so far with what few views make of it taken off. Takes as long as [`Self::refine`].
    pub fn estimate(&self) -> Option<Estimate> {
        self.reconstruction.estimate()
    }

    /// Ends the turn with the views taken so far, with or without a profile: from now on this is the number of planned views. Views
    /// may still be replaced, so that one without a profile may get one.
    ///
    /// # Errors
    /// When no view was taken yet.
    pub fn end_early(&mut self) -> Result<(), PipelineError> {
        self.reconstruction.replan(self.views.len())?;
        self.calibrated = None;
        self.settings.planned_views = self.views.len() as u32;
        Ok(())
    }

    /// The hull so far, through the best camera that is known of it.
    pub fn live(&self) -> LiveVolume {
        self.reconstruction.live()
    }

    /// Whether the live model would gain by [`Self::refine`]: enough views have come in since the last time, from enough sides.
    pub fn is_refinable(&self) -> bool {
        self.reconstruction.is_refinable()
    }

    /// Calibrates the live model on the views so far, which takes as long as a view or two. For whoever has the time: what
    /// [`Self::finish`] gives does not depend on it. The estimate is that of [`Self::estimate`].
    pub fn refine(&mut self) -> Option<Estimate> {
        self.reconstruction.refine()
    }

    /// Whether the live hull says that the end will not trust such an estimate.
    pub fn is_hollow(&self, estimate: &Estimate) -> bool {
        self.reconstruction.is_hollow(estimate)
    }

    /// The live hull as a mesh for looking at.
    pub fn live_mesh(&self) -> Mesh {
        self.reconstruction.live_mesh()
    }

    /// Surface and measures. The record is in the order of the views, whatever order they came in.
    pub fn finish(mut self) -> Result<(Mesh, SpecimenRecord), PipelineError> {
        self.views.sort_by_key(|v| v.index);
        compare_areas(&mut self.views);
        let used = self.reconstruction.hull().live().views;
        // Opposite views are mirror images: half a turn encloses the body, less leaves the hull open on a side.
        let needed = (self.settings.planned_views as usize).div_ceil(2).max(3);
        if used < needed {
            let reason = self.views.iter().find_map(|v| v.reason.clone()).unwrap_or_else(|| "views are missing".into());
            return Err(PipelineError::TooFewViews { used, planned: self.settings.planned_views, needed, reason });
        }
        let mut closure = self.closure();
        if let (Some(last), Some(first)) = (&self.closure, self.carved.iter().position(|view| *view == 0)) {
            self.reconstruction.observe_closure(&last.mask, &last.edge, first);
        }
        let TurnModel { model, hull, calibration, seen_again, closure: lie, .. } = {
            let calibrated = self.calibrated.take().unwrap_or_else(|| self.reconstruction.calibrate());
            self.reconstruction.measure(calibrated, self.settings.sphere)?
        };
        if let Ok(found) = &calibration {
            self.judged(&found.calibration.views, &seen_again);
        }
        if let Some(record) = &mut closure {
            record.lie = lie;
        }
        let found = calibration.as_ref().ok().map(|judged| &judged.calibration);
        let quality = self.quality(found, closure.as_ref(), &model.measurement);
        let mut flags = Vec::new();
        let mut flag = |raised: bool, name: &str| {
            if raised {
                flags.push(name.to_owned());
            }
        };
        flag(self.views.iter().any(|v| !v.used), "bad_view");
        let clipped = |side: fn(&Detection) -> bool| {
            self.views.iter().any(|v| self.carved.contains(&v.index) && v.detection.as_ref().is_some_and(side))
        };
        flag(clipped(Detection::is_clipped_left), "clipped_left");
        flag(clipped(Detection::is_clipped_right), "clipped_right");
        flag(hull.touches_box(), "outside_box");
        flag(quality.raises("few_views"), "few_views");
        let moved = quality.raises("moved") || found.is_some_and(|c| c.moved.is_some());
        flag(moved, "moved");
        // The turn of a bead cannot be told, and changes nothing.
        flag(quality.is_undecided() && !moved && !self.settings.sphere, "closure_undecided");
        flag(closure.is_none(), "no_closure");
        flag(looks_dead(&self.views), "dead_looking");
        flag(blur_is_off(&self.views, self.settings.segment.edge.blur_px), "blur_mismatch");
        flag(model.measurement.is_nonconvex(), "nonconvex");
        flag(found.is_none(), "uncalibrated");
        flag(calibration.as_ref().is_ok_and(|judged| judged.gate.verdict == Verdict::NotLargest), "calibration_gate");
        flag(quality.raises("wrong_steps"), "wrong_steps");
        for name in quality.flags() {
            if !flags.iter().any(|f| f == name) {
                flags.push(name.to_owned());
            }
        }
        let shape = Shape::of(&model.mesh);
        let taken: Vec<(u32, f64)> = self.views.iter().map(|v| (v.index, v.omega)).collect();
        let camera = found.map_or(&self.settings.camera, |c| &c.camera);
        let facing = if self.settings.sphere { None } else { Facing::of(&shape, camera, &taken) };
        let record = SpecimenRecord {
            measurement: model.measurement,
            shape: Some(shape),
            facing,
            views: self.views,
            closure,
            calibration: calibration.as_ref().ok().map(CalibrationRecord::from),
            uncalibrated: calibration.as_ref().err().filter(|why| **why != NotCalibrated::NotAsked).map(ToString::to_string),
            quality: Some(quality),
            flags,
        };
        Ok((model.mesh, record))
    }

    /// Holds the turn against the method's limits.
    fn quality(&self, found: Option<&Calibration>, closure: Option<&ClosureRecord>, measured: &Measurement) -> Quality {
        let strip: Vec<ViewStrip> = self.views.iter().map(ViewRecord::strip).collect();
        let omegas: Vec<f64> = self.views.iter().filter(|v| v.used).map(|v| v.omega).collect();
        let rig = &self.settings.camera;
        let facts = TurnFacts {
            planned_views: self.settings.planned_views as usize,
            omegas: &omegas,
            strip: &strip,
            closure: closure.map(|c| ClosureOff {
                overlap: c.iou,
                along_px: c.lie.map_or(c.shift_px[0], |l| l.along_px),
                across_px: c.lie.map_or(c.shift_px[1], |l| l.across_px),
                turn_deg: c.lie.map(|l| l.turn_rad.to_degrees()),
                sd: c.lie.and_then(|l| l.sd).map(|sd| ClosureSd {
                    along_px: sd.along_px,
                    across_px: sd.across_px,
                    turn_deg: sd.turn_rad.to_degrees(),
                }),
            }),
            calibration: found.map(|c| CalibrationOff {
                uy_px: c.camera.uy - rig.uy,
                gamma_deg: (c.camera.gamma - rig.gamma).to_degrees(),
                alpha_deg: (c.camera.alpha - rig.alpha).to_degrees(),
                rho_percent: 100.0 * (c.rho - 1.0),
                is_rho_told: c.tells_steps(),
            }),
            volume_sd_percent: measured.spread.map(|s| 100.0 * s.volume_of_turn_um3() / measured.volume_um3),
        };
        Quality::of(&facts, &self.settings.quality)
    }

    /// Writes down what the calibration found of the views that carved.
    fn judged(&mut self, states: &[ViewState], seen_again: &[Option<[f64; 2]>]) {
        for ((index, state), again) in self.carved.iter().zip(states).zip(seen_again) {
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
    /// Holds volume and area against reference larvae of its age: standard deviations from their mean, and how many are allowed.
    pub fn held_against(&mut self, [volume_z, area_z]: [Option<f64>; 2], limit: f64) {
        let quality = self.quality.take().unwrap_or_default().among_references(volume_z, area_z, limit);
        self.flags.retain(|f| !OFF_REFERENCES.contains(&f.as_str()));
        for name in quality.flags() {
            if !self.flags.iter().any(|f| f == name) {
                self.flags.push(name.to_owned());
            }
        }
        self.quality = Some(quality);
    }
}

/// Holds each profile's area against those of its neighbours around the turn; views without a profile are passed over.
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

/// Whether most of the views that carved show a dead larva.
fn looks_dead(views: &[ViewRecord]) -> bool {
    let used: Vec<bool> = views.iter().filter(|v| v.used).filter_map(|v| Some(v.detection?.looks_dead())).collect();
    2 * used.iter().filter(|dead| **dead).count() > used.len()
}

/// Whether the views' median blur is another than the configured one; views that don't tell are left out.
fn blur_is_off(views: &[ViewRecord], configured_px: f64) -> bool {
    let mut found: Vec<f64> = views.iter().filter_map(|v| v.quality?.blur_px).collect();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).is_some_and(|median| (median - configured_px).abs() > BLUR_MISMATCH_PX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_areas_neighbours_are_those_around_the_turn_that_have_one() {
        let view = |index: u32, area_px: Option<usize>| ViewRecord { index, used: area_px.is_some(), area_px, ..ViewRecord::default() };
        let mut views: Vec<_> =
            [Some(100), Some(100), None, Some(150), Some(100), Some(80)].into_iter().zip(0..).map(|(a, i)| view(i, a)).collect();
        compare_areas(&mut views);
        let ratios: Vec<_> = views.iter().map(|v| v.area_ratio).collect();
        // View 3's neighbours are 0, 1, 4 and 5: 100, 100, 100, 80.
        assert_eq!(ratios[3], Some(1.5));
        assert_eq!((ratios[2], ratios[0]), (None, Some(1.0)));
        assert_eq!(ratios[5], Some(0.8));
        let mut few: Vec<_> = (0..4).map(|i| view(i, Some(9))).collect();
        compare_areas(&mut few);
        assert!(few.iter().all(|v| v.area_ratio.is_none()));
    }
}
