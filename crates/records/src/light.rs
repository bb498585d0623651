//! Light level and focus of one frame, from a part of its pixels.
//!
//! ```text
//! every 5th row:  I(u), I(u + 2): the same colour of a mosaic ── histogram ─► median, share at 255
//!                                                             └─ (I(u + 2) - I(u))^2 ─► sharpness
//! ```

use carved_core::frame::{PixelFormat, RawFrame};
use serde::{Deserialize, Serialize};

/// Distance between two evaluated rows. It is odd, so that both kinds of rows of a mosaic occur.
const ROW_STEP: usize = 5;
/// The maximum pixel value.
const TOP: usize = 255;

/// Light level and focus of a frame, which depend on lamp, exposure and lens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Median of the pixels, 0 to 255. It is the level of the background, because a specimen covers less than half of a frame.
    pub background: f64,
    /// Share of the pixels at 255.
    pub saturated: f64,
    /// Mean square of the difference between pixels two columns apart, divided by the square of the background. It increases with the
    /// sharpness. Only frames of the same rig and specimen can be compared.
    pub focus: f64,
}

impl Light {
    /// Evaluates every fifth row of a frame.
    pub fn of(frame: &RawFrame) -> Self {
        let bpp = frame.format().bytes_per_pixel();
        // In RGB only green is evaluated. In a mosaic all pixels are.
        let first = usize::from(frame.format() == PixelFormat::RGB8Packed);
        let mut histogram = [0u32; TOP + 1];
        let (mut squares, mut pairs) = (0u64, 0u64);
        for row in frame.bytes().chunks_exact(frame.width() as usize * bpp).step_by(ROW_STEP) {
            let mut two_before: [Option<u8>; 2] = [None; 2];
            for (u, &value) in row.iter().skip(first).step_by(bpp).enumerate() {
                histogram[usize::from(value)] += 1;
                if let Some(before) = two_before[u % 2].replace(value) {
                    squares += u64::from(value.abs_diff(before)).pow(2);
                    pairs += 1;
                }
            }
        }
        let all: u32 = histogram.iter().sum();
        let mut below = 0;
        let median = histogram.iter().position(|n| {
            below += n;
            2 * below >= all
        });
        let background = median.unwrap_or(0) as f64;
        let of_background = (background * background).max(1.0);
        Self {
            background,
            saturated: f64::from(histogram[TOP]) / f64::from(all.max(1)),
            focus: squares as f64 / pairs.max(1) as f64 / of_background,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(width: u32, height: u32, format: PixelFormat, value: impl Fn(usize, usize) -> u8) -> RawFrame {
        let bpp = format.bytes_per_pixel();
        let bytes = (0..(width * height) as usize).flat_map(|i| vec![value(i % width as usize, i / width as usize); bpp]).collect();
        RawFrame::new(width, height, format, bytes).unwrap()
    }

    #[test]
    fn background_and_saturation_are_those_of_the_pixels() {
        for format in PixelFormat::ALL {
            // A quarter of the width is dark, as with a specimen, and every eighth column is saturated.
            let light = Light::of(&frame(64, 50, format, |u, _| if u % 8 == 0 { 255 } else { [40, 200][usize::from(u >= 16)] }));
            assert_eq!(light.background.to_bits(), 200f64.to_bits(), "{format:?}");
            assert!((light.saturated - 0.125).abs() < 1e-12, "{format:?}: {light:?}");
        }
    }

    #[test]
    fn a_mosaic_of_even_colour_has_no_edges_and_a_blurred_edge_less_than_a_sharp_one() {
        let even = Light::of(&frame(64, 50, PixelFormat::BayerRG8, |u, v| [180, 200, 200, 90][u % 2 + 2 * (v % 2)]));
        assert!(even.focus.abs() < 1e-12, "{even:?}");
        let edge =
            |width: f64| Light::of(&frame(64, 50, PixelFormat::Mono8, |u, _| (100.0 + 100.0 * ((u as f64 - 32.0) / width).tanh()) as u8));
        assert!(edge(1.0).focus > 2.0 * edge(6.0).focus, "{:?} {:?}", edge(1.0), edge(6.0));
    }
}
