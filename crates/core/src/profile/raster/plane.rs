//! A window of a picture as numbers, for filters and fits.

/// One `f32` per pixel of `width` columns, whose first row is row `top` of the picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub(in crate::profile) struct Plane {
    pub width: usize,
    pub height: usize,
    /// Row of the picture in which the window begins.
    pub top: usize,
    pub data: Vec<f32>,
}

impl Plane {
    /// Sets the window and clears it: rows `top .. top + height` of the picture.
    pub fn reset(&mut self, width: usize, top: usize, height: usize) {
        (self.width, self.top, self.height) = (width, top, height);
        self.data.clear();
        self.data.resize(self.width * self.height, 0.0);
    }

    pub fn row(&self, v: usize) -> &[f32] {
        &self.data[v * self.width..(v + 1) * self.width]
    }

    /// Bilinear value at `(u, v)` in picture coordinates. Beyond the window its border is continued.
    #[inline]
    pub fn sample(&self, u: f64, v: f64) -> f32 {
        let u = (u as f32).max(0.0).min((self.width - 1) as f32);
        let v = ((v - self.top as f64) as f32).max(0.0).min((self.height - 1) as f32);
        let (u0, v0) = (u as usize, v as usize);
        let (fu, fv) = (u - u0 as f32, v - v0 as f32);
        let right = usize::from(u0 + 1 < self.width);
        let at = v0 * self.width + u0;
        let below = if v0 + 1 < self.height { at + self.width } else { at };
        let (upper, lower) = (&self.data[at..=at + right], &self.data[below..=below + right]);
        let upper = upper[0] + fu * (upper[right] - upper[0]);
        let lower = lower[0] + fu * (lower[right] - lower[0]);
        upper + fv * (lower - upper)
    }
}

/// Computes the weights of a Gaussian that is cut at three standard deviations and sums to 1.
pub(in crate::profile) fn gaussian(sigma: f64, kernel: &mut Vec<f32>) {
    let reach = (3.0 * sigma).ceil() as i32;
    let weight = |k: i32| (-0.5 * (f64::from(k) / sigma).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(weight).sum();
    kernel.clear();
    kernel.extend((-reach..=reach).map(|k| (weight(k) / sum) as f32));
}

/// Number of interleaved sums. The processor computes them at once, whereas a single sum waits for each addition.
const LANES: usize = 8;

/// The sum of `value` over the values.
pub(in crate::profile) fn sum_of(values: &[f32], value: impl Fn(f32) -> f32) -> f32 {
    sum_of_pairs(values, values, |a, _| value(a))
}

/// The sum of `value` over the pairs of values at the same places of two slices of the same length.
#[inline]
pub(in crate::profile) fn sum_of_pairs(a: &[f32], b: &[f32], value: impl Fn(f32, f32) -> f32) -> f32 {
    let mut sums = [0.0f32; LANES];
    let ((chunks, rest), (other_chunks, other_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in chunks.iter().zip(other_chunks) {
        for k in 0..LANES {
            sums[k] += value(a[k], b[k]);
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(rest.iter().zip(other_rest)) {
        *sum += value(*a, *b);
    }
    sums.iter().sum()
}

/// The value at `share` (0 to 1) of the sorted values; 0 for none. Overwrites its input.
pub(in crate::profile) fn quantile(values: &mut [f32], share: f64) -> f32 {
    /// Buckets, by the leading bits of a value. Sorting fewer values than that takes no longer than counting.
    const BUCKETS: usize = 4096;
    if values.is_empty() {
        return 0.0;
    }
    let mut rank = (share * (values.len() - 1) as f64).round() as usize;
    let mut left = values.len();
    if left > BUCKETS {
        // Bits in the order of the numbers.
        let bucket = |value: f32| {
            let bits = value.to_bits();
            ((if value.is_sign_negative() { !bits } else { bits | 1 << 31 }) >> (u32::BITS - BUCKETS.ilog2())) as usize
        };
        let mut counts = [0u32; BUCKETS];
        for value in &*values {
            counts[bucket(*value)] += 1;
        }
        let mut chosen = 0;
        while rank >= counts[chosen] as usize {
            rank -= counts[chosen] as usize;
            chosen += 1;
        }
        left = 0;
        for i in 0..values.len() {
            if bucket(values[i]) == chosen {
                values[left] = values[i];
                left += 1;
            }
        }
    }
    *values[..left].select_nth_unstable_by(rank, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(w: usize, h: usize) -> Plane {
        Plane { width: w, height: h, top: 5, data: (0..w * h).map(|i| (i % w) as f32 + 10.0 * (i / w) as f32).collect() }
    }

    #[test]
    fn a_quantile_of_many_is_that_of_the_sorted() {
        let values: Vec<f32> = (0..10_007).map(|i| ((i * 7919 % 10_007) as f32 - 3000.0) * 0.01).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        for (share, rank) in [(0.0, 0), (0.25, 2502), (0.3, 3002), (0.98, 9806), (1.0, 10_006)] {
            assert_eq!(quantile(&mut values.clone(), share).to_bits(), sorted[rank].to_bits(), "{share}");
        }
    }

    #[test]
    fn sampling_is_exact_on_a_ramp_and_holds_the_border() {
        let p = ramp(6, 4);
        assert!((p.sample(2.25, 6.5) - 17.25).abs() < 1e-5);
        assert!((p.sample(-9.0, 5.0) - 0.0).abs() < 1e-6 && (p.sample(99.0, 99.0) - 35.0).abs() < 1e-6);
    }
}
