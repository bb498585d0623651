//! Silhouettes and cameras to a model and its numbers.
//!
//! ```text
//!  views ───── masks, edges ───┐
//!  cameras ─┬─ psi, omega ─────┼─ Reconstruction: calibrated, measured ──┬── mesh, voxels
//!           └─ matrices ───────┴─ HullModel: carved as they are ─────────┴── report
//!                └─ turntable ─── psi, omega
//! ```

mod bounds;
mod measured;
mod mirror;
mod report;
mod turntable;
mod view;

pub use bounds::NoBox;
pub use measured::{Judged, Measured, Refusal};
pub use mirror::MixedWorlds;
pub use view::{NoSilhouette, View, WrongSensor, coverage_of};

use crate::Stopped;
use carved_core::geometry::{BoxUm, Camera, GridError, NoTurn, Projection, ProjectionError, Turntable, VoxelGrid};
use carved_core::reconstruction::{CalibrationSettings, ReconstructionError, ReconstructionSettings, SurfaceSettings};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::Path;

/// The cameras of a set.
#[derive(Debug, Clone, PartialEq)]
pub enum Cameras {
    /// One camera in front of a capillary that turns.
    Psi(Psi),
    /// One camera per view, without assumptions.
    Matrices {
        /// The matrix of each view.
        projections: Vec<Projection>,
        /// The name of each matrix's image, if the file has names.
        names: Option<Vec<String>>,
    },
}

/// A camera and the angles of its views.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Psi {
    /// The camera.
    #[serde(flatten)]
    pub camera: Camera,
    /// Angle of the capillary in each view, rad.
    pub omega: Vec<f64>,
}

impl Cameras {
    /// The number of cameras, and their type in words.
    pub fn count(&self) -> (usize, &'static str) {
        match self {
            Self::Psi(psi) => (psi.omega.len(), "angles in omega"),
            Self::Matrices { projections, .. } => (projections.len(), "matrices"),
        }
    }
}

/// Unit of the cameras' world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Micrometres.
    Um,
    /// Any unit. The report has no unit in its keys then.
    None,
}

impl Unit {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Um => "um",
            Self::None => "none",
        }
    }
}

/// The paper's finer sampling density.
const DEFAULT_VOXEL_UM: f64 = 6.93;
/// Number of voxels for a grid without a unit and without a given size: the same as in the paper's box at the default size.
const DEFAULT_VOXELS: f64 = 15e6;

/// How a set is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The box to carve. `None`: the paper's; without a unit, what the silhouettes' bounding rectangles have in common.
    pub bounds: Option<BoxUm>,
    /// Edge of a voxel. `None`: 6.93 um; without a unit, 15 million voxels in the box.
    pub voxel: Option<f64>,
    /// Unit of the cameras' world.
    pub unit: Unit,
    /// Fit a sphere, for beads.
    pub sphere: bool,
    /// Matrices are those of one camera in front of an object that turns, and are calibrated as such.
    pub turntable: bool,
    /// How the model is made and how a turn is calibrated.
    pub reconstruction: ReconstructionSettings,
}

/// The settings of the model for silhouettes. They are used as they are, because the origin of their edges is unknown.
pub fn settings(epsilon: f64, calibrate: bool, surface: SurfaceSettings) -> ReconstructionSettings {
    let calibration = CalibrationSettings { enabled: calibrate, edge_sd_px: 0.0, ..CalibrationSettings::default() };
    ReconstructionSettings { epsilon, surface, calibration }
}

impl Settings {
    /// The box that is known before any silhouette. `None` if it must be derived from them.
    fn given_box(&self) -> Option<BoxUm> {
        self.bounds.or((self.unit == Unit::Um).then_some(BoxUm::PAPER))
    }

    fn grid(&self, bounds: BoxUm) -> Result<VoxelGrid, GridError> {
        let voxel = self.voxel.unwrap_or_else(|| match self.unit {
            Unit::Um => DEFAULT_VOXEL_UM,
            Unit::None => libm::cbrt((0..3).map(|a| bounds.max[a] - bounds.min[a]).product::<f64>() / DEFAULT_VOXELS),
        });
        VoxelGrid::new(bounds, voxel)
    }

    /// Checks box and voxel size, as far as they are known before any silhouette.
    ///
    /// # Errors
    /// They are no grid.
    pub fn check(&self) -> Result<(), GridError> {
        self.given_box().map_or(Ok(()), |bounds| self.grid(bounds).map(|_| ()))
    }
}

/// A step of a computation that is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Everything is checked, and the box is known.
    Checked,
    /// A view was observed.
    View,
    /// All views of a turn were carved.
    Carved,
    /// The turn was calibrated.
    Calibrated,
    /// Surface and numbers are known.
    Measured,
}

