//! The natural cubic spline: a smooth curve through a few measured values.

#[derive(Debug, Clone)]
pub struct Spline {
    knots: Vec<[f64; 2]>,
    /// Second derivatives at the knots.
    curvature: Vec<f64>,
}

impl Spline {
    /// The spline through `knots` (position, value), in the order of position. It is straight at both ends.
    pub fn through(knots: &[[f64; 2]]) -> Self {
        let n = knots.len();
        let mut curvature = vec![0.0; n];
        let mut upper = vec![0.0; n];
        // Thomas algorithm on h_i m_(i-1) + 2 (h_i + h_(i+1)) m_i + h_(i+1) m_(i+1) = 6 (slope_(i+1) - slope_i).
        for i in 1..n.saturating_sub(1) {
            let (before, after) = (knots[i][0] - knots[i - 1][0], knots[i + 1][0] - knots[i][0]);
            let bend = 6.0 * ((knots[i + 1][1] - knots[i][1]) / after - (knots[i][1] - knots[i - 1][1]) / before);
            let pivot = 2.0 * (before + after) - before * upper[i - 1];
            upper[i] = after / pivot;
            curvature[i] = (bend - before * curvature[i - 1]) / pivot;
        }
        for i in (1..n.saturating_sub(1)).rev() {
            curvature[i] -= upper[i] * curvature[i + 1];
        }
        Self { knots: knots.to_vec(), curvature }
    }

    /// The value at `s`. Beyond the knots it is the value of the last knot.
    pub fn at(&self, s: f64) -> f64 {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else { return 0.0 };
        if s <= first[0] {
            return first[1];
        }
        if s >= last[0] {
            return last[1];
        }
        let i = self.knots.partition_point(|k| k[0] <= s);
        let ([x0, y0], [x1, y1]) = (self.knots[i - 1], self.knots[i]);
        let h = x1 - x0;
        let (a, b) = ((x1 - s) / h, (s - x0) / h);
        a * y0 + b * y1 + ((a.powi(3) - a) * self.curvature[i - 1] + (b.powi(3) - b) * self.curvature[i]) * h * h / 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_through_its_knots_and_draws_a_sine_between() {
        let knots: Vec<[f64; 2]> = (0..=8).map(|i| f64::from(i) / 8.0 * std::f64::consts::PI).map(|x| [x, x.sin()]).collect();
        let spline = Spline::through(&knots);
        for k in &knots {
            assert!((spline.at(k[0]) - k[1]).abs() < 1e-12);
        }
        // The sine is straight at 0 and pi, as the spline is; its error is h^4 5/384 = 3e-4.
        for i in 0..=100 {
            let x = f64::from(i) / 100.0 * std::f64::consts::PI;
            assert!((spline.at(x) - x.sin()).abs() < 3.2e-4);
        }
    }
}
