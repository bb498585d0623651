//! From profiles to a measured model: the one path of a live run, of replay and of offline work.
//!
//! ```text
//!  (Mask, outlines, omega) per view ── observe ── LiveVolume           after each view
//!                                         │ ├──── live_mesh            coarse, for the page
//!                                         │ ├──── refine               now and then: the live model's own calibration
//!                                         │ └──── estimate             the volume so far
//!                                       finish ── calibrate ── carve again ── Model       mesh and measurement
//!                                                     └── support functions ──┘
//! ```
//! A model has two surfaces. The paper's is the surface of the binary voxels after fairing; its tables refer to it. The field's
//! surface lies where the outlines put it, at their sub-pixel positions, and needs no fairing; this mesh is kept. The same
//! views in any order give the same model bit for bit, on any number of threads.

use crate::carver::{CarveError, Carver, Leaves};
use crate::geometry::{CameraError, Projection, VoxelGrid};
use crate::measure::{self, AreaMethod, Estimator, Estimators, Extents, Measurement, SphereError, VoxelEstimate};
use crate::parallel::prelude::*;
use crate::profile::{Mask, Polygon};
use crate::range::{OutOfRange, Range, Ranged};
use crate::ranges;
use crate::surface::{self, Contour, ContourError, Distance, Fairing, FairingError, Mesh, Occupancy};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

mod calibrated;
mod estimated;
mod finned;
mod refined;
mod turn;

pub use calibrated::{Calibrated, CalibrationRecord, CalibrationSettings, Judged, NotCalibrated};
pub use finned::Finned;
pub use refined::is_seen_around;
pub use turn::{Reconstruction, TurnModel};

/// How the surface is made from the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceSettings {
    /// Weight of the umbrella operator in one iteration of the implicit fairing. A larger weight gives a smoother and smaller surface.
    pub fairing_lambda: f64,
    /// Iterations of the implicit fairing. With 0 the surface is not faired.
    pub fairing_iterations: usize,
}

impl Default for SurfaceSettings {
    /// The ten iterations of the paper, and the weight that reproduces its areas.
    fn default() -> Self {
        Self { fairing_lambda: 0.8, fairing_iterations: 10 }
    }
}

impl Ranged for SurfaceSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        // With a larger weight the solver does not converge within its steps.
        fairing_lambda: 0.0, 100.0, "(weight)";
        fairing_iterations: 0.0, 1000.0, "iterations";
    ];
}

/// What the model depends on besides views, camera and grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReconstructionSettings {
    /// Share of the planned views that may miss a voxel of the hull.
    pub epsilon: f64,
    /// How the surface is made from the voxels.
    pub surface: SurfaceSettings,
    /// How the turn calibrates its own camera.
    pub calibration: CalibrationSettings,
}

impl Default for ReconstructionSettings {
    fn default() -> Self {
        Self { epsilon: 0.05, surface: SurfaceSettings::default(), calibration: CalibrationSettings::default() }
    }
}

