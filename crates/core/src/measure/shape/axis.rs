//! The body axis: a smooth curve through the centres of the slices across it.
//!
//! ```text
//!    straight start        slices across           a polynomial through        slices across that,
//!    (principal axis)      it, their centres       their centres               twice more
//!   ----+----+----+---     |  / . \  |  .          __..--*--..__               / | \
//! ```
//! The curve is a polynomial of degree 4 in each coordinate over the relative arc length. It is fitted by least squares with
//! the thickness of the slices (root of the area) as weight, and continues straight from the first and last slice to the ends
//! of the body. The outermost slices are not fitted: a slice that is a little oblique in a blunt end is cut off on one side,
//! which moves its centre to the other side and makes the next slice more oblique.

use super::section::{Flat, Plane, cut, ranks};
use super::{Refusal, Solid, Vector};
use crate::surface::Mesh;
use nalgebra::{SMatrix, SVector};

/// Number of slices along the axis. Each is in the middle of its hundredth of the length, so that none lies on a flat end.
pub const STATIONS: usize = 100;
/// Degree of the curve. An S has 3, and an arc of 90 deg is off by 1e-4 of its radius. A higher degree follows a yolk and not
/// the body.
const DEGREE: usize = 4;
/// Slices at either end that the fit leaves out: 3 % for the first slices of a tube that is oblique by 30 deg.
const NOT_FITTED: usize = 3;
/// Fits after the straight start. From a tube bent by 90 deg, the third changes the length by less than 1e-4.
const FITS: usize = 3;
/// Pieces of the arc length's table: the chord of a piece is short of its arc by 1e-7 at a bend of a right angle.
const PIECES: usize = 400;
/// A body has a long axis if its second moment along it is this many times that across: half as long again as wide.
const ELONGATED: f64 = 2.25;

type Coefficients = SMatrix<f64, { DEGREE + 1 }, 3>;

/// A curve of known length, from the body's first end.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Of Legendre's polynomials in u.
    coefficients: Coefficients,
    /// u at the curve's ends, and the straight distance from there to the ends of the body.
    from_to: [f64; 2],
    reach_um: [f64; 2],
    /// Arc length from the curve's first end at `PIECES + 1` even values of u.
    arc_um: Vec<f64>,
}

