//! Detects a colour mosaic that is about to be read as grey.
//!
//! ```text
//!    R G R G      in each pair of rows every second pixel is darker or brighter than the two beside it,
//!    G B G B      in the whole picture by the same few grey values: no scene looks like this
//! ```

/// Smallest step that counts, grey values. Frames of a colour camera have 3 and more, also in dim light. Pictures of grey cameras and grey
/// copies of colour pictures have at most 0.05, and uneven columns of cheap sensors 0.5.
const LEAST_GREY: f64 = 1.0;
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
}
