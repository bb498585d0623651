//! Means over many blocks beside the body: they show what is fainter than the noise of one block.

use super::coarse::Coarse;

/// Blocks that a mean reaches on each side of its middle. Its noise is 1/9 of a block's.
const REACH: usize = 4;
/// Fewest blocks that make a mean.
const LEAST: f32 = 4.0;

/// Means of the contrast. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Faint {
    /// Lightness or colour, whichever is the greater. 0 where too few blocks count.
    pub contrast: Vec<f32>,
    /// Sums of lightness and colour, and number of blocks, over the columns of the window.
    rows: Vec<[f32; 3]>,
}

impl Faint {
    /// Averages the blocks for which `counts` holds. Neither the body nor a speck may count, because either would outweigh
    /// everything faint around it.
    pub fn find(&mut self, coarse: &Coarse, counts: impl Fn(usize) -> bool) {
        let (w, h) = (coarse.width, coarse.height);
        let window = |at: usize, end: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(end);
        let sum = |values: &mut dyn Iterator<Item = [f32; 3]>| values.fold([0.0; 3], |s, x| [s[0] + x[0], s[1] + x[1], s[2] + x[2]]);
        self.rows.clear();
        for v in 0..h {
            let block = |u: usize| if counts(v * w + u) { [coarse.lightness[v * w + u], coarse.colour[v * w + u], 1.0] } else { [0.0; 3] };
            self.rows.extend((0..w).map(|u| sum(&mut window(u, w).map(block))));
        }
        self.contrast.clear();
        for v in 0..h {
            self.contrast.extend((0..w).map(|u| {
                let [lightness, colour, n] = sum(&mut window(v, h).map(|y| self.rows[y * w + u]));
                if n < LEAST { 0.0 } else { lightness.max(colour.abs()) / n }
            }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::Noise;
    use super::*;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 40;

    /// A body of contrast 30 in columns 0 .. 20, a fin of contrast 1 in columns 20 .. 40, and noise of 1. 81 blocks have a noise of 0.11, and
    /// the largest of 360 means lies within 0.4; a mean of a third of the window, as near the body, within 0.7.
    #[test]
    fn something_as_faint_as_the_noise_shows_up_to_the_body_that_does_not_count() {
        let mut noise = Noise::new(3);
        let map = (0..WIDTH * HEIGHT).map(|i| match i % WIDTH {
            0..20 => 30.0,
            20..40 => 1.0 + noise.next() as f32,
            _ => noise.next() as f32,
        });
        let coarse = Coarse::of_lightness(WIDTH, map.collect());
        let mut faint = Faint::default();
        faint.find(&coarse, |i| i % WIDTH >= 20);
        let column = |u: usize| (10..30).map(move |v| v * WIDTH + u);
        for (columns, level, off) in [(20..24, 1.0, 0.7), (24..36, 1.0, 0.4), (45..55, 0.0, 0.4)] {
            for i in columns.flat_map(column) {
                assert!((faint.contrast[i] - level).abs() < off, "{} in column {}", faint.contrast[i], i % WIDTH);
            }
        }
        assert!(column(5).all(|i| faint.contrast[i] == 0.0), "too far from anything that counts");
    }
}
