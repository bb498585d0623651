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
        self.to_bayer([0, 0])
    }

    /// The colours behind a Bayer mosaic whose first red pixel is in this column and row, each 0 or 1.
    pub(crate) fn to_bayer(&self, first_red: [usize; 2]) -> Vec<u8> {
        let width = self.width as usize;
        let colour = |i: usize| (i % width + first_red[0]) % 2 + (i / width + first_red[1]) % 2;
        self.data.chunks_exact(3).enumerate().map(|(i, rgb)| rgb[colour(i)]).collect()
    }

    /// The image that a colour camera delivers: the Bayer mosaic of [`Rgb::to_bayer_rg8`] with the missing colours interpolated linearly
    /// from the nearest pixels. Neighbouring pixels then share noise, as they do on VAST frames.
    #[must_use]
    pub fn demosaicked(&self) -> Self {
        let (width, height) = (self.width as usize, self.height as usize);
        let mosaic = self.to_bayer_rg8();
        let colour = |u: usize, v: usize| u % 2 + v % 2;
        let mut data = Vec::with_capacity(self.data.len());
        for v in 0..height {
            for u in 0..width {
                let own = mosaic[v * width + u];
                for wanted in 0..3 {
                    if colour(u, v) == wanted {
                        data.push(own);
                        continue;
                    }
                    // All pixels of another colour among the eight neighbours are equally near.
                    let near = (v.saturating_sub(1)..(v + 2).min(height))
                        .flat_map(|y| (u.saturating_sub(1)..(u + 2).min(width)).map(move |x| (x, y)))
                        .filter(|&(x, y)| colour(x, y) == wanted);
                    let (sum, count) = near.fold((0u32, 0u32), |(sum, count), (x, y)| (sum + u32::from(mosaic[y * width + x]), count + 1));
                    // An image of one row or column lacks a colour.
                    data.push((sum + count / 2).checked_div(count).map_or(own, |mean| mean as u8));
                }
            }
        }
        Self { width: self.width, height: self.height, data }
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
    fn demosaicking_keeps_a_slope_and_averages_the_nearest_pixels_of_a_colour() {
        // Levels that rise linearly along both axes are interpolated exactly, except at the border.
        let level = |u: u32, v: u32, k: u32| (10 + 4 * u + 6 * v + 20 * k) as u8;
        let data = (0..6 * 8).flat_map(|i| (0..3).map(move |k| level(i % 8, i / 8, k))).collect();
        let picture = Rgb { width: 8, height: 6, data };
        let seen = picture.demosaicked();
        for (u, v) in (1..7).flat_map(|u| (1..5).map(move |v| (u, v))) {
            let at = ((v * 8 + u) * 3) as usize;
            assert_eq!(seen.data[at..at + 3], picture.data[at..at + 3], "pixel ({u}, {v})");
        }
        // A red pixel takes its blue from the four corners.
        let mut spot = Rgb { width: 5, height: 5, data: vec![0; 75] };
        spot.data[(5 + 1) * 3 + 2] = 200;
        let seen = spot.demosaicked();
        assert_eq!([(1, 1), (2, 1), (2, 2), (3, 3)].map(|(u, v): (usize, usize)| seen.data[(v * 5 + u) * 3 + 2]), [200, 100, 50, 0]);
    }

    #[test]
    fn grey_stays_grey_in_luma() {
        let picture = Rgb { width: 1, height: 2, data: vec![200, 200, 200, 255, 255, 255] };
        assert_eq!(picture.to_mono8(), [200, 255]);
    }
}
