//! The visual hull with a tolerance, carved view by view.
//!
//! ```text
//!  grid ── tiles of 8 x 8 rows ── blocks of 64 x 8 x 8 ── voxels       Mask ── Runs ─┬─ Lines   a row of voxels is a line
//!            one range of life      one count    bit planes                          └─ Boxes   any other projection
//!                └──────────────────────┴──────────┴──────────── Spans, words missed ────┘
//! ```
//! The centre of a voxel is projected in f64 and samples `mask[floor(v + 0.5)][floor(u + 0.5)]`. It is covered when that pixel
//! is inside and the centre lies in front of the camera. A centre outside the image, or not in front of the camera, is a miss.
//! Where a view says that the specimen leaves the image on the left or right, the last column of the image decides beyond that
//! side. A voxel lives while its misses do not exceed `floor(epsilon N + 1e-9)` of the planned `N` views, and never comes back.
//! So the live hull only shrinks, always contains the final one, and does not depend on the order of the views.
//!
//! A block that a view covers completely costs nothing, and a block that it misses completely costs one count. So the work of a
//! view follows the surface. The result is that of the definition, bit for bit: the definition decides wherever a quicker way
//! is not certain. The views are kept as runs, so that they can be carved again, with another plan or through other cameras.

mod boxes;
mod counts;
mod definition;
mod lines;
mod misses;
mod residual;
mod runs;
mod tile;
mod voxels;

#[cfg(test)]
pub(crate) mod tests;

pub use definition::Leaves;
pub use residual::ResidualVolume;
pub use runs::Runs;
pub use voxels::Voxels;

use crate::geometry::{Projection, VoxelGrid};
use crate::parallel::prelude::*;
use crate::profile::Mask;
use boxes::Boxes;
use counts::{ROW, SIDE, Tally};
use definition::{Centres, View};
use lines::Lines;
use misses::Spans;
use tile::{Sight, Tile};

/// Voxels along the edge of a block, as the surface reads it.
pub(crate) const BLOCK: usize = 8;

// A surface's block is a part of a carver's block: as many rows, and whole bytes of their words.
const _: () = assert!(BLOCK == SIDE && ROW.is_multiple_of(BLOCK));

/// One bit per voxel of a block: word `z`, bit `8 y + x`.
pub(crate) type Bits = [u64; BLOCK];

/// Why a view or a plan cannot be carved. The model is unchanged.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CarveError {
    /// The tolerated share of missing views is out of its range.
    #[error("epsilon is {found}; the tolerated share of missing views runs from 0 to below 1")]
    Epsilon {
        /// The share.
        found: f64,
    },
    /// No views are planned.
    #[error("0 views are planned; a hull needs at least 1")]
    NoViews,
    /// More views were observed than planned.
    #[error("view {found} of {planned} planned: the tolerance was set for {planned}. Plan more views and carve again")]
    TooManyViews {
        /// Views planned.
        planned: usize,
        /// Number of the refused view, from 1.
        found: usize,
    },
    /// The mask has no pixel, or too many on a side.
    #[error("the mask is {width} x {height} px; it needs at least one pixel and at most {limit} on a side")]
    MaskSize {
        /// Width of the mask, px.
        width: usize,
        /// Height of the mask, px.
        height: usize,
        /// Most pixels on a side.
        limit: usize,
    },
    /// The new plan has fewer views than were observed.
    #[error("{observed} views were observed, so {planned} cannot be planned: plan at least as many")]
    PlanTooSmall {
        /// Views of the new plan.
        planned: usize,
        /// Views observed.
        observed: usize,
    },
}

/// The contents of a block of 8^3 voxels. Voxels outside the grid count as dead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlockKind {
    Dead,
    /// Each of its 512 voxels lives.
    Full,
    Mixed,
}

/// A view as it was observed.
#[derive(Debug, Clone)]
pub(crate) struct Observed {
    pub runs: Runs,
    pub projection: Projection,
    pub leaves: Leaves,
}

/// A visual hull that is carved view by view.
#[derive(Debug, Clone)]
pub struct Carver {
    hull: Hull,
    planned: usize,
    epsilon: f64,
    views: Vec<Observed>,
}

/// The miss counts of a grid, and the memory that counting needs.
#[derive(Debug, Clone)]
struct Hull {
    grid: VoxelGrid,
    centres: Centres,
    tally: Tally,
    tile_counts: [usize; 2],
    tiles: Vec<Tile>,
    live: u64,
    /// Reused from view to view: one per piece of the tiles.
    spans: Vec<Spans>,
    lines: lines::Buffers,
    sums: Vec<u32>,
}