/// Why there is no model.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ReconstructionError {
    /// The camera is not valid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The carver refused the view or the grid.
    #[error(transparent)]
    Carve(#[from] CarveError),
    /// The mask does not have the size of the sensor.
    #[error("the mask is {width} x {height} px, the camera's sensor {sensor_width} x {sensor_height}")]
    MaskSize {
        /// Columns of the mask, px.
        width: usize,
        /// Rows of the mask, px.
        height: usize,
        /// Columns of the sensor, px.
        sensor_width: u32,
        /// Rows of the sensor, px.
        sensor_height: u32,
    },
    /// The angle of the view is not a finite number.
    #[error("omega is {found}; an angle is a finite number of rad")]
    Omega {
        /// The angle that was given, rad.
        found: f64,
    },
    /// No view was observed, or none counts.
    #[error("{observed} of {planned} planned views were observed; nothing is measured before the first")]
    NoViews {
        /// Views that were observed.
        observed: usize,
        /// Views of the plan.
        planned: usize,
    },
    /// No voxel is left.
    #[error(
        "no voxel of the grid is left after {observed} views: the profiles do not agree on a body. Check masks, angles, camera and box"
    )]
    EmptyHull {
        /// Views that were observed.
        observed: usize,
    },
    /// A part of the voxel box is not in front of the camera.
    #[error(
        "the camera's plane cuts the voxel box, or the box lies behind the camera: its corners lie from {nearest} to {farthest} in front of the camera, in the \
         unit of the box (um on an instrument). The box must lie wholly before it: check the projection, the box and their units"
    )]
    CameraInBox {
        /// Depth of the box's nearest corner, um.
        nearest: f64,
        /// Depth of the box's farthest corner, um.
        farthest: f64,
    },
    /// The outline of a view gives no distances.
    #[error(transparent)]
    Contour(#[from] ContourError),
    /// A setting is out of its range.
    #[error(transparent)]
    Setting(#[from] OutOfRange),
    /// The surface could not be faired.
    #[error(transparent)]
    Fairing(#[from] FairingError),
    /// No sphere could be fitted to the surface.
    #[error("sphere: {0}")]
    Sphere(#[from] SphereError),
}

/// The hull after a view. Through one camera its volume never increases.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LiveVolume {
    /// Number of views observed so far.
    pub views: usize,
    /// Number of voxels left.
    pub voxels: u64,
    /// Their volume, um^3.
    pub volume_um3: f64,
}

/// The model after all views.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Surface of the field: the hull where the views' outlines put it. This mesh is kept.
    pub mesh: Mesh,
    /// Surface of the voxels, before fairing.
    pub unfaired: Mesh,
    /// The numbers of both surfaces.
    pub measurement: Measurement,
    /// Whether the hull reaches the outermost voxels of the grid. The body may then continue outside.
    pub touches_box: bool,
}

/// A model of views through any projections.
#[derive(Debug, Clone)]
pub struct HullModel {
    carver: Carver,
    /// Contours of the views that carved.
    contours: Vec<Contour>,
    settings: ReconstructionSettings,
}

/// A view that carves.
struct Silhouette<'a> {
    mask: Cow<'a, Mask>,
    /// The outlines that the mask was filled from; without any, the sides of its pixels are used.
    outlines: &'a [Polygon],
    projection: Projection,
    leaves: Leaves,
}

impl HullModel {
    /// An empty model: no view is observed, and every voxel is left.
    ///
    /// # Errors
    ///
    /// A setting or a grid from which no model can be made.
    pub fn new(grid: VoxelGrid, planned_views: usize, settings: ReconstructionSettings) -> Result<Self, ReconstructionError> {
        if let Some(wrong) = settings.surface.outside().into_iter().next() {
            return Err(wrong.into());
        }
        Ok(Self { carver: Carver::new(grid, planned_views, settings.epsilon)?, contours: Vec::new(), settings })
    }

    /// Carves with one view. `outlines` are those that the mask was filled from; without any, the sides of the mask's pixels
    /// are used.
    ///
    /// # Errors
    ///
    /// Whatever the carver refuses, and a camera that does not have the whole box in front of it. The model is then unchanged.
    pub fn observe(
        &mut self,
        mask: &Mask,
        outlines: &[Polygon],
        projection: &Projection,
        leaves: Leaves,
    ) -> Result<LiveVolume, ReconstructionError> {
        self.observe_all(&[Silhouette { mask: Cow::Borrowed(mask), outlines, projection: *projection, leaves }])?;
        Ok(self.live())
    }

    /// Carves with some views, one after the other. Their contours are made first, on all cores.
    fn observe_all(&mut self, views: &[Silhouette]) -> Result<(), ReconstructionError> {
        let contours: Vec<Result<Contour, _>> = views.par_iter().map(|view| self.contour(view)).collect();
        for (Silhouette { mask, projection, leaves, .. }, contour) in views.iter().zip(contours) {
            let contour = contour?;
            self.carver.observe(mask, projection, *leaves)?;
            self.contours.push(contour);
        }
        Ok(())
    }

