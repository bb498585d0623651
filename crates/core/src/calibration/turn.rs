//! The calibration of a whole turn: which views belong, where the axis is, and how far the capillary really turned.

use super::closed_form::{AxisError, axis};
use super::least_squares::{GivenView, GlassFound, Priors, Solution, SolveError, pivot, solve};
use super::screen::{Bad, Moved, ViewOff, moved, short, views_off, worst, wrong_areas};
use super::tangents::TurnView;
use crate::geometry::{Camera, Projection};
use crate::statistics::{Line, upper_median};
use nalgebra::Matrix4;

/// Least views that count in a calibration. Fewer views enclose nothing.
pub const VIEWS_LEAST: usize = 4;
/// Largest share of the views that may be left out. More are not outliers.
const BAD_SHARE: f64 = 0.3;
/// Relative difference of the angles from which on the flag for wrong steps is raised: another number of steps per revolution,
/// or a coupling that slips.
const WRONG_STEPS: f64 = 0.01;
/// Standard deviations from which on a ratio of angles differs from 1.
const SURE: f64 = 5.0;
/// A prior standard deviation that fixes an unknown.
const HELD: f64 = 1e-6;
/// A specimen is round if a camera that is held leaves residuals of at most this multiple of a free one's.
const ROUND: f64 = 1.5;
/// A slice is a disc if all harmonics except its place are less than this share of its mean radius. Rendered beads have under
/// 0.01, most slices of a larva over 0.1.
const DISC: f64 = 0.05;
/// Least views that determine a ratio of angles.
const RHO_VIEWS_LEAST: usize = 7;
/// Largest relative difference between a ratio of angles and the start of its search.
const NEAR: f64 = 0.08;
/// Another ratio of angles must leave at most this share of the residuals of the planned one.
const EXPLAINS: f64 = 0.5;
/// Residual from which on the angles themselves are doubted, px.
const DOUBT_PX: f64 = 1.0;

/// Why a turn cannot be calibrated.
#[derive(Debug, Clone, thiserror::Error, PartialEq)]
pub enum CalibrationError {
    /// Too few views agree on a specimen.
    #[error(
        "{used} of {given} views show a specimen that they agree on; {VIEWS_LEAST} are needed to tell where the axis is. Calibrate with more views, or \
         measure with the camera as it is"
    )]
    TooFewViews {
        /// Views that agree.
        used: usize,
        /// Views given.
        given: usize,
    },
    /// The closed form finds no axis.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// The least squares have no solution.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// What the calibration found of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewState {
    /// Why the view is left out. `None` for a view that counts.
    pub bad: Option<Bad>,
    /// Shift of the profile down the image against the camera, px. 0 for a view that is left out.
    pub dy_px: f64,
    /// Root of the mean square distance between its edges and the model of all others, px. `None` for a view that is left out.
    pub residual_px: Option<f64>,
}

/// Standard deviations of the camera and of the angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PsiSd {
    /// Of uy, px.
    pub uy_px: f64,
    /// Of gamma, rad.
    pub gamma_rad: f64,
    /// Of alpha, rad.
    pub alpha_rad: f64,
    /// Of rho.
    pub rho: f64,
}

/// The calibration of one turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The camera as given, with uy, gamma and alpha of this turn.
    pub camera: Camera,
    /// The camera by the closed form alone.
    pub start: Camera,
    /// Ratio of the true angles to the ledger's.
    pub rho: f64,
    /// Standard deviations of the camera and of rho.
    pub sd: PsiSd,
    /// What the views say of the glass. `None` where the camera has none, or they say nothing.
    pub glass: Option<GlassFound>,
    /// Strength of the perspective that the views show, as a share of the camera's: 1 as given, 0 for parallel rays, less where near and far are
    /// exchanged. `None` where the views do not tell.
    pub perspective: Option<f64>,
    /// What was found of each view, in the order given.
    pub views: Vec<ViewState>,
    /// The step in the specimen's pose. `None` where it stayed where it was.
    pub moved: Option<Moved>,
    /// Standard deviation of the edges against the model, um.
    pub residual_sd_um: f64,
    /// Passes of the least squares.
    pub passes: usize,
    /// Whether the passes converged.
    pub converged: bool,
    /// Covariance of uy (px), gamma, alpha (rad) and rho.
    pub covariance: Matrix4<f64>,
    first: f64,
}

