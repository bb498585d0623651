//! Axis, roll, tilt, slip and a shift per view by least squares, each slice's support function eliminated.
//!
//! ```text
//!   residual of a tangent = offset(uy, gamma, alpha, dy_i) - h_slice(theta(rho))
//!   normal matrix of what is sought - what the slices' own coefficients explain of it (Schur) + priors
//! ```
//! Shifts that go with cos omega and sin omega are those of a specimen that lies elsewhere, and so on with every odd harmonic.

use super::slices::{Fit, Slice, SliceError, SlicesLost, fit, harmonics};
use super::support::Support;
use super::tangents::{Pose, TurnView};
use crate::geometry::Camera;
use crate::parallel::*;
use crate::profile::Columns;
use crate::statistics::mad_sd;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::FRAC_PI_2;

/// What is believed before any profile is seen, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Priors {
    /// Of gamma and alpha against the camera given. A bead tells its roll by little more than this.
    pub gamma_rad: f64,
    pub alpha_rad: f64,
    /// Of the ratio of true to planned angles.
    pub rho: f64,
    pub dy_px: f64,
}

impl Default for Priors {
    fn default() -> Self {
        Self { gamma_rad: 1f64.to_radians(), alpha_rad: 1f64.to_radians(), rho: 0.05, dy_px: 1.0 }
    }
}

/// Unknowns before the shifts: uy, gamma, alpha, rho.
const SHARED: usize = 4;
/// Passes are ended by then, converged or not.
pub const PASSES_MOST: usize = 8;
/// Slices that are looked at.
const SLICES: usize = 120;
/// Below this an edge is no better known: the px are 5.5 um, and a tenth is what segmentation gives at its best.
const SD_LEAST_UM: f64 = 0.2;

/// What holds a shift at nothing, per px^2: a thousandth of a px.
const HELD: f64 = 1e6;

/// A pass that would tilt the camera by more than this many of its prior's standard deviations tilts it not at all. Tilt is told so
/// weakly that it takes up what fits nothing else, and comes back by half a pass.
const TILT_MOST: f64 = 3.0;
/// What holds it, per rad^2: a microradian.
const TILT_HELD: f64 = 1e12;

/// A solution.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    pub camera: Camera,
    pub rho: f64,
    pub dy_px: Vec<f64>,
    /// Of uy (px), gamma, alpha (rad), rho and each dy (px), in this order.
    pub covariance: DMatrix<f64>,
    /// Robust standard deviation of the residuals.
    pub residual_sd_um: f64,
    pub passes: usize,
    pub converged: bool,
    pub slices: Vec<(Slice, Fit)>,
    /// Shifts that no slice can tell from its own shape, orthonormal: `dy_px` has no part of them.
    pub gauge: Vec<DVector<f64>>,
}

/// Slices that a turn must have in common.
const SLICES_LEAST: usize = 8;

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SolveError {
    #[error("{found} of {given} views have a profile; three quarters are needed. Look at the frames of the others")]
    FewProfiles { found: usize, given: usize },
    #[error(
        "{found} slices across the capillary have an outline; {SLICES_LEAST} are needed. {lost}. Look whether the specimen slid along the capillary or left \
         the view, and check the scale of the camera"
    )]
    FewSlices { found: usize, lost: SlicesLost },
    #[error(
        "the edges do not determine the axis: the least squares have no solution. Look whether the profiles are smooth and closed, and measure with the camera as it is"
    )]
    Singular,
}

/// A view as it is given to the solver.
#[derive(Debug, Clone, Copy)]
pub struct GivenView<'a> {
    pub columns: &'a Columns,
    /// By the ledger.
    pub omega: f64,
}

/// The angle that slip turns all others about: where the capillary was taken to be at 0, or nearest to it.
pub(super) fn pivot(given: &[GivenView]) -> f64 {
    given.iter().map(|v| v.omega).min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
}

