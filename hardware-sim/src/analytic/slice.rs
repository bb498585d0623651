//! A slice of a solid across the capillary, given by its support function: the extent of the solid in each direction.
//!
//! ```text
//!        t = pi (dorsal)             h(t)   extent along (cos t, sin t) of (y, z)
//!            ____                    X(t) = (x, h cos t - h_t sin t, h sin t + h_t cos t)
//!          /      \  --- h(t) --->|  n(t) = (-h_s, x_s cos t, x_s sin t), outwards
//!   z <---|   +    |
//!          \______/                  s runs along the solid from end to end; x and h are smooth in it, also at
//!            y v   t = 0 (ventral)   rounded ends, where dh/dx has no bound
//! ```

/// Number of harmonics of a section that is not an ellipse: orders 2 to 4. Order 1 belongs to the centre line.
pub const HARMONICS: usize = 3;

/// The shape of a slice around its centre.
#[derive(Debug, Clone, Copy)]
pub enum Section {
    /// Half axes along y and z, and their derivatives along s.
    Ellipse { half: [f64; 2], half_s: [f64; 2] },
    /// Mean radius, then cos and sin of each harmonic from order 2 on; and their derivatives along s.
    Fourier { mean: f64, mean_s: f64, waves: [[f64; 2]; HARMONICS], waves_s: [[f64; 2]; HARMONICS] },
}

/// A slice and its derivatives along s.
#[derive(Debug, Clone, Copy)]
pub struct Slice {
    pub s: f64,
    pub x: f64,
    pub x_s: f64,
    /// The centre line's y and z, and their derivatives along s.
    pub centre: [f64; 2],
    pub centre_s: [f64; 2],
    pub section: Section,
}

/// The support function in one direction. The index letters are derivatives.
#[derive(Debug, Clone, Copy, Default)]
pub struct Support {
    pub sin: f64,
    pub cos: f64,
    pub h: f64,
    pub h_t: f64,
    pub h_s: f64,
    pub h_st: f64,
    /// `h + h_tt`: length of outline per angle, the radius of curvature. It is negative only if the slice is not convex.
    pub bow: f64,
}

impl Slice {
    pub fn support(&self, t: f64) -> Support {
        let (sin, cos) = t.sin_cos();
        let ([y, z], [y_s, z_s]) = (self.centre, self.centre_s);
        let mut support = match &self.section {
            Section::Ellipse { half, half_s } => ellipse(*half, *half_s, sin, cos),
            Section::Fourier { mean, mean_s, waves, waves_s } => fourier([*mean, *mean_s], waves, waves_s, sin, cos),
        };
        support.h += y * cos + z * sin;
        support.h_t += z * cos - y * sin;
        support.h_s += y_s * cos + z_s * sin;
        support.h_st += z_s * cos - y_s * sin;
        support
    }

    /// The point of the surface in this direction.
    pub fn point(&self, at: &Support) -> [f64; 3] {
        let &Support { sin, cos, h, h_t, .. } = at;
        [self.x, h * cos - h_t * sin, h * sin + h_t * cos]
    }

    /// An upper bound of `h_s`.
    pub fn steepest(&self) -> f64 {
        let [y_s, z_s] = self.centre_s;
        y_s.hypot(z_s)
            + match &self.section {
                Section::Ellipse { half_s: [b, c], .. } => b.abs().max(c.abs()),
                Section::Fourier { mean_s, waves_s, .. } => mean_s.abs() + waves_s.iter().map(|[a, b]| a.hypot(*b)).sum::<f64>(),
            }
    }
}

fn ellipse([b, c]: [f64; 2], [b_s, c_s]: [f64; 2], sin: f64, cos: f64) -> Support {
    let h = (b * cos).hypot(c * sin);
    if h <= 0.0 {
        // A pole: only the growth along s is known. No contour is computed in the pole itself.
        return Support { sin, cos, h_s: (b_s * cos).hypot(c_s * sin), ..Support::default() };
    }
    let h_t = (c * c - b * b) * sin * cos / h;
    let h_s = (b * b_s * cos * cos + c * c_s * sin * sin) / h;
    let h_st = (2.0 * (c * c_s - b * b_s) * sin * cos - h_s * h_t) / h;
    Support { sin, cos, h, h_t, h_s, h_st, bow: (b * c).powi(2) / h.powi(3) }
}

fn fourier([mean, mean_s]: [f64; 2], waves: &[[f64; 2]; HARMONICS], waves_s: &[[f64; 2]; HARMONICS], sin: f64, cos: f64) -> Support {
    let mut at = Support { sin, cos, h: mean, h_t: 0.0, h_s: mean_s, h_st: 0.0, bow: mean };
    // cos and sin of the multiples of t by the addition theorems.
    let (mut cos_k, mut sin_k) = (cos, sin);
    let mut k = 1.0;
    for ([a, b], [a_s, b_s]) in waves.iter().zip(waves_s) {
        (cos_k, sin_k) = (cos_k * cos - sin_k * sin, sin_k * cos + cos_k * sin);
        k += 1.0;
        let wave = a * cos_k + b * sin_k;
        at.h += wave;
        at.h_t += k * (b * cos_k - a * sin_k);
        at.h_s += a_s * cos_k + b_s * sin_k;
        at.h_st += k * (b_s * cos_k - a_s * sin_k);
        at.bow += (1.0 - k * k) * wave;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slice at `s` of a test solid, and the derivatives of its support function by differences.
    fn slice(s: f64, fourier: bool) -> Slice {
        let section = if fourier {
            let wave = |k: f64| [30.0 * (s * k).sin() / k, 12.0 * (s + k).cos() / k];
            let wave_s = |k: f64| [30.0 * (s * k).cos(), -12.0 * (s + k).sin() / k];
            Section::Fourier {
                mean: 100.0 + 20.0 * s,
                mean_s: 20.0,
                waves: [2.0, 3.0, 4.0].map(wave),
                waves_s: [2.0, 3.0, 4.0].map(wave_s),
            }
        } else {
            Section::Ellipse { half: [100.0 + 30.0 * s, 40.0 * s.sin()], half_s: [30.0, 40.0 * s.cos()] }
        };
        Slice { s, x: s, x_s: 1.0, centre: [5.0 * s * s, 3.0 * s], centre_s: [10.0 * s, 3.0], section }
    }

    #[test]
    fn the_derivatives_are_those_of_the_support_function() {
        for fourier in [false, true] {
            for (s, t) in [(0.7, 0.3), (1.1, 2.5), (0.4, -1.9), (1.3, 4.4)] {
                let at = slice(s, fourier).support(t);
                let e = 1e-5;
                let (more, less) = (slice(s, fourier).support(t + e), slice(s, fourier).support(t - e));
                let (on, back) = (slice(s + e, fourier).support(t), slice(s - e, fourier).support(t));
                let near = |found: f64, by: f64| assert!((found - by).abs() < 1e-5 * (1.0 + by.abs()), "{found} against {by} at {s}, {t}");
                near(at.h_t, (more.h - less.h) / (2.0 * e));
                near(at.h_s, (on.h - back.h) / (2.0 * e));
                near(at.h_st, (on.h_t - back.h_t) / (2.0 * e));
                near(at.bow, at.h + (more.h_t - less.h_t) / (2.0 * e));
                assert!(at.h_s.abs() <= slice(s, fourier).steepest());
            }
        }
    }
}