impl Calibration {
    /// The true angle of a view that the ledger has at `omega`, rad.
    pub fn angle(&self, omega: f64) -> f64 {
        self.first + self.rho * (omega - self.first)
    }

    /// The views that count, each with its calibrated pose. `given` are all views, as they were calibrated.
    pub fn turn_views<'a>(&self, given: &[GivenView<'a>]) -> Vec<TurnView<'a>> {
        let used = given.iter().zip(&self.views).filter(|(_, state)| state.bad.is_none());
        used.map(|(view, state)| TurnView { columns: view.columns, omega: self.angle(view.omega), dy_px: state.dy_px }).collect()
    }

    /// The projection of a view that the ledger has at `omega` (rad). The view's shift is added to the principal point.
    pub fn projection(&self, view: usize, omega: f64) -> Projection {
        Camera { uy: self.camera.uy + self.views[view].dy_px, ..self.camera.clone() }.projection(self.angle(omega))
    }

    /// Whether the ratio of angles differs from 1 by more than five standard deviations, in enough views of a specimen that did
    /// not move. A specimen that turned once in the capillary looks like another ratio.
    pub fn is_rho_significant(&self) -> bool {
        let used = self.views.iter().filter(|v| v.bad.is_none()).count();
        used >= RHO_VIEWS_LEAST && self.moved.is_none() && (self.rho - 1.0).abs() > SURE * self.sd.rho
    }

    /// Whether the capillary did not turn as far as the ledger says, by more than 1 %.
    pub fn has_wrong_steps(&self) -> bool {
        self.is_rho_significant() && (self.rho - 1.0).abs() > WRONG_STEPS
    }
}

/// Estimates uy, gamma, alpha, the ratio of true to planned angles and the shift of each view. Views that do not belong are
/// left out.
///
/// # Errors
/// [`CalibrationError`] when too few views agree on a specimen, or the views do not determine the axis.
pub fn calibrate(camera: &Camera, given: &[GivenView], priors: Priors) -> Result<Calibration, CalibrationError> {
    let mut bad: Vec<Option<Bad>> = given.iter().map(|v| v.columns.extent().is_none().then_some(Bad::Blank)).collect();
    let good = |bad: &[Option<Bad>]| -> Vec<usize> { (0..given.len()).filter(|&i| bad[i].is_none()).collect() };
    let shown = good(&bad);
    let areas: Vec<(f64, f64)> = shown.iter().map(|&i| (given[i].omega, given[i].columns.area_px())).collect();
    let profiles: Vec<_> = shown.iter().map(|&i| given[i].columns).collect();
    for (at, why) in wrong_areas(&areas).into_iter().chain(short(&profiles)) {
        bad[shown[at]] = Some(why);
    }
    let mut used = good(&bad);
    if used.len() < VIEWS_LEAST {
        return Err(CalibrationError::TooFewViews { used: used.len(), given: given.len() });
    }
    let least = VIEWS_LEAST.max(((1.0 - BAD_SHARE) * given.len() as f64) as usize);
    let mut views: Vec<GivenView> = used.iter().map(|&i| given[i]).collect();
    let mut found = solved(camera, &views, priors)?;
    let mut offs = views_off(&found.solution, &turned(&views));
    let mut shifted = specimen_moved(camera, &found, &views, &offs, priors);
    while shifted.is_none() && used.len() > least {
        let Some((at, why)) = worst(&offs) else { break };
        bad[used[at]] = Some(why);
        used.remove(at);
        views.remove(at);
        found = solved(camera, &views, priors)?;
        offs = views_off(&found.solution, &turned(&views));
        // An outlier scatters so far that it hides a step.
        shifted = specimen_moved(camera, &found, &views, &offs, priors);
    }
    let mut covariance = covariance(camera, &found, &views, &offs, priors);
    let slip = found.solution.rho - 1.0;
    let is_unsure = slip.abs() > SLIP_LEAST && slip.abs() < SLIP_SURE * covariance[(3, 3)].sqrt();
    if found.is_axis_observable
        && is_unsure
        && let Ok(held) = solve(&found.start, camera, 1.0, &views, Priors { rho: HELD, ..priors })
    {
        // What is not known to differ from the ledger does not: few views of a fin look like slip. It may differ by as much.
        covariance[(3, 3)] += slip * slip;
        found.solution = held;
        offs = views_off(&found.solution, &turned(&views));
    }
    let sd = |at: usize| covariance[(at, at)].sqrt();
    let Solved { start, solution, .. } = found;
    let mut states: Vec<ViewState> = bad.into_iter().map(|bad| ViewState { bad, dy_px: 0.0, residual_px: None }).collect();
    for ((&i, off), &dy_px) in used.iter().zip(&offs).zip(&solution.dy_px) {
        states[i] = ViewState { bad: None, dy_px, residual_px: Some(off.rms_px) };
    }
    Ok(Calibration {
        sd: PsiSd { uy_px: sd(0), gamma_rad: sd(1), alpha_rad: sd(2), rho: sd(3) },
        covariance,
        glass: solution.glass,
        perspective: solution.perspective,
        camera: solution.camera,
        start,
        rho: solution.rho,
        views: states,
        moved: shifted.map(|m| Moved { view: used[m.view], ..m }),
        residual_sd_um: solution.residual_sd_um,
        passes: solution.passes,
        converged: solution.converged,
        first: pivot(&views),
    })
}

