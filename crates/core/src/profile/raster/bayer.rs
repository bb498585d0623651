//! Bilinear demosaicing of a Bayer mosaic.

/// Each missing colour is the mean of the nearest pixels that have it; at the border the mosaic is mirrored, which keeps
/// its phase. `first_red`: column and row of the first red pixel, each 0 or 1.
pub(in crate::profile) fn demosaic(raw: &[u8], width: usize, height: usize, first_red: [usize; 2]) -> [Vec<u8>; 3] {
    let mut planes: [Vec<u8>; 3] = std::array::from_fn(|_| vec![0; width * height]);
    let [red, green, blue] = &mut planes;
    let every_second: Vec<u8> = (0..=width).map(|u| if u % 2 == 0 { u8::MAX } else { 0 }).collect();
    for v in 0..height {
        let span = v * width..(v + 1) * width;
        let rows = Rows([mirror(v as isize - 1, height), v, mirror(v as isize + 1, height)].map(|r| &raw[r * width..(r + 1) * width]));
        let (red, green, blue) = (&mut red[span.clone()], &mut green[span.clone()], &mut blue[span]);
        // A row with blue is a row with red in which these two colours are exchanged, shifted by one pixel.
        let phase = (v + first_red[1]) % 2;
        let is_own = &every_second[(phase + first_red[0]) % 2..][..width];
        if phase == 0 { rows.fill(is_own, red, green, blue) } else { rows.fill(is_own, blue, green, red) }
    }
    planes
}

/// Index `i` of `n`, mirrored at both ends.
fn mirror(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    let i = if i < 0 { -i } else { i };
    let i = if i > last { 2 * last - i } else { i };
    i.clamp(0, last) as usize
}

/// A row of the mosaic and its two neighbours.
struct Rows<'a>([&'a [u8]; 3]);

impl Rows<'_> {
    /// Fills the three colours of the row. `own` is the colour that the row has where `is_own` is 255, with green where it is 0;
    /// `other` is the colour of the rows above and below.
    fn fill(&self, is_own: &[u8], own: &mut [u8], green: &mut [u8], other: &mut [u8]) {
        let width = own.len();
        for u in [0, width.saturating_sub(1)].into_iter().filter(|&u| u < width) {
            let around = self.0.map(|row| [mirror(u as isize - 1, width), u, mirror(u as isize + 1, width)].map(|u| row[u]));
            [own[u], green[u], other[u]] = colours(is_own[u], around);
        }
        let Some(n) = width.checked_sub(2) else { return };
        // Every pixel takes the same way and no index is checked, so that many are computed at once.
        let [above, here, below] = self.0.map(|row| [&row[..n], &row[1..][..n], &row[2..][..n]]);
        let (is_own, own, green, other) = (&is_own[1..][..n], &mut own[1..][..n], &mut green[1..][..n], &mut other[1..][..n]);
        for u in 0..n {
            let around = [above.map(|row| row[u]), here.map(|row| row[u]), below.map(|row| row[u])];
            [own[u], green[u], other[u]] = colours(is_own[u], around);
        }
    }
}

/// The row's own colour, green and the other colour of a pixel, from the pixels around it.
#[inline]
fn colours(is_own: u8, [above, here, below]: [[u8; 3]; 3]) -> [u8; 3] {
    let mean = |a: u8, b: u8| (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
    let mean_of_4 = |a: u8, b: u8, c: u8, d: u8| ((u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d) + 2) / 4) as u8;
    let choose = |if_own: u8, if_green: u8| (if_own & is_own) | (if_green & !is_own);
    [
        choose(here[1], mean(here[0], here[2])),
        choose(mean_of_4(here[0], here[2], above[1], below[1]), here[1]),
        choose(mean_of_4(above[0], above[2], below[0], below[2]), mean(above[1], below[1])),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::PixelFormat;

    /// Bilinear interpolation reproduces a colour that varies linearly, away from the mirrored border.
    #[test]
    fn a_linear_ramp_comes_back_exactly() {
        let (w, h) = (12, 10);
        let truth = |c: usize, u: usize, v: usize| (20 + 40 * c + 4 * u + 6 * v) as u8;
        // The first two rows of each mosaic, as the names of the formats say them.
        for (format, rows) in [
            (PixelFormat::BayerRG8, ["RG", "GB"]),
            (PixelFormat::BayerGR8, ["GR", "BG"]),
            (PixelFormat::BayerGB8, ["GB", "RG"]),
            (PixelFormat::BayerBG8, ["BG", "GR"]),
        ] {
            assert!(format.name().starts_with(&format!("Bayer{}", rows[0])));
            let channel = |u: usize, v: usize| "RGB".find(char::from(rows[v % 2].as_bytes()[u % 2])).unwrap();
            let raw: Vec<u8> = (0..w * h).map(|i| truth(channel(i % w, i / w), i % w, i / w)).collect();
            let planes = demosaic(&raw, w, h, format.first_red().unwrap());
            for v in 1..h - 1 {
                for u in 1..w - 1 {
                    for (c, plane) in planes.iter().enumerate() {
                        assert_eq!(plane[v * w + u], truth(c, u, v), "{format:?}: channel {c} at {u}, {v}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_grey_mosaic_stays_grey_to_the_last_pixel_of_odd_sizes() {
        for first_red in PixelFormat::ALL.into_iter().filter_map(PixelFormat::first_red) {
            for plane in demosaic(&[77; 7 * 5], 7, 5, first_red) {
                assert!(plane.iter().all(|&p| p == 77));
            }
        }
    }
}
