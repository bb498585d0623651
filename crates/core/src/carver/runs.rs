//! A mask as the runs of covered pixels in each of its rows: a few numbers instead of a million pixels.

use super::{CarveError, Carver};
use crate::profile::Mask;

/// The covered pixels of a view, row by row.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Runs {
    width: usize,
    height: usize,
    /// First row that has a run.
    first: usize,
    /// Row `first + n` has the runs `covered[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    /// First covered column, and the column after the last.
    covered: Vec<[u16; 2]>,
}

impl Runs {
    /// The runs of a mask.
    ///
    /// # Errors
    /// A mask without pixels, or with more than [`Carver::MAX_MASK_SIDE`] on a side.
    pub fn new(mask: &Mask) -> Result<Self, CarveError> {
        let (width, height, limit) = (mask.width(), mask.height(), Carver::MAX_MASK_SIDE);
        if [width, height].iter().any(|&n| n == 0 || n > limit) {
            return Err(CarveError::MaskSize { width, height, limit });
        }
        let rows = || (0..height).filter(|&v| !blank(mask.row(v)));
        let mut runs = Self { width, height, starts: vec![0], ..Self::default() };
        let (Some(first), Some(last)) = (rows().next(), rows().next_back()) else { return Ok(runs) };
        runs.first = first;
        for v in first..=last {
            runs.push_row(mask.row(v));
        }
        Ok(runs)
    }

    fn push_row(&mut self, row: &[u8]) {
        // Pixels are 0 or 255. 64 pixels equal to the one before are skipped at once. Otherwise eight pixels are a word, and a
        // run begins or ends where the word changes.
        let mut start = None;
        for (at, pixels) in (0..).step_by(64).zip(row.chunks(64)) {
            let (any, all) = pixels.iter().fold((0, u8::MAX), |(any, all), &p| (any | p, all & p));
            if if start.is_some() { all != 0 } else { any == 0 } {
                continue;
            }
            for (at, eight) in (at..).step_by(8).zip(pixels.chunks(8)) {
                let mut bytes = [eight[eight.len() - 1]; 8];
                bytes[..eight.len()].copy_from_slice(eight);
                let word = u64::from_le_bytes(bytes);
                let mut turns = word ^ ((word << 8) | (u64::from(start.is_some()) * 0xff));
                while turns != 0 {
                    let byte = turns.trailing_zeros() / 8;
                    turns &= !(0xff << (8 * byte));
                    let at = at as u16 + byte as u16;
                    match start.take() {
                        None => start = Some(at),
                        Some(start) => self.covered.push([start, at]),
                    }
                }
            }
        }
        if let Some(start) = start {
            self.covered.push([start, row.len() as u16]);
        }
        self.starts.push(self.covered.len() as u32);
    }

    /// Width of the mask, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the mask, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The mask that the runs were made of.
    pub fn mask(&self) -> Mask {
        let mut mask = Mask::empty(self.width, self.height);
        for v in self.rows() {
            for &[start, end] in self.row(v) {
                (usize::from(start)..usize::from(end)).for_each(|u| mask.set(u, v, true));
            }
        }
        mask
    }

    /// The rows that can have runs.
    pub(super) fn rows(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.starts.len() - 1
    }

    /// The runs of a row, from left to right.
    pub(super) fn row(&self, v: usize) -> &[[u16; 2]] {
        match v.checked_sub(self.first) {
            Some(n) if n + 1 < self.starts.len() => &self.covered[self.starts[n] as usize..self.starts[n + 1] as usize],
            _ => &[],
        }
    }

    pub(super) fn covers(&self, u: usize, v: usize) -> bool {
        self.row(v).iter().any(|&[start, end]| (usize::from(start)..usize::from(end)).contains(&u))
    }

    /// Number of covered pixels.
    pub fn area_px(&self) -> usize {
        self.covered.iter().map(|&[start, end]| usize::from(end - start)).sum()
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        self.starts.capacity() * size_of::<u32>() + self.covered.capacity() * size_of::<[u16; 2]>()
    }
}

fn blank(pixels: &[u8]) -> bool {
    pixels.iter().fold(0, |any, p| any | p) == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_cover_what_the_mask_covers(width in 1..70usize, pixels in prop::collection::vec(prop::bool::weighted(0.6), 1..400), blank in 0..5usize) {
            let height = pixels.len().div_ceil(width) + 2 * blank;
            let mut mask = Mask::empty(width, height);
            for (n, inside) in pixels.iter().enumerate() {
                mask.set(n % width, blank + n / width, *inside);
            }
            let runs = Runs::new(&mask).unwrap();
            for v in 0..height {
                prop_assert!((0..width).all(|u| runs.covers(u, v) == mask.get(u, v)));
                prop_assert!(runs.row(v).windows(2).all(|w| w[0][1] < w[1][0]), "runs that touch are one");
            }
            prop_assert!(runs.rows().len() <= height - 2 * blank);
            prop_assert_eq!(runs.area_px(), mask.area_px());
            prop_assert_eq!(runs.mask(), mask);
        }
    }
}
