//! What the sensor sees at an angle of the shaft: the interface between the emulated camera and its image source.

use crate::scene::{Exposure, Rgb, Scene};

/// Layout of the bytes of an image, by its GenICam name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// One grey byte per pixel.
    Mono8,
    /// One byte per pixel behind a Bayer mosaic whose first row is R G R G.
    BayerRG8,
    /// Three bytes per pixel, red first.
    RGB8Packed,
}

impl PixelFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Mono8, Self::BayerRG8, Self::RGB8Packed];

    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Mono8 | Self::BayerRG8 => 1,
            Self::RGB8Packed => 3,
        }
    }

    /// The GenICam name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::BayerRG8 => "BayerRG8",
            Self::RGB8Packed => "RGB8Packed",
        }
    }

    /// The number of the format in GigE Vision.
    pub(crate) fn code(self) -> u32 {
        match self {
            Self::Mono8 => 0x0108_0001,
            Self::BayerRG8 => 0x0108_0009,
            Self::RGB8Packed => 0x0218_0014,
        }
    }

    pub(crate) fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.code() == code)
    }
}

/// An image, row by row, without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pixels {
    pub width: u32,
    pub height: u32,
    pub format: PixelFormat,
    pub bytes: Vec<u8>,
}

impl Pixels {
    /// An image whose bytes all have one value.
    pub fn filled(width: u32, height: u32, format: PixelFormat, value: u8) -> Self {
        Self { width, height, format, bytes: vec![value; width as usize * height as usize * format.bytes_per_pixel()] }
    }

    fn of(picture: Rgb, format: PixelFormat) -> Self {
        let bytes = match format {
            PixelFormat::Mono8 => picture.to_mono8(),
            PixelFormat::BayerRG8 => picture.to_bayer_rg8(),
            PixelFormat::RGB8Packed => picture.data,
        };
        Self { width: picture.width, height: picture.height, format, bytes }
    }

    /// Whether the number of bytes fits the size and the format.
    pub fn is_whole(&self) -> bool {
        self.bytes.len() == self.width as usize * self.height as usize * self.format.bytes_per_pixel()
    }

    /// The bytes of the rectangle at `(x, y)`. The rectangle must lie inside the image.
    pub(crate) fn crop(&self, x: u32, y: u32, width: u32, height: u32) -> Vec<u8> {
        let bpp = self.format.bytes_per_pixel();
        if (x, y, width, height) == (0, 0, self.width, self.height) {
            return self.bytes.clone();
        }
        let stride = self.width as usize * bpp;
        let row = |v: u32| (y + v) as usize * stride + x as usize * bpp;
        (0..height).flat_map(|v| &self.bytes[row(v)..row(v) + width as usize * bpp]).copied().collect()
    }
}

/// An image source: what the sensor of the camera sees.
pub trait Sight: Send + Sync {
    /// Width and height of the sensor, px.
    fn size(&self) -> (u32, u32);
    /// The image of the whole sensor. The camera crops its region from it. The angle of `exposure` is the true angle of the shaft at
    /// the middle of the exposure, unwrapped and counted from the index. Exposures are numbered from 0 since the rig was started.
    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels;
    /// The image of an exposure during which the shaft turns. `path_rad` is the angle at a part of the exposure, from 0 to 1. An image
    /// source that does not blur shows the angle at the middle.
    fn look_along(&self, exposure: &Exposure, _path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        self.look(exposure, format)
    }
    /// Shifts the scene along x, um. It is called before each image if the rig has a slide, and never otherwise.
    fn slide_to(&self, _shift_um: f64) {}
}

impl Sight for Scene {
    fn size(&self) -> (u32, u32) {
        let camera = &self.settings().camera;
        (camera.width, camera.height)
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        Pixels::of(self.render(exposure), format)
    }

    fn look_along(&self, exposure: &Exposure, path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        Pixels::of(self.render_along(path_rad, exposure.number), format)
    }

    fn slide_to(&self, shift_um: f64) {
        Scene::slide_to(self, shift_um);
    }
}
