//! The corners of fins: the area that the harmonics beyond a slice's series would subtract.
//!
//! ```text
//!   harmonics of a corner fall with k^2      each takes (k^2 - 1) squares off the area
//!   series ends at k = 8: the rest is estimated from the eighth harmonic, and taken off
//!   series ends before:   nothing is taken off, and Sections::left_out_um3 is part of the standard deviation
//! ```

use super::sections::{Section, Sections};
use crate::calibration::{HARMONICS_MOST, Support, area_loss};
use crate::parallel::prelude::*;
use std::f64::consts::FRAC_PI_2;

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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::series_of;
    use std::f64::consts::PI;

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
}
