//! The tolerant hull as a continuous field: how far inside the outlines a point lies, without the tolerated misses.
//!
//! ```text
//!   value = the (budget + 1)-th smallest, over the views, of the distance inside the view's outline (um, negative outside)
//!
//!      dead blocks  .  .  .        evaluated: blocks that the voxels' surface passes, then any next to one
//!      . . . [#][#][#][#] .        where the field changes sign towards it
//!      . .[#][#] full [#] .
//! ```
//! A point that more than `budget` views see outside of their outlines has a negative value, every other point a positive one.
//! The sign agrees with the hull at the sub-pixel positions of the outlines instead of at pixel centres, so that the surface
//! between two voxels is interpolated and not put half way.

use super::occupancy::{Kinds, inside_rows};
use super::{Contour, Field, Inside, contour::Side};
use crate::carver::{BLOCK, Bits, BlockKind, Carver};
use crate::geometry::VoxelGrid;
use crate::parallel::prelude::*;

const VOXELS: usize = BLOCK * BLOCK * BLOCK;

/// One block's values; voxel `(x, y, z)` is at `(z * BLOCK + y) * BLOCK + x`.
type Values = [f32; VOXELS];

/// The field of a carver's hull near its surface, um, positive inside.
pub struct Distance<'a> {
    grid: &'a VoxelGrid,
    kinds: Kinds,
    /// Index of each block's values in `values`, by the number of the block.
    slots: Vec<Option<u32>>,
    values: Vec<Values>,
}

impl<'a> Distance<'a> {
    /// Distance up to which the views' contours must be exact, um. The surface needs one voxel.
    pub fn reach_um(grid: &VoxelGrid) -> f64 {
        1.5 * grid.size()
    }

    /// The field of a hull. `contours` are those of the views that `carver` has observed.
    pub fn new(carver: &'a Carver, contours: &[Contour]) -> Self {
        let grid = carver.grid();
        let kinds = Kinds::new(carver);
        let budget = carver.budget() as usize;
        let mut field = Self { grid, slots: vec![None; kinds.len()], kinds, values: Vec::new() };
        let mut todo: Vec<[i32; 3]> = field.kinds.held().filter(|&block| field.is_at_surface(block)).collect();
        while !todo.is_empty() {
            let first = field.values.len();
            let values = |nearest: &mut Nearest, &block: &[i32; 3]| nearest.values(grid, block, contours);
            field.values.par_extend(todo.par_iter().map_init(|| Nearest::new(budget), values));
            for (n, &block) in todo.iter().enumerate() {
                field.slots[field.kinds.number(block)] = Some((first + n) as u32);
            }
            let mut next: Vec<[i32; 3]> = todo.iter().flat_map(|&block| field.crossed_neighbours(block)).collect();
            next.sort_unstable();
            next.dedup();
            todo = next;
        }
        field
    }

    /// Whether the voxels' surface passes through a block or one of its faces.
    fn is_at_surface(&self, block: [i32; 3]) -> bool {
        let kind = self.kinds.of(block);
        let other = if kind == BlockKind::Full { BlockKind::Dead } else { BlockKind::Full };
        kind == BlockKind::Mixed || neighbours(block).any(|(_, _, next)| self.kinds.of(next) == other)
    }

    /// Blocks without values at the end of a lattice edge on which the field changes its sign.
    fn crossed_neighbours(&self, block: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
        let values = self.evaluated(block);
        neighbours(block).filter_map(move |(axis, up, next)| {
            if !self.kinds.holds(next) || self.evaluated(next).is_some() {
                return None;
            }
            let inside = self.kinds.of(next) == BlockKind::Full;
            let face = if up { BLOCK - 1 } else { 0 };
            let stride = [1, BLOCK, BLOCK * BLOCK][axis];
            let on_face = |n: &usize| n / stride % BLOCK == face;
            let values = values?;
            (0..VOXELS).filter(on_face).any(|n| (values[n] > 0.0) != inside).then_some(next)
        })
    }

    fn evaluated(&self, block: [i32; 3]) -> Option<&Values> {
        let slot = self.kinds.holds(block).then(|| self.slots[self.kinds.number(block)]).flatten()?;
        Some(&self.values[slot as usize])
    }

