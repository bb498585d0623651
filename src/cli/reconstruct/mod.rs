//! `carved reconstruct`: makes a model from any silhouettes with any cameras.
//!
//! ```text
//!  --views DIR ────── views ───── masks, edges ──┐
//!  --cameras FILE ─┬─ psi, omega ────────────────┼─ Reconstruction: calibrated, measured ──┬── mesh ── PLY
//!                  └─ matrices ──────────────────┴─ HullModel: carved as they are ─────────┴── report ── one JSON object on stdout
//!                       └─ --calibrate, of a turn ─ psi, omega
//! ```
//! Everything is read and checked before anything is computed, and everything is computed before anything is written. A set that cannot be
//! measured is refused, also on stdout as `{"flags": [..], "error": ".."}`, with exit code 3.

mod bounds;
pub(super) mod cameras;
mod measured;
mod mirror;
mod output;
mod report;
mod turntable;
pub(super) mod views;

use crate::cli::output::PIPE_CLOSED;
use crate::cli::told;
use anyhow::{Context, bail};
use cameras::Cameras;
use carved_core::geometry::{BoxUm, VoxelGrid};
use carved_core::reconstruction::{CalibrationSettings, ReconstructionSettings, SurfaceSettings};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;
use views::View;

/// Exit code for a refused set.
const REFUSED: u8 = 3;

/// The paper's finer sampling density.
const DEFAULT_VOXEL_UM: f64 = 6.93;
/// Number of voxels for a grid without a unit and without a given size: the same as in the paper's box at the default size.
const DEFAULT_VOXELS: f64 = 15e6;

/// Silhouettes and cameras in, model and measurements out
#[derive(Debug, clap::Args)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct Args {
    /// Folder of silhouettes, PNG or PGM, one per view in the order of their names; 128 or more is inside
    #[arg(long, value_name = "DIR")]
    pub views: PathBuf,
    /// camera.json (psi and the angles `omega`), or one 3 x 4 matrix per view: JSON, or text with 12 numbers per line
    #[arg(long, value_name = "FILE")]
    pub cameras: PathBuf,
    /// The box to carve [default: the paper's -2500,2500,-500,500,-500,500 um; without a unit, what the silhouettes' bounding rectangles
    /// have in common; for psi, a body of revolution around them]
    #[arg(long = "box", value_name = "x0,x1,y0,y1,z0,z1", value_parser = parse_box, allow_hyphen_values = true)]
    pub bounds: Option<BoxUm>,
    /// Edge of a voxel [default: 6.93 um; without a unit, 15 million voxels in the box]
    #[arg(long, value_name = "S")]
    pub voxel: Option<f64>,
    /// Share of the views that may miss a voxel of the hull
    #[arg(long, value_name = "E", default_value_t = ReconstructionSettings::default().epsilon)]
    pub epsilon: f64,
    /// Unit of the cameras' world
    #[arg(long, value_enum, default_value_t = Unit::Um)]
    pub unit: Unit,
    /// Fit a sphere, for beads
    #[arg(long)]
    pub sphere: bool,
    /// Measure with the camera as given, without calibration
    #[arg(long)]
    pub no_calibrate: bool,
    /// Calibrate matrices too; they must be those of one camera in front of an object that turns (psi is always calibrated)
    #[arg(long, conflicts_with = "no_calibrate")]
    pub calibrate: bool,
    /// Weight of the umbrella operator in one iteration of the fairing
    #[arg(long, value_name = "LAMBDA", default_value_t = SurfaceSettings::default().fairing_lambda)]
    pub fairing_lambda: f64,
    /// Iterations of the fairing
    #[arg(long, value_name = "N", default_value_t = SurfaceSettings::default().fairing_iterations)]
    pub fairing_iterations: usize,
    /// PLY file for the mesh [default: the name of the views' folder, in the current folder, numbered if taken]
    #[arg(long, value_name = "PLY")]
    pub out: Option<PathBuf>,
    /// Replace the file at --out
    #[arg(long, requires = "out")]
    pub force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Unit {
    Um,
    None,
}

impl Unit {
    fn name(self) -> &'static str {
        match self {
            Self::Um => "um",
            Self::None => "none",
        }
    }
}

fn parse_box(text: &str) -> Result<BoxUm, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse().map_err(|_| format!("found {n:?} where a number is expected")))
        .collect::<Result<_, _>>()?;
    match numbers[..] {
        [x0, x1, y0, y1, z0, z1] => Ok(BoxUm { min: [x0, y0, z0], max: [x1, y1, z1] }),
        _ => Err(format!("found {} numbers, expected 6: x0,x1,y0,y1,z0,z1", numbers.len())),
    }
}

