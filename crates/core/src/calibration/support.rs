//! The support function of one slice as a Fourier series.
//!
//! ```text
//!   h(theta) = a0 + sum_k (a_k cos k theta + b_k sin k theta)      theta from y towards z, um
//!              distance from the capillary's axis of the tangent whose outward normal points to theta
//!   the slice: (y, z) = h (cos, sin) + h' (-sin, cos)      perimeter = 2 pi a0      area = 1/2 Int h (h + h'') dtheta
//! ```

use std::f64::consts::PI;

/// A slice, as the coefficients `a0, a1, b1, a2, b2, ..`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Support {
    pub coefficients: Vec<f64>,
}

/// The factor of a harmonic's squares in the area of a slice: `k^2 - 1`.
pub(crate) fn area_loss(k: usize) -> f64 {
    (k * k) as f64 - 1.0
}

impl Support {
    /// `h` and its derivative at `theta`.
    pub fn at(&self, theta: f64) -> [f64; 2] {
        let (sin, cos) = theta.sin_cos();
        let (mut s, mut c) = (0.0, 1.0);
        let (mut h, mut slope) = (self.coefficients[0], 0.0);
        for (pair, k) in self.coefficients[1..].chunks_exact(2).zip(1u32..) {
            (c, s) = (c * cos - s * sin, s * cos + c * sin);
            h += pair[0] * c + pair[1] * s;
            slope += f64::from(k) * (pair[1] * c - pair[0] * s);
        }
        [h, slope]
    }

    /// `h + h''`: the radius of curvature of the outline where its normal points to `theta`.
    pub fn curvature_radius(&self, theta: f64) -> f64 {
        let (sin, cos) = theta.sin_cos();
        let (mut s, mut c) = (0.0, 1.0);
        let mut radius = self.coefficients[0];
        for (pair, k) in self.coefficients[1..].chunks_exact(2).zip(1u32..) {
            (c, s) = (c * cos - s * sin, s * cos + c * sin);
            radius += (1.0 - f64::from(k * k)) * (pair[0] * c + pair[1] * s);
        }
        radius
    }

    /// Area of the outline: `1/2 Int h (h + h'')`, in which harmonic `k` takes off `k^2 - 1` times half the sum of its squares.
    pub fn area_um2(&self) -> f64 {
        self.area_less_um2(area_loss)
    }

    /// The same where harmonic `k` takes off `loss(k)` times half the sum of its squares.
    pub(crate) fn area_less_um2(&self, loss: impl Fn(usize) -> f64) -> f64 {
        let [first, rest @ ..] = &self.coefficients[..] else { return 0.0 };
        let harmonics: f64 = rest.chunks_exact(2).zip(1..).map(|(pair, k)| loss(k) * (pair[0].powi(2) + pair[1].powi(2))).sum();
        PI * (first * first - harmonics / 2.0)
    }

    /// Perimeter of the outline, um (Cauchy): it depends on the mean radius only.
    pub fn perimeter_um(&self) -> f64 {
        2.0 * PI * self.coefficients[0]
    }
}

/// Writes the functions that the coefficients multiply, at `theta`.
pub(crate) fn basis(theta: f64, row: &mut [f64]) {
    let (sin, cos) = theta.sin_cos();
    let (mut s, mut c) = (0.0, 1.0);
    row[0] = 1.0;
    for pair in row[1..].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
}

/// The series of `h` up to harmonic `series`, from `n` directions.
#[cfg(test)]
pub(crate) fn series_of(h: impl Fn(f64) -> f64, series: usize, n: u32) -> Support {
    let mut coefficients = vec![0.0; 1 + 2 * series];
    let mut row = coefficients.clone();
    for i in 0..n {
        let theta = 2.0 * PI * f64::from(i) / f64::from(n);
        basis(theta, &mut row);
        for (at, (sum, value)) in coefficients.iter_mut().zip(&row).enumerate() {
            *sum += h(theta) * value * if at == 0 { 1.0 } else { 2.0 } / f64::from(n);
        }
    }
    Support { coefficients }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ellipse_has_its_area_and_perimeter() {
        let (a, b) = (150.0f64, 100.0f64);
        let h = |theta: f64| (a * theta.cos()).hypot(b * theta.sin());
        let support = series_of(h, 12, 64);
        assert!((support.area_um2() / (PI * a * b) - 1.0).abs() < 1e-6, "{}", support.area_um2());
        // Ramanujan's second formula, good to 1e-9 here.
        let e = ((a - b) / (a + b)).powi(2);
        let perimeter = PI * (a + b) * (1.0 + 3.0 * e / (10.0 + (4.0 - 3.0 * e).sqrt()));
        assert!((support.perimeter_um() / perimeter - 1.0).abs() < 1e-6, "{}", support.perimeter_um());
        let [value, slope] = support.at(0.3);
        assert!((value - h(0.3)).abs() < 1e-3 && (slope - (h(0.3005) - h(0.2995)) / 1e-3).abs() < 1e-2, "{value} {slope}");
    }
}
