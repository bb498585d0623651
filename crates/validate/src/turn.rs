//! One turn of a specimen of known size, and its numbers by both estimators.
//!
//! ```text
//!   Phantom + Disturbance ── outlines ── Turn ──┬─ calibrate ── sections ── Support      ours
//!   rendered frames ───────────┘   (some stops) └─ projections ── carve ─── Voxels       the paper's
//! ```

use crate::camera::camera;
use carved_core::calibration::{Calibration, CalibrationError, GivenView, Pose, Priors, TurnView, calibrate};
use carved_core::carver::{Carver, Leaves};
use carved_core::geometry::{BoxUm, Camera, Projection, VoxelGrid};
use carved_core::measure::support::{Sections, SupportEstimate, calibration_sd};
use carved_core::measure::{self, Spread, fit_sphere};
use carved_core::pipeline::{Pipeline, PipelineSettings};
use carved_core::profile::{Columns, Mask, Polygon, SegmentSettings};
use carved_core::quality::{Estimate, QualitySettings};
use carved_core::reconstruction::{ReconstructionSettings, SurfaceSettings, is_seen_around};
use carved_core::surface::{self, Fairing, Occupancy};
use hardware_sim::analytic::{self, Disturbance, Phantom};
use hardware_sim::scene::{self, Truth};
use std::f64::consts::TAU;

/// Share of the views that may miss a voxel, as in the paper.
pub const EPSILON: f64 = 0.05;
/// Number of captured views in a turn; smaller samplings are even subsets.
pub const CAPTURED: usize = 84;
pub const ASDS: [usize; 8] = [4, 7, 12, 14, 21, 28, 42, CAPTURED];

/// The truth while a simulated turn was taken.
#[derive(Debug, Clone)]
pub struct True {
    pub camera: Camera,
    /// Shift of each view, px.
    pub dy_px: Vec<f64>,
    pub size: Truth,
}

/// The profiles of a turn, with what a rig would know about it.
#[derive(Debug, Clone)]
pub struct Turn {
    pub nominal: Camera,
    pub ledger: Vec<f64>,
    pub outlines: Vec<Vec<Polygon>>,
    pub columns: Vec<Columns>,
    /// The masks from segmentation. `None` for analytic profiles, whose masks are made on request.
    filled: Option<Vec<Mask>>,
    pub truth: True,
}

/// The angles of equal steps over one turn, rad.
pub fn even_plan(views: usize) -> Vec<f64> {
    (0..views).map(|i| TAU * i as f64 / views as f64).collect()
}

/// Indices of the stops of a captured turn that make an even turn with fewer views.
pub fn even_stops(asd: usize) -> Vec<usize> {
    (0..asd).map(|i| i * CAPTURED / asd).collect()
}

impl Turn {
    /// A finless larva of 3, 4 or 5 dpf anywhere in the capillary, with a turn of even steps.
    ///
    /// # Errors
    /// None for these ages.
    pub fn of_larva(seed: u64, views: usize, disturbance: &Disturbance) -> anyhow::Result<Self> {
        let phantom = Phantom::larva(3 + (seed % 3) as u8, seed)?.placed(analytic::Pose::seeded(seed));
        Ok(Self::of(&phantom, &scene::Camera::default(), &even_plan(views), disturbance))
    }

    /// A turn with analytic profiles.
    pub fn of(phantom: &Phantom, nominal: &scene::Camera, ledger: &[f64], disturbance: &Disturbance) -> Self {
        let views = phantom.views(nominal, ledger, disturbance);
        let truth =
            True { camera: camera(&disturbance.camera(nominal)), dy_px: views.iter().map(|v| v.dy_px).collect(), size: phantom.truth() };
        let outlines = views.into_iter().map(|v| v.outline.into_iter().map(|vertices| Polygon { vertices }).collect()).collect();
        Self::new(camera(nominal), ledger.to_vec(), outlines, None, truth)
    }

