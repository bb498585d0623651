//! A frame as the camera sent it: raw bytes and what they mean. Devices make it, the store keeps it, `profile` reads it.

use serde::{Deserialize, Serialize};

/// Layout of a frame's bytes, by its GenICam name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PixelFormat {
    /// One grey byte per pixel.
    Mono8,
    /// One byte per pixel under a colour mosaic whose first row reads R G R G.
    BayerRG8,
    /// Three bytes per pixel, red first.
    RGB8Packed,
}

impl PixelFormat {
    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Mono8 | Self::BayerRG8 => 1,
            Self::RGB8Packed => 3,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::BayerRG8 => "BayerRG8",
            Self::RGB8Packed => "RGB8Packed",
        }
    }
}

/// Pixels as they came off the sensor, row by row, without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawFrame {
    width: u32,
    height: u32,
    format: PixelFormat,
    bytes: Vec<u8>,
}

#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("a {width} x {height} {} frame has {expected} bytes, found {found}", format.name())]
pub struct WrongFrameSize {
    pub width: u32,
    pub height: u32,
    pub format: PixelFormat,
    pub expected: usize,
    pub found: usize,
}

impl RawFrame {
    /// # Errors
    /// Refuses bytes that are not exactly `width * height` pixels of `format`.
    pub fn new(width: u32, height: u32, format: PixelFormat, bytes: Vec<u8>) -> Result<Self, WrongFrameSize> {
        let expected = width as usize * height as usize * format.bytes_per_pixel();
        if bytes.len() != expected {
            return Err(WrongFrameSize { width, height, format, expected, found: bytes.len() });
        }
        Ok(Self { width, height, format, bytes })
    }

    pub fn width(&self) -> u32 {
        self.width
    }

    pub fn height(&self) -> u32 {
        self.height
    }

    pub fn format(&self) -> PixelFormat {
        self.format
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}
