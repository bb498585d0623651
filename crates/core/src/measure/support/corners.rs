//! The corners of fins: the area that the harmonics beyond a slice's series would subtract.
//!
//! ```text
//!   harmonics of a corner fall with k^2      each takes (k^2 - 1) squares off the area
//!   series ends at k = 8: the rest is estimated from the eighth harmonic, and taken off
//!   series ends before:   nothing is taken off, and Sections::left_out_um3 is part of the standard deviation
//! ```

use super::sections::{Section, Sections};
use crate::calibration::{HARMONICS_MOST, Support, area_loss, basis};
use crate::parallel::prelude::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The area that the harmonics beyond the eighth subtract, as a multiple of the square of the eighth.
///
/// A fin makes corners, and the harmonics of a corner fall with `k^2`. Beyond the eighth, the even ones subtract
/// `8^4 sum (k^2 - 1) / k^4 = 226` squares of it (k = 10, 12, ...). The odd ones subtract as much where fins are on one side,
/// and nothing where they face each other; half of that is assumed. A smooth slice has almost no eighth harmonic: an ellipse of
/// 2 : 1 loses 0.02 % by this, one of 3 : 1 0.4 %.
const BEYOND_THE_EIGHTH: f64 = 1.5 * 226.0;

/// How the area of a slice treats the harmonics beyond the end of its series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Corners {
    /// The series has [`HARMONICS_MOST`] harmonics: the rest is estimated from the last one and subtracted.
    TakenOff,
    /// The series is shorter: nothing is subtracted.
    NotEstimated,
}

impl Corners {
    /// The treatment for a series with this number of harmonics.
    pub fn of(harmonics: usize) -> Self {
        if harmonics == HARMONICS_MOST { Self::TakenOff } else { Self::NotEstimated }
    }

    /// The factor of half the sum of the squares of harmonic `k` that is subtracted from the area, in units of pi.
    pub(super) fn area_loss(self, k: usize) -> f64 {
        match self {
            Self::TakenOff if k == HARMONICS_MOST => area_loss(k) + BEYOND_THE_EIGHTH,
            _ => area_loss(k),
        }
    }

    /// Area of a slice, um^2. It is negative where the harmonics outweigh the radius, which is not the outline of a body.
    pub fn area_um2(self, support: &Support) -> f64 {
        match self {
            Self::TakenOff => support.area_less_um2(|k| self.area_loss(k)),
            Self::NotEstimated => support.area_um2(),
        }
    }
}

impl Sections {
    /// Area of each slice, um^2.
    pub(super) fn areas_um2(&self) -> Vec<f64> {
        self.slices.par_iter().map(Section::area_um2).collect()
    }

    /// What the corners of fins that a short series leaves out would take off the volume, um^3, if the last even harmonic were
    /// that of a corner. The harmonics of a corner fall with `k^2`, and cost the area `k^2 - 1` of their squares. Of the odd
    /// ones half as much is counted: between fins that face each other and fins on one side. 0 for a series of the most
    /// harmonics, where it is taken off already.
    pub fn left_out_um3(&self) -> f64 {
        let last = self.harmonics / 2 * 2;
        if last == 0 || Corners::of(self.harmonics) == Corners::TakenOff {
            return 0.0;
        }
        let share = |k: usize| area_loss(k) * (last as f64 / k as f64).powi(4);
        // The harmonics from 200 on add 1 % of it.
        let beyond: f64 = (last + 2..200).step_by(2).map(share).sum();
        let squares = |s: &Section| s.support.coefficients[2 * last - 1].powi(2) + s.support.coefficients[2 * last].powi(2);
        1.5 * FRAC_PI_2 * beyond * self.slices.iter().filter(|s| s.fins.is_none()).map(squares).sum::<f64>() * self.step_um
    }

