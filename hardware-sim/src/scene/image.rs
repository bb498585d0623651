//! Images of the scene: colour frames, their conversions to other sensors, and coverage.

/// An 8-bit colour image: three bytes per pixel, red first, rows without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rgb {
    pub width: u32,
    pub height: u32,
    pub data: Vec<u8>,
}

impl Rgb {
    /// The image behind a Bayer mosaic: first row R G R G, second row G B G B. The noise of each pixel and colour is independent, so
    /// that the noise of the mosaic is that of single sensor pixels.
    pub fn to_bayer_rg8(&self) -> Vec<u8> {
        let width = self.width as usize;
        self.data.chunks_exact(3).enumerate().map(|(i, rgb)| rgb[(i % width % 2) + (i / width % 2)]).collect()
    }

    /// Luma with the weights of ITU-R BT.601.
    pub fn to_mono8(&self) -> Vec<u8> {
        self.data
            .chunks_exact(3)
            .map(|p| ((u32::from(p[0]) * 299 + u32::from(p[1]) * 587 + u32::from(p[2]) * 114 + 500) / 1000) as u8)
            .collect()
    }
}

/// The part of each pixel that the specimens cover: 0 is none, 255 is all. A pixel is inside from 128 on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coverage {
    pub width: u32,
    pub height: u32,
    pub data: Vec<u8>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mosaic_starts_red_green_and_green_blue() {
        let picture = Rgb { width: 2, height: 2, data: [[1, 2, 3]; 4].concat() };
        assert_eq!(picture.to_bayer_rg8(), [1, 2, 2, 3]);
    }

    #[test]
    fn grey_stays_grey_in_luma() {
        let picture = Rgb { width: 1, height: 2, data: vec![200, 200, 200, 255, 255, 255] };
        assert_eq!(picture.to_mono8(), [200, 255]);
    }
}
