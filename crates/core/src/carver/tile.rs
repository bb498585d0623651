//! A tile: 8 x 8 rows of voxels over the whole length of the capillary, divided into blocks of 64 x 8 x 8.

use super::counts::{self, ROW, ROWS, SIDE, Tally, Words};
use super::misses::{Missed, Spans, Verdict};
use super::{Boxes, Lines};

/// The way in which a view is looked up.
pub(super) enum Sight<'a> {
    Lines(Lines<'a>),
    Boxes(Boxes<'a>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    /// Every voxel has this many misses.
    Uniform(u32),
    /// The voxels differ. Their words are in this slot.
    Mixed(u32),
}

#[derive(Debug, Clone)]
pub(super) struct Tile {
    /// First row along y and z, and the one after the last in the grid.
    lo: [usize; 2],
    hi: [usize; 2],
    /// Voxels of a row.
    length: usize,
    live: u64,
    /// The blocks that may contain live voxels, from first to before last.
    reach: [usize; 2],
    /// The range of voxels of each row `8 z + y` that may be live.
    rows: [[u32; 2]; ROWS],
    blocks: Vec<Block>,
    slots: Vec<u64>,
    free: Vec<u32>,
}

impl Tile {
    /// The tile whose first row is `lo` along y and z, in a grid of `counts` voxels, with memory for `room` words.
    pub fn new(lo: [usize; 2], counts: [usize; 3], room: usize) -> Self {
        let mut tile = Self {
            lo,
            hi: [0, 1].map(|a| (lo[a] + SIDE).min(counts[a + 1])),
            length: counts[0],
            live: 0,
            reach: [0; 2],
            rows: [[0; 2]; ROWS],
            blocks: vec![Block::Uniform(0); counts[0].div_ceil(ROW)],
            // The pages are written to, so that they are mapped before the first view needs them.
            slots: vec![u64::MAX; room],
            free: Vec::new(),
        };
        tile.reset();
        tile
    }

    /// Resets the tile to its first state and keeps its memory.
    pub fn reset(&mut self) {
        self.blocks.fill(Block::Uniform(0));
        self.slots.clear();
        self.free.clear();
        let [y, z] = self.sides();
        self.live = (self.length * y * z) as u64;
        self.reach = [0, self.blocks.len()];
        self.rows = counts::corner([1, y, z]).map(|word| if word == 0 { [0; 2] } else { [0, self.length as u32] });
    }

    fn sides(&self) -> [usize; 2] {
        [self.hi[0] - self.lo[0], self.hi[1] - self.lo[1]]
    }

    pub fn live(&self) -> u64 {
        self.live
    }

    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<Block>() + self.slots.capacity() * size_of::<u64>() + self.free.capacity() * size_of::<u32>()
    }

    /// The voxels of a row in `block`, from first to before last.
    fn voxels(&self, block: usize) -> [usize; 2] {
        [block * ROW, (block * ROW + ROW).min(self.length)]
    }

    /// The bits of a block that are in the grid.
    fn held(&self, block: usize) -> Words {
        let ([from, to], [y, z]) = (self.voxels(block), self.sides());
        counts::corner([to - from, y, z])
    }

    /// The live voxels of a block.
    pub fn words(&self, block: usize, tally: Tally) -> Words {
        match self.blocks[block] {
            Block::Uniform(misses) if misses > tally.budget() => [0; ROWS],
            Block::Uniform(_) => self.held(block),
            Block::Mixed(slot) => self.live_words(slot, tally),
        }
    }

    /// Whether all voxels of a block are live, or all dead.
    pub fn uniform(&self, block: usize, tally: Tally) -> Option<bool> {
        match self.blocks[block] {
            Block::Uniform(misses) => Some(misses <= tally.budget()),
            Block::Mixed(_) => None,
        }
    }

    fn live_words(&self, slot: u32, tally: Tally) -> Words {
        let at = slot as usize * tally.words();
        std::array::from_fn(|row| self.slots[at + row])
    }

    /// Counts one view's misses.
    pub fn observe(&mut self, sight: &Sight, tally: Tally, spans: &mut Spans) {
        if self.live == 0 {
            return;
        }
        let before = self.live;
        match sight {
            Sight::Lines(lines) => {
                let span = [self.voxels(self.reach[0])[0], self.voxels(self.reach[1] - 1)[1]];
                match lines.judge(span, self.lo, self.hi) {
                    Verdict::Inside => return,
                    Verdict::Outside => self.each_block(tally, |_, _| Missed::All),
                    Verdict::Cut => {
                        spans.clear();
                        for (row, &[from, to]) in self.rows.iter().enumerate().filter(|(_, [from, to])| from < to) {
                            let at = (self.lo[0] + row % SIDE, self.lo[1] + row / SIDE);
                            lines.look([from as usize, to as usize], at, row, spans);
                            spans.close(row);
                        }
                        self.each_block(tally, |tile, block| {
                            let [from, to] = tile.voxels(block);
                            spans.missed(from, to)
                        });
                    }
                }
            }
            Sight::Boxes(boxes) => self.each_block(tally, |tile, block| {
                let [from, to] = tile.voxels(block);
                let live = tile.words(block, tally);
                boxes.missed([from, tile.lo[0], tile.lo[1]], [to, tile.hi[0], tile.hi[1]], &live)
            }),
        }
        if self.live < before {
            self.shrink(tally);
        }
    }

    fn each_block(&mut self, tally: Tally, missed: impl Fn(&Self, usize) -> Missed) {
        for block in self.reach[0]..self.reach[1] {
            if self.blocks[block] != Block::Uniform(tally.budget() + 1) {
                let missed = missed(self, block);
                self.live -= u64::from(self.count(block, missed, tally));
            }
        }
    }

    /// Counts what a view misses of a live block. Returns how many voxels died.
    fn count(&mut self, block: usize, missed: Missed, tally: Tally) -> u32 {
        match (missed, self.blocks[block]) {
            (Missed::None, _) => 0,
            (Missed::All, Block::Uniform(misses)) => self.miss_all(block, misses, tally),
            (Missed::All, Block::Mixed(slot)) => self.add(block, slot, &[u64::MAX; ROWS], tally),
            (Missed::Some(words), Block::Mixed(slot)) => self.add(block, slot, &words, tally),
            (Missed::Some(words), Block::Uniform(misses)) => {
                let held = self.held(block);
                let hit = |row: usize| words[row] & held[row];
                if (0..ROWS).all(|row| hit(row) == 0) {
                    return 0;
                }
                if (0..ROWS).all(|row| hit(row) == held[row]) {
                    return self.miss_all(block, misses, tally);
                }
                let slot = self.take_slot(tally);
                tally.fill(self.slot(slot, tally), &held, misses);
                self.blocks[block] = Block::Mixed(slot);
                self.add(block, slot, &words, tally)
            }
        }
    }

    fn miss_all(&mut self, block: usize, misses: u32, tally: Tally) -> u32 {
        self.blocks[block] = Block::Uniform(misses + 1);
        let ([from, to], [y, z]) = (self.voxels(block), self.sides());
        if misses == tally.budget() { ((to - from) * y * z) as u32 } else { 0 }
    }

    fn add(&mut self, block: usize, slot: u32, missed: &Words, tally: Tally) -> u32 {
        let words = self.slot(slot, tally);
        let died = Tally::add(words, missed);
        if died > 0 && words[..ROWS].iter().all(|&word| word == 0) {
            self.blocks[block] = Block::Uniform(tally.budget() + 1);
            self.free.push(slot);
        }
        died
    }

    fn take_slot(&mut self, tally: Tally) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            let slot = self.slots.len() / tally.words();
            self.slots.resize((slot + 1) * tally.words(), 0);
            slot as u32
        })
    }

    fn slot(&mut self, slot: u32, tally: Tally) -> &mut [u64] {
        let at = slot as usize * tally.words();
        &mut self.slots[at..at + tally.words()]
    }

    /// Removes blocks and rows that have died.
    fn shrink(&mut self, tally: Tally) {
        let dead = Block::Uniform(tally.budget() + 1);
        let [mut from, mut to] = self.reach;
        while from < to && self.blocks[from] == dead {
            from += 1;
        }
        while from < to && self.blocks[to - 1] == dead {
            to -= 1;
        }
        self.reach = [from, to];
        let word = |block: usize, row: usize| match self.blocks[block] {
            Block::Uniform(misses) if misses > tally.budget() => 0,
            Block::Uniform(_) => u64::MAX,
            Block::Mixed(slot) => self.slots[slot as usize * tally.words() + row],
        };
        let mut rows = self.rows;
        for (row, range) in rows.iter_mut().enumerate().filter(|(_, [from, to])| from < to) {
            let first = (from..to).map(|block| (block, word(block, row))).find(|(_, word)| *word != 0);
            let last = (from..to).rev().map(|block| (block, word(block, row))).find(|(_, word)| *word != 0);
            let (Some((first, low)), Some((last, high))) = (first, last) else {
                *range = [0; 2];
                continue;
            };
            let end = last * ROW + ROW - high.leading_zeros() as usize;
            *range = [(first * ROW) as u32 + low.trailing_zeros(), end.min(self.length) as u32];
        }
        self.rows = rows;
        if self.live == 0 {
            self.slots.clear();
            self.free.clear();
        }
    }
}