    pub fn new(nominal: Camera, ledger: Vec<f64>, outlines: Vec<Vec<Polygon>>, filled: Option<Vec<Mask>>, truth: True) -> Self {
        let (width, height) = (nominal.width as usize, nominal.height as usize);
        let columns = outlines.iter().map(|o| Columns::from_outlines(o, width, height)).collect();
        Self { nominal, ledger, outlines, columns, filled, truth }
    }

    pub fn all(&self) -> Vec<usize> {
        (0..self.ledger.len()).collect()
    }

    pub fn given(&self, stops: &[usize]) -> Vec<GivenView<'_>> {
        stops.iter().map(|&i| GivenView { columns: &self.columns[i], omega: self.ledger[i] }).collect()
    }

    /// The views without calibration: the rig's camera and the ledger's angles.
    pub fn as_planned(&self, stops: &[usize]) -> Vec<TurnView<'_>> {
        stops.iter().map(|&i| TurnView { columns: &self.columns[i], omega: self.ledger[i], dy_px: 0.0 }).collect()
    }

    /// Calibrates the turn of these stops.
    ///
    /// # Errors
    /// Those of [`calibrate`].
    pub fn calibrated(&self, stops: &[usize]) -> Result<Calibration, CalibrationError> {
        calibrate(&self.nominal, &self.given(stops), Priors::default())
    }

    /// Mean shift of these stops, px, which `uy` absorbs.
    pub fn mean_dy_px(&self, stops: &[usize]) -> f64 {
        stops.iter().map(|&i| self.truth.dy_px[i]).sum::<f64>() / stops.len().max(1) as f64
    }

    /// Error of `uy`, px.
    pub fn uy_error_px(&self, stops: &[usize], found: &Camera) -> f64 {
        found.uy - self.truth.camera.uy - self.mean_dy_px(stops)
    }

    pub fn gamma_error_deg(&self, found: &Camera) -> f64 {
        (found.gamma - self.truth.camera.gamma).to_degrees()
    }

    /// One mask per stop.
    pub fn masks(&self) -> Vec<Mask> {
        self.filled.clone().unwrap_or_else(|| self.outlines.iter().map(|outlines| filled(outlines, &self.nominal)).collect())
    }
}

fn filled(outlines: &[Polygon], camera: &Camera) -> Mask {
    let outlines: Vec<Vec<[f64; 2]>> = outlines.iter().map(|p| p.vertices.clone()).collect();
    let covered = analytic::coverage(&outlines, camera.width, camera.height);
    let width = camera.width as usize;
    let mut mask = Mask::empty(width, camera.height as usize);
    for (at, _) in covered.data.iter().enumerate().filter(|(_, c)| **c >= 128) {
        mask.set(at % width, at / width, true);
    }
    mask
}

/// The numbers of a calibrated turn by the support function. The standard deviations cover views and calibration: they are for another turn
/// of the same specimen on the same rig.
#[derive(Debug, Clone)]
pub struct Support {
    pub estimate: SupportEstimate,
    pub volume_sd_um3: f64,
    pub area_sd_um2: f64,
}

/// The numbers by the support function. `None` if the views have too few slices in common, or the uncertainty of the calibration is not
/// known.
pub fn support(turn: &Turn, stops: &[usize], found: &Calibration) -> Option<Support> {
    let given = turn.given(stops);
    let views = found.turn_views(&given);
    let estimate = sections(&Pose::new(&found.camera), &views, found.residual_sd_um)?;
    let [volume, area] = calibration_sd(found, &given).ok()?;
    let (volume_sd_um3, area_sd_um2) = (estimate.volume_sd_um3.hypot(volume), estimate.area_sd_um2.hypot(area));
    Some(Support { estimate, volume_sd_um3, area_sd_um2 })
}