/// The ratio of angles is that of the ledger unless it differs by so many standard deviations. A smaller difference than the least one changes
/// nothing. 12 views of larvae with fins that turned by the ledger gave 0.9988 to 1.0052, each within 1.5 standard deviations.
const SLIP_SURE: f64 = 3.0;
const SLIP_LEAST: f64 = 2e-4;

/// The specimen turned within the capillary if the residuals of the views on the shorter side fall to this share with the turn. They fell to 0.32 to
/// 0.77 in turns of larvae that did by 9 deg (12 and 84 views), and to 0.85 to 0.98 for the best turn of larvae with fins that did not (12 views).
const TURN_EXPLAINS: f64 = 0.8;

/// The step in the specimen's pose. What few views show of fins looks like a turn, so a turn counts only if it explains their edges.
fn specimen_moved(camera: &Camera, found: &Solved, views: &[GivenView], offs: &[ViewOff], priors: Priors) -> Option<Moved> {
    let at = turned(views);
    let step = moved(offs, &at, found.is_axis_observable)?;
    let mut corrected = views.to_vec();
    corrected[step.view..].iter_mut().for_each(|view| view.omega += step.turn_rad);
    let side = if 2 * step.view < views.len() { 0..step.view } else { step.view..views.len() };
    let residual_px = |offs: &[ViewOff]| offs[side.clone()].iter().map(|off| off.rms_px).sum::<f64>();
    let explains = |solution: Solution| residual_px(&views_off(&solution, &turned(&corrected))) < TURN_EXPLAINS * residual_px(offs);
    if solve(&found.start, camera, 1.0, &corrected, priors).is_ok_and(explains) { Some(step) } else { moved(offs, &at, false) }
}

/// Angle of each view from the pivot by the ledger, rad.
fn turned(views: &[GivenView]) -> Vec<f64> {
    views.iter().map(|v| v.omega - pivot(views)).collect()
}

