//! The live voxels as a dense array, for programs that show volumes.

use super::{BLOCK, BlockKind, Carver};

/// The live voxels of a carver in the smallest box around them, with a border of one dead voxel on every side, so that a surface that is
/// drawn through the array is closed.
#[derive(Debug, Clone, PartialEq)]
pub struct Voxels {
    /// Centre of the array's first voxel, in the coordinates and the unit of the grid (um on an instrument).
    pub origin: [f64; 3],
    /// Edge of a voxel, in that unit.
    pub size: f64,
    /// Voxels along x, y, z.
    pub counts: [usize; 3],
    /// 1 for a live voxel, 0 for a dead one. x runs fastest, then y, then z.
    pub inside: Vec<u8>,
}

impl Carver {
    /// The live voxels. `None` where no voxel lives.
    pub fn voxels(&self) -> Option<Voxels> {
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        self.each_live(|at| {
            for axis in 0..3 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        });
        if low[0] > high[0] {
            return None;
        }
        // Two more than the live ones: the border.
        let counts: [usize; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 3);
        let grid = self.grid();
        let origin = std::array::from_fn(|axis| grid.centre(axis, low[axis]) - grid.size());
        let mut inside = vec![0; counts.iter().product()];
        self.each_live(|at| {
            let [x, y, z] = std::array::from_fn(|axis| at[axis] - low[axis] + 1);
            inside[x + counts[0] * (y + counts[1] * z)] = 1;
        });
        Some(Voxels { origin, size: grid.size(), counts, inside })
    }

    /// Calls `found` with the index of every live voxel along x, y, z.
    fn each_live(&self, mut found: impl FnMut([usize; 3])) {
        let [nx, ny, nz] = self.block_counts();
        for (bz, by, bx) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
            let block = [bx, by, bz].map(|n| n as i32);
            if self.block_kind(block) == BlockKind::Dead {
                continue;
            }
            for (k, plane) in self.block(block).into_iter().enumerate() {
                let mut left = plane;
                while left != 0 {
                    let bit = left.trailing_zeros() as usize;
                    left &= left - 1;
                    found([bx * BLOCK + bit % BLOCK, by * BLOCK + bit / BLOCK, bz * BLOCK + k]);
                }
            }
        }
    }
}