/// The estimate of the pipeline after these stops, as during a turn.
pub fn estimate(turn: &Turn, stops: &[usize]) -> Option<Estimate> {
    let mut stops = stops.to_vec();
    stops.sort_unstable();
    if !is_seen_around(stops.iter().map(|&i| turn.ledger[i])) {
        return None;
    }
    let found = turn.calibrated(&stops).ok()?;
    let given = turn.given(&stops);
    let sections = Sections::of(&Pose::new(&found.camera), &found.turn_views(&given), found.residual_sd_um, [false; 2]).ok()?;
    let support = SupportEstimate::of(&sections);
    let [volume_calibration_um3, _] = calibration_sd(&found, &given).ok()?;
    let spread = Spread {
        volume_views_um3: support.volume_sd_um3,
        volume_calibration_um3,
        volume_corners_um3: sections.left_out_um3(),
        ..Spread::default()
    };
    Estimate::of(stops.len(), &support, &spread)
}

pub fn sections(pose: &Pose, views: &[TurnView], sd_um: f64) -> Option<SupportEstimate> {
    Sections::of(pose, views, sd_um, [false; 2]).ok().map(|s| SupportEstimate::of(&s))
}

/// The paper's numbers of a hull.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Voxels {
    pub volume_um3: f64,
    pub area_um2: f64,
    /// Diameter of the sphere nearest to the surface. `None` unless requested.
    pub diameter_um: Option<f64>,
}

/// Carves and measures as the paper does, without the field surface, which takes most of a model's time.
///
/// # Errors
/// Those of carving and fairing.
pub fn voxels(grid: VoxelGrid, views: &[(&Mask, Projection)], sphere: bool) -> anyhow::Result<Voxels> {
    let mut carver = Carver::new(grid, views.len(), EPSILON)?;
    for (mask, projection) in views {
        carver.observe(mask, projection, Leaves::default())?;
    }
    let SurfaceSettings { fairing_lambda: lambda, fairing_iterations: iterations } = SurfaceSettings::default();
    let mesh = surface::fair(&surface::extract(&Occupancy(&carver)), Fairing { lambda, iterations })?;
    let diameter_um = if sphere { Some(fit_sphere(&mesh.vertices)?.diameter_um) } else { None };
    Ok(Voxels { volume_um3: carver.volume_um3(), area_um2: measure::area(&mesh), diameter_um })
}

/// The views that a calibration kept, with their masks. `masks` has one mask per stop of the turn.
pub fn calibrated_views<'a>(turn: &Turn, masks: &'a [Mask], stops: &[usize], found: &Calibration) -> Vec<(&'a Mask, Projection)> {
    stops
        .iter()
        .enumerate()
        .filter(|(at, _)| found.views[*at].bad.is_none())
        .map(|(at, &stop)| (&masks[stop], found.projection(at, turn.ledger[stop])))
        .collect()
}

/// Edge of the voxels of rendered turns, um. The volume by support functions does not depend on the voxels, which are coarse to save time.
pub const VOXEL_UM: f64 = 20.0;

/// The pipeline of the instrument, for turns of one camera that are rendered.
pub fn pipeline(camera: &Camera, planned_views: usize, voxel_um: f64) -> anyhow::Result<Pipeline> {
    let bounds = BoxUm { min: [-2800.0, -350.0, -350.0], max: [2800.0, 350.0, 350.0] };
    Ok(Pipeline::new(PipelineSettings {
        camera: camera.clone(),
        grid: VoxelGrid::new(bounds, voxel_um)?,
        planned_views: planned_views as u32,
        segment: SegmentSettings::default(),
        empty_capillary: None,
        reconstruction: ReconstructionSettings::default(),
        quality: QualitySettings::default(),
        sphere: false,
    })?)
}

/// The paper's box at a sampling density.
///
/// # Errors
/// None for the densities in use.
pub fn grid(voxel_um: f64) -> anyhow::Result<VoxelGrid> {
    Ok(VoxelGrid::new(BoxUm::PAPER, voxel_um)?)
}

/// Error of a number, per cent.
pub fn off(found: f64, truth: f64) -> f64 {
    100.0 * (found / truth - 1.0)
}
