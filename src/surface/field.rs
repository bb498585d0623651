//! A scalar field on a lattice, handed out block by block.

use crate::carver::BLOCK;

/// Samples along the edge of a block of 8^3 cells: its corners, shared with the next block included.
pub const SIDE: usize = BLOCK + 1;

/// Sample `(x, y, z)` of a block is at `(z * SIDE + y) * SIDE + x`.
pub type Samples = [f32; SIDE * SIDE * SIDE];

/// Larger inside. The lattice has no end: outside its own extent a field must stay below the level, so that its surface
/// is closed.
pub trait Field: Sync {
    /// World coordinates of sample (0, 0, 0).
    fn origin(&self) -> [f64; 3];
    fn spacing(&self) -> f64;
    /// The value at the surface; a sample above it is inside.
    fn level(&self) -> f32;
    /// Every block `b` with surface in one of its cells, which lie between samples `8 b` and `8 b + 8`; others may be
    /// among them.
    fn blocks(&self) -> Vec<[i32; 3]>;
    /// Writes the samples of a block.
    fn samples(&self, block: [i32; 3], out: &mut Samples);
}