/// The tiles are spread over the threads in this many pieces, so that no thread waits long for the last one.
const PIECES: usize = 64;

/// Most words that a hull reserves before its first view: 16 MB, of which the paper's grids take 3 to 8.
const ROOM_WORDS: usize = 1 << 21;

fn tally(planned_views: usize, epsilon: f64) -> Result<Tally, CarveError> {
    if !(0.0..1.0).contains(&epsilon) {
        return Err(CarveError::Epsilon { found: epsilon });
    }
    if planned_views == 0 {
        return Err(CarveError::NoViews);
    }
    // The miss after the last tolerated one must still be a number.
    Ok(Tally::new(((epsilon * planned_views as f64 + 1e-9).floor() as u32).min(u32::MAX - 1)))
}

impl Hull {
    fn new(grid: VoxelGrid, tally: Tally) -> Self {
        let counts = grid.counts();
        let tile_counts = [1, 2].map(|a| counts[a].div_ceil(SIDE));
        let places = (0..tile_counts[1]).flat_map(|z| (0..tile_counts[0]).map(move |y| [y * SIDE, z * SIDE]));
        // About half of the blocks are cut by the first views.
        let room = (counts[0].div_ceil(ROW) / 2).min(ROOM_WORDS / (tile_counts[0] * tile_counts[1] * tally.words())) * tally.words();
        let tiles: Vec<Tile> = places.map(|lo| Tile::new(lo, counts, room)).collect();
        let spans = vec![Spans::new(counts[0].div_ceil(ROW)); PIECES.min(tiles.len())];
        let live = grid.len() as u64;
        Self {
            grid,
            centres: definition::centres(&grid),
            tally,
            tile_counts,
            tiles,
            live,
            spans,
            lines: lines::Buffers::default(),
            sums: Vec::new(),
        }
    }

    /// As new; the memory is kept.
    fn reset(&mut self, tally: Tally) {
        self.tally = tally;
        self.tiles.iter_mut().for_each(Tile::reset);
        self.live = self.grid.len() as u64;
    }

    fn observe(&mut self, runs: &Runs, leaves: Leaves, projection: &Projection) {
        let lookup = projection.lookup();
        let view = View::new(runs, leaves, &lookup, &self.centres);
        let sight = match Lines::new(view, self.grid.size(), self.grid.counts(), &mut self.lines) {
            Some(lines) => Sight::Lines(lines),
            None => Sight::Boxes(Boxes::new(view, &mut self.sums)),
        };
        let tally = self.tally;
        let piece = self.tiles.len().div_ceil(PIECES);
        self.live = self
            .tiles
            .par_chunks_mut(piece)
            .zip(&mut self.spans)
            .map(|(tiles, spans)| {
                tiles
                    .iter_mut()
                    .map(|tile| {
                        tile.observe(&sight, tally, spans);
                        tile.live()
                    })
                    .sum::<u64>()
            })
            .sum();
    }
}

impl Carver {
    /// Largest side of a mask, px. Columns of larger masks do not fit the runs.
    pub const MAX_MASK_SIDE: usize = 65_535;

    /// A hull of which nothing is carved yet. `epsilon` is the share of the planned views that may miss a voxel.
    ///
    /// # Errors
    /// A tolerance outside `0..1` and a plan without views.
    pub fn new(grid: VoxelGrid, planned_views: usize, epsilon: f64) -> Result<Self, CarveError> {
        let hull = Hull::new(grid, tally(planned_views, epsilon)?);
        Ok(Self { hull, planned: planned_views, epsilon, views: Vec::new() })
    }

    /// Counts the misses of one view. `leaves` says on which sides the specimen extends beyond the image.
    ///
    /// # Errors
    /// More views than were planned, and a mask too large for its runs. The hull is then unchanged.
    pub fn observe(&mut self, mask: &Mask, projection: &Projection, leaves: Leaves) -> Result<(), CarveError> {
        let observed = self.views.len();
        if observed == self.planned {
            return Err(CarveError::TooManyViews { planned: self.planned, found: observed + 1 });
        }
        let runs = Runs::new(mask)?;
        self.hull.observe(&runs, leaves, projection);
        self.views.push(Observed { runs, projection: *projection, leaves });
        Ok(())
    }

