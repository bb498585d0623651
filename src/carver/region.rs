//! A region of 32^3 voxels: one count as long as all its voxels are alike, then 64 blocks.

use super::BlockKind;
use super::bits::{self, BLOCK, Bits, Tally};
use super::shadow::{Shadow, Verdict};

/// Voxels along the edge of a region.
pub(super) const REGION: usize = 32;
const CELLS: usize = REGION / BLOCK;

#[derive(Debug, Clone)]
pub(super) struct Region {
    /// First voxel, and the one after the last that the grid holds.
    lo: [usize; 3],
    hi: [usize; 3],
    live: u64,
    state: State,
}

#[derive(Debug, Clone)]
enum State {
    /// Every voxel has this many misses.
    Uniform(u32),
    Split(Box<Split>),
}

#[derive(Debug, Clone, Copy)]
enum Cell {
    Uniform(u32),
    /// The voxels differ; their bits are in this slot.
    Mixed(u32),
}

#[derive(Debug, Clone)]
struct Split {
    cells: [Cell; CELLS * CELLS * CELLS],
    slots: Vec<u64>,
    free: Vec<u32>,
}

impl Region {
    pub fn new(lo: [usize; 3], counts: [usize; 3]) -> Self {
        let hi = std::array::from_fn(|a| (lo[a] + REGION).min(counts[a]));
        Self { lo, hi, live: volume(lo, hi), state: State::Uniform(0) }
    }

    pub fn live(&self) -> u64 {
        self.live
    }

    pub fn observe(&mut self, shadow: &Shadow, tally: Tally) {
        if self.live == 0 {
            return;
        }
        let verdict = shadow.judge(self.lo, self.hi);
        match (verdict, &mut self.state) {
            (Verdict::Inside, _) => return,
            (Verdict::Outside, State::Uniform(misses)) => {
                *misses += 1;
                if *misses > tally.budget() {
                    self.live = 0;
                }
            }
            (Verdict::Outside, State::Split(split)) => {
                for (cell, lo, hi) in cells(self.lo, self.hi) {
                    self.live -= u64::from(split.miss_all(cell, lo, hi, tally));
                }
            }
            (Verdict::Cut, state) => {
                if let State::Uniform(misses) = *state {
                    *state = State::Split(Box::new(Split::new(misses)));
                }
                if let State::Split(split) = state {
                    for (cell, lo, hi) in cells(self.lo, self.hi) {
                        self.live -= u64::from(split.observe(cell, lo, hi, shadow, tally));
                    }
                }
            }
        }
        if self.live == 0 {
            self.state = State::Uniform(tally.budget() + 1);
        }
    }

    fn cell_bounds(&self, cell: [usize; 3]) -> ([usize; 3], [usize; 3]) {
        let lo: [usize; 3] = std::array::from_fn(|a| (self.lo[a] + cell[a] * BLOCK).min(self.hi[a]));
        (lo, std::array::from_fn(|a| (lo[a] + BLOCK).min(self.hi[a])))
    }

    pub fn bits(&self, cell: [usize; 3], tally: Tally) -> Bits {
        if self.live == 0 {
            return bits::NONE;
        }
        let (lo, hi) = self.cell_bounds(cell);
        match &self.state {
            State::Uniform(_) => bits::corner(sides(lo, hi)),
            State::Split(split) => match split.cells[index(cell)] {
                Cell::Uniform(misses) if misses > tally.budget() => bits::NONE,
                Cell::Uniform(_) => bits::corner(sides(lo, hi)),
                Cell::Mixed(slot) => split.live_bits(slot, tally),
            },
        }
    }

    pub fn kind(&self, cell: [usize; 3], tally: Tally) -> BlockKind {
        let (lo, hi) = self.cell_bounds(cell);
        let held = volume(lo, hi);
        let misses = match &self.state {
            _ if self.live == 0 || held == 0 => return BlockKind::Dead,
            State::Uniform(misses) => *misses,
            State::Split(split) => match split.cells[index(cell)] {
                Cell::Uniform(misses) => misses,
                Cell::Mixed(_) => return BlockKind::Mixed,
            },
        };
        match misses > tally.budget() {
            true => BlockKind::Dead,
            false if held == (BLOCK * BLOCK * BLOCK) as u64 => BlockKind::Full,
            false => BlockKind::Mixed,
        }
    }
}

