//! A field on a lattice, provided block by block.

use crate::carver::BLOCK;

/// Samples along the edge of a block of 8^3 cells, including its corners, which the next block shares.
pub const SIDE: usize = BLOCK + 1;

/// Which samples of a block are inside: bit x of row `SIDE z + y`.
pub type Inside = [u16; SIDE * SIDE];

/// The field whose surface [`extract`](super::extract) finds. The lattice has no end: outside of the field's own extent no
/// sample is inside, so that its surface is closed.
pub trait Field: Sync {
    /// World coordinates of sample (0, 0, 0), um.
    fn origin(&self) -> [f64; 3];
    /// Distance between neighbouring samples, um.
    fn spacing(&self) -> f64;
    /// Every block `b` with surface in one of its cells, which lie between samples `8 b` and `8 b + 8`. Other blocks may be
    /// among them.
    fn blocks(&self) -> Vec<[i32; 3]>;
    /// Which of the samples `8 b` to `8 b + 8` of a block are inside.
    fn inside(&self, block: [i32; 3]) -> Inside;
    /// Where the surface crosses the edge from sample `at` to the next one along `axis`, exactly one of which is inside: the
    /// share of the edge before the crossing, 0 to 1.
    fn crossing(&self, at: [i32; 3], axis: usize) -> f64;
}
