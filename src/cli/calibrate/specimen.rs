//! `carved calibrate specimen`: psi from the profiles of one turn.
//!
//! ```text
//!  --views DIR ───── profiles ─┬─ least-squares ── psi, views left out ── gate
//!  --cameras FILE ── psi ──────┴─ vrv, coherence ── --free ── psi
//! ```
//! Prints one JSON object on stdout. A refusal is in it and on stderr.

use crate::cli::reconstruct::{cameras, views};
use anyhow::{Context, bail};
use carved_core::calibration::Ask;
use carved_core::geometry::{BoxUm, VoxelGrid};
use carved_offline::calibrate::{self, CalibrateError, CalibratedTurn, Search, Turn};
use carved_offline::silhouettes::Cameras;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of profiles, PNG or PGM, one per view in the order of their names; grey values are coverage
    #[arg(long, value_name = "DIR")]
    views: PathBuf,
    /// camera.json: psi as the rig knows it, with the ledger's angles `omega`
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    /// Objective to optimise
    #[arg(long, value_enum, default_value_t = Objective::LeastSquares)]
    objective: Objective,
    /// Parameters that vrv and coherence may change, each with a range in px or deg other than the usual one [default: uy,gamma]
    #[arg(long, value_name = "uy,gamma,alpha=0.5,..", value_delimiter = ',')]
    free: Vec<Ask>,
    /// Share of the views that may miss a voxel; above 0 the volume has its maxima beside the true axis
    #[arg(long, value_name = "E", default_value_t = 0.0)]
    epsilon: f64,
    /// Edge of a voxel for vrv
    #[arg(long, value_name = "UM", default_value_t = 10.0)]
    voxel: f64,
    /// Maximum number of evaluations of the objective
    #[arg(long, value_name = "N", default_value_t = 2000)]
    evaluations: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Objective {
    /// The volume that no view misses, as in the paper
    Vrv,
    /// Mean overlap of the profiles with the hull
    Coherence,
    /// Residuals of the edges after elimination of the slices' shapes; checked by vrv
    LeastSquares,
}

/// Reads the profiles, calibrates and prints the report.
///
/// # Errors
/// Names the wrong file or option, the value found and the value expected.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let grid = VoxelGrid::new(BoxUm::PAPER, args.voxel).context("--voxel")?;
    let found = match args.objective {
        Objective::LeastSquares => {
            if !args.free.is_empty() || args.epsilon != 0.0 {
                bail!(
                    "--free and --epsilon: least-squares frees uy, gamma, alpha, the angles' ratio and each view's shift, and has its own way; leave them out, or ask for --objective vrv or coherence"
                );
            }
            calibrate::least_squares(&read(args)?)?
        }
        Objective::Vrv | Objective::Coherence => search(args, grid)?,
    };
    for doubt in &found.doubts {
        note!("carved: {doubt}");
    }
    say!("{:#}", found.report);
    Ok(())
}

fn read(args: &Args) -> anyhow::Result<Turn> {
    let (cameras_file, folder) = (args.cameras.display(), args.views.display());
    let Cameras::Psi(psi) = cameras::read(&args.cameras)? else {
        bail!("--cameras {cameras_file}: expected an object with psi and the angles omega; matrices have no axis to calibrate");
    };
    let turn = Turn::new(psi, views::read(&args.views)?).with_context(|| format!("--cameras {cameras_file}, --views {folder}"))?;
    for blank in &turn.blank {
        note!("carved: {} is blank, and is left out", args.views.join(blank).display());
    }
    Ok(turn)
}

fn search(args: &Args, grid: VoxelGrid) -> anyhow::Result<CalibratedTurn> {
    let objective = match args.objective {
        Objective::Coherence => calibrate::Objective::Coherence,
        _ => calibrate::Objective::Vrv { grid, epsilon: args.epsilon },
    };
    let search = Search::new(&args.free, objective, args.evaluations).context("--free")?;
    for refusal in search.refusals() {
        note!("carved: {refusal}");
    }
    search.run(&read(args)?).map_err(|error| match error {
        CalibrateError::Objective(_) => anyhow::Error::new(error).context("--epsilon"),
        error => error.into(),
    })
}
