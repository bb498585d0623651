//! `carved calibrate specimen`: psi from the profiles of one turn.
//!
//! ```text
//!  --views DIR ───── profiles ─┬─ least-squares ── psi, views left out ── gate
//!  --cameras FILE ── psi ──────┴─ vrv, coherence ── --free, --optimizer ── psi
//! ```
//! Prints one JSON object on stdout. A refusal is in it and on stderr.

use crate::cli::reconstruct::cameras::{self, Cameras};
use crate::cli::reconstruct::views::{self, View};
use anyhow::{Context, bail};
use carved_core::calibration::{
    Ask, Free, GivenView, Objective as Large, Optimised, Optimiser, Parameter, Priors, Psi, Refusal, Stop, Vrv, VrvVerdict, calibrate,
    check_vrv, optimise,
};
use carved_core::carver::Runs;
use carved_core::geometry::{BoxUm, VoxelGrid};
use carved_core::profile::Mask;
use serde_json::{Value, json};
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
    /// Optimiser for vrv and coherence [default: nelder-mead]
    #[arg(long, value_enum)]
    optimizer: Option<Search>,
    /// Parameters that vrv and coherence may change, each with a range in px or deg other than the usual one [default: uy,gamma]
    #[arg(long, value_name = "uy,gamma,alpha=0.5,..", value_delimiter = ',')]
    free: Vec<Ask>,
    /// Share of the views that may miss a voxel; above 0 the volume has its maxima beside the true axis
    #[arg(long, value_name = "E", default_value_t = 0.0)]
    epsilon: f64,
    /// Edge of a voxel for vrv
    #[arg(long, value_name = "UM", default_value_t = 10.0)]
    voxel: f64,
    /// Seed of cma-es
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
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

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Search {
    NelderMead,
    CmaEs,
}

/// Smallest step as a share of the first one. The first steps are some px and a tenth of a degree; profiles do not resolve a thousandth of
/// that.
const SHARE: f64 = 1e-3;

/// The profiles of a turn and the known parameters.
struct Turn {
    names: Vec<String>,
    views: Vec<View>,
    runs: Vec<Runs>,
    known: Psi,
}

/// Reads the profiles, calibrates and prints the report.
///
/// # Errors
/// Names the wrong file or option, the value found and the value expected.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let grid = VoxelGrid::new(BoxUm::PAPER, args.voxel).context("--voxel")?;
    let report = match args.objective {
        Objective::LeastSquares => {
            if args.optimizer.is_some() || !args.free.is_empty() || args.epsilon != 0.0 {
                bail!(
                    "--optimizer, --free and --epsilon: least-squares frees uy, gamma, alpha, the angles' ratio and each view's shift, and has its own way; leave them out, or ask for --objective vrv or coherence"
                );
            }
            least_squares(&read(args)?)?
        }
        Objective::Vrv | Objective::Coherence => search(args, grid)?,
    };
    say!("{report:#}");
    Ok(())
}

fn read(args: &Args) -> anyhow::Result<Turn> {
    let file = args.cameras.display();
    let Cameras::Psi(psi) = cameras::read(&args.cameras)? else {
        bail!("--cameras {file}: expected an object with psi and the angles omega; matrices have no axis to calibrate");
    };
    let views = views::read(&args.views)?;
    if psi.omega.len() != views.len() {
        bail!(
            "--cameras {file}: {} angles in omega, but {} holds {} images; one per view is expected",
            psi.omega.len(),
            args.views.display(),
            views.len()
        );
    }
    let (width, height) = (views[0].mask.width(), views[0].mask.height());
    if (psi.camera.width as usize, psi.camera.height as usize) != (width, height) {
        bail!(
            "{} is {width} x {height} px, but {file} gives the sensor as {} x {}",
            views[0].path.display(),
            psi.camera.width,
            psi.camera.height
        );
    }
    // Views without a profile contain no information about the axis.
    let (shown, blank): (Vec<(View, f64)>, Vec<_>) = views.into_iter().zip(psi.omega).partition(|(view, _)| !view.is_blank());
    for (view, _) in &blank {
        note!("carved: {} is blank, and is left out", view.path.display());
    }
    if shown.is_empty() {
        bail!("--views {}: all images are blank; there is nothing to calibrate with", args.views.display());
    }
    let (views, omega): (Vec<View>, Vec<f64>) = shown.into_iter().unzip();
    let runs = views.iter().map(|v| Runs::new(&v.mask).with_context(|| v.path.display().to_string())).collect::<anyhow::Result<_>>()?;
    Ok(Turn { names: views.iter().map(View::name).collect(), views, runs, known: Psi::new(psi.camera, omega) })
}