impl Axis {
    /// Through the centroid along the long axis; along the capillary where the body has none. Low x comes first.
    fn straight(mesh: &Mesh, solid: &Solid) -> Self {
        let [least, next, most] = solid.principal_moments_um5;
        let half = (least + next + most) / 2.0;
        let elongated = half - least > ELONGATED * (half - next);
        let direction = if elongated { Vector::from(solid.principal_axes[0]) } else { Vector::x() };
        let direction = if direction.x < 0.0 { -direction } else { direction };
        let middle = Vector::from(solid.centroid_um);
        let ends = mesh.vertices.iter().map(|&v| (Vector::from(v) - middle).dot(&direction));
        let [low, high] = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(h), high.max(h)]);
        let mut coefficients = Coefficients::zeros();
        coefficients.set_row(0, &(middle + direction * f64::midpoint(low, high)).transpose());
        coefficients.set_row(1, &(direction * ((high - low) / 2.0)).transpose());
        Self::new(coefficients, [-1.0, 1.0])
    }

    fn new(coefficients: Coefficients, from_to: [f64; 2]) -> Self {
        let mut axis = Self { coefficients, from_to, reach_um: [0.0; 2], arc_um: vec![0.0] };
        let step = (from_to[1] - from_to[0]) / PIECES as f64;
        let mut sum = 0.0;
        for piece in 0..PIECES {
            sum += axis.velocity(from_to[0] + step * (piece as f64 + 0.5)).norm() * step;
            axis.arc_um.push(sum);
        }
        axis
    }

    /// Along the curve, from end to end of the body.
    pub fn length_um(&self) -> f64 {
        self.reach_um[0] + self.arc_um[PIECES] + self.reach_um[1]
    }

    fn velocity(&self, u: f64) -> Vector {
        (self.coefficients.transpose() * legendre(u).1).into_owned()
    }

    /// Place and unit tangent at an arc length from the body's first end.
    pub fn at(&self, s_um: f64) -> (Vector, Vector) {
        let from = s_um - self.reach_um[0];
        let within = from.clamp(0.0, self.arc_um[PIECES]);
        let piece = self.arc_um.partition_point(|&a| a <= within).clamp(1, PIECES);
        let [low, high] = [self.arc_um[piece - 1], self.arc_um[piece]];
        let part = if high > low { (within - low) / (high - low) } else { 0.0 };
        let u = self.from_to[0] + (self.from_to[1] - self.from_to[0]) * (piece as f64 - 1.0 + part) / PIECES as f64;
        let place = self.coefficients.transpose() * legendre(u).0;
        let tangent = self.velocity(u).normalize();
        (place + tangent * (from - within), tangent)
    }

    /// Planes across the curve. Their directions are carried along it without twist from `across` at its middle.
    pub fn planes(&self, s_um: &[f64], across: Vector) -> Vec<Plane> {
        let places: Vec<(Vector, Vector)> = s_um.iter().map(|&s| self.at(s)).collect();
        let (middle_at, middle_along) = self.at(self.length_um() / 2.0);
        let split = s_um.partition_point(|&s| s < self.length_um() / 2.0);
        let start = upright(across, middle_along);
        let carried = |order: &mut dyn Iterator<Item = &(Vector, Vector)>| {
            let mut last = (middle_at, middle_along, start);
            order
                .map(|&(at, along)| {
                    last = (at, along, carry(last, at, along));
                    Plane { at, across: [last.2, along.cross(&last.2)], along }
                })
                .collect::<Vec<_>>()
        };
        let mut planes = carried(&mut places[..split].iter().rev());
        planes.reverse();
        planes.extend(carried(&mut places[split..].iter()));
        planes
    }

    /// The same curve from its other end.
    pub fn reversed(mut self) -> Self {
        for (degree, mut row) in self.coefficients.row_iter_mut().enumerate() {
            if degree % 2 == 1 {
                row.neg_mut();
            }
        }
        let [from, to] = self.from_to;
        let reach_um = [self.reach_um[1], self.reach_um[0]];
        Self { reach_um, ..Self::new(self.coefficients, [-to, -from]) }
    }

    /// The curve through the centres of these slices.
    fn through(mesh: &Mesh, planes: &[Plane], ranks: &[u32], flats: &[Option<Flat>]) -> Result<Self, Refusal> {
        let mut normal = SMatrix::<f64, { DEGREE + 1 }, { DEGREE + 1 }>::zeros();
        let mut right = Coefficients::zeros();
        for ((station, plane), flat) in planes.iter().enumerate().zip(flats).take(STATIONS - NOT_FITTED).skip(NOT_FITTED) {
            if let Some(flat) = flat {
                let row = legendre(relative(station)).0;
                let weight = flat.area_um2.sqrt();
                normal += row * row.transpose() * weight;
                right += row * plane.point(flat.centre).transpose() * weight;
            }
        }
        let coefficients = normal.cholesky().ok_or(Refusal::Slices { empty: flats.iter().filter(|f| f.is_none()).count() })?.solve(&right);
        let mut axis = Self::new(coefficients, [relative(0), relative(STATIONS - 1)]);
        // The body's ends: the farthest of what lies near the first slice, and near the last. Where the fit has the curve reach
        // out of the body, they lie before its own.
        let (first, last) = (axis.at(0.0), axis.at(axis.arc_um[PIECES]));
        let mut ends = [f64::NEG_INFINITY; 2];
        for (&v, &rank) in mesh.vertices.iter().zip(ranks) {
            if rank as usize <= NOT_FITTED {
                ends[0] = ends[0].max((first.0 - Vector::from(v)).dot(&first.1));
            } else if rank as usize >= STATIONS - NOT_FITTED {
                ends[1] = ends[1].max((Vector::from(v) - last.0).dot(&last.1));
            }
        }
        axis.reach_um = ends.map(|end| if end.is_finite() { end } else { 0.0 });
        Ok(axis)
    }

    /// The axis of a solid, from its end at low x.
    pub fn of(mesh: &Mesh, solid: &Solid) -> Result<Self, Refusal> {
        let mut axis = Self::straight(mesh, solid);
        for _ in 0..FITS {
            let planes = axis.planes(&axis.stations(), Vector::y());
            let ranks = ranks(mesh, &planes);
            let flats: Vec<_> = cut(mesh, &planes, &ranks).0.iter().map(super::section::Section::flat).collect();
            axis = Self::through(mesh, &planes, &ranks, &flats)?;
        }
        Ok(axis)
    }

    /// Arc lengths of the stations.
    pub fn stations(&self) -> Vec<f64> {
        (0..STATIONS).map(|i| self.length_um() * (i as f64 + 0.5) / STATIONS as f64).collect()
    }
}

/// A station's relative place, -1 to 1 from end to end.
fn relative(station: usize) -> f64 {
    2.0 * (station as f64 + 0.5) / STATIONS as f64 - 1.0
}

/// The part of a direction that is across another, as a unit vector; any across where there is none.
pub fn upright(direction: Vector, along: Vector) -> Vector {
    let rest = |d: Vector| d - along * d.dot(&along);
    let wanted = rest(direction);
    if wanted.norm() > 1e-3 * direction.norm() { wanted.normalize() } else { rest(Vector::ith(along.iamin(), 1.0)).normalize() }
}

/// Carries a direction across a curve on to the next place without turning it around the curve (double reflection).
fn carry((at, along, across): (Vector, Vector, Vector), to: Vector, along_there: Vector) -> Vector {
    let mirrored = |v: Vector, by: Vector| if by.norm_squared() > 0.0 { v - by * (2.0 * by.dot(&v) / by.norm_squared()) } else { v };
    let step = to - at;
    let (along_half, across_half) = (mirrored(along, step), mirrored(across, step));
    upright(mirrored(across_half, along_there - along_half), along_there)
}

/// Legendre's polynomials and their derivatives at u.
fn legendre(u: f64) -> (SVector<f64, { DEGREE + 1 }>, SVector<f64, { DEGREE + 1 }>) {
    let (mut p, mut d) = (SVector::zeros(), SVector::zeros());
    p[0] = 1.0;
    p[1] = u;
    d[1] = 1.0;
    for n in 1..DEGREE {
        let k = n as f64;
        p[n + 1] = ((2.0 * k + 1.0) * u * p[n] - k * p[n - 1]) / (k + 1.0);
        d[n + 1] = d[n - 1] + (2.0 * k + 1.0) * p[n];
    }
    (p, d)
}
