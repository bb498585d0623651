//! Detects a colour mosaic that is about to be read as grey, or in the order of another camera.
//!
//! ```text
//!    R G R G      in each pair of rows every second pixel is darker or brighter than the two beside it,
//!    G B G B      in the whole picture by the same few grey values: no scene looks like this
//! ```

use carved_core::frame::PixelFormat;

/// Smallest step that counts, grey values. Frames of a colour camera have 3 and more, also in dim light. Pictures of grey cameras and grey
/// copies of colour pictures have at most 0.05, and uneven columns of cheap sensors 0.5.
const LEAST_GREY: f64 = 1.0;
/// Difference of the two greens that is a camera's own, grey values: their amplifiers differ by up to 2 % of 200 grey values.
const GREENS_GREY: f64 = 4.0;
/// Smallest step, as a multiple of the step that chance gives.
const CHANCE: f64 = 8.0;

/// Grey values by which the colours of the mosaic differ. `None` if the picture is no mosaic.
pub fn step_grey(pixels: &[u8], width: usize) -> Option<f64> {
    let mut rows = [Steps::default(); 2];
    for (v, row) in pixels.chunks_exact(width.max(1)).enumerate() {
        // Both neighbours are used, so that a gradient of the light cancels.
        row.windows(3).step_by(2).for_each(|w| rows[v % 2].add(2 * i64::from(w[1]) - i64::from(w[0]) - i64::from(w[2])));
    }
    rows.iter().filter_map(Steps::clear).max_by(f64::total_cmp)
}

/// A mosaic whose pixels are not in the order that was stated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the green pixels of a mosaic {order} differ by {greens_grey:.1} grey values in the mean, its red and blue ones by {others_grey:.1}"
)]
pub struct UnevenGreens {
    order: &'static str,
    greens_grey: f64,
    others_grey: f64,
}

/// Whether what should be the green pixels of a mosaic are red and blue ones: the green pixels of the two rows have the same filter. `None`
/// where they agree, or where red and blue have the same mean, so that the picture does not tell.
pub fn uneven_greens(pixels: &[u8], width: usize, format: PixelFormat) -> Option<UnevenGreens> {
    let (order, [red_u, red_v]) = (format.mosaic()?, format.first_red()?);
    // Whole cells of 2 x 2 pixels, so that all four means are of the same area.
    let mut sums = [[0u64; 2]; 2];
    let mut cells = 0u64;
    for rows in pixels.chunks_exact(2 * width.max(1)) {
        let (upper, lower) = rows.split_at(width);
        for (above, below) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
            for (sum, row) in sums.iter_mut().zip([above, below]) {
                sum.iter_mut().zip(row).for_each(|(sum, pixel)| *sum += u64::from(*pixel));
            }
            cells += 1;
        }
    }
    let mean = |u: usize, v: usize| sums[v % 2][u % 2] as f64 / cells.max(1) as f64;
    let greens_grey = (mean(red_u + 1, red_v) - mean(red_u, red_v + 1)).abs();
    let others_grey = (mean(red_u, red_v) - mean(red_u + 1, red_v + 1)).abs();
    (greens_grey > GREENS_GREY + others_grey).then_some(UnevenGreens { order, greens_grey, others_grey })
}

/// Doubled differences between the pixels of every second row and their neighbours.
#[derive(Clone, Copy, Default)]
struct Steps {
    n: i64,
    sum: i64,
    squares: i64,
}

impl Steps {
    fn add(&mut self, doubled: i64) {
        self.n += 1;
        self.sum += doubled;
        self.squares += doubled * doubled;
    }

    fn clear(&self) -> Option<f64> {
        let n = self.n.max(1) as f64;
        let mean = self.sum as f64 / n;
        let chance = ((self.squares as f64 / n - mean * mean).max(0.0) / n).sqrt();
        let step = mean.abs() / 2.0;
        (step >= LEAST_GREY && mean.abs() > CHANCE * chance).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture with uneven light, a dark line in each direction, and values of 0 to 15 as noise.
    fn picture(width: usize, height: usize, more: impl Fn(usize, usize) -> i32) -> Vec<u8> {
        let mut state = 9u64;
        let mut pixel = |u: usize, v: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let line = if u == 21 || v / 3 == 7 { -60 } else { 0 };
            (150 - (u / 4) as i32 + line + more(u, v) + (state >> 60) as i32).clamp(0, 255) as u8
        };
        (0..width * height).map(|i| pixel(i % width, i / width)).collect()
    }

    #[test]
    fn a_mosaic_is_distinguished_from_a_grey_picture() {
        for (width, height) in [(160, 120), (101, 67)] {
            assert_eq!(step_grey(&picture(width, height, |_, _| 0), width), None);
            let rg = |u: usize, v: usize| [[0, 3], [3, 6]][v % 2][u % 2];
            assert!(step_grey(&picture(width, height, rg), width).is_some_and(|step| (2.0..4.0).contains(&step)), "{width} x {height}");
        }
        assert_eq!(step_grey(&[9; 4], 2), None, "nothing has two neighbours");
    }

    #[test]
    fn a_mosaic_in_the_order_of_another_camera_is_told_by_its_greens() {
        let mosaics = || PixelFormat::ALL.into_iter().filter(|format| format.first_red().is_some());
        for (width, height) in [(160, 120), (101, 67)] {
            for camera in mosaics() {
                let [red_u, red_v] = camera.first_red().unwrap();
                // Red is 30 grey values darker than green and blue 10 brighter; the two greens of the camera differ by 2.
                let filters = [[-30, 0], [2, 10]];
                let pixels = picture(width, height, |u, v| filters[(v + red_v) % 2][(u + red_u) % 2]);
                for stated in mosaics() {
                    let found = uneven_greens(&pixels, width, stated);
                    // Orders whose red and blue are exchanged have the same greens.
                    let diagonal = |format: PixelFormat| format.first_red().unwrap().iter().sum::<usize>() % 2;
                    assert_eq!(found.is_none(), diagonal(camera) == diagonal(stated), "{camera:?} read as {stated:?}: {found:?}");
                }
            }
        }
        let grey = picture(160, 120, |_, _| 0);
        assert!(mosaics().all(|stated| uneven_greens(&grey, 160, stated).is_none()), "where colours are equal, nothing tells the order");
        assert!(mosaics().all(|stated| uneven_greens(&[9; 3], 1, stated).is_none()), "no cell of 2 x 2 pixels");
        assert!(mosaics().all(|stated| uneven_greens(&[], 0, stated).is_none()));
    }
}
