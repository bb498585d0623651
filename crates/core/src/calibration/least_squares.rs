//! Axis, roll, tilt, slip and a shift per view by least squares. The support function of each slice is eliminated.
//!
//! ```text
//!   residual of a tangent = offset(uy, gamma, alpha, dy_i) - h_slice(theta(rho))
//!   normal matrix of what is sought - what the slices' own coefficients explain of it (Schur) + priors
//! ```
//! Shifts that vary with cos omega and sin omega are those of a specimen that lies elsewhere. The same holds for every odd
//! harmonic: these are the gauge (null-space) directions of the problem.

use super::slices::{Fit, Slice, SliceError, SlicesLost, fit, harmonics};
use super::support::Support;
use super::tangents::{Pose, TurnView};
use crate::geometry::{Camera, GlassTube};
use crate::parallel::prelude::*;
use crate::profile::Columns;
use crate::statistics::mad_sd;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// Prior standard deviations of the unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Priors {
    /// Of gamma, rad, about the camera as given. The roll of a bead is hardly observable beyond this.
    pub gamma_rad: f64,
    /// Of alpha, rad, about the camera as given.
    pub alpha_rad: f64,
    /// Of the ratio of the true angles to the planned ones.
    pub rho: f64,
    /// Of the shift of one view, px.
    pub dy_px: f64,
}

impl Default for Priors {
    fn default() -> Self {
        Self { gamma_rad: 1f64.to_radians(), alpha_rad: 1f64.to_radians(), rho: 0.05, dy_px: 1.0 }
    }
}

/// Number of unknowns before the shifts: uy, gamma, alpha, rho.
const SHARED: usize = 4;
/// Most passes of the least squares; they end then whether or not they have converged.
pub const PASSES_MOST: usize = 8;
/// Number of slices that are fitted.
const SLICES: usize = 120;
/// Least standard deviation of an edge, um. A px is 5.5 um, and segmentation at its best gives a tenth of it.
const SD_LEAST_UM: f64 = 0.2;

/// Weight that holds a gauge direction at 0, per px^2: a standard deviation of a thousandth of a px.
const HELD: f64 = 1e6;

/// A pass that would change the tilt by more than this many standard deviations of its prior leaves it unchanged. The tilt is
/// so weakly observable that it takes up errors of every other kind, and returns by only half of them per pass.
const TILT_MOST: f64 = 3.0;
/// Weight that holds the tilt, per rad^2: a standard deviation of a microradian.
const TILT_HELD: f64 = 1e12;

/// Weight that holds the glass and the perspective while all else is sought.
const RAYS_HELD: f64 = 1e12;
/// A share of the perspective with a larger standard deviation says nothing. Larvae of 12 and 21 views have 0.03 to 0.07.
const PERSPECTIVE_SD_MOST: f64 = 0.2;

/// A solution of the least squares.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    pub camera: Camera,
    /// What the views say of the glass. `None` where the camera has none, or they say nothing.
    pub glass: Option<GlassFound>,
    /// Strength of the perspective that the views show, as a share of the camera's: 1 as given, 0 for parallel rays, less where near and far are
    /// exchanged. `None` where the views do not tell.
    pub perspective: Option<f64>,
    pub rho: f64,
    pub dy_px: Vec<f64>,
    /// Covariance of uy (px), gamma, alpha (rad), rho and each dy (px), in this order.
    pub covariance: DMatrix<f64>,
    /// Robust standard deviation of the residuals, um.
    pub residual_sd_um: f64,
    pub passes: usize,
    pub converged: bool,
    pub slices: Vec<(Slice, Fit)>,
    /// Orthonormal gauge directions of the shifts, which no slice can distinguish from its own shape. `dy_px` has no component
    /// along them.
    pub gauge: Vec<DVector<f64>>,
}

/// Least number of slices that the views of a turn must have in common.
const SLICES_LEAST: usize = 8;

/// Why the least squares have no solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// Too many views have no profile.
    #[error("{found} of {given} views have a profile; three quarters are needed. Look at the frames of the others")]
    FewProfiles {
        /// Views with a profile.
        found: usize,
        /// Views given.
        given: usize,
    },
    /// Too few slices have an outline.
    #[error(
        "{found} slices across the capillary have an outline; {SLICES_LEAST} are needed. {lost}. Look whether the specimen slid along the capillary or left \
         the view, and check the scale of the camera"
    )]
    FewSlices {
        /// Slices with an outline.
        found: usize,
        /// The other slices, by cause.
        lost: SlicesLost,
    },
    /// The normal equations are singular.
    #[error(
        "the edges do not determine the axis: the least squares have no solution. Look whether the profiles are smooth and closed, and measure with the camera as it is"
    )]
    Singular,
}

/// A view as it is given to the calibration.
#[derive(Debug, Clone, Copy)]
pub struct GivenView<'a> {
    /// Edges of its profile, column by column.
    pub columns: &'a Columns,
    /// Angle of the capillary by the ledger, rad.
    pub omega: f64,
}

