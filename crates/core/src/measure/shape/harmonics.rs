//! Spherical-harmonic power of the surface.
//!
//! ```text
//!   body axis ──> s: surface ahead of the slice / all of it = (1 - z) / 2        a sphere of even area
//!   around it ──> phi: angle around the slice's centre, carried along without twist
//!
//!   X(z, phi) = sum of c_lm Y_lm          power of degree l = sum over m and the three coordinates of |c_lm|^2 / 4 pi
//! ```
//! `r(theta, phi)` around the centroid would need a body that is star-shaped around it; a larva that is bent by its own
//! thickness is not. The coordinates themselves as functions on a sphere need only slices that are star-shaped. A turn of the
//! body mixes coordinates and a turn of the sphere mixes orders m: neither changes the power of a degree.

use super::axis::STATIONS;
use super::body::Slices;
use super::section::{Section, cut, ranks};
use super::{Refusal, Vector};
use crate::surface::Mesh;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Highest degree that is computed.
pub const MAX_DEGREE: usize = 8;
/// Coefficients of a degree: cosines of orders 0 to 8, then sines of orders 1 to 8.
const ORDERS: usize = 2 * MAX_DEGREE + 1;
/// Slices at the nodes of Gauss' quadrature, and rays in each.
const SLICES: usize = 48;
const RAYS: usize = 64;
const ALL: i32 = RAYS as i32;
/// Bins of the area along the axis.
const BINS: usize = 4 * STATIONS;
/// Largest share of rays that meet the surface several times or never. Beyond it slices are not star-shaped. The fins of a hull
/// take up to half of it.
const STRAY_SHARE: f64 = 0.05;

/// Power of the surface per degree, independent of position and orientation.
///
/// Error: 1e-3 of the sum for bodies with rounded ends on 250 000 triangles. A flat end counts as if it were a four-hundredth
/// of the length deep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Harmonics {
    /// Power of degrees 1 to 8, um^2. Degree 1 is the part of an ellipsoid; a ball has its squared radius there and nothing
    /// else.
    pub power_um2: Vec<f64>,
    /// Each power over their sum: independent of size, too.
    pub power_share: Vec<f64>,
    /// Mean square distance of the surface from its centre less the powers: the part of finer degrees, um^2.
    pub finer_um2: f64,
}

impl Harmonics {
    pub(super) fn of(mesh: &Mesh, slices: &Slices) -> Result<Self, Refusal> {
        let length_um = slices.axis.length_um();
        let ahead = area_ahead(mesh, slices);
        let whole = ahead[BINS];
        let nodes = gauss_legendre(SLICES);
        let s_um: Vec<f64> = nodes
            .iter()
            .map(|&(z, _)| {
                let wanted = whole * (1.0 - z) / 2.0;
                let bin = ahead.partition_point(|&a| a <= wanted).clamp(1, BINS);
                let span = ahead[bin] - ahead[bin - 1];
                let part = if span > 0.0 { (wanted - ahead[bin - 1]) / span } else { 0.5 };
                length_um * (bin as f64 - 1.0 + part) / BINS as f64
            })
            .collect();
        let planes = slices.axis.planes(&s_um, slices.planes[STATIONS / 2].across[0]);
        let ranks = ranks(mesh, &planes);
        let (sections, _) = cut(mesh, &planes, &ranks);
        let mut strays = 0;
        let mut coefficients = vec![Vector::zeros(); (MAX_DEGREE + 1) * ORDERS];
        let (mut mean_square, mut mean) = (0.0, Vector::zeros());
        for ((plane, section), &(z, weight)) in planes.iter().zip(&sections).zip(&nodes) {
            let centre = section.flat().map_or([0.0; 2], |f| f.centre);
            let (reaches, stray) = rays(section, centre);
            strays += stray;
            let places: Vec<Vector> = (0..RAYS)
                .map(|k| {
                    let (sin, cos) = (TAU * k as f64 / RAYS as f64).sin_cos();
                    plane.point([centre[0] + reaches[k] * cos, centre[1] + reaches[k] * sin])
                })
                .collect();
            // The sphere's 4 pi, shared out.
            let share = weight * TAU / RAYS as f64;
            let heights = normalised_legendre(z);
            for order in 0..=MAX_DEGREE {
                let (mut even, mut odd) = (Vector::zeros(), Vector::zeros());
                for (k, place) in places.iter().enumerate() {
                    let (sin, cos) = (TAU * ((order * k) % RAYS) as f64 / RAYS as f64).sin_cos();
                    even += place * cos;
                    odd += place * sin;
                }
                let both = if order == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
                for degree in order..=MAX_DEGREE {
                    let factor = both * share * heights[degree][order];
                    coefficients[degree * ORDERS + order] += even * factor;
                    if order > 0 {
                        coefficients[degree * ORDERS + MAX_DEGREE + order] += odd * factor;
                    }
                }
            }
            mean += places.iter().sum::<Vector>() * (share / (4.0 * PI));
            mean_square += places.iter().map(Vector::norm_squared).sum::<f64>() * (share / (4.0 * PI));
        }
        if strays as f64 > STRAY_SHARE * (SLICES * RAYS) as f64 {
            return Err(Refusal::Star { rays: strays, of: SLICES * RAYS });
        }
        let power_um2: Vec<f64> = (1..=MAX_DEGREE)
            .map(|degree| {
                let row = &coefficients[degree * ORDERS..(degree + 1) * ORDERS];
                row.iter().map(Vector::norm_squared).sum::<f64>() / (4.0 * PI)
            })
            .collect();
        let sum: f64 = power_um2.iter().sum();
        let finer_um2 = (mean_square - mean.norm_squared() - sum).max(0.0);
        Ok(Self { power_share: power_um2.iter().map(|p| p / sum).collect(), power_um2, finer_um2 })
    }
}

