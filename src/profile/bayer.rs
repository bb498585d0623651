//! Bilinear demosaicing of an R G / G B mosaic.

/// Each missing colour is the mean of the nearest pixels that have it; at the border the mosaic is mirrored, which keeps
/// its phase.
pub(super) fn demosaic_rg(raw: &[u8], width: usize, height: usize) -> [Vec<u8>; 3] {
    let mirror = |i: isize, n: usize| -> usize {
        let last = n as isize - 1;
        let i = if i < 0 {
            -i
        } else if i > last {
            2 * last - i
        } else {
            i
        };
        i.clamp(0, last) as usize
    };
    let mut planes: [Vec<u8>; 3] = std::array::from_fn(|_| vec![0; width * height]);
    let [red, green, blue] = &mut planes;
    for v in 0..height {
        let rows = [mirror(v as isize - 1, height), v, mirror(v as isize + 1, height)].map(|r| &raw[r * width..(r + 1) * width]);
        for u in 0..width {
            let (l, r) = (mirror(u as isize - 1, width), mirror(u as isize + 1, width));
            let p = |row: usize, col: usize| u32::from(rows[row][col]);
            let centre = rows[1][u];
            let across = (p(1, l) + p(1, r)).div_ceil(2) as u8;
            let down = (p(0, u) + p(2, u)).div_ceil(2) as u8;
            let plus = ((p(1, l) + p(1, r) + p(0, u) + p(2, u) + 2) / 4) as u8;
            let corners = ((p(0, l) + p(0, r) + p(2, l) + p(2, r) + 2) / 4) as u8;
            let at = v * width + u;
            (red[at], green[at], blue[at]) = match (v % 2, u % 2) {
                (0, 0) => (centre, plus, corners),
                (0, _) => (across, centre, down),
                (_, 0) => (down, centre, across),
                _ => (corners, plus, centre),
            };
        }
    }
    planes
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
