//! A larva-like solid that is smooth from end to end, so that its outline, volume and area can be computed exactly.
//!
//! ```text
//!      ___-------________
//!    (         +- - - - -_---___  .......     x = -L/2 cos s; around a bent centre line the mean radius is
//!     \___       ____----  ''''''''''''       sin s exp(sum c_j T_j(-cos s)): round at both ends
//!         ------                              waves of order 2 to 4 make sections deeper than wide, and lopsided
//!     head          fin fold: a thin ellipse in every slice, from the middle to behind the tail
//! ```
//! Girth and depth along the body are those of the drawing of [`crate::scene::Larva`], smoothed.

use super::slice::{HARMONICS, Section, Slice};
use crate::scene::phantom::LarvaError;
use crate::scene::seeded::{Seeded, mixed};
use std::f64::consts::{PI, TAU};

/// Terms of the girth: a series of Chebyshev polynomials.
const TERMS: usize = 8;
/// Logarithm of mean radius over sin s, in thousandths of the length, at 3 and at 5 dpf. Within 12 % and 6 % of the drawing.
const GIRTH: [[f64; TERMS]; 2] =
    [[3.963, -0.976, 0.154, 0.061, 0.028, 0.002, 0.073, 0.013], [3.847, -0.933, 0.160, 0.053, 0.022, 0.030, 0.043, 0.030]];
/// The centre line's height, thousandths of the length, up to order 2 in -cos s.
const RISE: [[f64; 3]; 2] = [[9.1, -21.8, 1.8], [10.2, -19.9, 2.0]];
/// Second harmonic, which makes sections deeper than wide: its mean and its growth towards the tail, relative to the mean radius.
const DEPTH: [[f64; 2]; 2] = [[0.165, 0.035], [0.11, 0.06]];

/// A larva's body.
#[derive(Debug, Clone)]
pub struct Body {
    pub length_um: f64,
    /// Factor on the mean radius.
    girth: f64,
    terms: [f64; TERMS],
    rise_um: [f64; 3],
    bend_um: [f64; 2],
    phase: [f64; 2],
    depth: [f64; 2],
    /// Harmonics from order 2 on, relative to the mean radius: (cos, sin), and the same to be multiplied by sin of the slice's phase.
    lopsided: [[f64; 2]; HARMONICS],
    lopsided_by_place: [[f64; 2]; HARMONICS],
}

impl Body {
    /// # Errors
    /// The age is not 3, 4 or 5 dpf.
    pub fn new(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        // Length and volume at the age; youth is 1 at 3 dpf.
        let (length_um, volume_um3, youth) = match dpf {
            3 => (3_700.0, 2.40e8, 1.0),
            4 => (3_900.0, 2.66e8, 0.5),
            5 => (4_100.0, 3.05e8, 0.0),
            found => return Err(LarvaError::Age { found, first: 3, last: 5 }),
        };
        let mut s = Seeded::new(mixed(seed ^ (u64::from(dpf) << 56) ^ 0xA11A));
        let length_um = (length_um * (1.0 + s.normal(0.018))).clamp(3_600.0, 4_200.0);
        let volume_um3 = (volume_um3 * (1.0 + s.normal(0.05))).clamp(2.2e8, 3.2e8);
        let youth: f64 = youth + s.between(-0.1, 0.1);
        let mix = |[young, old]: [f64; 2]| youth * young + (1.0 - youth) * old;
        let mut body = Self {
            length_um,
            girth: 1.0,
            // Higher terms change the girth more steeply, so they vary less.
            terms: std::array::from_fn(|j| mix([GIRTH[0][j], GIRTH[1][j]]) + s.normal(0.03 / (1.0 + j as f64))),
            rise_um: std::array::from_fn(|j| 1e-3 * length_um * mix([RISE[0][j], RISE[1][j]])),
            bend_um: [s.normal(20.0), s.normal(20.0)],
            phase: [s.between(0.0, TAU), s.between(0.0, TAU)],
            depth: std::array::from_fn(|j| mix([DEPTH[0][j], DEPTH[1][j]])),
            lopsided: std::array::from_fn(|k| [s.normal(LOPSIDED[k]), s.normal(LOPSIDED[k])]),
            lopsided_by_place: std::array::from_fn(|k| [s.normal(LOPSIDED[k]), s.normal(LOPSIDED[k])]),
        };
        // The area of sections grows with the square of the girth.
        body.girth = (volume_um3 / super::truth::volume_um3(&super::loft::Solid::Body(body.clone()))).sqrt();
        Ok(body)
    }