/// Starts from `camera` with `rho`, and holds gamma and alpha to the `nominal` one's.
///
/// # Errors
/// When the views show too little of the specimen, or their edges do not determine the axis.
pub(crate) fn solve(camera: &Camera, nominal: &Camera, rho: f64, given: &[GivenView], priors: Priors) -> Result<Solution, SolveError> {
    let n = given.len();
    let first = pivot(given);
    let mut state = State { camera: camera.clone(), rho, dy_px: vec![0.0; n] };
    let xs = places(camera, given)?;
    let turned: Vec<f64> = given.iter().map(|v| first + rho * (v.omega - first)).collect();
    let series = harmonics(&turned);
    let gauge = gauge(&turned, series);
    let mut supports: Vec<Option<Support>> = vec![None; xs.len()];
    let mut sd_um = f64::INFINITY;
    let mut passes = 0;
    let mut converged = false;
    loop {
        let pose = Pose::new(&state.camera);
        let views: Vec<TurnView> = (0..n)
            .map(|i| TurnView { columns: given[i].columns, omega: first + state.rho * (given[i].omega - first), dy_px: state.dy_px[i] })
            .collect();
        let slices;
        (slices, sd_um) = fitted(&pose, &views, &xs, &mut supports, series, sd_um)?;
        let (mut matrix, mut right) = normal_equations(&slices, &state, given, first, sd_um, (nominal, rho), priors);
        for direction in &gauge {
            let off = direction.dot(&DVector::from_column_slice(&state.dy_px));
            matrix.view_mut((SHARED, SHARED), (n, n)).ger(HELD, direction, direction, 1.0);
            right.rows_mut(SHARED, n).axpy(HELD * off, direction, 1.0);
        }
        let factor = matrix.clone().cholesky().ok_or(SolveError::Singular)?;
        if converged || passes == PASSES_MOST {
            let State { camera, rho, dy_px } = state;
            return Ok(Solution {
                camera,
                rho,
                dy_px,
                covariance: factor.inverse(),
                residual_sd_um: sd_um,
                passes,
                converged,
                slices,
                gauge,
            });
        }
        let mut step = factor.solve(&right);
        let tilts_too_far = step[2].abs() > TILT_MOST * priors.alpha_rad;
        if tilts_too_far {
            // Edges that are wrong, as of fins that some views miss, are no tilt: it waits until those count less.
            matrix[(2, 2)] += TILT_HELD;
            step = matrix.cholesky().ok_or(SolveError::Singular)?.solve(&right);
        }
        state.camera.uy -= step[0];
        state.camera.gamma -= step[1];
        state.camera.alpha -= step[2];
        state.rho -= step[3];
        for (off, change) in state.dy_px.iter_mut().zip(step.iter().skip(SHARED)) {
            *off -= change;
        }
        passes += 1;
        // A step well within what is not known anyway changes nothing; one within the resolution of what is asked neither.
        let small = |at: usize, resolution: f64| step[at].abs() < resolution.max(0.02 * factor.inverse()[(at, at)].sqrt());
        converged = passes > 1 && !tilts_too_far && small(0, 0.005) && small(1, 1e-5) && small(3, 2e-5);
    }
}

/// The slices with the support function nearest to each, by columns that the `supports` before tell; and what residuals scatter by, which
/// `sd_um` was before.
fn fitted(
    pose: &Pose,
    views: &[TurnView],
    xs: &[f64],
    supports: &mut [Option<Support>],
    series: usize,
    sd_um: f64,
) -> Result<(Vec<(Slice, Fit)>, f64), SolveError> {
    let rounds = if sd_um.is_finite() { 2 } else { 0 };
    let slices: Vec<Result<(Slice, Fit), SliceError>> = xs
        .par_iter()
        .zip(&*supports)
        .map(|(&x_um, support)| {
            let slice = Slice::of(x_um, pose, views, support.as_ref())?;
            let fit = fit(&slice, series, sd_um, rounds)?;
            Ok((slice, fit))
        })
        .collect();
    for (support, found) in supports.iter_mut().zip(&slices) {
        *support = found.as_ref().ok().map(|(_, fit)| fit.support.clone());
    }
    let lost = SlicesLost::among(&slices);
    let slices: Vec<(Slice, Fit)> = slices.into_iter().flatten().collect();
    if slices.len() < SLICES_LEAST {
        return Err(SolveError::FewSlices { found: slices.len(), lost });
    }
    // A series with as many coefficients as there are tangents would leave no residual: what is left is per degree of freedom.
    let tangents: usize = slices.iter().map(|(s, _)| s.sights.len()).sum();
    let free = (tangents as f64 - (slices.len() * (2 * series + 1)) as f64).max(1.0);
    let all: Vec<f64> = slices.iter().flat_map(|(_, f)| f.residuals.iter().copied()).collect();
    let sd_um = (mad_sd(&all) * (tangents as f64 / free).sqrt()).max(SD_LEAST_UM);
    Ok((slices, sd_um))
}

/// Shifts that no slice can tell from its own shape, orthonormal: their mean is the axis', and what goes with an odd harmonic of
/// omega is that harmonic of every slice. They are left to axis and slices.
fn gauge(omegas: &[f64], harmonics: usize) -> Vec<DVector<f64>> {
    let wave = |k: usize, shift: f64| DVector::from_iterator(omegas.len(), omegas.iter().map(|w| (k as f64 * w - shift).cos()));
    let odd = (1..=harmonics).step_by(2).flat_map(|k| [wave(k, 0.0), wave(k, FRAC_PI_2)]);
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for mut candidate in std::iter::once(wave(0, 0.0)).chain(odd) {
        let length = candidate.norm();
        for direction in &basis {
            candidate.axpy(-direction.dot(&candidate), direction, 1.0);
        }
        // What is left of a wave that the others make up is rounding.
        if candidate.norm() > 1e-6 * length {
            basis.push(candidate.normalize());
        }
    }
    basis
}

struct State {
    camera: Camera,
    rho: f64,
    dy_px: Vec<f64>,
}