    /// What the corners of fins that the series leaves out may do to the area, um^2. Two parts add up:
    ///
    /// * Views that are few take some harmonics of a corner for the mean radius, and so for the perimeter.
    /// * A corner that is smeared by the end of the series runs less steeply along the capillary. Harmonic `k` of a corner changes the
    ///   area by a part that falls with `k^2`; what the last even one changes is known.
    pub fn left_out_um2(&self) -> f64 {
        let last = self.harmonics / 2 * 2;
        if last == 0 {
            return 0.0;
        }
        let amplitude = |s: &Section| s.support.coefficients[2 * last - 1].hypot(s.support.coefficients[2 * last]);
        let without_fins = || (0..self.slices.len()).filter(|&at| self.slices[at].fins.is_none());
        let radius = self.corners_in_radius * without_fins().map(|at| amplitude(&self.slices[at])).sum::<f64>();
        // The area without the harmonics from `k` on.
        let rings = |k: usize| {
            let mut shorter = self.slices.clone();
            let cut = |s: &mut Section| s.support.coefficients[(2 * k - 1).min(2 * self.harmonics + 1)..].fill(0.0);
            shorter.iter_mut().filter(|s| s.fins.is_none()).for_each(cut);
            without_fins().map(|at| self.ring(&shorter, at)).sum::<f64>()
        };
        let found = [self.harmonics + 1, last, last.saturating_sub(2).max(2)].map(rings);
        // One of the two last may be where the sum over the slices changes its sign.
        let changes = [found[0] - found[1], (found[1] - found[2]) * (1.0 - 2.0 / last as f64).powi(2)].map(f64::abs);
        let beyond: f64 = (last + 2..200).step_by(2).map(|k| (last as f64 / k as f64).powi(2)).sum();
        (TAU * radius + beyond * changes[0].max(changes[1])) * self.step_um
    }
}

