//! Defocus: a separable Gaussian over a block of pixels. Pixels at the border are repeated outwards.

use rayon::prelude::*;

/// Blurs `width` x rows pixels of three colours.
pub fn blurred(pixels: &[[f32; 3]], width: usize, sigma_px: f64) -> Vec<[f32; 3]> {
    if sigma_px <= 0.0 || width == 0 {
        return pixels.to_vec();
    }
    let height = pixels.len() / width;
    let kernel = kernel(sigma_px);
    let reach = kernel.len() / 2;
    let mut across = vec![[0.0f32; 3]; pixels.len()];
    across.par_chunks_mut(width).zip(pixels.par_chunks(width)).for_each(|(out, row)| {
        for (u, pixel) in out.iter_mut().enumerate() {
            for (k, weight) in kernel.iter().enumerate() {
                add(pixel, row[(u + k).saturating_sub(reach).min(width - 1)], *weight);
            }
        }
    });
    let mut out = vec![[0.0f32; 3]; pixels.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(v, row)| {
        for (k, weight) in kernel.iter().enumerate() {
            let from = (v + k).saturating_sub(reach).min(height - 1) * width;
            for (pixel, other) in row.iter_mut().zip(&across[from..from + width]) {
                add(pixel, *other, *weight);
            }
        }
    });
    out
}

/// Reach of a blur on each side, px.
pub fn reach(sigma_px: f64) -> usize {
    (4.0 * sigma_px.max(0.0)).ceil() as usize
}

fn kernel(sigma_px: f64) -> Vec<f32> {
    let reach = reach(sigma_px) as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|d| (-0.5 * (d as f64 / sigma_px).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

#[inline]
fn add(to: &mut [f32; 3], from: [f32; 3], weight: f32) {
    for k in 0..3 {
        to[k] += from[k] * weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_keeps_its_place_and_a_flat_field_its_level() {
        let pixels: Vec<[f32; 3]> = (0..40 * 20).map(|i| [if i % 40 < 20 { 0.0 } else { 200.0 }; 3]).collect();
        let out = blurred(&pixels, 40, 0.7);
        let row = &out[10 * 40..11 * 40];
        assert!((row[19][1] + row[20][1] - 200.0).abs() < 1e-3, "symmetric about the edge");
        assert!(row[19][1] > 10.0 && row[20][1] < 190.0, "blurred");
        assert!(row[0][0].abs() < 1e-3 && (row[39][2] - 200.0).abs() < 1e-3);
    }
}
