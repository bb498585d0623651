//! The body of each slice without its fins: a short series through the edges, most of which show the body.

use super::{Edge, Slice};
use crate::calibration::{Support, basis};
use crate::parallel::prelude::*;
use crate::statistics::median;
use nalgebra::{SMatrix, SVector};

/// Harmonics of the body's outline.
const HARMONICS: usize = 3;
const SIZE: usize = 2 * HARMONICS + 1;
/// Least share of the half-views that must show a body in a slice.
const SHARE_LEAST: f64 = 0.6;
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
/// Slices from which the centre is extrapolated beyond the body's end.
const END: usize = 25;

/// The coefficients of a body's outline.
type Coefficients = SVector<f64, SIZE>;

/// A body that has edges so far inside its outline, px root mean square, is no short series: the slice is bent or has two parts.
const INWARD_MOST_PX: f64 = 1.5;

/// The outline nearest to a slice's edges, of which fins stand out. `None` where too few views show a body, and where no outline of
/// these harmonics describes it.
fn nearest(edges: &[Edge], half_views: usize, px_um: f64) -> Option<Coefficients> {
    let row = |theta: f64| {
        let mut row = Coefficients::zeros();
        basis(theta, row.as_mut_slice());
        row
    };
    let seen: Vec<(Coefficients, f64)> = edges.iter().filter_map(|e| Some((row(e.theta), e.body_um?))).collect();
    if (edges.len() as f64) < SHARE_LEAST * half_views as f64 || seen.len() < SIZE {
        return None;
    }
    let held = SMatrix::<f64, SIZE, SIZE>::from_fn(|i, j| {
        if i != j {
            0.0
        } else if i < 3 {
            HELD
        } else {
            SHAPE_HELD
        }
    });
    let mut weights = vec![1.0; seen.len()];
    let mut found = Coefficients::zeros();
    for round in 0..ROUNDS.0 + ROUNDS.1 {
        let mut normal = held * seen.len() as f64;
        let mut right = Coefficients::zeros();
        for ((row, h), &weight) in seen.iter().zip(&weights) {
            normal += row * row.transpose() * weight;
            right += row * (weight * h);
        }
        found = normal.cholesky()?.solve(&right);
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
    (mean_square <= INWARD_MOST_PX * INWARD_MOST_PX).then_some(found)
}

/// The body of every slice, smoothed along the capillary. Beyond the ends of the body its centre goes on straight, with nothing around
/// it. `None` where no slice has one.
pub(super) fn bodies(slices: &[Slice], half_views: usize, px_um: f64) -> Option<Vec<Support>> {
    let raw: Vec<Option<Coefficients>> = slices.par_iter().map(|s| nearest(&s.edges, half_views, px_um)).collect();
    let at: Vec<usize> = (0..raw.len()).filter(|&i| raw[i].is_some()).collect();
    let there: Vec<Coefficients> = raw.into_iter().flatten().collect();
    let (&first, &last) = (at.first()?, at.last()?);
    let along = |k: usize| -> Vec<f64> {
        let medians: Vec<f64> = (0..there.len())
            .map(|i| median((0..MEDIAN).map(|j| there[(i + j).saturating_sub(MEDIAN / 2).min(there.len() - 1)][k]).collect()))
            .collect();
        smoothed(&medians, SIGMA)
    };
    let coefficients: Vec<Vec<f64>> = (0..SIZE).into_par_iter().map(along).collect();
    // Centres beyond the ends, by the line through the last slices.
    let line = |near: &[usize], k: usize, x: usize| {
        let n = near.len() as f64;
        let (mx, my) = (near.iter().map(|&j| at[j] as f64).sum::<f64>() / n, near.iter().map(|&j| coefficients[k][j]).sum::<f64>() / n);
        let (xy, xx) = near.iter().fold((0.0, 0.0), |(xy, xx), &j| {
            let dx = at[j] as f64 - mx;
            (xy + dx * (coefficients[k][j] - my), xx + dx * dx)
        });
        my + if xx > 0.0 { xy / xx * (x as f64 - mx) } else { 0.0 }
    };
    let series = |of: &dyn Fn(usize) -> f64| Support { coefficients: (0..SIZE).map(of).collect() };
    let count = there.len().min(END);
    let (left, right): (Vec<usize>, Vec<usize>) = ((0..count).collect(), (there.len() - count..there.len()).collect());
    Some(
        (0..slices.len())
            .map(|x| {
                if x < first || x > last {
                    let near = if x < first { &left } else { &right };
                    return series(&|k| if k == 1 || k == 2 { line(near, k, x) } else { 0.0 });
                }
                let j = at.partition_point(|&a| a < x);
                series(&|k| match at[j] {
                    here if here == x => coefficients[k][j],
                    after => {
                        let before = at[j - 1];
                        let part = (x - before) as f64 / (after - before) as f64;
                        coefficients[k][j - 1] + part * (coefficients[k][j] - coefficients[k][j - 1])
                    }
                })
            })
            .collect(),
    )
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
