//! What the sensor sees at an angle of the shaft: the interface between the emulated camera and its image source.

use crate::scene::{Exposure, Rgb, Scene};

/// Layout of the bytes of an image, by its GenICam name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    /// One grey byte per pixel.
    Mono8,
    /// One byte per pixel behind a Bayer mosaic whose first row is R G R G.
    BayerRG8,
    /// The same with a first row G R G R.
    BayerGR8,
    /// The same with a first row G B G B.
    BayerGB8,
    /// The same with a first row B G B G.
    BayerBG8,
    /// Three bytes per pixel, red first.
    RGB8Packed,
}

/// Layout of the bytes that the camera sends: of an image, or of its grey pixels with more bits than the sensor of the emulated camera has. The bits
/// of each pixel are then followed by its own highest bits, so that white stays white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WireFormat {
    /// As the image is.
    Plain(PixelFormat),
    /// 10 bits, a stream of bits with the lowest first.
    Mono10p,
    /// 12 bits, a stream of bits with the lowest first.
    Mono12p,
    /// 10 bits, two pixels in three bytes.
    Mono10Packed,
    /// 12 bits, two pixels in three bytes.
    Mono12Packed,
}

impl WireFormat {
    /// The formats of a camera with their GenICam names.
    pub(crate) const ALL: [(&'static str, Self); 10] = [
        ("Mono8", Self::Plain(PixelFormat::Mono8)),
        ("BayerRG8", Self::Plain(PixelFormat::BayerRG8)),
        ("BayerGR8", Self::Plain(PixelFormat::BayerGR8)),
        ("BayerGB8", Self::Plain(PixelFormat::BayerGB8)),
        ("BayerBG8", Self::Plain(PixelFormat::BayerBG8)),
        ("RGB8Packed", Self::Plain(PixelFormat::RGB8Packed)),
        ("Mono10p", Self::Mono10p),
        ("Mono12p", Self::Mono12p),
        ("Mono10Packed", Self::Mono10Packed),
        ("Mono12Packed", Self::Mono12Packed),
    ];

    /// The number of the format in PFNC and GigE Vision.
    pub(crate) const fn code(self) -> u32 {
        match self {
            Self::Plain(format) => format.code(),
            Self::Mono10p => 0x010a_0046,
            Self::Mono12p => 0x010c_0047,
            Self::Mono10Packed => 0x010c_0004,
            Self::Mono12Packed => 0x010c_0006,
        }
    }

    pub(crate) fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().map(|(_, sent)| sent).find(|sent| sent.code() == code)
    }

    /// The format of the image.
    pub fn image(self) -> PixelFormat {
        if let Self::Plain(format) = self { format } else { PixelFormat::Mono8 }
    }

    /// Bytes of so many pixels.
    pub(crate) fn bytes(self, pixels: usize) -> usize {
        match self {
            Self::Plain(format) => pixels * format.bytes_per_pixel(),
            Self::Mono10p => (pixels * 10).div_ceil(8),
            Self::Mono12p | Self::Mono10Packed | Self::Mono12Packed => (pixels * 12).div_ceil(8),
        }
    }

    /// The bytes of an image as they are sent.
    pub(crate) fn of(self, image: Vec<u8>) -> Vec<u8> {
        let widened = |grey: u8, bits: u32| u32::from(grey) << (bits - 8) | u32::from(grey) >> (16 - bits);
        let mut bytes = vec![0; self.bytes(image.len())];
        let bits = match self {
            Self::Plain(_) => return image,
            Self::Mono10p => 10,
            Self::Mono12p => 12,
            Self::Mono10Packed | Self::Mono12Packed => {
                let bits = if self == Self::Mono10Packed { 10 } else { 12 };
                let mask = (1 << (bits - 8)) - 1;
                for (group, pair) in bytes.chunks_mut(3).zip(image.chunks(2)) {
                    for (at, &grey) in pair.iter().enumerate() {
                        let value = widened(grey, bits);
                        group[2 * at] = (value >> (bits - 8)) as u8;
                        group[1] |= ((value & mask) << (4 * at)) as u8;
                    }
                }
                return bytes;
            }
        };
        for (pixel, &grey) in image.iter().enumerate() {
            let first = pixel * bits as usize;
            for bit in (0..bits as usize).filter(|bit| widened(grey, bits) >> bit & 1 == 1) {
                bytes[(first + bit) / 8] |= 1 << ((first + bit) % 8);
            }
        }
        bytes
    }
}

impl PixelFormat {
    /// All formats.
    pub const ALL: [Self; 6] = [Self::Mono8, Self::BayerRG8, Self::BayerGR8, Self::BayerGB8, Self::BayerBG8, Self::RGB8Packed];

    pub fn bytes_per_pixel(self) -> usize {
        if self == Self::RGB8Packed { 3 } else { 1 }
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

    /// The number of the format in GigE Vision.
    const fn code(self) -> u32 {
        match self {
            Self::Mono8 => 0x0108_0001,
            Self::BayerGR8 => 0x0108_0008,
            Self::BayerRG8 => 0x0108_0009,
            Self::BayerGB8 => 0x0108_000a,
            Self::BayerBG8 => 0x0108_000b,
            Self::RGB8Packed => 0x0218_0014,
        }
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
            PixelFormat::BayerGR8 => picture.to_bayer([1, 0]),
            PixelFormat::BayerGB8 => picture.to_bayer([0, 1]),
            PixelFormat::BayerBG8 => picture.to_bayer([1, 1]),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The first two rows of each mosaic are as the name of its format says.
    #[test]
    fn mosaics_begin_as_their_names_say() {
        for format in PixelFormat::ALL {
            let Some(order) = format.name().strip_prefix("Bayer").map(|rest| &rest[..2]) else { continue };
            let picture = Rgb { width: 4, height: 2, data: [b'R', b'G', b'B'].repeat(8) };
            let bytes = Pixels::of(picture, format).bytes;
            let other = match order {
                "RG" => "GB",
                "GR" => "BG",
                "GB" => "RG",
                _ => "GR",
            };
            assert_eq!(String::from_utf8(bytes).unwrap(), order.repeat(2) + &other.repeat(2), "{}", format.name());
        }
    }

    /// Pixels 0xff, 0x80 and 0x01: 0x3ff, 0x202 and 0x004 of 10 bits, 0xfff, 0x808 and 0x010 of 12 bits.
    #[test]
    fn packed_pixels_are_laid_out_as_the_standards_say() {
        let grey = vec![0xff, 0x80, 0x01];
        assert_eq!(WireFormat::Mono12p.of(grey.clone()), [0xff, 0x8f, 0x80, 0x10, 0x00]);
        assert_eq!(WireFormat::Mono12Packed.of(grey.clone()), [0xff, 0x8f, 0x80, 0x01, 0x00]);
        assert_eq!(WireFormat::Mono10p.of(grey.clone()), [0xff, 0x0b, 0x48, 0x00]);
        assert_eq!(WireFormat::Mono10Packed.of(grey), [0xff, 0x23, 0x80, 0x01, 0x00]);
    }
}