/// Covariance of uy, gamma, alpha and rho: that of the least squares, but not less than what is known otherwise.
fn covariance(camera: &Camera, found: &Solved, views: &[GivenView], offs: &[ViewOff], priors: Priors) -> Matrix4<f64> {
    let mut covariance = found.solution.covariance.fixed_view::<4, 4>(0, 0).into_owned();
    let mut at_least = |at: usize, sd: f64| covariance[(at, at)] = covariance[(at, at)].max(sd * sd);
    // The scatter of the views' own angles says how well their ratio is known: an angle's error is the same in all slices.
    let angles: Vec<[f64; 2]> = turned(views).into_iter().zip(offs).map(|(at, off)| [at, off.turn]).collect();
    at_least(3, Line::through(&angles).and_then(|line| line.slope_sd).unwrap_or(0.0));
    if !found.is_axis_observable {
        at_least(3, priors.rho);
        at_least(1, priors.gamma_rad);
        // uy is the row of the axis in the principal point's column, and the specimen lies beside it.
        let lever_px =
            upper_median(views.iter().filter_map(|v| v.columns.extent()).map(|(a, b)| (a + b) as f64 / 2.0 - camera.ux).collect());
        at_least(0, lever_px.abs() * priors.gamma_rad);
        at_least(2, priors.alpha_rad);
    }
    covariance
}

/// A solution with its start.
struct Solved {
    start: Camera,
    solution: Solution,
    /// Whether roll and tilt are observable. Of a round specimen they are not, and those of the given camera are used.
    is_axis_observable: bool,
}

fn solved(camera: &Camera, views: &[GivenView], priors: Priors) -> Result<Solved, CalibrationError> {
    let from = |rho: f64, priors: Priors| {
        let first = pivot(views);
        let turned: Vec<_> = views.iter().map(|v| (v.columns, first + rho * (v.omega - first))).collect();
        let start = axis(camera, &turned)?;
        let free = solve(&start, camera, rho, views, priors).ok();
        // Views that fit no turn are fitted best by equal angles, which are no turn.
        let near = |s: &Solution| (s.rho / rho - 1.0).abs() < NEAR;
        let solution = match free.filter(near) {
            Some(solution) => solution,
            None => solve(&start, camera, rho, views, Priors { rho: HELD, ..priors })?,
        };
        Ok::<_, CalibrationError>(Solved { start, solution, is_axis_observable: true })
    };
    let residual = |s: &Solved| s.solution.residual_sd_um;
    let mut nominal = from(1.0, priors);
    if nominal.as_ref().is_ok_and(|s| !s.solution.converged && is_round(&s.solution)) {
        // A round specimen looks alike however the axis lies and however far it turned. Nothing converges, and only the place
        // of the axis at the specimen is observable.
        let held = from(1.0, Priors { gamma_rad: HELD, alpha_rad: HELD, rho: HELD, ..priors });
        let explains = |held: &Solved| nominal.as_ref().ok().is_none_or(|free| residual(held) < ROUND * residual(free));
        if let Some(held) = held.ok().filter(explains) {
            nominal = Ok(Solved { is_axis_observable: false, ..held });
        }
    }
    if views.len() < RHO_VIEWS_LEAST || nominal.as_ref().is_ok_and(|s| residual(s) * camera.ky <= DOUBT_PX) {
        return nominal;
    }
    // Another number of steps per revolution: all angles have one ratio to the planned ones.
    let others = RATIOS.iter().filter_map(|&rho| from(rho, priors).ok());
    let better = others.min_by(|a, b| residual(a).total_cmp(&residual(b)));
    match (nominal, better) {
        // The planned ratio stands unless another explains everything. A specimen that moved fits no ratio, and some ratios a
        // little better.
        (Ok(a), Some(b)) if residual(&b) > EXPLAINS * residual(&a) || residual(&b) * camera.ky > DOUBT_PX => Ok(a),
        (_, Some(b)) => Ok(b),
        (nominal, None) => nominal,
    }
}

/// Whether most slices are discs.
fn is_round(solution: &Solution) -> bool {
    let shape = |coefficients: &[f64]| coefficients.iter().skip(3).map(|c| c * c).sum::<f64>().sqrt() / coefficients[0];
    upper_median(solution.slices.iter().map(|(_, fit)| shape(&fit.support.coefficients)).collect()) < DISC
}

/// Ratios of true to planned angles that are tried as a start. Half the turn is not among them: it shows every slice from each
/// side once, and any views fit that.
const RATIOS: [f64; 11] = [0.75, 0.8, 0.84, 0.88, 0.92, 0.96, 1.04, 1.08, 1.14, 1.2, 1.3];