    /// Carves the views again with the tolerance of another number of planned views.
    ///
    /// # Errors
    /// A plan without views, and one of fewer views than were observed.
    pub fn replan(&mut self, planned_views: usize) -> Result<(), CarveError> {
        let observed = self.views.len();
        if planned_views < observed {
            return Err(CarveError::PlanTooSmall { planned: planned_views, observed });
        }
        let tally = tally(planned_views, self.epsilon)?;
        self.planned = planned_views;
        self.carve_again(tally);
        Ok(())
    }

    /// Some of the views, by number, carved again through other projections and with the same plan.
    #[must_use]
    pub(crate) fn through(&self, views: &[(usize, Projection)]) -> Self {
        let mut hull = Hull::new(*self.grid(), self.hull.tally);
        let of = |&(view, projection): &(usize, Projection)| Observed { projection, ..self.views[view].clone() };
        let views: Vec<Observed> = views.iter().map(of).collect();
        for Observed { runs, projection, leaves } in &views {
            hull.observe(runs, *leaves, projection);
        }
        Self { hull, views, ..*self }
    }

    fn carve_again(&mut self, tally: Tally) {
        self.hull.reset(tally);
        for Observed { runs, projection, leaves } in &self.views {
            self.hull.observe(runs, *leaves, projection);
        }
    }

    /// The grid that is carved.
    pub fn grid(&self) -> &VoxelGrid {
        &self.hull.grid
    }

    /// Views that the tolerance is set for.
    pub fn planned_views(&self) -> usize {
        self.planned
    }

    /// Views observed so far.
    pub fn observed_views(&self) -> usize {
        self.views.len()
    }

    /// The views observed, in the order in which they came.
    pub(crate) fn views(&self) -> &[Observed] {
        &self.views
    }

    /// Misses that a voxel survives.
    pub fn budget(&self) -> u32 {
        self.hull.tally.budget()
    }

    /// Voxels that live.
    pub fn live_voxels(&self) -> u64 {
        self.hull.live
    }

    /// Volume of the live hull, in the cube of the grid's unit.
    pub fn volume_um3(&self) -> f64 {
        self.hull.live as f64 * self.grid().voxel_volume()
    }

    /// Bytes on the heap: counts, views and buffers.
    pub fn bytes(&self) -> usize {
        let hull = &self.hull;
        let tiles: usize = hull.tiles.iter().map(|tile| size_of::<Tile>() + tile.bytes()).sum();
        let views: usize = self.views.iter().map(|view| size_of::<Observed>() + view.runs.bytes()).sum();
        tiles + views + hull.spans.iter().map(Spans::bytes).sum::<usize>() + hull.lines.bytes() + hull.sums.capacity() * size_of::<u32>()
    }

    /// Blocks of 8^3 voxels along each axis; the last ones may reach over the grid's end.
    pub(crate) fn block_counts(&self) -> [usize; 3] {
        self.grid().counts().map(|n| n.div_ceil(BLOCK))
    }

    /// The live voxels of a block as bits. None where the block lies outside the grid.
    pub(crate) fn block(&self, block: [i32; 3]) -> Bits {
        let Some([x, y, z]) = self.held(block) else { return [0; BLOCK] };
        let words = self.tile(y, z).words(x / (ROW / BLOCK), self.hull.tally);
        let shift = x % (ROW / BLOCK) * BLOCK;
        std::array::from_fn(|k| (0..BLOCK).fold(0, |bits, j| bits | (words[k * SIDE + j] >> shift & 0xff) << (BLOCK * j)))
    }

    /// What a block holds.
    pub(crate) fn block_kind(&self, block: [i32; 3]) -> BlockKind {
        let Some([x, y, z]) = self.held(block) else { return BlockKind::Dead };
        match self.tile(y, z).uniform(x / (ROW / BLOCK), self.hull.tally) {
            Some(false) => BlockKind::Dead,
            _ => match self.block(block) {
                bits if bits == [0; BLOCK] => BlockKind::Dead,
                bits if bits == [u64::MAX; BLOCK] => BlockKind::Full,
                _ => BlockKind::Mixed,
            },
        }
    }

    /// Place of a block, if it has voxels of the grid.
    fn held(&self, block: [i32; 3]) -> Option<[usize; 3]> {
        let counts = self.block_counts();
        let mut at = [0; 3];
        for axis in 0..3 {
            at[axis] = usize::try_from(block[axis]).ok().filter(|&n| n < counts[axis])?;
        }
        Some(at)
    }

    fn tile(&self, y: usize, z: usize) -> &Tile {
        &self.hull.tiles[z * self.hull.tile_counts[0] + y]
    }
}
