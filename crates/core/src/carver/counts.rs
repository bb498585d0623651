//! The misses of a block of 64 x 8 x 8 voxels as bit planes.
//!
//! ```text
//!  word 8 z + y (of 64)   bit x
//!  live            1 while the voxel lives
//!  plane 0, 1, ..  the binary digits of (start + misses): the miss after the last tolerated one carries out of the last
//!                  plane and clears the live bit
//! ```
//! 4096 voxels take 512 bytes per plane, and a whole block is counted in a few dozen vector instructions.

/// Voxels of a row along the capillary in one word.
pub(super) const ROW: usize = 64;
/// Rows along y and along z in a block.
pub(super) const SIDE: usize = 8;
pub(super) const ROWS: usize = SIDE * SIDE;

/// One bit per voxel of a block.
pub(super) type Words = [u64; ROWS];

/// The lowest `n` bits.
pub(super) fn ones(n: usize) -> u64 {
    if n < ROW { (1 << n) - 1 } else { u64::MAX }
}

/// The bits of the first `x`, `y`, `z` voxels along each axis: the part of a block at the grid's end that is in the grid.
pub(super) fn corner([x, y, z]: [usize; 3]) -> Words {
    std::array::from_fn(|row| if row % SIDE < y && row / SIDE < z { ones(x) } else { 0 })
}

pub(super) fn count(words: &[u64]) -> u32 {
    words.iter().map(|w| w.count_ones()).sum()
}

/// Number of misses that a voxel survives, and number of planes in which they are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tally {
    budget: u32,
    planes: usize,
    start: u32,
}

impl Tally {
    pub fn new(budget: u32) -> Self {
        let planes = (u32::BITS - budget.leading_zeros()) as usize;
        // Counting starts here, so that miss number budget + 1 is the one that overflows `planes` digits.
        let start = ((1u64 << planes) - 1 - u64::from(budget)) as u32;
        Self { budget, planes, start }
    }

    pub fn budget(self) -> u32 {
        self.budget
    }

    /// Words of one block: live bits, then the planes.
    pub fn words(self) -> usize {
        ROWS * (1 + self.planes)
    }

    /// Writes a block whose voxels all have `misses` so far.
    pub fn fill(self, words: &mut [u64], live: &Words, misses: u32) {
        let (first, planes) = words.split_at_mut(ROWS);
        first.copy_from_slice(live);
        for (digit, plane) in planes.chunks_exact_mut(ROWS).enumerate() {
            plane.fill(if (self.start + misses) >> digit & 1 != 0 { u64::MAX } else { 0 });
        }
    }

    /// Counts one more miss for the voxels in `missed`. Returns how many voxels died of it.
    pub fn add(words: &mut [u64], missed: &Words) -> u32 {
        let (live, planes) = words.split_at_mut(ROWS);
        let mut carry = *missed;
        for (c, l) in carry.iter_mut().zip(&*live) {
            *c &= l;
        }
        for plane in planes.chunks_exact_mut(ROWS) {
            let mut any = 0;
            for (c, p) in carry.iter_mut().zip(plane) {
                let digit = *p;
                *p = digit ^ *c;
                *c &= digit;
                any |= *c;
            }
            if any == 0 {
                return 0;
            }
        }
        for (c, l) in carry.iter().zip(live) {
            *l &= !c;
        }
        count(&carry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_dies_at_the_first_miss_beyond_the_budget_wherever_counting_began() {
        let mut missed = [0; ROWS];
        (missed[0], missed[27], missed[63]) = (1 << 5, 1 << 63, 1);
        for budget in [0, 1, 2, 3, 4, 6, 7, 8, 30] {
            for before in 0..=budget {
                let tally = Tally::new(budget);
                let mut words = vec![0; tally.words()];
                tally.fill(&mut words, &corner([64, 8, 8]), before);
                for misses in before + 1..=budget + 2 {
                    let died = Tally::add(&mut words, &missed);
                    assert_eq!(died, if misses == budget + 1 { 3 } else { 0 }, "budget {budget}, {misses} misses");
                    assert_eq!(words[0] >> 5 & 1 == 0, misses > budget);
                    assert_eq!(count(&words[..ROWS]), if misses > budget { 4093 } else { 4096 });
                }
            }
        }
    }

    #[test]
    fn a_corner_holds_the_product_of_its_sides() {
        for (x, y, z) in [(0, 8, 8), (1, 2, 3), (64, 8, 8), (63, 8, 1)] {
            assert_eq!(count(&corner([x, y, z])) as usize, x * y * z);
        }
        let words = corner([3, 2, 1]);
        assert_eq!((words[1], words[2], words[8]), (0b111, 0, 0));
    }
}