/// Why silhouettes give no numbers.
#[derive(Debug, thiserror::Error)]
pub enum SilhouettesError {
    /// Not one camera per view.
    #[error("{cameras} {what}, but {views} images; one per view is expected")]
    Count {
        /// Number of cameras.
        cameras: usize,
        /// Their type in words.
        what: &'static str,
        /// Number of silhouettes.
        views: usize,
    },
    /// A silhouette is not of the size of the camera's sensor.
    #[error(transparent)]
    Size(#[from] WrongSensor),
    /// The views give no numbers.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Box and voxel size.
    #[error(transparent)]
    Grid(GridError),
    /// Box and voxel size along the axis of a turntable.
    #[error("along the axis of the turn: {0}")]
    GridAlongAxis(GridError),
    /// No box was given, and none could be derived.
    #[error(transparent)]
    Box(#[from] NoBox),
    /// The matrices are not those of a turn.
    #[error(transparent)]
    NoTurn(#[from] NoTurn),
    /// The matrices are of different worlds.
    #[error(transparent)]
    MixedWorlds(#[from] MixedWorlds),
    /// A matrix of a mirrored world is no projection.
    #[error("mirrored: {0}")]
    Mirrored(ProjectionError),
    /// A view is refused.
    #[error("{name}: {source}")]
    View {
        /// Name of the view.
        name: String,
        /// Why.
        source: ReconstructionError,
    },
    /// The model.
    #[error(transparent)]
    Reconstruction(#[from] ReconstructionError),
    /// The caller ended the computation.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// A set that was measured.
#[derive(Debug)]
pub struct Solved {
    measured: Measured,
    cameras: Cameras,
    grid: VoxelGrid,
    /// The turn that the matrices are of, where they were calibrated.
    table: Option<Turntable>,
    /// Whether the matrices are those of a mirrored world. It was mirrored for the computation.
    mirrored: bool,
    unit: Unit,
}

/// Measures silhouettes. `step` is called in the caller's thread after each step.
///
/// # Errors
/// Names what does not fit, what was found and what is expected.
pub fn reconstruct(
    mut cameras: Cameras,
    views: &[View],
    settings: &Settings,
    step: &mut dyn FnMut(Step) -> Result<(), Stopped>,
) -> Result<Solved, SilhouettesError> {
    let (count, what) = cameras.count();
    if count != views.len() {
        return Err(SilhouettesError::Count { cameras: count, what, views: views.len() });
    }
    if let (Cameras::Psi(psi), Some(view)) = (&cameras, views.first()) {
        view.fits(&psi.camera)?;
    }
    let mut bounds = settings.given_box();
    let mirrored = unmirrored(&mut cameras, views, &mut bounds)?;
    let voxel = settings.voxel.filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.0);
    let bounds = match (bounds, &cameras) {
        (Some(bounds), _) => bounds,
        (None, Cameras::Matrices { projections, .. }) => bounds::derived(projections, views, bounds::middle(projections, views)?, voxel)?,
        (None, Cameras::Psi(psi)) => bounds::of_turn(psi, views, voxel)?,
    };
    let mut grid = settings.grid(bounds).map_err(SilhouettesError::Grid)?;
    step(Step::Checked)?;
    let &Settings { unit, sphere, reconstruction, .. } = settings;
    let table = match &cameras {
        Cameras::Matrices { projections, .. } if settings.turntable => Some(turntable::find(projections, views, bounds, unit)?),
        _ => None,
    };
    let mut measured = match &cameras {
        _ if views.iter().all(View::is_blank) => measured::empty(views, &cameras),
        Cameras::Psi(psi) => measured::turn(psi, grid, views, reconstruction, sphere, step)?,
        Cameras::Matrices { projections, .. } => match &table {
            None => measured::hull(projections, grid, views, reconstruction, sphere, step)?,
            Some(table) => {
                let (measured, along_axis) = turntable::measure(table, views, bounds, grid.size(), reconstruction, sphere, step)?;
                grid = along_axis;
                measured
            }
        },
    };
    if mirrored {
        mirror::mesh(&mut measured);
        measured.doubts.push(mirror::SAID.into());
    }
    step(Step::Measured)?;
    Ok(Solved { measured, cameras, grid, table, mirrored, unit })
}

impl Solved {
    /// The result. Its mesh is in the world of the cameras.
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// The result without its report.
    pub fn into_measured(self) -> Measured {
        self.measured
    }

    /// Whether the voxels are of the mirror image of the cameras' world, at x = 0.
    pub fn is_mirrored(&self) -> bool {
        self.mirrored
    }

    /// The report of `carved reconstruct`. `mesh` is the file of the surface.
    ///
    /// # Errors
    /// A number that JSON does not hold.
    pub fn report(&self, views: &[View], mesh: Option<&Path>, timing_ms: Map<String, Value>) -> Result<Value, serde_json::Error> {
        let report = report::report(&self.measured, views, &self.cameras, &self.grid, mesh, timing_ms)?;
        let mut report = self.table.iter().fold(report, turntable::with_table);
        report["mirrored_world"] = self.mirrored.into();
        let report = if self.mirrored { mirror::report(report, self.table.is_some()) } else { report };
        Ok(report::in_unit(report, self.unit))
    }
}

/// Mirrors cameras and box if the matrices are those of a mirrored world. Returns whether they are.
fn unmirrored(cameras: &mut Cameras, views: &[View], bounds: &mut Option<BoxUm>) -> Result<bool, SilhouettesError> {
    let Cameras::Matrices { projections, .. } = cameras else { return Ok(false) };
    if views.iter().all(View::is_blank) {
        return Ok(false);
    }
    let at = match bounds {
        Some(bounds) => std::array::from_fn(|a| f64::midpoint(bounds.min[a], bounds.max[a])),
        None => bounds::middle(projections, views)?,
    };
    let mirrored = mirror::is_mirrored(projections, at)?;
    if mirrored {
        *projections = mirror::projections(projections).map_err(SilhouettesError::Mirrored)?;
        *bounds = bounds.map(mirror::bounds);
    }
    Ok(mirrored)
}
