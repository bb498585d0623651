//! A window of a picture as numbers, for filters and fits.

use super::background::Bore;

/// One `f32` per pixel of `width` columns, whose first row is row `top` of the picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    /// Row of the picture in which the window begins.
    pub top: usize,
    pub data: Vec<f32>,
}

impl Plane {
    /// Sets the size of the window for a bore and clears it.
    pub fn reset(&mut self, bore: &Bore) {
        (self.width, self.height, self.top) = (bore.width, bore.height(), bore.top);
        self.data.clear();
        self.data.resize(self.width * self.height, 0.0);
    }

    pub fn row(&self, v: usize) -> &[f32] {
        &self.data[v * self.width..(v + 1) * self.width]
    }

    /// Bilinear value at `(u, v)` in picture coordinates. Beyond the window its border is continued.
    pub fn sample(&self, u: f64, v: f64) -> f32 {
        let u = u.clamp(0.0, (self.width - 1) as f64);
        let v = (v - self.top as f64).clamp(0.0, (self.height - 1) as f64);
        let (u0, v0) = (u as usize, v as usize);
        let (u1, v1) = ((u0 + 1).min(self.width - 1), (v0 + 1).min(self.height - 1));
        let (fu, fv) = ((u - u0 as f64) as f32, (v - v0 as f64) as f32);
        let p = |u: usize, v: usize| self.data[v * self.width + u];
        let upper = p(u0, v0) + fu * (p(u1, v0) - p(u0, v0));
        let lower = p(u0, v1) + fu * (p(u1, v1) - p(u0, v1));
        upper + fv * (lower - upper)
    }
}

/// Computes the weights of a Gaussian that is cut at three standard deviations and sums to 1.
pub(super) fn gaussian(sigma: f64, kernel: &mut Vec<f32>) {
    let reach = (3.0 * sigma).ceil() as i32;
    let weight = |k: i32| (-0.5 * (f64::from(k) / sigma).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(weight).sum();
    kernel.clear();
    kernel.extend((-reach..=reach).map(|k| (weight(k) / sum) as f32));
}

/// The value at `share` (0 to 1) of the sorted values; 0 for none. Reorders its input.
pub(super) fn quantile(values: &mut [f32], share: f64) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let k = (share * (values.len() - 1) as f64).round() as usize;
    *values.select_nth_unstable_by(k, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(w: usize, h: usize) -> Plane {
        Plane { width: w, height: h, top: 5, data: (0..w * h).map(|i| (i % w) as f32 + 10.0 * (i / w) as f32).collect() }
    }

    #[test]
    fn sampling_is_exact_on_a_ramp_and_holds_the_border() {
        let p = ramp(6, 4);
        assert!((p.sample(2.25, 6.5) - 17.25).abs() < 1e-5);
        assert!((p.sample(-9.0, 5.0) - 0.0).abs() < 1e-6 && (p.sample(99.0, 99.0) - 35.0).abs() < 1e-6);
    }
}
