//! Slices of the specimen, with the tangents that all views give of each and the support function nearest to them.

use super::support::{Support, basis};
use super::tangents::{Pose, Side, Tangent, TurnView};
use crate::statistics::huber;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::f64::consts::TAU;

/// Least share of the views that must show a slice: towards the ends perspective hides it from some.
pub(super) const SHARE_OF_VIEWS: f64 = 0.75;

/// Why a slice has no support function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum SliceError {
    #[error("the views show {found} edges of the slice; {needed} are needed")]
    FewEdges { found: usize, needed: usize },
    #[error("the edges of the slice do not determine its outline")]
    Undetermined,
    #[error("the outline that is nearest to the slice's edges encloses nothing")]
    Empty,
}

/// Slices without a support function, counted by cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SlicesLost {
    /// Too few views show them.
    pub few_edges: usize,
    /// Their edges do not determine an outline.
    pub undetermined: usize,
    /// The outline that is nearest to their edges encloses nothing.
    pub empty: usize,
}

impl SlicesLost {
    /// Counts the failures among some slices.
    pub(crate) fn among<T>(slices: &[Result<T, SliceError>]) -> Self {
        let mut lost = Self::default();
        for error in slices.iter().filter_map(|slice| slice.as_ref().err()) {
            match error {
                SliceError::FewEdges { .. } => lost.few_edges += 1,
                SliceError::Undetermined => lost.undetermined += 1,
                SliceError::Empty => lost.empty += 1,
            }
        }
        lost
    }
}

impl std::fmt::Display for SlicesLost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { few_edges, undetermined, empty } = self;
        write!(
            f,
            "Of the other slices {few_edges} are shown by fewer than three quarters of the views, {undetermined} have edges that do not determine an outline, and {empty} have an outline that encloses nothing"
        )
    }
}

/// The tangents of one slice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    pub view: usize,
    pub side: Side,
    pub tangent: Tangent,
}

/// One slice: its place and its tangents.
#[derive(Debug, Clone)]
pub(crate) struct Slice {
    pub x_um: f64,
    pub sights: Vec<Sight>,
}

impl Slice {
    /// The tangents of slice `x_um` (um along the axis). `support` is the slice's own support function from the pass before: it says in
    /// which column each tangent touches. Without one the column that sees the axis is read.
    ///
    /// # Errors
    /// [`SliceError::FewEdges`] where too few views see the slice.
    pub fn of(x_um: f64, pose: &Pose, views: &[TurnView], support: Option<&Support>) -> Result<Self, SliceError> {
        let mut sights = Vec::with_capacity(2 * views.len());
        for (number, view) in views.iter().enumerate() {
            for side in Side::BOTH {
                sights.extend(pose.tangent(x_um, view, side, support).map(|tangent| Sight { view: number, side, tangent }));
            }
        }
        let needed = 2.0 * SHARE_OF_VIEWS * views.len() as f64;
        if (sights.len() as f64) < needed {
            return Err(SliceError::FewEdges { found: sights.len(), needed: needed.ceil() as usize });
        }
        Ok(Self { x_um, sights })
    }
}

/// The support function nearest to a slice's tangents.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub support: Support,
    /// Residuals of the tangents' offsets, um.
    pub residuals: Vec<f64>,
    pub weights: Vec<f64>,
    /// Rows of the series at each tangent, one after the other.
    pub rows: Vec<f64>,
    pub normal: Cholesky<f64, Dyn>,
}

impl Fit {
    /// Leave-one-out residuals of a view, um: the residuals of its tangents against the fit of all other views. Each comes with
    /// the number of its tangent. Empty where the view has no tangent, or where the others do not determine the fit.
    pub fn leave_one_out(&self, slice: &Slice, view: usize) -> Vec<(usize, f64)> {
        let own = own(slice, view);
        if own.is_empty() {
            return Vec::new();
        }
        let rows = self.rows_of(&own);
        let lever = rows.transpose() * self.normal.solve(&rows);
        // (I - B S B' W) e = r
        let open = DMatrix::from_fn(own.len(), own.len(), |a, b| f64::from(u8::from(a == b)) - lever[(a, b)] * self.weights[own[b]]);
        let residual = DVector::from_iterator(own.len(), own.iter().map(|&at| self.residuals[at]));
        // A view that alone determines a coefficient cannot be judged by the others.
        let Some(leave_one_out) = open.lu().solve(&residual) else { return Vec::new() };
        own.into_iter().zip(leave_one_out.iter().copied()).collect()
    }

    /// How the coefficients change when a view is left out.
    pub fn without(&self, slice: &Slice, view: usize) -> Vec<f64> {
        let leave_one_out = self.leave_one_out(slice, view);
        if leave_one_out.is_empty() {
            return vec![0.0; self.support.coefficients.len()];
        }
        let own: Vec<usize> = leave_one_out.iter().map(|(at, _)| *at).collect();
        let weighed = DVector::from_iterator(own.len(), leave_one_out.iter().map(|(at, e)| -self.weights[*at] * e));
        self.normal.solve(&(self.rows_of(&own) * weighed)).as_slice().to_vec()
    }

    /// The series at some sights, a column each.
    fn rows_of(&self, sights: &[usize]) -> DMatrix<f64> {
        let size = self.support.coefficients.len();
        DMatrix::from_fn(size, sights.len(), |k, n| self.rows[sights[n] * size + k])
    }
}

fn own(slice: &Slice, view: usize) -> Vec<usize> {
    slice.sights.iter().enumerate().filter(|(_, s)| s.view == view).map(|(at, _)| at).collect()
}

/// The normal equations of a series of some harmonics: the sums over the tangents of which its coefficients are the solution.
#[derive(Debug, Clone)]
pub(crate) struct Equations {
    size: usize,
    /// The lower triangle, row by row.
    normal: Vec<f64>,
    right: Vec<f64>,
}

