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

pub(super) mod cameras;
mod output;
pub(super) mod views;

use crate::cli::output::PIPE_CLOSED;
use crate::cli::with_causes;
use anyhow::Context;
use carved_core::flag::Flag;
use carved_core::geometry::BoxUm;
use carved_core::measure::Estimator;
use carved_core::reconstruction::{ReconstructionSettings, SurfaceSettings};
use carved_offline::silhouettes::{self, Cameras, Refusal, Settings, SilhouettesError, Step, View};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Exit code for a refused set.
const REFUSED: u8 = 3;

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
        Ok(report) if is_empty(&report) => {
            note!("carved: nothing was reconstructed, the volume is 0: `views` says which silhouettes are blank or fit no other");
            say(&report, ExitCode::from(REFUSED))
        }
        Ok(report) if report["turn_findings"].as_array().is_some_and(|findings| !findings.is_empty()) => {
            note!("carved: the silhouettes do not show one specimen that turns, so no volume is given: `turn_findings` says why");
            say(&report, ExitCode::from(REFUSED))
        }
        Ok(report) => say(&report, ExitCode::SUCCESS),
        Err(error) => {
            let flags: Vec<Flag> = refusal(&error).map(Refusal::flag).into_iter().collect();
            let error = with_causes(&error);
            note!("carved: {error}");
            say(&serde_json::json!({"flags": flags, "error": error}), ExitCode::from(REFUSED))
        }
    }
}

/// Whether no voxel is left: a volume of 0 is no answer that a script may go on with.
fn is_empty(report: &serde_json::Value) -> bool {
    report["flags"].as_array().is_some_and(|flags| flags.iter().any(|flag| flag == "empty"))
}

/// The refusal that an error is.
fn refusal(error: &anyhow::Error) -> Option<&Refusal> {
    match error.downcast_ref() {
        Some(SilhouettesError::Refused(refusal)) => Some(refusal),
        _ => None,
    }
}

fn reconstruct(args: &Args) -> anyhow::Result<serde_json::Value> {
    let destination = output::Destination::choose(args.out.as_deref(), &args.views, args.force)?;
    let settings = settings(args);
    // The command line is checked before any file is read.
    settings.check().context("--box and --voxel")?;
    let mut clock = Clock::new(Instant::now());
    let cameras = cameras::read(&args.cameras)?;
    let views = views::read(&args.views)?;
    let views = in_order(&cameras, views)?;
    let mut step = |step: Step| {
        match step {
            Step::Checked => clock.split("read"),
            Step::Carved => clock.split("carve"),
            Step::Calibrated => clock.split("calibrate"),
            Step::Measured => clock.split("reconstruct"),
            Step::View => {}
        }
        Ok(())
    };
    let solved = silhouettes::reconstruct(cameras, &views, &settings, &mut step).map_err(|error| of_options(args, error))?;
    let measured = solved.measured();
    let mesh_path = match &measured.mesh {
        Some(mesh) => {
            let mut ply = Vec::new();
            crate::export::write_ply(mesh, settings.unit.name(), Estimator::Field.name(), &mut ply)?;
            Some(destination.write(&ply)?)
        }
        None => None,
    };
    clock.split("write");
    for doubt in &measured.doubts {
        note!("carved: {doubt}");
    }
    Ok(solved.report(&views, mesh_path.as_deref(), clock.spent)?)
}

fn settings(args: &Args) -> Settings {
    let surface = SurfaceSettings { fairing_lambda: args.fairing_lambda, fairing_iterations: args.fairing_iterations };
    Settings {
        bounds: args.bounds,
        voxel: args.voxel,
        unit: match args.unit {
            Unit::Um => silhouettes::Unit::Um,
            Unit::None => silhouettes::Unit::None,
        },
        sphere: args.sphere,
        turntable: args.calibrate,
        reconstruction: silhouettes::settings(args.epsilon, !args.no_calibrate, surface),
    }
}

/// The error with the options that it is about.
fn of_options(args: &Args, error: SilhouettesError) -> anyhow::Error {
    let about = match &error {
        SilhouettesError::Count { .. } | SilhouettesError::Size(_) => {
            format!("--cameras {}, --views {}", args.cameras.display(), args.views.display())
        }
        SilhouettesError::View { .. } => format!("--views {}", args.views.display()),
        SilhouettesError::Grid(_) | SilhouettesError::GridAlongAxis(_) => "--box and --voxel".into(),
        SilhouettesError::Box(_) => "--box".into(),
        SilhouettesError::NoTurn(_) => "--calibrate".into(),
        SilhouettesError::Mirrored(_) => "--cameras".into(),
        _ => return error.into(),
    };
    anyhow::Error::new(error).context(about)
}

/// The views in the order of the cameras' names, if they have names.
fn in_order(cameras: &Cameras, mut views: Vec<View>) -> anyhow::Result<Vec<View>> {
    let Cameras::Matrices { names: Some(names), .. } = cameras else { return Ok(views) };
    let stem = |name: &str| std::path::Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut ordered = Vec::with_capacity(names.len());
    for name in names {
        let at = views.iter().position(|v| stem(&v.name) == stem(name)).with_context(|| format!("--views: found no image for {name}"))?;
        ordered.push(views.swap_remove(at));
    }
    Ok(ordered)
}

/// Duration of each step, ms.
struct Clock {
    last: Instant,
    spent: Map<String, Value>,
}

impl Clock {
    fn new(now: Instant) -> Self {
        Self { last: now, spent: Map::new() }
    }

    fn split(&mut self, what: &str) {
        let now = Instant::now();
        self.spent.insert(what.into(), json!(now.duration_since(self.last).as_secs_f64() * 1e3));
        self.last = now;
    }
}