impl Split {
    fn new(misses: u32) -> Self {
        Self { cells: [Cell::Uniform(misses); CELLS * CELLS * CELLS], slots: Vec::new(), free: Vec::new() }
    }

    /// One view over one block; returns how many voxels died.
    fn observe(&mut self, cell: usize, lo: [usize; 3], hi: [usize; 3], shadow: &Shadow, tally: Tally) -> u32 {
        if matches!(self.cells[cell], Cell::Uniform(misses) if misses > tally.budget()) {
            return 0;
        }
        match shadow.judge(lo, hi) {
            Verdict::Inside => 0,
            Verdict::Outside => self.miss_all(cell, lo, hi, tally),
            Verdict::Cut => match self.cells[cell] {
                Cell::Uniform(misses) => {
                    let held = bits::corner(sides(lo, hi));
                    let missed = shadow.misses(lo, hi, &held);
                    if missed == held {
                        return self.miss_all(cell, lo, hi, tally);
                    }
                    if missed == bits::NONE {
                        return 0;
                    }
                    let slot = self.take_slot(tally);
                    tally.fill(self.slot(slot, tally), &held, misses);
                    self.cells[cell] = Cell::Mixed(slot);
                    self.add(cell, slot, &missed, tally)
                }
                Cell::Mixed(slot) => {
                    let live = self.live_bits(slot, tally);
                    let missed = shadow.misses(lo, hi, &live);
                    self.add(cell, slot, &missed, tally)
                }
            },
        }
    }

    /// A view that misses the whole block.
    fn miss_all(&mut self, cell: usize, lo: [usize; 3], hi: [usize; 3], tally: Tally) -> u32 {
        match &mut self.cells[cell] {
            Cell::Uniform(misses) if *misses > tally.budget() => 0,
            Cell::Uniform(misses) => {
                *misses += 1;
                if *misses > tally.budget() { volume(lo, hi) as u32 } else { 0 }
            }
            Cell::Mixed(slot) => {
                let slot = *slot;
                self.add(cell, slot, &bits::ALL, tally)
            }
        }
    }

    fn add(&mut self, cell: usize, slot: u32, missed: &Bits, tally: Tally) -> u32 {
        let words = self.slot(slot, tally);
        let before = bits::count(&words[..BLOCK]);
        Tally::add(words, missed);
        let after = bits::count(&words[..BLOCK]);
        if after == 0 {
            self.cells[cell] = Cell::Uniform(tally.budget() + 1);
            self.free.push(slot);
        }
        before - after
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

    fn live_bits(&self, slot: u32, tally: Tally) -> Bits {
        let at = slot as usize * tally.words();
        std::array::from_fn(|z| self.slots[at + z])
    }
}

/// The blocks of a region that hold voxels of the grid: number, first voxel, the one after the last.
fn cells(lo: [usize; 3], hi: [usize; 3]) -> impl Iterator<Item = (usize, [usize; 3], [usize; 3])> {
    let [nx, ny, nz]: [usize; 3] = std::array::from_fn(|a| (hi[a] - lo[a]).div_ceil(BLOCK));
    (0..nz).flat_map(move |z| {
        (0..ny).flat_map(move |y| {
            (0..nx).map(move |x| {
                let cell = [x, y, z];
                let first: [usize; 3] = std::array::from_fn(|a| lo[a] + cell[a] * BLOCK);
                (index(cell), first, std::array::from_fn(|a| (first[a] + BLOCK).min(hi[a])))
            })
        })
    })
}

fn index([x, y, z]: [usize; 3]) -> usize {
    (z * CELLS + y) * CELLS + x
}

fn sides(lo: [usize; 3], hi: [usize; 3]) -> [usize; 3] {
    std::array::from_fn(|a| hi[a] - lo[a])
}

fn volume(lo: [usize; 3], hi: [usize; 3]) -> u64 {
    sides(lo, hi).iter().map(|&n| n as u64).product()
}