fn least_squares(turn: &Turn) -> anyhow::Result<Value> {
    let Turn { names, views, known, .. } = turn;
    let given: Vec<GivenView> = views.iter().zip(&known.omega).map(|(v, &omega)| GivenView { columns: &v.columns, omega }).collect();
    let found = calibrate(&known.camera, &given, Priors::default())?;
    let judged = check_vrv(&found, &known.camera, &given);
    let used = |at: &usize| found.views[*at].bad.is_none();
    let kept: Vec<usize> = (0..views.len()).filter(used).collect();
    let start = Psi::new(known.camera.clone(), kept.iter().map(|&at| known.omega[at]).collect());
    let left_out: Vec<Value> =
        found.views.iter().zip(names).filter_map(|(state, name)| Some(json!({"view": name, "why": state.bad?.to_string()}))).collect();
    match judged.verdict {
        VrvVerdict::Passed => {}
        VrvVerdict::NotLargest => note!(
            "carved: warning: another axis than the calibrated one leaves a larger hull: the views do not quite agree on one turn of one body"
        ),
        VrvVerdict::Worse => note!(
            "carved: warning: the camera as given leaves a larger hull than the calibrated one: the views do not show one turn of one body"
        ),
    }
    Ok(json!({
        "objective": "least-squares",
        "views": kept.iter().map(|&at| &names[at]).collect::<Vec<_>>(),
        "left_out": left_out,
        "psi": {"before": told(&start), "after": told(&Psi::of(&found, &known.omega))},
        "vrv_um3": {"before": judged.given_um3, "after": judged.solution_um3},
        "residual_sd_um": found.residual_sd_um,
        "rho": found.rho,
        "sd": {"uy_px": found.sd.uy_px, "gamma_rad": found.sd.gamma_rad, "alpha_rad": found.sd.alpha_rad, "rho": found.sd.rho},
        "evaluations": found.passes,
        "converged": found.converged,
        "refusals": [],
        "gate": judged,
    }))
}

/// A row of pixels crosses the silhouette of a larva in a few pieces: body, fins, a loop of the tail.
const MOST_PIECES_PER_ROW: f64 = 16.0;

/// Mean number of pieces in a row of pixels, over the rows that have any.
fn pieces_per_row(mask: &Mask) -> f64 {
    let (mut rows, mut pieces) = (0, 0);
    for row in mask.data().chunks_exact(mask.width()) {
        let begun = usize::from(row[0] != 0) + row.windows(2).filter(|pair| pair[0] == 0 && pair[1] != 0).count();
        (rows, pieces) = (rows + usize::from(begun > 0), pieces + begun);
    }
    pieces as f64 / rows.max(1) as f64
}

/// Refuses pictures that are no silhouettes: each evaluation would visit every piece of them, and the search needs hundreds of evaluations.
fn silhouettes(views: &[View]) -> anyhow::Result<()> {
    for view in views {
        let found = pieces_per_row(&view.mask);
        if found > MOST_PIECES_PER_ROW {
            bail!(
                "{} is no silhouette: its rows fall into {found:.0} pieces in the mean, expected {MOST_PIECES_PER_ROW:.0} at most. Segment it again, or \
                 leave it out with its angle",
                view.path.display()
            );
        }
    }
    Ok(())
}

fn search(args: &Args, grid: VoxelGrid) -> anyhow::Result<Value> {
    let usual = || ["uy", "gamma"].iter().filter_map(|name| name.parse().ok()).collect();
    let (free, refusals) = Free::new(&if args.free.is_empty() { usual() } else { args.free.clone() });
    let said: Vec<String> = refusals.iter().map(Refusal::to_string).collect();
    if free.is_empty() {
        bail!("--free: nothing is left to search. {}", said.join(". "));
    }
    for refusal in &said {
        note!("carved: {refusal}");
    }
    let Turn { names, views, runs, known } = read(args)?;
    silhouettes(&views)?;
    let start = known;
    let (name, mut large) = match args.objective {
        Objective::Coherence => ("coherence", Large::Coherence(views.iter().map(|v| &v.columns).collect())),
        _ => ("vrv", Large::Vrv(Box::new(Vrv::new(runs.iter().collect(), grid, args.epsilon).context("--epsilon")?))),
    };
    let (how, by) = match args.optimizer {
        None | Some(Search::NelderMead) => (Optimiser::NelderMead, "nelder-mead"),
        Some(Search::CmaEs) => (Optimiser::CmaEs { seed: args.seed }, "cma-es"),
    };
    let Optimised { psi, before, after, evaluations, converged, on_bound } =
        optimise(&start, &free, &mut large, how, Stop { evaluations: args.evaluations, share: SHARE })?;
    if before <= 0.0 {
        bail!(
            "{name} is 0 at the cameras given: no voxel is seen by all views. Check the order of the views, a blank one among them, and uy"
        );
    }
    let bound: Vec<&str> = on_bound.into_iter().map(Parameter::name).collect();
    for name in &bound {
        note!("carved: warning: {name} ended on its bound; what is best may lie beyond");
    }
    Ok(json!({
        "objective": name,
        "optimizer": by,
        "free": free.parameters().map(Parameter::name).collect::<Vec<_>>(),
        "views": names,
        "psi": {"before": told(&start), "after": told(&psi)},
        (if name == "vrv" { "vrv_um3" } else { "coherence" }): {"before": before, "after": after},
        "evaluations": evaluations,
        "converged": converged,
        "on_bound": bound,
        "refusals": said,
    }))
}

/// The parameters in the format of camera.json, with the shifts of the views.
fn told(psi: &Psi) -> Value {
    let mut told = json!(psi.camera);
    told["omega"] = json!(psi.omega);
    told["dy"] = json!(psi.dy_px);
    told
}
