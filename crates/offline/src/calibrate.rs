//! Psi from the silhouettes of one turn.
//!
//! ```text
//!  silhouettes ─┬─ least squares ── psi, views left out ── VRV check
//!  psi ─────────┴─ VRV, coherence ── free parameters ── psi
//! ```

use crate::silhouettes::{Psi as Given, View, WrongSensor};
use carved_core::calibration::{
    Ask, CalibrationError, Free, GivenView, Objective as Large, Optimised, Parameter, Priors, Psi, Refusal, Stop, Vrv, VrvVerdict,
    calibrate, check_vrv, optimise,
};
use carved_core::carver::{CarveError, Runs};
use carved_core::geometry::VoxelGrid;
use carved_core::profile::Mask;
use serde_json::{Value, json};

/// Smallest step as a share of the first one. The first steps are some px and a tenth of a degree; profiles do not resolve a thousandth of
/// that.
const SHARE: f64 = 1e-3;

/// A row of pixels crosses the silhouette of a larva in a few pieces: body, fins, a loop of the tail.
const MOST_PIECES_PER_ROW: f64 = 16.0;

/// Why a turn is not calibrated.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// Not one angle per view.
    #[error("{angles} angles in omega, but {views} images; one per view is expected")]
    Count {
        /// Number of angles.
        angles: usize,
        /// Number of silhouettes.
        views: usize,
    },
    /// A silhouette is not of the size of the camera's sensor.
    #[error(transparent)]
    Size(#[from] WrongSensor),
    /// No view shows anything.
    #[error("all {views} silhouettes are blank; there is nothing to calibrate with")]
    Blank {
        /// Number of silhouettes.
        views: usize,
    },
    /// A view is refused by the carver.
    #[error("{name}: {source}")]
    View {
        /// Name of the view.
        name: String,
        /// Why.
        source: CarveError,
    },
    /// Each evaluation would visit every piece of a row, and the search needs hundreds of evaluations.
    #[error(
        "{name} is no silhouette: its rows fall into {found:.0} pieces in the mean, expected {MOST_PIECES_PER_ROW:.0} at most. Segment it again, or \
         leave it out with its angle"
    )]
    Pieces {
        /// Name of the view.
        name: String,
        /// Mean number of pieces in a row.
        found: f64,
    },
    /// Every parameter was refused.
    #[error("nothing is left to search. {0}")]
    NothingToSearch(String),
    /// The tolerance or the grid.
    #[error(transparent)]
    Objective(CarveError),
    /// The objective is 0 where the search begins.
    #[error("{0} is 0 at the cameras given: no voxel is seen by all views. Check the order of the views, a blank one among them, and uy")]
    Nothing(&'static str),
    /// The least squares have no solution.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
}

/// The silhouettes of a turn and the known parameters. Blank ones are left out: they contain no information about the axis.
#[derive(Debug)]
pub struct Turn {
    views: Vec<View>,
    runs: Vec<Runs>,
    known: Psi,
    /// Names of the blank silhouettes.
    pub blank: Vec<String>,
}

impl Turn {
    /// The turn of these silhouettes, of which each has its angle in `psi`.
    ///
    /// # Errors
    /// Sizes or numbers that differ, and silhouettes of which all are blank.
    pub fn new(psi: Given, views: Vec<View>) -> Result<Self, CalibrateError> {
        let count = views.len();
        if psi.omega.len() != count {
            return Err(CalibrateError::Count { angles: psi.omega.len(), views: count });
        }
        for view in &views {
            view.fits(&psi.camera)?;
        }
        let (shown, blank): (Vec<(View, f64)>, Vec<_>) = views.into_iter().zip(psi.omega).partition(|(view, _)| !view.is_blank());
        let blank = blank.into_iter().map(|(view, _)| view.name).collect();
        if shown.is_empty() {
            return Err(CalibrateError::Blank { views: count });
        }
        let (views, omega): (Vec<View>, Vec<f64>) = shown.into_iter().unzip();
        let runs = |view: &View| Runs::new(&view.mask).map_err(|source| CalibrateError::View { name: view.name.clone(), source });
        let runs = views.iter().map(runs).collect::<Result<_, _>>()?;
        Ok(Self { views, runs, known: Psi::new(psi.camera, omega), blank })
    }

    fn names(&self) -> Vec<&str> {
        self.views.iter().map(|view| view.name.as_str()).collect()
    }
}

/// A turn with its calibrated camera.
#[derive(Debug)]
pub struct CalibratedTurn {
    /// Camera, angles and shifts of the views.
    pub psi: Psi,
    /// The report of `carved calibrate specimen`.
    pub report: Value,
    /// Reasons to doubt it, in plain words.
    pub doubts: Vec<String>,
}

