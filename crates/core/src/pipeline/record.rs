//! The numbers of a specimen and of its views, as `measurement.json` holds them.

use crate::calibration::PoseOffset;
use crate::fins::Fin;
use crate::flag::{Flag, StoredFlag};
use crate::geometry::{Camera, Projection};
use crate::inside::{Eyes, SwimBladder};
use crate::measure::Measurement;
use crate::measure::facing::Facing;
use crate::measure::shape::Shape;
use crate::profile::{Detection, ProfileQuality, Walls};
use crate::quality::{ClosureOff, ClosureSd, CoarseOutline, Quality, TurnFinding, UsualOpacity, ViewStrip, add_raised};
use crate::reconstruction::CalibrationRecord;
use crate::statistics::{median, upper_median};
use serde::{Deserialize, Serialize};

/// The result of one view.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// The outline of a long specimen, by which the same picture in another well is known, also in another format. `None` for a bead, without a
    /// profile, and in files of versions that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outline: Option<CoarseOutline>,
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
    /// Where the view sees the `fins` of the specimen, point by point: `[u, v]`, px to a tenth. Empty for a view that does not
    /// count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fins_px: Vec<Vec<[f64; 2]>>,
}

impl ViewRecord {
    /// Its entry in the residual strip.
    pub(super) fn strip(&self) -> ViewStrip {
        ViewStrip {
            view: self.index,
            used: self.used,
            reason: self.reason.clone(),
            residual_px: self.residual_px,
            overlap_percent: self.overlap_percent,
        }
    }
}

/// The walls in one frame as a ruler for the rig, in the column of the principal point. The walls are the same glass in every
/// frame: what changes is the rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WallRecord {
    /// Distance of the inner wall lines, um by the calibrated scale across.
    pub bore_um: f64,
    /// Middle of the bore below the calibrated axis, px.
    pub shift_px: f64,
    /// Tilt of the bore less the calibrated one, deg. Positive when the right end is lower.
    pub tilt_deg: f64,
}

impl WallRecord {
    pub(super) fn of(walls: &Walls, camera: &Camera) -> Self {
        Self {
            bore_um: walls.bore_px(camera.ux) / camera.ky,
            shift_px: walls.middle_v(camera.ux) - camera.uy,
            tilt_deg: walls.tilt_deg() - camera.gamma.to_degrees(),
        }
    }
}

/// The view at 0 deg compared with the view at 360 deg. Lost steps and a specimen that moved show only here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    pub(super) fn off(&self) -> ClosureOff {
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
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SpecimenRecord {
    /// Volume, area and size.
    pub measurement: Measurement,
    /// Shape of the mesh that is kept.
    #[serde(default)]
    pub shape: Option<Shape>,
    /// Which views show a larva's back, belly and sides. `None` for a bead, and where the shape does not determine a back.
    #[serde(default)]
    pub facing: Option<Facing>,
    /// The eyes of a larva. `None` for a bead, and where they were not looked for.
    #[serde(default)]
    pub eyes: Option<Eyes>,
    /// The swim bladder of a larva. `None` for a bead, and where it was not looked for.
    #[serde(default)]
    pub bladder: Option<SwimBladder>,
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
    /// Why the views do not show one specimen that turns at the angles of the ledger. Empty for a good turn. With a finding the numbers are not those
    /// of a specimen.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turn_findings: Vec<TurnFinding>,
    /// What is wrong with the numbers: codes of the table in docs/quality.md. An earlier version may have raised others.
    pub flags: Vec<StoredFlag>,
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

    /// Median blur of the views, px. `None` where no view shows it.
    pub fn blur_px(&self) -> Option<f64> {
        let blurs: Vec<f64> = self.views.iter().filter_map(|view| view.quality?.blur_px).collect();
        (!blurs.is_empty()).then(|| upper_median(blurs))
    }

    /// Median opacity of the larva over the views that count, 0 (clear) to 1 (black). `None` where no view shows it, and for a bead.
    pub fn opacity(&self) -> Option<f64> {
        if self.measurement.sphere.is_some() {
            return None;
        }
        median(self.views.iter().filter(|view| view.used).filter_map(|view| view.detection?.opacity).collect())
    }

    /// Compares the larva with those that the rig measured before it: it looks dead if most views show it opaque and it is so beside them.
    pub fn compare_with_earlier(&mut self, usual: UsualOpacity) {
        let seen: Vec<bool> = self.views.iter().filter(|view| view.used).filter_map(|view| Some(view.detection?.looks_dead())).collect();
        let is_opaque = 2 * seen.iter().filter(|yes| **yes).count() > seen.len();
        self.flags.retain(|flag| *flag != Flag::DeadLooking);
        if is_opaque && self.opacity().is_some_and(|opacity| usual.is_exceeded_by(opacity)) {
            self.flags.push(Flag::DeadLooking.into());
        }
    }

    /// Adds the comparison with reference larvae of the same age: volume and area in standard deviations from their mean, and
    /// the number that is allowed.
    pub fn compare_with_references(&mut self, [volume_z, area_z]: [Option<f64>; 2], limit: f64) {
        let quality = self.quality.take().unwrap_or_default().among_references(volume_z, area_z, limit);
        self.flags.retain(|flag| *flag != Flag::VolumeOffReferences && *flag != Flag::AreaOffReferences);
        add_raised(&mut self.flags, &quality);
        self.quality = Some(quality);
    }
}

/// Compares the area of each profile with those of its neighbours around the turn. Views without a profile are left out.
pub(super) fn compare_areas(views: &mut [ViewRecord]) {
    const TO_EITHER_SIDE: usize = 2;
    let areas: Vec<(usize, f64)> = views.iter().enumerate().filter_map(|(at, v)| Some((at, v.area_px? as f64))).collect();
    let n = areas.len();
    // Fewer views would be their own neighbours on the other side.
    if n <= 2 * TO_EITHER_SIDE {
        return;
    }
    for (k, (at, area)) in areas.iter().enumerate() {
        let near: [f64; 2 * TO_EITHER_SIDE] = std::array::from_fn(|i| {
            let away = if i < TO_EITHER_SIDE { n - 1 - i } else { i - TO_EITHER_SIDE + 1 };
            areas[(k + away) % n].1
        });
        views[*at].area_ratio = median(near.to_vec()).map(|median| area / median);
    }
}