/// Area of the surface ahead of even places along the axis.
fn area_ahead(mesh: &Mesh, slices: &Slices) -> Vec<f64> {
    let Slices { axis, s_um, planes, ranks, .. } = slices;
    let per_bin = BINS as f64 / axis.length_um();
    // The place of a vertex between two planes follows from its distances to both.
    let place = |v: u32| {
        let (rank, at) = (ranks[v as usize] as usize, mesh.vertices[v as usize]);
        let height = |p: usize| planes[p].height(at);
        let s = match rank {
            0 => s_um[0] + height(0),
            STATIONS => s_um[STATIONS - 1] + height(STATIONS - 1),
            _ => {
                let [behind, before] = [height(rank - 1), -height(rank)];
                s_um[rank - 1] + (s_um[rank] - s_um[rank - 1]) * behind / (behind + before)
            }
        };
        (s * per_bin).clamp(0.0, BINS as f64)
    };
    let mut bins = vec![0.0; BINS + 1];
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle).map(Vector::from);
        let area = (b - a).cross(&(c - a)).norm() / 2.0;
        let mut s = triangle.map(place);
        s.sort_by(f64::total_cmp);
        let [low, middle, high] = s;
        // Share of a triangle in front of a place: quadratic from its first corner, and quadratic to its last.
        let before = |at: f64| match at {
            at if at <= low => 0.0,
            at if at >= high => 1.0,
            at if at < middle => (at - low) * (at - low) / ((middle - low) * (high - low)),
            at => 1.0 - (high - at) * (high - at) / ((high - middle) * (high - low)),
        };
        let last = (high as usize).min(BINS - 1);
        let mut done = 0.0;
        for bin in low as usize..=last {
            let share = if bin == last { 1.0 } else { before(bin as f64 + 1.0) };
            bins[bin.min(BINS - 1) + 1] += area * (share - done);
            done = share;
        }
    }
    let mut sum = 0.0;
    bins.iter()
        .map(|area| {
            sum += area;
            sum
        })
        .collect()
}

/// How far rays from a section's centre at even angles reach, the farthest where they meet its border more than once; and how
/// many meet it more than once or never.
fn rays(section: &Section, centre: [f64; 2]) -> ([f64; RAYS], usize) {
    let (mut reaches, mut hits) = ([0.0f64; RAYS], [0; RAYS]);
    // The first ray that is not before a corner. Sides that meet there agree on it to the bit, so that a ray through it meets one.
    let next_ray = |p: [f64; 2]| (p[1].atan2(p[0]) / TAU * RAYS as f64).ceil() as i32;
    for side in &section.sides {
        let [a, b] = side.map(|p| [p[0] - centre[0], p[1] - centre[1]]);
        let (from, to) = (next_ray(a), next_ray(b));
        // The short way round.
        let by = (to - from + ALL / 2).rem_euclid(ALL) - ALL / 2;
        let first = if by > 0 { from } else { to };
        for ray in first..first + by.abs() {
            let at = ray.rem_euclid(ALL) as usize;
            let (sin, cos) = (TAU * at as f64 / RAYS as f64).sin_cos();
            let [before, behind] = [a[1] * cos - a[0] * sin, b[1] * cos - b[0] * sin];
            let span = before - behind;
            let part = if span == 0.0 { 0.0 } else { (before / span).clamp(0.0, 1.0) };
            let hit = (a[0] + (b[0] - a[0]) * part) * cos + (a[1] + (b[1] - a[1]) * part) * sin;
            reaches[at] = reaches[at].max(hit);
            hits[at] += 1;
        }
    }
    (reaches, hits.iter().filter(|&&h| h != 1).count())
}

/// Nodes in falling order and weights, which sum to 2.
fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|i| {
            let mut z = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            // Newton's steps double the digits; the start has three.
            for _ in 0..6 {
                let (mut last, mut now) = (1.0, z);
                for k in 2..=n {
                    let k = k as f64;
                    (last, now) = (now, ((2.0 * k - 1.0) * z * now - (k - 1.0) * last) / k);
                }
                slope = n as f64 * (z * now - last) / (z * z - 1.0);
                z -= now / slope;
            }
            (z, 2.0 / ((1.0 - z * z) * slope * slope))
        })
        .collect()
}

/// Legendre's associated functions by degree and order, so that with sqrt(2) cos, sin of the angle the square's integral over
/// the sphere is 1.
fn normalised_legendre(z: f64) -> [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1] {
    let mut p = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    let ring = (1.0 - z * z).sqrt();
    p[0][0] = (1.0 / (4.0 * PI)).sqrt();
    for m in 0..=MAX_DEGREE {
        if m > 0 {
            p[m][m] = p[m - 1][m - 1] * ring * ((2.0 * m as f64 + 1.0) / (2.0 * m as f64)).sqrt();
        }
        for l in m + 1..=MAX_DEGREE {
            let (lf, mf) = (l as f64, m as f64);
            let a = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
            let before = if l > m + 1 { p[l - 2][m] } else { 0.0 };
            let b = (((lf - 1.0) * (lf - 1.0) - mf * mf) / (4.0 * (lf - 1.0) * (lf - 1.0) - 1.0)).sqrt();
            p[l][m] = a * (z * p[l - 1][m] - b * before);
        }
    }
    p
}
