//! The body of each slice without its fins: a short series through the edges, most of which show the body.

use super::{Edge, Slice};
use crate::calibration::{Support, basis};
use crate::parallel::prelude::*;
use crate::statistics::{Line, upper_median};
use nalgebra::{SMatrix, SVector};

/// Harmonics of the body's outline.
const HARMONICS: usize = 3;
const SIZE: usize = 2 * HARMONICS + 1;
/// Rounds with a small weight for what stands out, then rounds with a weight that falls with the distance.
const ROUNDS: (usize, usize) = (6, 8);
const OUTWARD: f64 = 0.12;
const OUTWARD_PX: f64 = 0.7;
/// Weights that hold the coefficients where edges are few: those of size and place, and those of the shape.
const HELD: f64 = 2e-5;
const SHAPE_HELD: f64 = 8e-3;
/// Slices over which a coefficient is the median, and those of the mean after it.
const MEDIAN: usize = 13;
const SIGMA: f64 = 3.0;
/// Radius of what is beyond the body's end, px.
const BEYOND_PX: f64 = 1.0;
/// Slices from which the centre is extrapolated beyond the body's end.
const END: usize = 25;

/// The coefficients of a body's outline.
type Coefficients = SVector<f64, SIZE>;

/// A body that has edges so far inside its outline, px root mean square, is no short series: the slice is bent or has two parts.
const INWARD_MOST_PX: f64 = 1.5;

/// Why a slice has no body of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Missing {
    /// Too few views show one.
    Edges,
    /// No outline of these harmonics describes it.
    Shape,
}

/// The outline nearest to a slice's edges, of which fins stand out. At least `needed` edges must show a body.
fn nearest(edges: &[Edge], needed: usize, px_um: f64) -> Result<Coefficients, Missing> {
    let row = |theta: f64| {
        let mut row = Coefficients::zeros();
        basis(theta, row.as_mut_slice());
        row
    };
    let seen: Vec<(Coefficients, f64)> = edges.iter().filter_map(|e| Some((row(e.theta), e.body_um?))).collect();
    if seen.len() < needed.max(SIZE) {
        return Err(Missing::Edges);
    }
    let shape = |i: usize| if i < 3 { HELD } else { SHAPE_HELD };
    let held = SMatrix::<f64, SIZE, SIZE>::from_fn(|i, j| if i == j { shape(i) * seen.len() as f64 } else { 0.0 });
    let mut weights = vec![1.0; seen.len()];
    let mut found = Coefficients::zeros();
    for round in 0..ROUNDS.0 + ROUNDS.1 {
        let mut normal = held;
        let mut right = Coefficients::zeros();
        for ((row, h), &weight) in seen.iter().zip(&weights) {
            normal += row * row.transpose() * weight;
            right += row * (weight * h);
        }
        found = normal.cholesky().ok_or(Missing::Shape)?.solve(&right);
        for ((row, h), weight) in seen.iter().zip(&mut weights) {
            let outward_px = (h - row.dot(&found)) / px_um;
            *weight = if round >= ROUNDS.0 {
                (OUTWARD_PX / outward_px.max(OUTWARD_PX)).powi(2)
            } else if outward_px > 0.0 {
                OUTWARD
            } else {
                1.0
            };
        }
    }
    let inward = |(row, h): &(Coefficients, f64)| ((row.dot(&found) - h) / px_um).max(0.0).powi(2);
    let mean_square = seen.iter().map(inward).sum::<f64>() / seen.len() as f64;
    if mean_square <= INWARD_MOST_PX * INWARD_MOST_PX { Ok(found) } else { Err(Missing::Shape) }
}

/// What is known of the body in a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    /// Its outline.
    Body,
    /// There is none: only fins go on beyond its end.
    NoBody,
    /// Nothing: the slice is bent or has two parts.
    Nothing,
}

/// The body of every slice, smoothed along the capillary. Holes are filled, except long ones in which the body has another shape. Beyond the
/// ends of the body its centre goes on straight, with a pixel around it. `None` where no slice has one.
pub(super) fn bodies(slices: &[Slice], needed: usize, px_um: f64) -> Option<Vec<(Known, Support)>> {
    let raw: Vec<Result<Coefficients, Missing>> = slices.par_iter().map(|s| nearest(&s.edges, needed, px_um)).collect();
    let at: Vec<usize> = (0..raw.len()).filter(|&i| raw[i].is_ok()).collect();
    let there: Vec<Coefficients> = raw.iter().flatten().copied().collect();
    let (&first, &last) = (at.first()?, at.last()?);
    let along = |k: usize| -> Vec<f64> {
        let medians: Vec<f64> = (0..there.len())
            .map(|i| upper_median((0..MEDIAN).map(|j| there[(i + j).saturating_sub(MEDIAN / 2).min(there.len() - 1)][k]).collect()))
            .collect();
        smoothed(&medians, SIGMA)
    };
    let coefficients: Vec<Vec<f64>> = (0..SIZE).into_par_iter().map(along).collect();
    // Centres beyond the ends, by the line through the last slices.
    let line = |near: std::ops::Range<usize>, k: usize, x: usize| {
        let points: Vec<[f64; 2]> = near.map(|j| [at[j] as f64, coefficients[k][j]]).collect();
        let mean = |i: usize| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64;
        let slope = Line::through(&points).map_or(0.0, |line| line.slope);
        mean(1) + slope * (x as f64 - mean(0))
    };
    let series = |of: &dyn Fn(usize) -> f64| Support { coefficients: (0..SIZE).map(of).collect() };
    let count = there.len().min(END);
    let body = |x: usize| {
        if x < first || x > last {
            let near = if x < first { 0..count } else { there.len() - count..there.len() };
            let known = if raw[x] == Err(Missing::Edges) { Known::NoBody } else { Known::Nothing };
            let beyond = |k: usize| match k {
                0 => BEYOND_PX * px_um,
                1 | 2 => line(near.clone(), k, x),
                _ => 0.0,
            };
            return (known, series(&beyond));
        }
        let j = at.partition_point(|&a| a < x);
        if at[j] == x {
            return (Known::Body, series(&|k| coefficients[k][j]));
        }
        let (before, after) = (at[j - 1], at[j]);
        let part = (x - before) as f64 / (after - before) as f64;
        let known = if raw[x] == Err(Missing::Shape) && after - before > MEDIAN { Known::Nothing } else { Known::Body };
        (known, series(&|k| coefficients[k][j - 1] + part * (coefficients[k][j] - coefficients[k][j - 1])))
    };
    Some((0..slices.len()).map(body).collect())
}

/// Smoothed by a Gaussian. Beyond its ends a series goes on by its reflection in the end's point.
pub(super) fn smoothed(values: &[f64], sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as isize;
    let weight = |k: isize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    let (n, sum) = (values.len() as isize, (-reach..=reach).map(weight).sum::<f64>());
    let at = |i: isize| {
        let last = n - 1;
        if i < 0 {
            2.0 * values[0] - values[(-i).min(last) as usize]
        } else if i > last {
            2.0 * values[last as usize] - values[(2 * last - i).max(0) as usize]
        } else {
            values[i as usize]
        }
    };
    (0..n).map(|i| (-reach..=reach).map(|k| weight(k) / sum * at(i + k)).sum()).collect()
}
