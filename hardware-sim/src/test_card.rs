//! A test card that carries the angle in its picture: what tests of the wires look at.

use crate::scene::Exposure;
use crate::sight::{PixelFormat, Pixels, Sight};
use std::f64::consts::TAU;

/// A slanted grating whose phase is the angle, under a strip that spells the angle's bits in black and white blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TestCard {
    width: u32,
    height: u32,
}

/// Height of the strip, and width of one bit in it.
const BIT_PX: usize = 4;

impl TestCard {
    /// At least 256 x 8 pixels, so that the 64 bits fit.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width: width.max(64 * BIT_PX as u32), height: height.max(2 * BIT_PX as u32) }
    }

    /// Reads the angle back out of a picture of a card.
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
                // Three planes that differ, so that a swap shows.
                pixel[1] = value ^ u8::from(v >= BIT_PX);
            }
        }
        pixels
    }
}
