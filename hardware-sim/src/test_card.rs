//! A test card whose image contains the angle. Tests of the protocols use it as image source.

use crate::scene::Exposure;
use crate::sight::{PixelFormat, Pixels, Sight};
use std::f64::consts::TAU;

/// A slanted grating whose phase is the angle. A strip at the top has the bits of the angle as black and white blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TestCard {
    width: u32,
    height: u32,
}

/// Height of the strip and width of one bit in it, px.
const BIT_PX: usize = 4;

impl TestCard {
    /// A card of this size, px. It has at least 256 x 8 px, so that the 64 bits fit.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width: width.max(64 * BIT_PX as u32), height: height.max(2 * BIT_PX as u32) }
    }

    /// Reads the angle, rad, from an image of a card.
    pub fn angle_rad(pixels: &Pixels) -> f64 {
        let bpp = pixels.format.bytes_per_pixel();
        let bits = (0..64).fold(0, |bits, i| (bits << 1) | u64::from(pixels.bytes[i * BIT_PX * bpp] > 127));
        f64::from_bits(bits)
    }
}

impl Sight for TestCard {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let mut pixels = Pixels::filled(self.width, self.height, format, 0);
        let bpp = format.bytes_per_pixel();
        let turn = (exposure.angle_rad / TAU * 4096.0).round() as i64;
        let bits = exposure.angle_rad.to_bits();
        for (i, pixel) in pixels.bytes.chunks_exact_mut(bpp).enumerate() {
            let (u, v) = (i % self.width as usize, i / self.width as usize);
            let value = if v < BIT_PX && u < 64 * BIT_PX {
                if bits >> (63 - u / BIT_PX) & 1 == 1 { 255 } else { 0 }
            } else {
                (u as i64 + 3 * v as i64 + turn) as u8
            };
            pixel.fill(value);
            if format == PixelFormat::RGB8Packed {
                // The colour planes differ, so that a test detects a swap.
                pixel[1] = value ^ u8::from(v >= BIT_PX);
            }
        }
        pixels
    }
}
