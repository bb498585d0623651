//! What one view misses of a tile. It is collected row by row and read block by block.

use super::counts::{ROW, ROWS, Words, ones};

/// What a view shows of some voxels as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Inside,
    Outside,
    Cut,
}

/// What a view misses of a block. It lives on the stack while it is counted.
#[derive(Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "it never leaves the stack")]
pub(super) enum Missed {
    None,
    All,
    /// Bits of voxels outside of the grid and of dead rows have no meaning.
    Some(Words),
}

/// The voxels that a view covers in each row of a tile: one span from first to last, or a span of all of them with bits for its
/// gaps.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    starts: [u32; ROWS],
    ends: [u32; ROWS],
    /// Over the rows that were looked up.
    starts_from_to: [u32; 2],
    ends_from_to: [u32; 2],
    /// Bits of the gaps, for the blocks that have any.
    gaps: Vec<Words>,
    gapped: Vec<bool>,
    /// Stretches of the current row that must be decided by the definition.
    pub unsure: Vec<[usize; 2]>,
}

impl Spans {
    /// Spans for rows of this many blocks.
    pub fn new(blocks: usize) -> Self {
        Self {
            starts: [0; ROWS],
            ends: [0; ROWS],
            starts_from_to: [0; 2],
            ends_from_to: [0; 2],
            gaps: vec![[0; ROWS]; blocks],
            gapped: vec![false; blocks],
            unsure: Vec::new(),
        }
    }

    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.gaps.capacity() * size_of::<Words>() + self.gapped.capacity() + self.unsure.capacity() * size_of::<[usize; 2]>()
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

    /// Covers these voxels of a row and no others.
    pub fn cover(&mut self, row: usize, from: usize, to: usize) {
        if from < to {
            (self.starts[row], self.ends[row]) = (from as u32, to as u32);
        }
    }

    /// Begins a row whose voxels of `span` are given bit by bit.
    pub fn open(&mut self, row: usize, [from, to]: [usize; 2]) {
        (self.starts[row], self.ends[row]) = (0, u32::MAX);
        self.gapped[from / ROW..to.div_ceil(ROW)].fill(true);
    }

    /// From this voxel on the row is covered if it was missed before, and missed if it was covered. Turns may come in any
    /// order.
    pub fn turn(&mut self, row: usize, [from, to]: [usize; 2], at: usize) {
        if at < to {
            let at = at.max(from / ROW * ROW);
            self.gaps[at / ROW][row] ^= 1 << (at % ROW);
        }
    }

    /// Converts the turns of an open row to bits. The argument tells whether its first voxels are missed.
    pub fn settle(&mut self, row: usize, [from, to]: [usize; 2], missed: bool) {
        let mut before = if missed { u64::MAX } else { 0 };
        for gaps in &mut self.gaps[from / ROW..to.div_ceil(ROW)] {
            let mut bits = gaps[row];
            for shift in [1, 2, 4, 8, 16, 32] {
                bits ^= bits << shift;
            }
            bits ^= before;
            gaps[row] = bits;
            before = 0u64.wrapping_sub(bits >> (ROW - 1));
        }
    }

    /// Covers one voxel of a settled row.
    pub fn find(&mut self, row: usize, i: usize) {
        self.gaps[i / ROW][row] &= !(1 << (i % ROW));
    }

    /// Ends a row that was looked up.
    pub fn close(&mut self, row: usize) {
        let (start, end) = (self.starts[row], self.ends[row]);
        self.starts_from_to = [self.starts_from_to[0].min(start), self.starts_from_to[1].max(start)];
        self.ends_from_to = [self.ends_from_to[0].min(end), self.ends_from_to[1].max(end)];
    }

    /// What the rows that were looked up miss of the voxels from `from` to before `to`, which lie in one block.
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
            if row == 7 {
                // A gap over the border of two blocks, and one of no length; what is right of the span does not count.
                spans.open(7, [0, 128]);
                for at in [100, 11, 70, 60, 30, 30, 150] {
                    spans.turn(7, [0, 128], at);
                }
                spans.settle(7, [0, 128], true);
                spans.find(7, 3);
            } else {
                spans.cover(row, 10 + row % 2, 100);
            }
            spans.close(row);
        }
        let Missed::Some(first) = spans.missed(0, 64) else { panic!("cut") };
        assert_eq!((first[0], first[1]), (ones(10), ones(11)));
        assert_eq!(first[7], (ones(11) & !(1 << 3)) | (0xf << 60));
        let Missed::Some(second) = spans.missed(64, 128) else { panic!("cut") };
        assert_eq!((second[0], second[7]), (!ones(36), !ones(36) | ones(6)));
        assert_eq!(spans.missed(128, 190), Missed::Some(std::array::from_fn(|row| if row == 7 { 0 } else { u64::MAX })));
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
