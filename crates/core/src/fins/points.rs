//! Points of fins in one slice: where the tangents of neighbouring views that stand out of the body meet.

use super::{Edge, SAME_PX, Slice, centre};
use crate::calibration::Support;
use crate::statistics::upper_median;
use nalgebra::{Matrix2, Vector2};
use std::f64::consts::TAU;

/// How far an edge must stand out of the body to be one of a fin, px.
const STANDS_PX: f64 = 4.0;
/// Least edges of a point.
const EDGES_LEAST: usize = 3;
/// A wider gap between two edges, rad, separates two fins. Where there are few views, this many times the angle between their
/// directions does.
const GAP: f64 = 25.0 / 180.0 * std::f64::consts::PI;
const GAP_DIRECTIONS: f64 = 1.4;
/// Edges that two points explain with less than this share of what one leaves are those of two fins.
const SPLIT: f64 = 0.4;
/// Squared distance beyond which an edge counts no more when groups are split, px^2.
const CAP_PX2: f64 = 9.0;
/// Rounds of the robust fit, and the least scatter that it assumes, px.
const ROUNDS: usize = 5;
const SD_LEAST_PX: f64 = 0.3;

/// A point of a fin in a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// y and z about the capillary's axis, um.
    pub at_um: [f64; 2],
    pub edges: usize,
}

/// An edge that stands out, about the body's centre.
#[derive(Clone, Copy)]
struct Outstanding {
    theta: f64,
    h: f64,
}

/// Widest gap between two edges of one fin, rad, for views from so many directions.
pub(super) fn widest_gap(directions: usize) -> f64 {
    GAP.max(GAP_DIRECTIONS * TAU / directions.max(1) as f64)
}

/// The points of fins in a slice. `widest` is the widest gap between two edges of one fin, rad.
pub(super) fn of(slice: &Slice, body: &Support, widest: f64, px_um: f64) -> Vec<Point> {
    let [y, z] = centre(body);
    let mut out: Vec<Outstanding> = slice
        .edges
        .iter()
        .filter(|e| e.found_um - body.at(e.theta)[0] > STANDS_PX * px_um)
        .map(|&Edge { theta, found_um, .. }| Outstanding { theta: theta.rem_euclid(TAU), h: found_um - y * theta.cos() - z * theta.sin() })
        .collect();
    if out.len() < EDGES_LEAST {
        return Vec::new();
    }
    out.sort_by(|a, b| a.theta.total_cmp(&b.theta));
    // Begin after the widest gap, so that no group goes on over the end.
    let n = out.len();
    let gap = |i: usize| (out[(i + 1) % n].theta - out[i].theta).rem_euclid(TAU);
    let begin = (0..n).max_by(|&a, &b| gap(a).total_cmp(&gap(b))).unwrap_or(0);
    out.rotate_left((begin + 1) % n);
    let mut points = Vec::new();
    for group in out.chunk_by(|a, b| (b.theta - a.theta).rem_euclid(TAU) <= widest) {
        let (first, second) = group.split_at(split(group, px_um));
        for part in [first, second] {
            if let Some((at, edges)) = meeting(part, px_um) {
                points.push(Point { at_um: [at[0] + y, at[1] + z], edges });
            }
        }
    }
    points
}

/// Where a group is divided between two fins; its length where it is one.
fn split(group: &[Outstanding], px_um: f64) -> usize {
    let n = group.len();
    let one = misfit(group, px_um);
    if n < 2 * EDGES_LEAST || one <= n as f64 {
        return n;
    }
    let two = |k: &usize| misfit(&group[..*k], px_um) + misfit(&group[*k..], px_um);
    let best = (EDGES_LEAST..=n - EDGES_LEAST).min_by(|a, b| two(a).total_cmp(&two(b)));
    best.filter(|k| two(k) < SPLIT * one).unwrap_or(n)
}

/// Sum of the capped squares of the distances from the point nearest to these tangents, px^2.
fn misfit(group: &[Outstanding], px_um: f64) -> f64 {
    let Some(p) = nearest(group, &vec![1.0; group.len()]) else { return CAP_PX2 * group.len() as f64 };
    group.iter().map(|e| (residual(e, p) / px_um).powi(2).min(CAP_PX2)).sum()
}

fn residual(e: &Outstanding, p: Vector2<f64>) -> f64 {
    e.h - p.x * e.theta.cos() - p.y * e.theta.sin()
}

/// The point nearest to these tangents by weighted least squares.
fn nearest(group: &[Outstanding], weights: &[f64]) -> Option<Vector2<f64>> {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for (e, &weight) in group.iter().zip(weights) {
        let row = Vector2::new(e.theta.cos(), e.theta.sin());
        normal += row * row.transpose() * weight;
        right += row * (weight * e.h);
    }
    (normal.determinant() > 1e-6).then(|| normal.cholesky().map(|c| c.solve(&right))).flatten()
}

/// The point in which these tangents meet, robustly, and the number of those that pass by it.
fn meeting(group: &[Outstanding], px_um: f64) -> Option<(Vector2<f64>, usize)> {
    if group.len() < EDGES_LEAST {
        return None;
    }
    let mut weights = vec![1.0; group.len()];
    let mut found = Vector2::zeros();
    for _ in 0..ROUNDS {
        let p = nearest(group, &weights)?;
        let residuals: Vec<f64> = group.iter().map(|e| residual(e, p)).collect();
        let sd = (1.4826 * upper_median(residuals.iter().map(|r| r.abs()).collect())).max(SD_LEAST_PX * px_um);
        weights.iter_mut().zip(&residuals).for_each(|(w, r)| *w = 1.0 / (1.0 + (r / (2.0 * sd)).powi(2)));
        found = p;
    }
    let edges = group.iter().filter(|e| residual(e, found).abs() < SAME_PX * px_um).count();
    (edges >= EDGES_LEAST).then_some((found, edges))
}