impl Equations {
    /// Those of no tangent.
    pub fn new(harmonics: usize) -> Self {
        let size = 2 * harmonics + 1;
        Self { size, normal: vec![0.0; size * size], right: vec![0.0; size] }
    }

    /// Adds a tangent at the distance `offset_um`. `row` is the series in its direction. A negative weight takes a tangent out again.
    pub fn add(&mut self, row: &[f64], offset_um: f64, weight: f64) {
        let size = self.size;
        for (a, &value) in row.iter().enumerate() {
            let weighed = weight * value;
            self.right[a] += weighed * offset_um;
            for (sum, &other) in self.normal[a * size..=a * size + a].iter_mut().zip(row) {
                *sum += weighed * other;
            }
        }
    }

    /// The solution for the first of the harmonics, with what it was solved by. `None` where the tangents do not determine it.
    pub fn solved(&self, harmonics: usize) -> Option<(Support, Cholesky<f64, Dyn>)> {
        let size = self.size.min(2 * harmonics + 1);
        let normal = DMatrix::from_fn(size, size, |a, b| self.normal[a.max(b) * self.size + a.min(b)]).cholesky()?;
        let coefficients = normal.solve(&DVector::from_column_slice(&self.right[..size]));
        Some((Support { coefficients: coefficients.as_slice().to_vec() }, normal))
    }
}

/// Fits a series of so many harmonics to the tangents of a slice. Residuals beyond the standard deviation `sd_um` count less
/// (Huber), in so many rounds.
///
/// # Errors
/// [`SliceError::Undetermined`] where the tangents do not determine as many harmonics.
pub(crate) fn fit(slice: &Slice, harmonics: usize, sd_um: f64, rounds: usize) -> Result<Fit, SliceError> {
    let size = 2 * harmonics + 1;
    let n = slice.sights.len();
    let mut rows = vec![0.0; n * size];
    for (sight, row) in slice.sights.iter().zip(rows.chunks_exact_mut(size)) {
        basis(sight.tangent.theta, row);
    }
    let mut weights = vec![1.0; n];
    let mut round = 0;
    loop {
        let mut equations = Equations::new(harmonics);
        for ((sight, row), weight) in slice.sights.iter().zip(rows.chunks_exact(size)).zip(&weights) {
            equations.add(row, sight.tangent.offset_um, *weight);
        }
        let (support, normal) = equations.solved(harmonics).ok_or(SliceError::Undetermined)?;
        let residuals: Vec<f64> = slice
            .sights
            .iter()
            .zip(rows.chunks_exact(size))
            .map(|(s, row)| s.tangent.offset_um - row.iter().zip(&support.coefficients).map(|(a, b)| a * b).sum::<f64>())
            .collect();
        round += 1;
        if round > rounds {
            return Ok(Fit { support, residuals, weights, rows, normal });
        }
        for (weight, residual) in weights.iter_mut().zip(&residuals) {
            *weight = huber(residual / sd_um);
        }
    }
}

/// Largest number of harmonics of a slice's series.
pub const HARMONICS_MOST: usize = 8;

/// Number of harmonics that the views at these angles (rad) determine, with enough left over to distinguish noise from shape:
/// 3, 4, 5 and 8 for 7, 12, 14 and 21 views. As many coefficients as directions would follow every error of an angle.
pub(crate) fn harmonics(omegas: &[f64]) -> usize {
    let by_directions = (0.36 * directions(omegas) as f64) as usize;
    (omegas.len().saturating_sub(1) / 2).min(by_directions).clamp(1, HARMONICS_MOST)
}

/// Number of directions from which views at these angles (rad) see the edges of a slice. Opposite views are mirror images and
/// count once.
pub fn directions(omegas: &[f64]) -> usize {
    let apart = 0.3 * TAU / (2 * omegas.len().max(1)) as f64;
    gaps(omegas).filter(|gap| *gap > apart).count()
}

/// The widest angle in which no view sees an edge, rad.
pub fn widest_gap(omegas: &[f64]) -> f64 {
    gaps(omegas).fold(0.0, f64::max)
}

/// Angle from each direction in which a view sees an edge to the next one, rad.
fn gaps(omegas: &[f64]) -> impl Iterator<Item = f64> {
    let mut normals: Vec<f64> = omegas.iter().flat_map(|w| [w.rem_euclid(TAU), (w + TAU / 2.0).rem_euclid(TAU)]).collect();
    normals.sort_by(f64::total_cmp);
    let first = normals.first().map(|first| first + TAU);
    let next: Vec<f64> = normals.iter().skip(1).copied().chain(first).collect();
    normals.into_iter().zip(next).map(|(from, to)| to - from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_views_count_once() {
        let even = |n: u32| (0..n).map(|i| f64::from(i) * TAU / f64::from(n)).collect::<Vec<_>>();
        let found: Vec<_> = [4, 7, 12, 14, 21, 28, 84].map(even).iter().map(|o| (directions(o), harmonics(o))).collect();
        assert!((widest_gap(&even(7)) - TAU / 14.0).abs() < 1e-9 && (widest_gap(&even(4)) - TAU / 4.0).abs() < 1e-9);
        let third: Vec<f64> = even(21)[..7].to_vec();
        assert!((widest_gap(&third) - (TAU / 2.0 - 6.0 * TAU / 21.0)).abs() < 1e-9, "{}", widest_gap(&third));
        assert_eq!((directions(&[1.0; 9]), directions(&[])), (2, 0));
        assert_eq!(found, [(4, 1), (14, 3), (12, 4), (14, 5), (42, 8), (28, 8), (84, 8)]);
    }
}
