//! What one view misses of a tile, collected row by row and read block by block.

use super::counts::{ROW, ROWS, Words, ones};

/// What a view misses of a block.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Missed {
    None,
    All,
    /// Bits of voxels outside the grid, and of rows that are dead, say nothing.
    Some(Words),
}

/// The voxels that a view covers in each row of a tile: one span from first to last, and the gaps within.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    starts: [u32; ROWS],
    ends: [u32; ROWS],
    /// Over the rows that were looked at.
    starts_from_to: [u32; 2],
    ends_from_to: [u32; 2],
    /// Bits of the gaps, for the blocks that have some.
    gaps: Vec<Words>,
    gapped: Vec<bool>,
}

impl Spans {
    /// For rows of this many blocks.
    pub fn new(blocks: usize) -> Self {
        Self {
            starts: [0; ROWS],
            ends: [0; ROWS],
            starts_from_to: [0; 2],
            ends_from_to: [0; 2],
            gaps: vec![[0; ROWS]; blocks],
            gapped: vec![false; blocks],
        }
    }

    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.gaps.capacity() * size_of::<Words>() + self.gapped.capacity()
    }

    pub fn clear(&mut self) {
        self.starts = [u32::MAX; ROWS];
        self.ends = [0; ROWS];
        for (gaps, gapped) in self.gaps.iter_mut().zip(&mut self.gapped) {
            if std::mem::take(gapped) {
                *gaps = [0; ROWS];
            }
        }
        self.starts_from_to = [u32::MAX, 0];
        self.ends_from_to = [u32::MAX, 0];
    }

    /// Covers voxels of a row; the stretches of a row come in growing order.
    pub fn cover(&mut self, row: usize, from: usize, to: usize) {
        if from >= to {
            return;
        }
        let before = self.ends[row] as usize;
        if before == 0 {
            self.starts[row] = from as u32;
        } else if before < from {
            for block in before / ROW..from.div_ceil(ROW) {
                self.gapped[block] = true;
                self.gaps[block][row] |= ones((from - block * ROW).min(ROW)) & !ones(before.saturating_sub(block * ROW));
            }
        }
        self.ends[row] = to as u32;
    }

    /// Ends a row that was looked at.
    pub fn close(&mut self, row: usize) {
        let (start, end) = (self.starts[row], self.ends[row]);
        self.starts_from_to = [self.starts_from_to[0].min(start), self.starts_from_to[1].max(start)];
        self.ends_from_to = [self.ends_from_to[0].min(end), self.ends_from_to[1].max(end)];
    }

    /// What the rows that were looked at miss of the voxels from `from` to before `to`, which lie in one block.
    pub fn missed(&self, from: usize, to: usize) -> Missed {
        if to as u32 <= self.starts_from_to[0] || from as u32 >= self.ends_from_to[1] {
            return Missed::All;
        }
        let block = from / ROW;
        if from as u32 >= self.starts_from_to[1] && to as u32 <= self.ends_from_to[0] && !self.gapped[block] {
            return Missed::None;
        }
        let first = (block * ROW) as u32;
        let within = |at: u32| ones(at.saturating_sub(first) as usize);
        Missed::Some(std::array::from_fn(|row| self.gaps[block][row] | within(self.starts[row]) | !within(self.ends[row])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_misses_what_its_rows_do_not_cover() {
        let mut spans = Spans::new(3);
        spans.clear();
        for row in 0..ROWS {
            // Row 7 has a gap over the border of two blocks.
            spans.cover(row, 10 + row % 2, if row == 7 { 60 } else { 100 });
            if row == 7 {
                spans.cover(7, 70, 100);
            }
            spans.close(row);
        }
        let Missed::Some(first) = spans.missed(0, 64) else { panic!("cut") };
        assert_eq!((first[0], first[1]), ((1 << 10) - 1, (1 << 11) - 1));
        assert_eq!(first[7], (1 << 11) - 1 | 0xf << 60);
        let Missed::Some(second) = spans.missed(64, 128) else { panic!("cut") };
        assert_eq!((second[0], second[7]), (!ones(36), !ones(36) | ones(6)));
        assert_eq!(spans.missed(128, 190), Missed::All);
        spans.clear();
        for row in 0..ROWS {
            spans.cover(row, 0, 192);
            spans.close(row);
        }
        assert_eq!(spans.missed(64, 128), Missed::None, "the gap of before is forgotten");
    }

    #[test]
    fn rows_that_cover_nothing_miss_all() {
        let mut spans = Spans::new(1);
        spans.clear();
        (0..ROWS).for_each(|row| spans.close(row));
        assert_eq!(spans.missed(0, 64), Missed::All);
        spans.clear();
        spans.cover(0, 3, 5);
        (0..ROWS).for_each(|row| spans.close(row));
        let Missed::Some(words) = spans.missed(0, 64) else { panic!("cut") };
        assert_eq!((words[0], words[1]), (!0b11000, u64::MAX));
    }
}