/// Calibrates by the residuals of the edges after elimination of the slices' shapes, and checks the result by VRV.
///
/// # Errors
/// Too few views, or no solution.
pub fn least_squares(turn: &Turn) -> Result<CalibratedTurn, CalibrateError> {
    let Turn { views, known, .. } = turn;
    let names = turn.names();
    let given: Vec<GivenView> = views.iter().zip(&known.omega).map(|(v, &omega)| GivenView { columns: &v.columns, omega }).collect();
    let found = calibrate(&known.camera, &given, Priors::default())?;
    let judged = check_vrv(&found, &known.camera, &given);
    let kept: Vec<usize> = (0..views.len()).filter(|&at| found.views[at].bad.is_none()).collect();
    let start = Psi::new(known.camera.clone(), kept.iter().map(|&at| known.omega[at]).collect());
    let left_out: Vec<Value> =
        found.views.iter().zip(&names).filter_map(|(state, name)| Some(json!({"view": name, "why": state.bad?.to_string()}))).collect();
    let doubt = match judged.verdict {
        VrvVerdict::Passed => None,
        VrvVerdict::NotLargest => {
            Some("warning: another axis than the calibrated one leaves a larger hull: the views do not quite agree on one turn of one body")
        }
        VrvVerdict::Worse => {
            Some("warning: the camera as given leaves a larger hull than the calibrated one: the views do not show one turn of one body")
        }
    };
    let psi = Psi::of(&found, &known.omega);
    let report = json!({
        "objective": "least-squares",
        "views": kept.iter().map(|&at| names[at]).collect::<Vec<_>>(),
        "left_out": left_out,
        "psi": {"before": psi_json(&start), "after": psi_json(&psi)},
        "vrv_um3": {"before": judged.given_um3, "after": judged.solution_um3},
        "residual_sd_um": found.residual_sd_um,
        "rho": found.rho,
        "sd": {"uy_px": found.sd.uy_px, "gamma_rad": found.sd.gamma_rad, "alpha_rad": found.sd.alpha_rad, "rho": found.sd.rho},
        "evaluations": found.passes,
        "converged": found.converged,
        "refusals": [],
        "gate": judged,
    });
    Ok(CalibratedTurn { psi, report, doubts: doubt.map(String::from).into_iter().collect() })
}

/// What a search makes as large as possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Objective {
    /// The volume that no view misses, as in the paper.
    Vrv {
        /// The voxels.
        grid: VoxelGrid,
        /// Share of the views that may miss a voxel. Above 0 the volume has its maxima beside the true axis.
        epsilon: f64,
    },
    /// Mean overlap of the profiles with the hull.
    Coherence,
}

/// A search over parameters of psi.
#[derive(Debug)]
pub struct Search {
    free: Free,
    refusals: Vec<String>,
    /// What is made as large as possible.
    pub objective: Objective,
    /// Maximum number of evaluations of the objective.
    pub evaluations: usize,
}

impl Search {
    /// A search over these parameters. Without any, over `uy` and `gamma`.
    ///
    /// # Errors
    /// Every parameter is refused.
    pub fn new(free: &[Ask], objective: Objective, evaluations: usize) -> Result<Self, CalibrateError> {
        let usual: Vec<Ask> = ["uy", "gamma"].iter().filter_map(|name| name.parse().ok()).collect();
        let (free, refusals) = Free::new(if free.is_empty() { &usual } else { free });
        let refusals: Vec<String> = refusals.iter().map(Refusal::to_string).collect();
        if free.is_empty() {
            return Err(CalibrateError::NothingToSearch(refusals.join(". ")));
        }
        Ok(Self { free, refusals, objective, evaluations })
    }

    /// Parameters that are not searched, or not as far as requested, in plain words.
    pub fn refusals(&self) -> &[String] {
        &self.refusals
    }

    /// Searches.
    ///
    /// # Errors
    /// A picture that is no silhouette, a tolerance that is none, and cameras at which the objective is 0.
    pub fn run(&self, turn: &Turn) -> Result<CalibratedTurn, CalibrateError> {
        let Turn { views, runs, known: start, .. } = turn;
        silhouettes(views)?;
        let (name, mut large) = match self.objective {
            Objective::Coherence => ("coherence", Large::Coherence(views.iter().map(|v| &v.columns).collect())),
            Objective::Vrv { grid, epsilon } => {
                let vrv = Vrv::new(runs.iter().collect(), grid, epsilon).map_err(CalibrateError::Objective)?;
                ("vrv", Large::Vrv(Box::new(vrv)))
            }
        };
        let stop = Stop { evaluations: self.evaluations, share: SHARE };
        let Optimised { psi, before, after, evaluations, converged, on_bound } =
            optimise(start, &self.free, &mut large, stop).map_err(CalibrateError::Objective)?;
        if before <= 0.0 {
            return Err(CalibrateError::Nothing(name));
        }
        let bound: Vec<&str> = on_bound.into_iter().map(Parameter::name).collect();
        let report = json!({
            "objective": name,
            "optimizer": "nelder-mead",
            "free": self.free.parameters().map(Parameter::name).collect::<Vec<_>>(),
            "views": turn.names(),
            "psi": {"before": psi_json(start), "after": psi_json(&psi)},
            (if name == "vrv" { "vrv_um3" } else { "coherence" }): {"before": before, "after": after},
            "evaluations": evaluations,
            "converged": converged,
            "on_bound": bound,
            "refusals": self.refusals,
        });
        let doubts = bound.iter().map(|name| format!("warning: {name} ended on its bound; what is best may lie beyond")).collect();
        Ok(CalibratedTurn { psi, report, doubts })
    }
}

/// Mean number of pieces in a row of pixels, over the rows that have any.
fn pieces_per_row(mask: &Mask) -> f64 {
    let (mut rows, mut pieces) = (0, 0);
    for row in mask.data().chunks_exact(mask.width()) {
        let begun = usize::from(row[0] != 0) + row.windows(2).filter(|pair| pair[0] == 0 && pair[1] != 0).count();
        (rows, pieces) = (rows + usize::from(begun > 0), pieces + begun);
    }
    pieces as f64 / rows.max(1) as f64
}

/// Refuses pictures that are no silhouettes.
fn silhouettes(views: &[View]) -> Result<(), CalibrateError> {
    for view in views {
        let found = pieces_per_row(&view.mask);
        if found > MOST_PIECES_PER_ROW {
            return Err(CalibrateError::Pieces { name: view.name.clone(), found });
        }
    }
    Ok(())
}

/// The parameters in the format of camera.json, with the shifts of the views.
fn psi_json(psi: &Psi) -> Value {
    let mut json = json!(psi.camera);
    json["omega"] = json!(psi.omega);
    json["dy"] = json!(psi.dy_px);
    json
}
