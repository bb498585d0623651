//! Slices smoothed along the capillary, and what leaving out a view does to them.

use super::sections::Section;
use crate::calibration::{Fit, Side, Sight, Slice, Support};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// What leaving out a view changes in one slice and, summed over the slices, in the specimen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Change {
    /// Change of the area of a slice (um^2) or of the volume (um^3).
    pub volume: f64,
    /// Change of the perimeter (um) or of the area (um^2).
    pub outline: f64,
}

impl Change {
    pub fn add(&mut self, other: &Self, step_um: f64) {
        self.volume += other.volume * step_um;
        self.outline += other.outline * step_um;
    }
}

/// Savitzky-Golay filter along the capillary: each coefficient becomes the value of the parabola nearest to it and its
/// neighbours. It smooths the centre, the square of the mean radius, and the other harmonics over the radius: where a specimen
/// ends in an ellipsoid, these are a parabola and constants.
pub(super) struct Smoother<'a> {
    near: &'a [Support],
    first: usize,
    even: Vec<f64>,
    /// Weights by size: a thin slice determines its shape badly.
    by_size: Vec<f64>,
}

impl<'a> Smoother<'a> {
    pub fn new(raw: &'a [Support], at: usize, reach: usize) -> Option<Self> {
        let window = (2 * reach + 1).min(raw.len());
        let first = at.saturating_sub(reach).min(raw.len() - window);
        let near = &raw[first..first + window];
        let even = savitzky_golay(&vec![1.0; window], at - first)?;
        let by_size = savitzky_golay(&near.iter().map(|s| s.coefficients[0].powi(2)).collect::<Vec<_>>(), at - first)?;
        Some(Self { near, first, even, by_size })
    }

    fn mean(weights: &[f64], values: impl Iterator<Item = f64>) -> f64 {
        weights.iter().zip(values).map(|(w, v)| w * v).sum()
    }

    /// `None` beyond the specimen's end, where the parabola is not above 0.
    pub fn support(&self) -> Option<Support> {
        let of = |k: usize| self.near.iter().map(move |s| s.coefficients[k]);
        let square = Self::mean(&self.even, of(0).map(|r| r * r));
        let radius = (square > 0.0).then(|| square.sqrt())?;
        let coefficients = (0..self.near[0].coefficients.len()).map(|k| match k {
            0 => radius,
            1 | 2 => Self::mean(&self.even, of(k)),
            _ => radius * Self::mean(&self.by_size, of(k).zip(of(0)).map(|(c, r)| c / r)),
        });
        Some(Support { coefficients: coefficients.collect() })
    }

    /// The residuals of the edges of `slice`, each by its weight, smoothed as the harmonics are, um. `found` are the slices that are smoothed.
    pub fn residuals(&self, section: &Section, found: &[(Slice, Fit)], slice: &Slice) -> Vec<f64> {
        let mut sums: Vec<f64> = Vec::new();
        for ((slice, fit), weight) in found[self.first..].iter().zip(&self.by_size) {
            let weight = weight * section.support.coefficients[0] / fit.support.coefficients[0];
            for ((sight, residual), counts) in slice.sights.iter().zip(&fit.residuals).zip(&fit.weights) {
                let at = edge(sight);
                if at >= sums.len() {
                    sums.resize(at + 1, 0.0);
                }
                sums[at] += weight * counts * residual;
            }
        }
        slice.sights.iter().map(|sight| sums[edge(sight)]).collect()
    }

    /// The change of the smoothed slice's area and perimeter that follows from changes of the raw coefficients.
    /// `outline` is the smoothed one with its fins.
    pub fn change<'c>(&self, section: &Section, outline: &Support, raw_change: impl Fn(usize) -> &'c [f64]) -> Change {
        let smooth = &section.support;
        let radius = smooth.coefficients[0];
        let near = || self.near.iter().enumerate().map(|(j, s)| (&s.coefficients, raw_change(self.first + j)));
        let wider = Self::mean(&self.even, near().map(|(c, d)| c[0] * d[0])) / radius;
        let corners = section.corners();
        let mut change = Change { volume: 2.0 * outline.coefficients[0] * wider, outline: 2.0 * PI * wider };
        for k in 3..smooth.coefficients.len() {
            let shape = Self::mean(&self.by_size, near().map(|(c, d)| (d[k] - c[k] / c[0] * d[0]) / c[0]));
            let by = radius * shape + wider * smooth.coefficients[k] / radius;
            let loss = corners.area_loss(k.div_ceil(2));
            change.volume -= loss * outline.coefficients[k] * by;
        }
        change.volume *= PI;
        change
    }
}

/// Number of an edge among those of all views.
fn edge(sight: &Sight) -> usize {
    2 * sight.view + usize::from(sight.side == Side::Lower)
}

/// Weights of a Savitzky-Golay filter of second order at place `at` of evenly spaced values: the share of each value in the
/// value of the nearest parabola, with the given weights of the values.
fn savitzky_golay(weights: &[f64], at: usize) -> Option<Vec<f64>> {
    let row = |i: usize| {
        let u = i as f64 - at as f64;
        Vector3::new(1.0, u, u * u)
    };
    let normal: Matrix3<f64> = weights.iter().enumerate().map(|(i, w)| *w * row(i) * row(i).transpose()).sum();
    let first = normal.cholesky()?.solve(&Vector3::x());
    Some(weights.iter().enumerate().map(|(i, w)| w * row(i).dot(&first)).collect())
}
