//! A field on a lattice, handed out block by block.

use crate::carver::BLOCK;

/// Samples along the edge of a block of 8^3 cells: its corners, shared with the next block included.
pub const SIDE: usize = BLOCK + 1;

/// Which samples of a block are inside: bit x of row `SIDE z + y`.
pub type Inside = [u16; SIDE * SIDE];

/// What [`extract`](super::extract) finds the surface of. The lattice has no end: outside its own extent nothing of a field
/// is inside, so that its surface is closed.
pub trait Field: Sync {
    /// World coordinates of sample (0, 0, 0).
    fn origin(&self) -> [f64; 3];
    fn spacing(&self) -> f64;
    /// Every block `b` with surface in one of its cells, which lie between samples `8 b` and `8 b + 8`; others may be
    /// among them.
    fn blocks(&self) -> Vec<[i32; 3]>;
    /// Which samples `8 b` to `8 b + 8` of a block are inside.
    fn inside(&self, block: [i32; 3]) -> Inside;
    /// Where the surface crosses the edge from sample `at` to the next along `axis`, one of which is inside: the share of the
    /// edge before it.
    fn crossing(&self, at: [i32; 3], axis: usize) -> f64;
}
