//! `carved reconstruct`: any silhouettes with any cameras to a model.
//!
//! ```text
//!  --views DIR ────── views ───── masks ───────┐
//!  --cameras FILE ─── cameras ─── projections ─┴─ HullModel ── mesh ── PLY
//!  --box --voxel --epsilon ────────────────────────┘     └──── report ── one JSON object on stdout
//! ```
//! Everything is read and checked before anything is made, and everything is made before anything is written.

mod cameras;
mod output;
mod report;
pub(super) mod views;

use crate::carver::Leaves;
use crate::geometry::{BoxUm, VoxelGrid};
use crate::reconstruction::{HullModel, ReconstructionSettings, SurfaceSettings};
use anyhow::{Context, bail};
use std::path::PathBuf;

/// The paper's finer sampling density.
const DEFAULT_VOXEL_UM: f64 = 6.93;
/// Voxels of a grid without a unit when no size is given: as many as the paper's box has at the default size.
const DEFAULT_VOXELS: f64 = 15e6;

/// Silhouettes and cameras in, model and measurements out
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of silhouettes, PNG or PGM, one per view in the order of their names; inside is 128 or more
    #[arg(long, value_name = "DIR")]
    pub views: PathBuf,
    /// camera.json (psi and the angles `omega`), or one 3 x 4 matrix per view: JSON, or text with 12 numbers per line
    #[arg(long, value_name = "FILE")]
    pub cameras: PathBuf,
    /// The volume that is carved [default: the paper's -2500,2500,-500,500,-500,500 um]
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
    /// Weight of the umbrella operator in one iteration of the fairing
    #[arg(long, value_name = "LAMBDA", default_value_t = SurfaceSettings::default().fairing_lambda)]
    pub fairing_lambda: f64,
    /// Iterations of the fairing
    #[arg(long, value_name = "N", default_value_t = SurfaceSettings::default().fairing_iterations)]
    pub fairing_iterations: usize,
    /// Where the mesh goes, PLY [default: the name of the views' folder, here, with a number if taken]
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

/// Reads, reconstructs, writes the mesh and prints the report.
///
/// # Errors
/// Names the file or option at fault, what was found and what was expected; nothing is then written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let destination = output::Destination::choose(args.out.as_deref(), &args.views, args.force)?;
    let grid = grid(args)?;
    let cameras = cameras::read(&args.cameras)?;
    let views = views::read(&args.views)?;
    if cameras.projections.len() != views.len() {
        bail!(
            "{}: {} {}, but {} holds {} images; one per view is expected",
            args.cameras.display(),
            cameras.projections.len(),
            cameras.what,
            args.views.display(),
            views.len()
        );
    }
    if let Some(((width, height), view)) = cameras.sensor.zip(views.first())
        && (width, height) != (view.mask.width(), view.mask.height())
    {
        bail!(
            "{} is {} x {} px, but {} gives the sensor as {width} x {height}",
            view.path.display(),
            view.mask.width(),
            view.mask.height(),
            args.cameras.display()
        );
    }

    let surface = SurfaceSettings { fairing_lambda: args.fairing_lambda, fairing_iterations: args.fairing_iterations };
    let mut hull = HullModel::new(grid, views.len(), ReconstructionSettings { epsilon: args.epsilon, surface })?;
    for (view, projection) in views.iter().zip(&cameras.projections) {
        hull.observe(&view.mask, &[], projection, Leaves::default()).with_context(|| view.path.display().to_string())?;
    }
    let model = hull.finish(args.sphere)?;
    let mut ply = Vec::new();
    crate::export::write_ply(&model.mesh, args.unit.name(), &mut ply)?;
    let overlaps = report::overlaps(&hull, &views, &cameras.projections);
    for doubt in report::doubts(&hull, &overlaps) {
        eprintln!("carved: {doubt}");
    }
    let mesh_path = destination.write(&ply)?;
    println!("{:#}", report::report(&hull, &model.measurement, &views, &overlaps, args.unit, &mesh_path)?);
    Ok(())
}

fn grid(args: &Args) -> anyhow::Result<VoxelGrid> {
    let bounds = match (args.bounds, args.unit) {
        (Some(bounds), _) => bounds,
        (None, Unit::Um) => BoxUm::PAPER,
        (None, Unit::None) => {
            bail!("--box: none given, and with --unit none there is no default; give x0,x1,y0,y1,z0,z1 in the cameras' world")
        }
    };
    let voxel = args.voxel.unwrap_or_else(|| match args.unit {
        Unit::Um => DEFAULT_VOXEL_UM,
        Unit::None => ((0..3).map(|a| bounds.max[a] - bounds.min[a]).product::<f64>() / DEFAULT_VOXELS).cbrt(),
    });
    VoxelGrid::new(bounds, voxel).context("--box and --voxel")
}