    /// The centre line at `c` = -cos s, and its derivative by c. It is also defined beyond the tail, for the fin fold.
    fn centre(&self, c: f64) -> ([f64; 2], [f64; 2]) {
        let [r0, r1, r2] = self.rise_um;
        let [by, bz] = self.bend_um;
        let at = |i: usize, turns: f64| {
            let (sin, cos) = (PI * turns * c + self.phase[i]).sin_cos();
            (sin, PI * turns * cos)
        };
        let ((y_sin, y_cos), (z_sin, z_cos)) = (at(0, 0.6), at(1, 0.9));
        let y = r0 + r1 * c + r2 * (2.0 * c * c - 1.0) + by * y_sin;
        ([y, bz * z_sin], [r1 + 4.0 * r2 * c + by * y_cos, bz * z_cos])
    }

    pub fn slice(&self, s: f64) -> Slice {
        let (sin, cos) = s.sin_cos();
        let c = -cos;
        let (log, log_c) = chebyshev(&self.terms, c);
        let scale = 1e-3 * self.length_um * self.girth * log.exp();
        // dc/ds is sin s.
        let (mean, mean_s) = (scale * sin, scale * (cos + sin * sin * log_c));
        let ([y, z], [y_c, z_c]) = self.centre(c);
        let (swing, swing_c) = ((1.7 * c + self.phase[0]).sin(), 1.7 * (1.7 * c + self.phase[0]).cos());
        let share = |k: usize, i: usize| {
            let (a, by) = (self.lopsided[k][i], self.lopsided_by_place[k][i]);
            let deeper = if (k, i) == (0, 0) { (self.depth[0] + self.depth[1] * c, self.depth[1]) } else { (0.0, 0.0) };
            (a + by * swing + deeper.0, by * swing_c + deeper.1)
        };
        let waves = std::array::from_fn(|k| std::array::from_fn(|i| mean * share(k, i).0));
        let waves_s = std::array::from_fn(|k| {
            std::array::from_fn(|i| {
                let (part, part_c) = share(k, i);
                mean_s * part + mean * part_c * sin
            })
        });
        Slice {
            s,
            x: self.length_um / 2.0 * c,
            x_s: self.length_um / 2.0 * sin,
            centre: [y, z],
            centre_s: [y_c * sin, z_c * sin],
            section: Section::Fourier { mean, mean_s, waves, waves_s },
        }
    }
}

/// Standard deviations of the random parts of harmonics 2, 3 and 4. With the depth, at most 0.2 of order 2, slices stay convex:
/// 3 of order 2, 8 of order 3 and 15 of order 4 must add up to less than 1.
const LOPSIDED: [f64; HARMONICS] = [0.006, 0.006, 0.0015];

/// A Chebyshev series and its derivative.
fn chebyshev(terms: &[f64; TERMS], c: f64) -> (f64, f64) {
    let (mut t, mut t_next) = (1.0, c);
    let (mut d, mut d_next) = (0.0, 1.0);
    let (mut sum, mut sum_c) = (0.0, 0.0);
    for a in terms {
        sum += a * t;
        sum_c += a * d;
        (d, d_next) = (d_next, 2.0 * t_next + 2.0 * c * d_next - d);
        (t, t_next) = (t_next, 2.0 * c * t_next - t);
    }
    (sum, sum_c)
}

/// The fin fold of a body: in each slice an ellipse around the centre line of the body, some micrometres thick. It begins inside the
/// body and ends behind it, so that it encloses the tip of the tail.
#[derive(Debug, Clone)]
pub struct Plate {
    body: Body,
    half_length_um: f64,
    middle_um: f64,
    half_height_um: f64,
    /// How much the height grows towards the tail.
    blunt: f64,
    half_thickness_um: f64,
}

