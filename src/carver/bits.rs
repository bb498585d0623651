//! The voxels of one block as bits, and their misses as bit planes.
//!
//! ```text
//!  word z (of 8)   bit 8 y + x
//!  live            1 while the voxel lives
//!  plane 0, 1, ..  the binary digits of (start + misses): the miss after the last tolerated one carries out of the last
//!                  plane and clears the live bit
//! ```
//! 512 voxels take 64 bytes per plane, and a whole block is counted in a few dozen instructions.

/// Voxels along the edge of a block.
pub const BLOCK: usize = 8;

/// One bit per voxel of a block: word `z`, bit `8 y + x`.
pub type Bits = [u64; BLOCK];

pub(super) const NONE: Bits = [0; BLOCK];
pub(super) const ALL: Bits = [u64::MAX; BLOCK];

pub(super) fn get(bits: &Bits, [x, y, z]: [usize; 3]) -> bool {
    bits[z] >> (BLOCK * y + x) & 1 != 0
}

pub(super) fn count(bits: &[u64]) -> u32 {
    bits.iter().map(|w| w.count_ones()).sum()
}

/// The bits of the first `x`, `y`, `z` voxels along each axis: what a block at the grid's end holds.
pub(super) fn corner([x, y, z]: [usize; 3]) -> Bits {
    let row = (1u64 << x) - 1;
    let layer = (0..y).fold(0, |layer, j| layer | row << (BLOCK * j));
    std::array::from_fn(|k| if k < z { layer } else { 0 })
}

/// How many misses a voxel survives, and in how many planes they are counted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tally {
    budget: u32,
    planes: usize,
    start: u32,
}

impl Tally {
    pub fn new(budget: u32) -> Self {
        let planes = (u32::BITS - budget.leading_zeros()) as usize;
        // Counting from here, miss number budget + 1 is the one that leaves `planes` digits.
        let start = ((1u64 << planes) - 1 - u64::from(budget)) as u32;
        Self { budget, planes, start }
    }

    pub fn budget(self) -> u32 {
        self.budget
    }

    /// Words that one block takes: live bits, then the planes.
    pub fn words(self) -> usize {
        BLOCK * (1 + self.planes)
    }

    /// Writes a block whose voxels all have `misses` so far.
    pub fn fill(self, words: &mut [u64], live: &Bits, misses: u32) {
        let (first, planes) = words.split_at_mut(BLOCK);
        first.copy_from_slice(live);
        for (digit, plane) in planes.chunks_exact_mut(BLOCK).enumerate() {
            plane.fill(if (self.start + misses) >> digit & 1 != 0 { u64::MAX } else { 0 });
        }
    }

    /// Counts one more miss where `missed` says so.
    pub fn add(words: &mut [u64], missed: &Bits) {
        let (live, planes) = words.split_at_mut(BLOCK);
        for z in 0..BLOCK {
            let mut carry = missed[z] & live[z];
            for plane in planes.chunks_exact_mut(BLOCK) {
                let digit = plane[z];
                plane[z] = digit ^ carry;
                carry &= digit;
            }
            live[z] &= !carry;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_dies_at_the_first_miss_beyond_the_budget_wherever_counting_began() {
        for budget in [0, 1, 2, 3, 4, 6, 7, 8, 30] {
            for before in 0..=budget {
                let tally = Tally::new(budget);
                let mut words = vec![0; tally.words()];
                tally.fill(&mut words, &ALL, before);
                let missed = [1 << 5, 0, 0, 1 << 63, 0, 0, 0, 1];
                for misses in before + 1..=budget + 2 {
                    Tally::add(&mut words, &missed);
                    let dead = misses > budget;
                    assert_eq!(get(&words[..8].try_into().unwrap(), [5, 0, 0]), !dead, "budget {budget}, {misses} misses");
                    assert_eq!(count(&words[..8]), if dead { 509 } else { 512 });
                }
            }
        }
    }

    #[test]
    fn a_corner_holds_the_product_of_its_sides() {
        for (x, y, z) in [(0, 8, 8), (1, 2, 3), (8, 8, 8), (7, 8, 1)] {
            assert_eq!(count(&corner([x, y, z])) as usize, x * y * z);
        }
        assert!(get(&corner([3, 2, 1]), [2, 1, 0]) && !get(&corner([3, 2, 1]), [2, 1, 1]));
    }
}