    /// The distances of a view's outline.
    fn contour(&self, view: &Silhouette) -> Result<Contour, ReconstructionError> {
        let Silhouette { mask, outlines, projection, leaves } = view;
        let grid = self.carver.grid();
        let centre = std::array::from_fn(|a| f64::midpoint(grid.centre(a, 0), grid.centre(a, grid.counts()[a] - 1)));
        let depths: [f64; 8] = std::array::from_fn(|n| {
            projection.depth(std::array::from_fn(|a| grid.centre(a, if n >> a & 1 == 0 { 0 } else { grid.counts()[a] - 1 })))
        });
        let (nearest, farthest) = depths.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &d| (low.min(d), high.max(d)));
        // The box extends half a voxel beyond the outermost centres, at most one voxel along the line of sight.
        if nearest <= grid.size() {
            return Err(ReconstructionError::CameraInBox { nearest, farthest });
        }
        Ok(Contour::new(mask, outlines, projection, *leaves, centre, Distance::reach_um(grid))?)
    }

    /// Carves all views so far again with the tolerance of another plan.
    ///
    /// # Errors
    ///
    /// A plan of fewer views than were observed.
    pub fn replan(&mut self, planned_views: usize) -> Result<(), ReconstructionError> {
        Ok(self.carver.replan(planned_views)?)
    }

    /// The hull after the views so far.
    pub fn live(&self) -> LiveVolume {
        let carver = &self.carver;
        LiveVolume { views: carver.observed_views(), voxels: carver.live_voxels(), volume_um3: carver.volume_um3() }
    }

    /// The voxels.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// Whether a mesh of the hull reaches the outermost voxels of the grid. The body may then continue outside.
    fn touches_box(&self, extents: &Extents) -> bool {
        let grid = self.carver.grid();
        (0..3).any(|a| extents.min[a] < grid.centre(a, 0) || extents.max[a] > grid.centre(a, grid.counts()[a] - 1))
    }

    /// Makes the surfaces and measures them. `sphere` fits a sphere, for beads.
    ///
    /// # Errors
    ///
    /// No view was observed, no voxel is left, or no sphere is determined.
    pub fn finish(&self, sphere: bool) -> Result<Model, ReconstructionError> {
        let carver = &self.carver;
        let LiveVolume { views, voxels, volume_um3 } = self.live();
        if views == 0 {
            return Err(ReconstructionError::NoViews { observed: views, planned: carver.planned_views() });
        }
        let SurfaceSettings { fairing_lambda: lambda, fairing_iterations: iterations } = self.settings.surface;
        let unfaired = surface::extract(&Occupancy(carver));
        let faired = surface::fair(&unfaired, Fairing { lambda, iterations })?;
        let mesh = surface::extract(&Distance::new(carver, &self.contours));
        let empty = ReconstructionError::EmptyHull { observed: views };
        let (Some(centroid_um), Some(extents)) = (measure::centroid(&faired), measure::extents(&faired)) else { return Err(empty) };
        let mesh_volume_um3 = measure::volume(&faired);
        let extent_um = extents.sides();
        let area_um2 = measure::area(&faired);
        let sphere = if sphere { Some(measure::fit_sphere(&faired.vertices)?) } else { None };
        let measurement = Measurement {
            voxels,
            voxel_size_um: carver.grid().size(),
            views,
            planned_views: carver.planned_views(),
            epsilon: self.settings.epsilon,
            estimator: Estimator::Voxel,
            fallback: None,
            volume_um3,
            volume_sd_um3: None,
            mesh_volume_um3,
            fairing_volume_loss: 1.0 - mesh_volume_um3 / measure::volume(&unfaired),
            area_um2,
            area_sd_um2: None,
            spread: None,
            estimators: Estimators { voxel: VoxelEstimate { volume_um3, area_um2 }, support: None },
            unfaired_area_um2: measure::area(&unfaired),
            area_method: AreaMethod { operator: "umbrella".into(), lambda, iterations },
            field_volume_um3: measure::volume(&mesh),
            field_area_um2: measure::area(&mesh),
            centroid_um,
            extent_um,
            length_um: extent_um[0],
            sphere,
            diameter_um: sphere.map(|s| s.diameter_um),
            sphere_rms_um: sphere.map(|s| s.rms_um),
            aspect_ratio: sphere.map(|_| 2.0 * extent_um[0] / (extent_um[1] + extent_um[2])),
        };
        let touches_box = measure::extents(&unfaired).is_some_and(|extents| self.touches_box(&extents));
        Ok(Model { mesh, unfaired, measurement, touches_box })
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod finned_tests;
#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests;