/// The angle about which slip turns all others: 0, or the angle nearest to it.
pub(super) fn pivot(given: &[GivenView]) -> f64 {
    given.iter().map(|v| v.omega).min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
}

/// Solves for the turn of one camera. The search starts from `camera` and `rho`; gamma and alpha are held to those of
/// `nominal`.
///
/// # Errors
/// [`SolveError`] when the views show too little of the specimen, or when their edges do not determine the axis.
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
            let perspective = found_perspective(matrix.clone(), &right);
            matrix[(SHARED + n, SHARED + n)] -= RAYS_HELD;
            let glass = camera.glass.and_then(|tube| found_glass(&tube, matrix, &right));
            return Ok(Solution {
                camera,
                glass,
                perspective,
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
            // Wrong edges, as of fins that some views miss, are no tilt. The tilt waits until these edges have less weight.
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
        // A step well within the uncertainty changes nothing, and neither does one within the resolution that is needed.
        let small = |at: usize, resolution: f64| step[at].abs() < resolution.max(0.02 * factor.inverse()[(at, at)].sqrt());
        converged = passes > 1 && !tilts_too_far && small(0, 0.005) && small(1, 1e-5) && small(3, 2e-5);
    }
}

/// What the views say of the glass, and so of the sense of rotation: a turn in the other sense is that of a mirror image, whose rays the glass
/// would turn the other way.
///
/// `matrix` and `right` are those of the solution, without what holds the glass. One step from the given ratio of the radii finds the one that the
/// views show, since `eps` is nearly straight in it.
fn found_glass(tube: &GlassTube, mut matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<GlassFound> {
    let at = matrix.nrows() - 2;
    // A ratio of 0 to 1 is all there is: the prior is loose, and only there for views that do not show it.
    matrix[(at, at)] += 1.0;
    let factor = matrix.cholesky()?;
    let ratio = tube.bore_radius_um / tube.outer_radius_um;
    let (found, sd) = (ratio - factor.solve(right)[at], factor.inverse()[(at, at)].sqrt());
    // The ratio at which no ray is turned, or as little as possible: 1 in water.
    let b_um = NEAR_THE_WALL * tube.bore_radius_um;
    let clear = ratio - tube.turn(b_um)[0] / tube.turn_by_ratio(b_um);
    let strength = (found - clear) / (ratio - clear);
    let strength_sd = (sd / (ratio - clear)).abs();
    let outer_radius_um = tube.bore_radius_um / found;
    let is_known = found > 0.0 && found.is_finite() && sd < RATIO_SD_MOST;
    is_known.then(|| GlassFound {
        outer_radius_um,
        outer_radius_sd_um: outer_radius_um * sd / found,
        is_sense_right: match strength {
            _ if strength.abs() < SENSE_SURE * strength_sd => None,
            RIGHT_LEAST.. => Some(true),
            ..WRONG_MOST => Some(false),
            _ => None,
        },
    })
}

/// The strength of the perspective at which the views fit best, by one step from that of the camera. It is only drawn half of the way towards what a
/// turn in the other sense would have, since the columns and weights of the tangents are those of the given camera.
fn found_perspective(mut matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<f64> {
    let at = matrix.nrows() - 1;
    // The prior is loose, and only there for cameras whose rays are parallel.
    matrix[(at, at)] += 1.0 - RAYS_HELD;
    let factor = matrix.cholesky()?;
    let (share, sd) = (1.0 - factor.solve(right)[at], factor.inverse()[(at, at)].sqrt());
    (share.is_finite() && sd < PERSPECTIVE_SD_MOST).then_some(share)
}

/// Share of the bore at which rays are compared.
const NEAR_THE_WALL: f64 = 0.85;
/// A ratio of the radii with a larger standard deviation says nothing: thin and thick walls differ by 0.2.
const RATIO_SD_MOST: f64 = 0.1;
/// Standard deviations from which on rays are turned one way or the other, and the least and largest share of what the given glass does.
/// Corners of fins draw the share half of the way to 1: a finned larva without glass has 0.53.
const SENSE_SURE: f64 = 5.0;
const RIGHT_LEAST: f64 = 0.75;
const WRONG_MOST: f64 = -0.5;

/// What the rays of one turn say of the glass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GlassFound {
    /// Radius of the outer face at which the views fit best, um. Less than that of the bore: the rays are turned the other way.
    pub outer_radius_um: f64,
    /// Its standard deviation by the residuals of this turn, um.
    pub outer_radius_sd_um: f64,
    /// Whether the capillary turned in the sense of the configuration. `None` where the rays are turned too little to tell.
    pub is_sense_right: Option<bool>,
}

/// Fits the support function of each slice, in the columns that the previous `supports` indicate. Returns the fitted slices and
/// the standard deviation of their residuals; `sd_um` is the previous one.
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
    // A series with as many coefficients as tangents would leave no residual, so the sum is divided by the degrees of freedom.
    let tangents: usize = slices.iter().map(|(s, _)| s.sights.len()).sum();
    let free = (tangents as f64 - (slices.len() * (2 * series + 1)) as f64).max(1.0);
    let all: Vec<f64> = slices.iter().flat_map(|(_, f)| f.residuals.iter().copied()).collect();
    let sd_um = (mad_sd(&all) * (tangents as f64 / free).sqrt()).max(SD_LEAST_UM);
    Ok((slices, sd_um))
}

