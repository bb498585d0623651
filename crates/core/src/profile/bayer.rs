//! Bilinear demosaicing of an R G / G B mosaic.

/// Each missing colour is the mean of the nearest pixels that have it; at the border the mosaic is mirrored, which keeps
/// its phase.
pub(super) fn demosaic_rg(raw: &[u8], width: usize, height: usize) -> [Vec<u8>; 3] {
    let mut planes: [Vec<u8>; 3] = std::array::from_fn(|_| vec![0; width * height]);
    let [red, green, blue] = &mut planes;
    for v in 0..height {
        let span = v * width..(v + 1) * width;
        let rows = Rows([mirror(v as isize - 1, height), v, mirror(v as isize + 1, height)].map(|r| &raw[r * width..(r + 1) * width]));
        let (red, green, blue) = (&mut red[span.clone()], &mut green[span.clone()], &mut blue[span]);
        // A row with blue is a row with red in which these two colours are exchanged, shifted by one pixel.
        if v % 2 == 0 { rows.fill(0, red, green, blue) } else { rows.fill(1, blue, green, red) }
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
    /// Fills the three colours of the row. `own` is the colour that the row has at every second pixel from `phase` on, with
    /// green at the others; `other` is the colour of the rows above and below.
    fn fill(&self, phase: usize, own: &mut [u8], green: &mut [u8], other: &mut [u8]) {
        let width = own.len();
        let mut set = |u: usize, (l, r): (usize, usize)| {
            let [above, here, below] = self.0;
            let mean = |a: u8, b: u8| u16::from(a).midpoint(u16::from(b) + 1) as u8;
            let mean_of_4 = |a: u8, b: u8, c: u8, d: u8| ((u16::from(a) + u16::from(b) + u16::from(c) + u16::from(d) + 2) / 4) as u8;
            if u % 2 == phase {
                own[u] = here[u];
                green[u] = mean_of_4(here[l], here[r], above[u], below[u]);
                other[u] = mean_of_4(above[l], above[r], below[l], below[r]);
            } else {
                own[u] = mean(here[l], here[r]);
                green[u] = here[u];
                other[u] = mean(above[u], below[u]);
            }
        };
        let ends = |u: usize| (mirror(u as isize - 1, width), mirror(u as isize + 1, width));
        let pairs = width.saturating_sub(2) / 2;
        if width > 0 {
            set(0, ends(0));
        }
        for u in (0..pairs).map(|k| 1 + 2 * k) {
            set(u, (u - 1, u + 1));
            set(u + 1, (u, u + 2));
        }
        for u in (1 + 2 * pairs).max(1)..width {
            set(u, ends(u));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bilinear interpolation reproduces a colour that varies linearly, away from the mirrored border.
    #[test]
    fn a_linear_ramp_comes_back_exactly() {
        let (w, h) = (12, 10);
        let truth = |c: usize, u: usize, v: usize| (20 + 40 * c + 4 * u + 6 * v) as u8;
        let channel = |u: usize, v: usize| (u % 2) + (v % 2);
        let raw: Vec<u8> = (0..h).flat_map(|v| (0..w).map(move |u| truth(channel(u, v), u, v))).collect();
        let planes = demosaic_rg(&raw, w, h);
        for v in 1..h - 1 {
            for u in 1..w - 1 {
                for (c, plane) in planes.iter().enumerate() {
                    assert_eq!(plane[v * w + u], truth(c, u, v), "channel {c} at {u}, {v}");
                }
            }
        }
    }

    #[test]
    fn a_grey_mosaic_stays_grey_to_the_last_pixel_of_odd_sizes() {
        for plane in demosaic_rg(&[77; 7 * 5], 7, 5) {
            assert!(plane.iter().all(|&p| p == 77));
        }
    }
}