/// Slices at even steps over what most views see of the specimen.
fn places(camera: &Camera, given: &[GivenView]) -> Result<Vec<f64>, SolveError> {
    let extents: Vec<(usize, usize)> = given.iter().filter_map(|v| v.columns.extent()).collect();
    if extents.is_empty() || 4 * extents.len() < 3 * given.len() {
        return Err(SolveError::FewProfiles { found: extents.len(), given: given.len() });
    }
    let middle = |mut ends: Vec<usize>| {
        ends.sort_unstable();
        ends[ends.len() / 2] as f64
    };
    let (from, to) = (middle(extents.iter().map(|e| e.0).collect()), middle(extents.iter().map(|e| e.1).collect()));
    let pose = Pose::new(camera);
    let count = ((to - from) as usize).min(SLICES);
    Ok((0..count).map(|i| pose.slice(from + (to - from) * (i as f64 + 0.5) / count as f64)).collect())
}

/// Gauss-Newton's matrix and right side, of residuals in standard deviations.
fn normal_equations(
    slices: &[(Slice, Fit)],
    state: &State,
    given: &[GivenView],
    first: f64,
    sd_um: f64,
    (nominal, rho): (&Camera, f64),
    priors: Priors,
) -> (DMatrix<f64>, DVector<f64>) {
    let unknowns = SHARED + given.len();
    let mut matrix = DMatrix::zeros(unknowns, unknowns);
    let mut right = DVector::zeros(unknowns);
    let parts: Vec<(DMatrix<f64>, DVector<f64>)> = slices
        .par_chunks(16)
        .map(|chunk| {
            let mut sum = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
            for (slice, fit) in chunk {
                eliminate(slice, fit, state, given, first, sd_um, &mut sum);
            }
            sum
        })
        .collect();
    // In a fixed order: the same profiles give the same bits on any number of threads.
    for (m, r) in parts {
        matrix += m;
        right += r;
    }
    let mut hold = |at: usize, off: f64, sd: f64| {
        matrix[(at, at)] += 1.0 / (sd * sd);
        right[at] += off / (sd * sd);
    };
    // Loose enough to change nothing, for profiles that do not tell an unknown at all.
    hold(0, 0.0, 1e3);
    hold(1, state.camera.gamma - nominal.gamma, priors.gamma_rad);
    hold(2, state.camera.alpha - nominal.alpha, priors.alpha_rad);
    hold(3, state.rho - rho, priors.rho);
    for (i, &dy) in state.dy_px.iter().enumerate() {
        hold(SHARED + i, dy, priors.dy_px);
    }
    (matrix, right)
}

/// Adds a slice's equations less what its own coefficients explain.
fn eliminate(
    slice: &Slice,
    fit: &Fit,
    state: &State,
    given: &[GivenView],
    first: f64,
    sd_um: f64,
    (matrix, right): &mut (DMatrix<f64>, DVector<f64>),
) {
    let camera = &state.camera;
    let size = fit.support.coefficients.len();
    let unknowns = right.len();
    // Own coefficients against what is sought.
    let mut mixed = DMatrix::<f64>::zeros(size, unknowns);
    let mut own = DVector::<f64>::zeros(size);
    let per_variance = 1.0 / (sd_um * sd_um);
    for (((sight, row), residual), weight) in slice.sights.iter().zip(fit.rows.chunks_exact(size)).zip(&fit.residuals).zip(&fit.weights) {
        let t = &sight.tangent;
        let sign = sight.side.sign();
        let px_um = 1.0 / camera.ky;
        let [_, slope] = fit.support.at(t.theta);
        let steep = t.edge_slope * camera.kx / camera.ky;
        let columns = [0, 1, 2, 3, SHARED + sight.view];
        let values = [
            -sign * px_um,
            -sign * (slice.x_um + steep * t.touch_um[0]),
            sign * (steep * t.touch_um[1] - t.ray * slice.x_um),
            slope * (given[sight.view].omega - first),
            // A shift of the axis and one of the profile are the same to one tangent.
            -sign * px_um,
        ];
        let weight = weight * per_variance;
        for (&a, x) in columns.iter().zip(values) {
            right[a] += weight * x * residual;
            for (&b, y) in columns.iter().zip(values) {
                matrix[(a, b)] += weight * x * y;
            }
            for (k, value) in row.iter().enumerate() {
                mixed[(k, a)] += weight * value * x;
            }
        }
        for (k, value) in row.iter().enumerate() {
            own[k] += weight * value * residual;
        }
    }
    // The fit's factor is of unscaled equations.
    let factor = fit.normal.l();
    let Some(explained) = factor.solve_lower_triangular(&mixed) else { return };
    let Some(left) = factor.solve_lower_triangular(&own) else { return };
    let scale = 1.0 / per_variance;
    matrix.gemm_tr(-scale, &explained, &explained, 1.0);
    right.gemv_tr(-scale, &explained, &left, 1.0);
}