/// Orthonormal gauge directions of the shifts. Their mean is a shift of the axis, and the part that varies with an odd harmonic
/// of omega is that harmonic of every slice. Both are left to the axis and the slices.
fn gauge(omegas: &[f64], harmonics: usize) -> Vec<DVector<f64>> {
    let wave = |k: usize, shift: f64| DVector::from_iterator(omegas.len(), omegas.iter().map(|w| (k as f64 * w - shift).cos()));
    let odd = (1..=harmonics).step_by(2).flat_map(|k| [wave(k, 0.0), wave(k, FRAC_PI_2)]);
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for mut candidate in std::iter::once(wave(0, 0.0)).chain(odd) {
        let length = candidate.norm();
        for direction in &basis {
            candidate.axpy(-direction.dot(&candidate), direction, 1.0);
        }
        // The rest of a wave that the others make up is rounding.
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

/// Places of the slices, um, at even steps over the part of the specimen that most views show.
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

/// Matrix and right side of the Gauss-Newton step, for residuals in standard deviations.
fn normal_equations(
    slices: &[(Slice, Fit)],
    state: &State,
    given: &[GivenView],
    first: f64,
    sd_um: f64,
    (nominal, rho): (&Camera, f64),
    priors: Priors,
) -> (DMatrix<f64>, DVector<f64>) {
    // The last ones are the ratio of the radii of the glass, and the share of the camera's perspective.
    let unknowns = SHARED + given.len() + 2;
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
    // The order is fixed: the same profiles give the same bits on any number of threads.
    for (m, r) in parts {
        matrix += m;
        right += r;
    }
    let mut hold = |at: usize, off: f64, sd: f64| {
        matrix[(at, at)] += 1.0 / (sd * sd);
        right[at] += off / (sd * sd);
    };
    // Loose enough to change nothing. It keeps the equations regular where the profiles do not determine an unknown.
    hold(0, 0.0, 1e3);
    hold(1, state.camera.gamma - nominal.gamma, priors.gamma_rad);
    hold(2, state.camera.alpha - nominal.alpha, priors.alpha_rad);
    hold(3, state.rho - rho, priors.rho);
    for (i, &dy) in state.dy_px.iter().enumerate() {
        hold(SHARED + i, dy, priors.dy_px);
    }
    for at in [unknowns - 2, unknowns - 1] {
        matrix[(at, at)] += RAYS_HELD;
    }
    (matrix, right)
}

/// Adds the equations of a slice, less what the slice's own coefficients explain (Schur complement).
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
    // The slice's coefficients against the shared unknowns.
    let mut mixed = DMatrix::<f64>::zeros(size, unknowns);
    let mut own = DVector::<f64>::zeros(size);
    let per_variance = 1.0 / (sd_um * sd_um);
    for (((sight, row), residual), weight) in slice.sights.iter().zip(fit.rows.chunks_exact(size)).zip(&fit.residuals).zip(&fit.weights) {
        let t = &sight.tangent;
        let sign = sight.side.sign();
        let px_um = 1.0 / camera.ky;
        let [_, slope] = fit.support.at(t.theta);
        let steep = t.edge_slope * camera.kx / camera.ky;
        let columns = [0, 1, 2, 3, SHARED + sight.view, unknowns - 2, unknowns - 1];
        // What moves a tangent outwards also turns it in the glass, to where the slice is wider or narrower.
        let out = sign + slope * t.turns;
        let values = [
            -out * px_um,
            -out * (slice.x_um + steep * t.touch_um[0]),
            out * (steep * t.touch_um[1] - t.ray * slice.x_um),
            slope * (given[sight.view].omega - first),
            // For one tangent a shift of the axis and a shift of the profile are the same.
            -out * px_um,
            slope * camera.glass.map_or(0.0, |tube| tube.turn_by_ratio(sign * t.offset_um)),
            // Rays that spread more turn the tangent, and show what lies farther away nearer to the principal point.
            slope * t.ray - out * steep * slice.x_um * t.touch_um[1] / camera.f,
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
    // The factor of the fit is that of the unscaled equations.
    let factor = fit.normal.l();
    let Some(explained) = factor.solve_lower_triangular(&mixed) else { return };
    let Some(left) = factor.solve_lower_triangular(&own) else { return };
    let scale = 1.0 / per_variance;
    matrix.gemm_tr(-scale, &explained, &explained, 1.0);
    right.gemv_tr(-scale, &explained, &left, 1.0);
}