/// Root mean square, over the places of a corner, of what its harmonics beyond a series add to the mean radius that views at these angles
/// (rad) give, as a multiple of the amplitude of the last even harmonic of the series. Views at even steps take the harmonic of the
/// number of their directions, and its multiples, for the mean radius.
pub(super) fn corners_in_radius(omegas: &[f64], harmonics: usize) -> f64 {
    let last = harmonics / 2 * 2;
    let normals: Vec<f64> = omegas.iter().flat_map(|omega| [*omega, omega + PI]).collect();
    let size = 2 * harmonics + 1;
    let mut row = vec![0.0; size];
    let mut rows = DMatrix::zeros(normals.len(), size);
    for (at, theta) in normals.iter().enumerate() {
        basis(*theta, &mut row);
        rows.row_mut(at).copy_from_slice(&row);
    }
    let Some(normal) = (rows.transpose() * &rows).cholesky() else { return 0.0 };
    // Weight of each tangent in the mean radius.
    let mut mean = DVector::zeros(size);
    mean[0] = 1.0;
    let weights = &rows * normal.solve(&mean);
    let gain = |k: usize| {
        let sum = normals.iter().zip(&weights).fold([0.0; 2], |sum, (theta, weight)| {
            let (sin, cos) = (k as f64 * theta).sin_cos();
            [sum[0] + weight * cos, sum[1] + weight * sin]
        });
        f64::midpoint(sum[0].powi(2), sum[1].powi(2))
    };
    let square = |k: usize| if k.is_multiple_of(2) { 1.0 } else { 0.5 } * gain(k) * (last as f64 / k as f64).powi(4);
    (harmonics + 1..200).map(square).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Pose, TurnView, series_of};
    use crate::geometry::Camera;
    use crate::measure::support::SupportEstimate;
    use crate::profile::{Columns, Polygon};

    /// A round body with a fin fold: its slices are the hull of a disc and of one point, or of two that face each other.
    #[test]
    fn a_series_cut_short_still_has_the_area_of_fins() {
        let radius = 200.0f64;
        for sides in [1.0, 2.0] {
            let (mut found, mut plain, mut truth) = (0.0, 0.0, 0.0);
            for fin in (21..=40).map(|tens| 10.0 * f64::from(tens)) {
                let reach = |theta: f64| if sides > 1.0 { theta.cos().abs() } else { theta.cos() };
                let series = series_of(|theta| radius.max(fin * reach(theta)), HARMONICS_MOST, 1024);
                found += Corners::of(HARMONICS_MOST).area_um2(&series);
                plain += Corners::NotEstimated.area_um2(&series);
                let flank = radius * (fin * fin - radius * radius).sqrt() - radius * radius * (radius / fin).acos();
                truth += PI * radius * radius + sides * flank;
            }
            assert!((found / truth - 1.0).abs() < 0.01, "{sides} sides: {:+.2} %", 100.0 * (found / truth - 1.0));
            assert!(plain / truth - 1.0 > 0.015, "{sides} sides without it: {:+.2} %", 100.0 * (plain / truth - 1.0));
        }
    }

    #[test]
    fn a_shorter_series_has_its_own_area() {
        let series = series_of(|theta| 100.0 + 5.0 * (3.0 * theta).cos(), 4, 64);
        assert_eq!(Corners::of(4), Corners::NotEstimated);
        assert!((Corners::of(4).area_um2(&series) - PI * (1e4 - 8.0 * 25.0 / 2.0)).abs() < 1e-6);
    }

    /// A body whose slices are ellipses, or the hulls of a disc and of fins' edges, from -300 to 300 um.
    #[derive(Debug, Clone, Copy)]
    enum Shape {
        Ellipsoid,
        EllipticCylinder,
        /// Fins on one side or on two, as an angle.
        Finned {
            sides: u32,
            at: f64,
            thick_um: f64,
        },
    }

    const HALF_UM: f64 = 300.0;

    impl Shape {
        /// Half axes of the slice at `x_um`, or the radius of its disc and the distance of its fins' edges.
        fn slice(self, x_um: f64) -> [f64; 2] {
            let part = (1.0 - (x_um / HALF_UM).powi(2)).max(0.0);
            match self {
                Self::Ellipsoid => [150.0 * part.sqrt(), 110.0 * part.sqrt()],
                Self::EllipticCylinder => [150.0, 75.0],
                Self::Finned { thick_um, .. } => [thick_um * part.sqrt(), thick_um * part.sqrt() + 0.9 * thick_um * part],
            }
        }

        fn h(self, x_um: f64, theta: f64) -> f64 {
            let [a, b] = self.slice(x_um);
            match self {
                Self::Finned { sides, at, .. } => {
                    let reach = (theta - at).cos();
                    a.max(b * if sides == 2 { reach.abs() } else { reach })
                }
                _ => (a * theta.cos()).hypot(b * theta.sin()),
            }
        }

        /// Points of the outline of a slice. Equal numbers belong together along the body.
        fn outline(self, x_um: f64) -> Vec<[f64; 3]> {
            let [a, b] = self.slice(x_um);
            let point = |r: f64, angle: f64| [x_um, r * angle.cos(), r * angle.sin()];
            let arc = |from: f64, to: f64| (0..=90).map(move |i| from + (to - from) * f64::from(i) / 90.0);
            match self {
                Self::Finned { sides, at, .. } => {
                    let touches = (a / b.max(1e-9)).clamp(0.0, 1.0).acos();
                    (0..sides)
                        .flat_map(|side| {
                            let (at, turn) = (at + TAU * f64::from(side) / f64::from(sides), TAU / f64::from(sides));
                            std::iter::once(point(b, at)).chain(arc(at + touches, at + turn - touches).map(move |angle| point(a, angle)))
                        })
                        .collect()
                }
                _ => arc(0.0, TAU).map(|t| [x_um, a * t.cos(), b * t.sin()]).collect(),
            }
        }

        /// Area between the ends of the body.
        fn area_um2(self) -> f64 {
            let triangle = |p: [f64; 3], q: [f64; 3], r: [f64; 3]| {
                let [u, v] = [q, r].map(|to| nalgebra::Vector3::from(to) - nalgebra::Vector3::from(p));
                u.cross(&v).norm() / 2.0
            };
            // Steps of the angle: they are small where the ends are round.
            let outlines: Vec<_> = (0..=400).map(|i| self.outline(-HALF_UM * (PI * f64::from(i) / 400.0).cos())).collect();
            let ring = |a: &[[f64; 3]], b: &[[f64; 3]]| {
                let n = a.len();
                (0..n).map(|i| triangle(a[i], a[(i + 1) % n], b[i]) + triangle(a[(i + 1) % n], b[(i + 1) % n], b[i])).sum::<f64>()
            };
            outlines.windows(2).map(|w| ring(&w[0], &w[1])).sum()
        }

        /// The area that so many views give, its standard deviation without the part of the corners, and this part, um^2.
        fn measured(self, views: u32) -> [f64; 3] {
            let k = 0.2;
            let (width, height) = (160usize, 120usize);
            let camera = Camera { f: 1e8, kx: k, ky: k, ux: 79.5, uy: 59.5, ..Camera::published(width as u32, height as u32) };
            let open = matches!(self, Self::EllipticCylinder);
            let omegas: Vec<f64> = (0..views).map(|i| TAU * f64::from(i) / f64::from(views)).collect();
            let seen: Vec<Columns> = omegas
                .iter()
                .map(|&omega| {
                    let places: Vec<f64> = (0..=600).map(|i| camera.ux + k * HALF_UM * (f64::from(i) / 300.0 - 1.0)).collect();
                    let at = |u: f64| (u - camera.ux) / k;
                    let lower = places.iter().map(|&u| [u, camera.uy + k * self.h(at(u), -omega)]);
                    let upper = places.iter().rev().map(|&u| [u, camera.uy - k * self.h(at(u), PI - omega)]);
                    Columns::from_outlines(&[Polygon { vertices: lower.chain(upper).collect() }], width, height)
                })
                .collect();
            let views: Vec<TurnView> = seen.iter().zip(&omegas).map(|(columns, &omega)| TurnView { columns, omega, dy_px: 0.0 }).collect();
            let sections = Sections::of(&Pose::new(&camera), &views, 0.5, [open; 2]).unwrap();
            let estimate = SupportEstimate::of(&sections);
            // The last columns of a cylinder are half covered.
            let ends = if open { 2.0 * HALF_UM / estimate.length_um } else { 1.0 };
            [estimate.area_um2 * ends, estimate.area_sd_um2, sections.left_out_um2()]
        }
    }

    #[test]
    fn the_interval_of_the_area_covers_bodies_with_and_without_corners() {
        let finned = (0..8).flat_map(|i| {
            let at = 0.05 + TAU * f64::from(i) / 24.0;
            [1, 2].into_iter().flat_map(move |sides| [40.0, 110.0].map(|thick_um| Shape::Finned { sides, at, thick_um }))
        });
        let shapes: Vec<Shape> = [Shape::Ellipsoid, Shape::EllipticCylinder].into_iter().chain(finned).collect();
        let mut missed_without = 0;
        for views in [7, 8, 10, 12, 14, 16, 20, 21, 28] {
            for shape in &shapes {
                let truth = shape.area_um2();
                let [area, sd, corners] = shape.measured(views);
                let off = (area - truth).abs();
                missed_without += usize::from(off > 2.0 * sd);
                assert!(off <= 2.0 * sd.hypot(corners), "{views} views, {shape:?}: {area} of {truth}, {sd}, {corners}");
                // The part is no blank cheque.
                assert!(corners < 0.03 * truth, "{views} views, {shape:?}: {corners} of {truth}");
            }
        }
        assert!(missed_without > 20, "{missed_without}");
    }
}
