//! A frame as the camera sent it: raw bytes and their meaning. Devices make it, the store keeps it, and `profile` reads it.

use serde::{Deserialize, Serialize};

/// Layout of a frame's bytes, by its GenICam name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum PixelFormat {
    /// One grey byte per pixel.
    Mono8,
    /// One byte per pixel under a colour mosaic whose first row reads R G R G.
    BayerRG8,
    /// One byte per pixel under a colour mosaic whose first row reads G R G R.
    BayerGR8,
    /// One byte per pixel under a colour mosaic whose first row reads G B G B.
    BayerGB8,
    /// One byte per pixel under a colour mosaic whose first row reads B G B G.
    BayerBG8,
    /// Three bytes per pixel, red first.
    RGB8Packed,
}

impl PixelFormat {
    /// All formats.
    pub const ALL: [Self; 6] = [Self::Mono8, Self::BayerRG8, Self::BayerGR8, Self::BayerGB8, Self::BayerBG8, Self::RGB8Packed];

    /// Bytes that one pixel takes.
    pub fn bytes_per_pixel(self) -> usize {
        if self == Self::RGB8Packed { 3 } else { 1 }
    }

    /// Column and row of the first red pixel of a colour mosaic, each 0 or 1. `None` of a format without a mosaic.
    pub fn first_red(self) -> Option<[usize; 2]> {
        match self {
            Self::Mono8 | Self::RGB8Packed => None,
            Self::BayerRG8 => Some([0, 0]),
            Self::BayerGR8 => Some([1, 0]),
            Self::BayerGB8 => Some([0, 1]),
            Self::BayerBG8 => Some([1, 1]),
        }
    }

    /// The first four pixels of a colour mosaic, row by row: `rggb`, `grbg`, `gbrg` or `bggr`. `None` of a format without a mosaic.
    pub fn mosaic(self) -> Option<&'static str> {
        match self {
            Self::Mono8 | Self::RGB8Packed => None,
            Self::BayerRG8 => Some("rggb"),
            Self::BayerGR8 => Some("grbg"),
            Self::BayerGB8 => Some("gbrg"),
            Self::BayerBG8 => Some("bggr"),
        }
    }

    /// The format of the mosaic with these first four pixels. `None` where no mosaic begins so.
    pub fn of_mosaic(order: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.mosaic() == Some(order))
    }

    /// The GenICam name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::BayerRG8 => "BayerRG8",
            Self::BayerGR8 => "BayerGR8",
            Self::BayerGB8 => "BayerGB8",
            Self::BayerBG8 => "BayerBG8",
            Self::RGB8Packed => "RGB8Packed",
        }
    }
}

/// Pixels as they came from the sensor, row by row, without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawFrame {
    width: u32,
    height: u32,
    format: PixelFormat,
    bytes: Vec<u8>,
}

/// The bytes do not fit the frame's size and format.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("a {width} x {height} {} frame has {expected} bytes, found {found}", format.name())]
pub struct WrongFrameSize {
    /// Width of the frame, px.
    pub width: u32,
    /// Height of the frame, px.
    pub height: u32,
    /// Layout of the bytes.
    pub format: PixelFormat,
    /// Bytes that the frame has by its size and format.
    pub expected: usize,
    /// Bytes given.
    pub found: usize,
}

impl RawFrame {
    /// A frame of these bytes.
    ///
    /// # Errors
    /// Bytes that are not exactly `width * height` pixels of `format`.
    pub fn new(width: u32, height: u32, format: PixelFormat, bytes: Vec<u8>) -> Result<Self, WrongFrameSize> {
        let expected = width as usize * height as usize * format.bytes_per_pixel();
        if bytes.len() != expected {
            return Err(WrongFrameSize { width, height, format, expected, found: bytes.len() });
        }
        Ok(Self { width, height, format, bytes })
    }

    /// Width, px.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Layout of the bytes.
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// The bytes, row by row.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}
