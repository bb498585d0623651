//! A mask as the runs of covered pixels in each of its rows: a few numbers where the mask has a million.

use super::{CarveError, Carver};
use crate::profile::Mask;

/// The covered pixels of a view, row by row.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Runs {
    width: usize,
    height: usize,
    /// First row that has a run.
    first: usize,
    /// Row `first + n` has the runs `runs[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    /// First covered column, and the one after the last.
    runs: Vec<[u16; 2]>,
}

impl Runs {
    /// # Errors
    /// Refuses a mask without pixels, or with more than [`Carver::MAX_MASK_SIDE`] on a side.
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
        let mut open = None;
        let mut at = 0;
        while at < row.len() {
            // Eight pixels alike, and like the one before, hold no end of a run.
            if let Some(eight) = row.get(at..at + 8) {
                let alike = if open.is_some() { eight.iter().all(|&p| p != 0) } else { blank(eight) };
                if alike {
                    at += 8;
                    continue;
                }
            }
            match (open, row[at] != 0) {
                (None, true) => open = Some(at),
                (Some(start), false) => {
                    self.runs.push([start as u16, at as u16]);
                    open = None;
                }
                _ => {}
            }
            at += 1;
        }
        if let Some(start) = open {
            self.runs.push([start as u16, row.len() as u16]);
        }
        self.starts.push(self.runs.len() as u32);
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn height(&self) -> usize {
        self.height
    }

    /// The rows that can have runs.
    pub(super) fn rows(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.starts.len() - 1
    }

    /// The runs of a row, from left to right.
    pub(super) fn row(&self, v: usize) -> &[[u16; 2]] {
        match v.checked_sub(self.first) {
            Some(n) if n + 1 < self.starts.len() => &self.runs[self.starts[n] as usize..self.starts[n + 1] as usize],
            _ => &[],
        }
    }

    pub(super) fn covers(&self, u: usize, v: usize) -> bool {
        self.row(v).iter().any(|&[start, end]| (usize::from(start)..usize::from(end)).contains(&u))
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        self.starts.capacity() * size_of::<u32>() + self.runs.capacity() * size_of::<[u16; 2]>()
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
        }
    }
}