    fn bits(&self, block: [i32; 3]) -> Bits {
        match self.evaluated(block) {
            Some(values) => std::array::from_fn(|z| {
                let layer = &values[z * BLOCK * BLOCK..][..BLOCK * BLOCK];
                layer.iter().enumerate().fold(0, |bits, (n, &value)| bits | u64::from(value > 0.0) << n)
            }),
            None if self.kinds.of(block) == BlockKind::Full => [u64::MAX; BLOCK],
            None => [0; BLOCK],
        }
    }

    /// The value of a voxel; where none was computed, the largest possible distance from the surface.
    fn value(&self, at: [i32; 3]) -> f32 {
        let block = at.map(|c| c.div_euclid(BLOCK as i32));
        let far = far(self.grid);
        match self.evaluated(block) {
            Some(values) => {
                let [x, y, z] = at.map(|c| c.rem_euclid(BLOCK as i32) as usize);
                values[(z * BLOCK + y) * BLOCK + x]
            }
            None if self.kinds.of(block) == BlockKind::Full => far,
            None => -far,
        }
    }
}

impl Field for Distance<'_> {
    fn origin(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.grid.centre(a, 0))
    }

    fn spacing(&self) -> f64 {
        self.grid.size()
    }

    fn blocks(&self) -> Vec<[i32; 3]> {
        self.kinds.surface_blocks(|block| self.evaluated(block).is_some())
    }

    fn inside(&self, [x, y, z]: [i32; 3]) -> Inside {
        inside_rows(|[i, j, k]| self.bits([x + i, y + j, z + k]))
    }

    fn crossing(&self, at: [i32; 3], axis: usize) -> f64 {
        let mut next = at;
        next[axis] += 1;
        let (a, b) = (f64::from(self.value(at)), f64::from(self.value(next)));
        a / (a - b)
    }
}

/// Two voxels, um: next to the surface no point is farther from it than one.
fn far(grid: &VoxelGrid) -> f32 {
    (2.0 * grid.size()) as f32
}

/// The six neighbours of a block: the axis, whether upwards, and the block.
fn neighbours(block: [i32; 3]) -> impl Iterator<Item = (usize, bool, [i32; 3])> {
    (0..6).map(move |n| {
        let (axis, up) = (n / 2, n % 2 == 1);
        let mut next = block;
        next[axis] += if up { 1 } else { -1 };
        (axis, up, next)
    })
}

/// The smallest distances so far at each voxel of a block, ascending; one more than the number of views that may miss.
struct Nearest {
    ranks: Vec<Values>,
}

impl Nearest {
    fn new(budget: usize) -> Self {
        Self { ranks: vec![[0.0; VOXELS]; budget + 1] }
    }

    fn values(&mut self, grid: &VoxelGrid, block: [i32; 3], contours: &[Contour]) -> Values {
        let first: [usize; 3] = std::array::from_fn(|a| block[a] as usize * BLOCK);
        let low: [f64; 3] = std::array::from_fn(|a| grid.centre(a, first[a]));
        let high: [f64; 3] = std::array::from_fn(|a| grid.centre(a, first[a] + BLOCK - 1));
        self.ranks.iter_mut().for_each(|rank| rank.fill(far(grid)));
        for contour in contours {
            match contour.side(low, high) {
                Side::Inside => {}
                Side::Outside => (0..BLOCK * BLOCK).for_each(|row| self.insert(row, [-contour.band_um(); BLOCK])),
                Side::Near => {
                    for row in 0..BLOCK * BLOCK {
                        let start = [low[0], grid.centre(1, first[1] + row % BLOCK), grid.centre(2, first[2] + row / BLOCK)];
                        self.insert(row, contour.row(start, grid.size()));
                    }
                }
            }
        }
        let mut values = self.ranks[self.ranks.len() - 1];
        let counts = grid.counts();
        for (n, value) in values.iter_mut().enumerate() {
            let at = [n % BLOCK, n / BLOCK % BLOCK, n / BLOCK / BLOCK];
            if (0..3).any(|a| first[a] + at[a] >= counts[a]) {
                *value = -far(grid);
            }
        }
        values
    }

    fn insert(&mut self, row: usize, mut found: [f32; BLOCK]) {
        for rank in &mut self.ranks {
            for (kept, new) in rank[row * BLOCK..][..BLOCK].iter_mut().zip(&mut found) {
                // Comparisons instead of `f32::min`, which also has to treat values that are not numbers.
                let (low, high) = if *new < *kept { (*new, *kept) } else { (*kept, *new) };
                *kept = low;
                *new = high;
            }
        }
    }
}

#[cfg(test)]
mod tests;
