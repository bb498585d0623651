//! Means over many blocks beside the body: they show what is fainter than the noise of one block.

use super::coarse::Coarse;

/// Blocks that a mean reaches on each side of its middle. Its noise is 1/9 of a block's.
const REACH: usize = 4;
/// Fewest blocks that make a mean.
const LEAST: f32 = 4.0;

/// Means of the contrast. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct Faint {
    /// Lightness or colour, whichever is the greater. 0 where too few blocks count.
    pub contrast: Vec<f32>,
    /// Sums of lightness and colour, and number of blocks, over the columns of the window.
    rows: [Vec<f32>; 3],
    /// The same over the rows of the window as well.
    sums: [Vec<f32>; 3],
}

impl Faint {
    /// Averages the blocks for which `counts` holds. Neither the body nor a speck may count, because either would outweigh
    /// everything faint around it.
    pub fn find(&mut self, coarse: &Coarse, counts: impl Fn(usize) -> bool) {
        let (w, h) = (coarse.width, coarse.height);
        self.rows.iter_mut().for_each(Vec::clear);
        for v in 0..h {
            let block = |u: usize| if counts(v * w + u) { [coarse.lightness[v * w + u], coarse.colour[v * w + u], 1.0] } else { [0.0; 3] };
            // The sum moves with the window: the block that enters it is added, the one that leaves it is subtracted.
            let mut sum = [0.0f32; 3];
            let add = |sum: &mut [f32; 3], sign: f32, u: usize| sum.iter_mut().zip(block(u)).for_each(|(sum, x)| *sum += sign * x);
            (0..REACH.min(w)).for_each(|u| add(&mut sum, 1.0, u));
            for u in 0..w {
                if u + REACH < w {
                    add(&mut sum, 1.0, u + REACH);
                }
                if u > REACH {
                    add(&mut sum, -1.0, u - REACH - 1);
                }
                self.rows.iter_mut().zip(sum).for_each(|(row, sum)| row.push(sum));
            }
        }
        for (sums, rows) in self.sums.iter_mut().zip(&self.rows) {
            sums.clear();
            sums.resize(w, 0.0);
            let row = |v: usize| &rows[v * w..(v + 1) * w];
            (0..REACH.min(h)).for_each(|v| sums.iter_mut().zip(row(v)).for_each(|(sum, x)| *sum += x));
        }
        self.contrast.clear();
        for v in 0..h {
            for (sums, rows) in self.sums.iter_mut().zip(&self.rows) {
                let row = |v: usize| &rows[v * w..(v + 1) * w];
                if v + REACH < h {
                    sums.iter_mut().zip(row(v + REACH)).for_each(|(sum, x)| *sum += x);
                }
                if v > REACH {
                    sums.iter_mut().zip(row(v - REACH - 1)).for_each(|(sum, x)| *sum -= x);
                }
            }
            let [lightness, colour, n] = &self.sums;
            let places = lightness.iter().zip(colour).zip(n);
            // The number of blocks is a sum of ones and is exact.
            self.contrast.extend(places.map(|((l, c), n)| if *n < LEAST { 0.0 } else { l.max(c.abs()) / n }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::synthetic::Noise;

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
