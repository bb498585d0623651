//! The visual hull with tolerance, carved view by view.
//!
//! ```text
//!  grid ── regions of 32^3 ── blocks of 8^3 ── voxels          Mask + Projection ── Shadow (what a box of voxels sees)
//!            one count          one count       bit planes                            │
//!                 └─────────────────┴───────────────┴──────── judged inside, outside ─┘
//!                                                             or cut: then one level down
//! ```
//! A voxel's centre is projected in f64 and samples `mask[floor(v + 0.5)][floor(u + 0.5)]`. It is covered when that pixel
//! is inside and the centre lies in front of the camera; a centre outside the image, or not in front of the camera, is a
//! miss. A voxel lives while its misses do not exceed `floor(epsilon N + 1e-9)` of the planned `N` views, and never comes
//! back: the live hull only shrinks, always contains the final one, and does not depend on the order of the views.
//!
//! Boxes that a view covers wholly cost nothing, boxes that it misses wholly cost one count, so the work of a view follows
//! the surface. The result is that of the definition bit for bit: a box is settled as a whole only where a rigorous
//! bound of its image allows it.

mod bits;
mod region;
mod shadow;

#[cfg(test)]
mod tests;

pub use bits::{BLOCK, Bits};

use crate::geometry::{Projection, VoxelGrid};
use crate::profile::Mask;
use bits::Tally;
use rayon::prelude::*;
use region::{REGION, Region};
use shadow::Shadow;

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CarveError {
    #[error("epsilon is {found}; the tolerated share of missing views runs from 0 to below 1")]
    Epsilon { found: f64 },
    #[error("0 views are planned; a hull needs at least 1")]
    NoViews,
    #[error("view {found} of {planned} planned: the tolerance was set for {planned}. Plan more views and carve again")]
    TooManyViews { planned: usize, found: usize },
    #[error("the mask is {width} x {height} px; it needs at least one pixel and less than {limit} on a side")]
    MaskSize { width: usize, height: usize, limit: usize },
}

/// What a block of 8^3 voxels holds; voxels outside the grid count as dead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockKind {
    Dead,
    /// Every one of its 512 voxels lives.
    Full,
    Mixed,
}

/// A visual hull in the making.
#[derive(Debug, Clone)]
pub struct Carver {
    grid: VoxelGrid,
    planned: usize,
    observed: usize,
    tally: Tally,
    region_counts: [usize; 3],
    regions: Vec<Region>,
    live: u64,
    /// Reused from view to view.
    sums: Vec<u32>,
}

impl Carver {
    /// Masks wider or higher than this would overflow the sums of covered pixels.
    pub const MAX_MASK_SIDE: usize = 65_535;

    /// # Errors
    /// Refuses a tolerance outside `0..1` and a plan without views.
    pub fn new(grid: VoxelGrid, planned_views: usize, epsilon: f64) -> Result<Self, CarveError> {
        if !(0.0..1.0).contains(&epsilon) {
            return Err(CarveError::Epsilon { found: epsilon });
        }
        if planned_views == 0 {
            return Err(CarveError::NoViews);
        }
        let budget = (epsilon * planned_views as f64 + 1e-9).floor() as u32;
        let counts = grid.counts();
        let region_counts = counts.map(|n| n.div_ceil(REGION));
        let mut regions = Vec::with_capacity(region_counts.iter().product());
        for z in 0..region_counts[2] {
            for y in 0..region_counts[1] {
                for x in 0..region_counts[0] {
                    regions.push(Region::new([x, y, z].map(|r| r * REGION), counts));
                }
            }
        }
        Ok(Self {
            grid,
            planned: planned_views,
            observed: 0,
            tally: Tally::new(budget),
            region_counts,
            regions,
            live: grid.len() as u64,
            sums: Vec::new(),
        })
    }

    /// Counts one view's misses.
    ///
    /// # Errors
    /// Refuses more views than were planned, and a mask too large for the sums; the hull is then unchanged.
    pub fn observe(&mut self, mask: &Mask, projection: &Projection) -> Result<(), CarveError> {
        if self.observed == self.planned {
            return Err(CarveError::TooManyViews { planned: self.planned, found: self.observed + 1 });
        }
        let (width, height) = (mask.width(), mask.height());
        if [width, height].iter().any(|&n| n == 0 || n > Self::MAX_MASK_SIDE) {
            return Err(CarveError::MaskSize { width, height, limit: Self::MAX_MASK_SIDE });
        }
        let shadow = Shadow::new(&self.grid, mask, projection, std::mem::take(&mut self.sums));
        let tally = self.tally;
        self.regions.par_iter_mut().for_each(|region| region.observe(&shadow, tally));
        self.sums = shadow.into_sums();
        self.live = self.regions.iter().map(Region::live).sum();
        self.observed += 1;
        Ok(())
    }

    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    pub fn planned_views(&self) -> usize {
        self.planned
    }

    pub fn observed_views(&self) -> usize {
        self.observed
    }

    /// Misses that a voxel survives.
    pub fn budget(&self) -> u32 {
        self.tally.budget()
    }

    pub fn live_voxels(&self) -> u64 {
        self.live
    }

    /// Volume of the live hull, in the cube of the grid's unit.
    pub fn volume_um3(&self) -> f64 {
        self.live as f64 * self.grid.voxel_volume()
    }

    /// Whether voxel `(i, j, k)` lives; outside the grid nothing does.
    pub fn is_live(&self, i: usize, j: usize, k: usize) -> bool {
        let block = [i, j, k].map(|n| (n / BLOCK) as i32);
        bits::get(&self.block(block), [i % BLOCK, j % BLOCK, k % BLOCK])
    }

    /// Blocks of 8^3 voxels along each axis; the last ones may reach over the grid's end.
    pub fn block_counts(&self) -> [usize; 3] {
        self.grid.counts().map(|n| n.div_ceil(BLOCK))
    }

    /// The live voxels of a block as bits; outside the grid none.
    pub fn block(&self, block: [i32; 3]) -> Bits {
        self.locate(block).map_or(bits::NONE, |(region, cell)| region.bits(cell, self.tally))
    }

    /// What a block holds, without looking at its voxels.
    pub fn block_kind(&self, block: [i32; 3]) -> BlockKind {
        self.locate(block).map_or(BlockKind::Dead, |(region, cell)| region.kind(cell, self.tally))
    }

    fn locate(&self, block: [i32; 3]) -> Option<(&Region, [usize; 3])> {
        const CELLS: usize = REGION / BLOCK;
        let mut at = [0; 3];
        for axis in 0..3 {
            at[axis] = usize::try_from(block[axis]).ok()?;
            if at[axis] >= self.region_counts[axis] * CELLS {
                return None;
            }
        }
        let [x, y, z] = at.map(|n| n / CELLS);
        let region = &self.regions[(z * self.region_counts[1] + y) * self.region_counts[0] + x];
        Some((region, at.map(|n| n % CELLS)))
    }
}