/// Prints the answer. Its reader may be gone, or the disk behind it full.
fn say(answer: &serde_json::Value, code: ExitCode) -> ExitCode {
    match writeln!(std::io::stdout().lock(), "{answer:#}") {
        Ok(()) => code,
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::from(PIPE_CLOSED),
        Err(error) => {
            note!("carved: the answer could not be printed: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Reads, reconstructs, writes the mesh and prints the report. A refusal is printed and has its own exit code.
pub fn run(args: &Args) -> ExitCode {
    match reconstruct(args) {
        Ok(report) => say(&report, ExitCode::SUCCESS),
        Err(error) => {
            let flags: Vec<&str> = error.downcast_ref::<measured::Refusal>().map(measured::Refusal::flag).into_iter().collect();
            let error = told(&error);
            note!("carved: {error}");
            say(&serde_json::json!({"flags": flags, "error": error}), ExitCode::from(REFUSED))
        }
    }
}

fn reconstruct(args: &Args) -> anyhow::Result<serde_json::Value> {
    let destination = output::Destination::choose(args.out.as_deref(), &args.views, args.force)?;
    // The command line is checked before any file is read.
    let mut bounds = given_box(args);
    bounds.map(|bounds| grid(args, bounds)).transpose()?;
    let mut clock = report::Clock::new(Instant::now());
    let mut cameras = cameras::read(&args.cameras)?;
    let views = views::read(&args.views)?;
    let views = in_order(&cameras, views)?;
    let (count, what) = cameras.count();
    if count != views.len() {
        bail!(
            "{}: {count} {what}, but {} holds {} images; one per view is expected",
            args.cameras.display(),
            args.views.display(),
            views.len()
        );
    }
    if let (Cameras::Psi(psi), Some(view)) = (&cameras, views.first()) {
        let (width, height) = (psi.camera.width as usize, psi.camera.height as usize);
        if (width, height) != (view.mask.width(), view.mask.height()) {
            bail!(
                "{} is {} x {} px, but {} gives the sensor as {width} x {height}",
                view.path.display(),
                view.mask.width(),
                view.mask.height(),
                args.cameras.display()
            );
        }
    }
    let mirrored = unmirrored(&mut cameras, &views, &mut bounds)?;
    let voxel = args.voxel.filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.0);
    let bounds = match (bounds, &cameras) {
        (Some(bounds), _) => bounds,
        (None, Cameras::Matrices { projections, .. }) => bounds::derived(projections, &views, bounds::middle(projections, &views)?, voxel)?,
        (None, Cameras::Psi(psi)) => bounds::of_turn(psi, &views, voxel)?,
    };
    let mut grid = grid(args, bounds)?;
    clock.split("read");
    let surface = SurfaceSettings { fairing_lambda: args.fairing_lambda, fairing_iterations: args.fairing_iterations };
    // Masks are used as they are, because the origin of their edges is unknown.
    let calibration = CalibrationSettings { enabled: !args.no_calibrate, edge_sd_px: 0.0, ..CalibrationSettings::default() };
    let settings = ReconstructionSettings { epsilon: args.epsilon, surface, calibration };
    let table = match &cameras {
        Cameras::Matrices { projections, .. } if args.calibrate => Some(turntable::find(projections, &views, bounds, args.unit)?),
        _ => None,
    };
    let mut measured = match &cameras {
        _ if views.iter().all(View::is_blank) => measured::empty(&views, &cameras),
        Cameras::Psi(psi) => measured::turn(psi, grid, &views, settings, args.sphere, &mut clock)?,
        Cameras::Matrices { projections, .. } => match &table {
            None => measured::hull(projections, grid, &views, settings, args.sphere)?,
            Some(table) => {
                let (measured, along_axis) = turntable::measure(table, &views, bounds, grid.size(), settings, args.sphere, &mut clock)?;
                grid = along_axis;
                measured
            }
        },
    };
    clock.split("reconstruct");
    if mirrored {
        mirror::mesh(&mut measured);
        measured.doubts.push(mirror::SAID.into());
    }
    let mesh_path = match &measured.mesh {
        Some(mesh) => {
            let mut ply = Vec::new();
            crate::export::write_ply(mesh, args.unit.name(), &mut ply)?;
            Some(destination.write(&ply)?)
        }
        None => None,
    };
    clock.split("write");
    for doubt in &measured.doubts {
        note!("carved: {doubt}");
    }
    let report = report::report(&measured, &views, &cameras, &grid, mesh_path.as_deref(), &clock)?;
    let mut report = table.iter().fold(report, turntable::told);
    report["mirrored_world"] = mirrored.into();
    let report = if mirrored { mirror::report(report, table.is_some()) } else { report };
    Ok(report::in_unit(report, args.unit))
}

/// The views in the order of the cameras' names, if they have names.
fn in_order(cameras: &Cameras, mut views: Vec<View>) -> anyhow::Result<Vec<View>> {
    let Cameras::Matrices { names: Some(names), .. } = cameras else { return Ok(views) };
    let stem = |name: &str| std::path::Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut ordered = Vec::with_capacity(names.len());
    for name in names {
        let at = views.iter().position(|v| stem(&v.name()) == stem(name)).with_context(|| format!("--views: found no image for {name}"))?;
        ordered.push(views.swap_remove(at));
    }
    Ok(ordered)
}

/// The box of the command line or of the unit. `None` if it must be derived from the silhouettes.
fn given_box(args: &Args) -> Option<BoxUm> {
    args.bounds.or((args.unit == Unit::Um).then_some(BoxUm::PAPER))
}

/// Mirrors cameras and box if the matrices are those of a mirrored world. Returns whether they are.
fn unmirrored(cameras: &mut Cameras, views: &[View], bounds: &mut Option<BoxUm>) -> anyhow::Result<bool> {
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
        *projections = mirror::projections(projections)?;
        *bounds = bounds.map(mirror::bounds);
    }
    Ok(mirrored)
}

fn grid(args: &Args, bounds: BoxUm) -> anyhow::Result<VoxelGrid> {
    let voxel = args.voxel.unwrap_or_else(|| match args.unit {
        Unit::Um => DEFAULT_VOXEL_UM,
        Unit::None => ((0..3).map(|a| bounds.max[a] - bounds.min[a]).product::<f64>() / DEFAULT_VOXELS).cbrt(),
    });
    VoxelGrid::new(bounds, voxel).context("--box and --voxel")
}