impl Plate {
    pub fn new(body: &Body, seed: u64) -> Self {
        let mut s = Seeded::new(mixed(seed ^ 0xF14));
        let length_um = body.length_um;
        Self {
            body: body.clone(),
            half_length_um: 0.315 * length_um,
            middle_um: 0.215 * length_um,
            half_height_um: 155.0 * (1.0 + s.normal(0.06)),
            blunt: 0.3 + s.between(-0.08, 0.08),
            half_thickness_um: 7.0,
        }
    }

    pub fn slice(&self, s: f64) -> Slice {
        let (sin, cos) = s.sin_cos();
        let (x, x_s) = (self.middle_um - self.half_length_um * cos, self.half_length_um * sin);
        let half_body = self.body.length_um / 2.0;
        let (centre, by_c) = self.body.centre(x / half_body);
        let (blunt, blunt_s) = (1.0 - self.blunt * cos, self.blunt * sin);
        let half = [self.half_height_um * sin * blunt, self.half_thickness_um * sin];
        let half_s = [self.half_height_um * (cos * blunt + sin * blunt_s), self.half_thickness_um * cos];
        Slice { s, x, x_s, centre, centre_s: by_c.map(|d| d * x_s / half_body), section: Section::Ellipse { half, half_s } }
    }

    /// The slice at a position along the capillary. `None` outside the plate.
    pub fn slice_at(&self, x_um: f64) -> Option<Slice> {
        let [from, to] = self.ends_um();
        (from < x_um && x_um < to).then(|| self.slice(self.angle_at(x_um)))
    }

    /// The parameter s of a position between the ends.
    pub fn angle_at(&self, x_um: f64) -> f64 {
        ((self.middle_um - x_um) / self.half_length_um).clamp(-1.0, 1.0).acos()
    }

    /// First and last x.
    pub fn ends_um(&self) -> [f64; 2] {
        [self.middle_um - self.half_length_um, self.middle_um + self.half_length_um]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_convex_and_their_derivatives_agree_with_differences() {
        for (dpf, seed) in (0..60).flat_map(|seed| [3, 4, 5].map(|dpf| (dpf, seed))) {
            let body = Body::new(dpf, seed).unwrap();
            let plate = Plate::new(&body, seed);
            for i in 1..100 {
                let s = PI * f64::from(i) / 100.0;
                for slice in [|b: &Body, _: &Plate, s| b.slice(s), |_: &Body, p: &Plate, s| p.slice(s)] {
                    let e = 1e-5;
                    let (here, on, back) = (slice(&body, &plate, s), slice(&body, &plate, s + e), slice(&body, &plate, s - e));
                    assert!((here.x_s - (on.x - back.x) / (2.0 * e)).abs() < 1e-3);
                    for k in 0..24 {
                        let t = TAU * f64::from(k) / 24.0;
                        let at = here.support(t);
                        assert!(at.bow > 0.0, "{dpf} dpf, seed {seed}: hollow at s = {s:.2}, t = {t:.2}: {at:?}");
                        let by_differences = (on.support(t).h - back.support(t).h) / (2.0 * e);
                        assert!((at.h_s - by_differences).abs() < 1e-3, "{} against {by_differences}", at.h_s);
                    }
                }
            }
        }
    }

    #[test]
    fn the_plate_begins_in_the_body_and_encloses_its_tail() {
        for seed in 0..40 {
            let body = Body::new(3 + (seed % 3) as u8, seed).unwrap();
            let plate = Plate::new(&body, seed);
            let [from, to] = plate.ends_um();
            assert!(to > body.length_um / 2.0);
            // Its first slice lies inside the body. In the last slice of the tail it is higher than the body.
            let (first, last) = (plate.slice_at(from + 1.0).unwrap(), body.slice(PI - 1e-3));
            let around = body.slice((-first.x / (body.length_um / 2.0)).acos());
            let behind = plate.slice_at(last.x).unwrap();
            for k in 0..24 {
                let t = TAU * f64::from(k) / 24.0;
                assert!(around.support(t).h > first.support(t).h);
                assert!(behind.support(t).h > last.support(t).h, "{} against {}", behind.support(t).h, last.support(t).h);
            }
        }
    }
}
