//! The fields of a carver: occupancy voxel by voxel, and the share of live voxels on a coarser lattice.

use super::{Field, Inside, SIDE};
use crate::carver::{BLOCK, Bits, BlockKind, Carver};
use crate::parallel::prelude::*;

/// 1 in live voxels, 0 elsewhere: the paper's binary volume.
pub struct Occupancy<'a>(pub &'a Carver);

impl Field for Occupancy<'_> {
    fn origin(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.0.grid().centre(a, 0))
    }

    fn spacing(&self) -> f64 {
        self.0.grid().size()
    }

    fn blocks(&self) -> Vec<[i32; 3]> {
        Kinds::new(self.0).surface_blocks(|_| false)
    }

    fn inside(&self, [x, y, z]: [i32; 3]) -> Inside {
        inside_rows(|[i, j, k]| self.0.block([x + i, y + j, z + k]))
    }

    /// Half way: it is only known that one of the two samples is inside.
    fn crossing(&self, _at: [i32; 3], _axis: usize) -> f64 {
        0.5
    }
}

/// The kind of each block of a carver, with one layer of dead blocks around the grid.
pub(super) struct Kinds {
    counts: [i32; 3],
    stride: [usize; 3],
    of_blocks: Vec<BlockKind>,
}

impl Kinds {
    pub fn new(carver: &Carver) -> Self {
        let counts = carver.block_counts().map(|n| n as i32);
        let stride = counts.map(|n| n as usize + 2);
        let mut found = Self { counts, stride, of_blocks: vec![BlockKind::Dead; stride.iter().product()] };
        let layer = stride[0] * stride[1];
        found.of_blocks.par_chunks_mut(layer).skip(1).take(counts[2] as usize).enumerate().for_each(|(z, kinds)| {
            for [x, y, _] in each([0; 3], [counts[0], counts[1], 1]) {
                kinds[(y + 1) as usize * stride[0] + (x + 1) as usize] = carver.block_kind([x, y, z as i32]);
            }
        });
        found
    }

    /// Upper bound of the numbers in use.
    pub fn len(&self) -> usize {
        self.of_blocks.len()
    }

    /// Number of a block that lies at most one layer outside of the grid.
    pub fn number(&self, [x, y, z]: [i32; 3]) -> usize {
        ((z + 1) as usize * self.stride[1] + (y + 1) as usize) * self.stride[0] + (x + 1) as usize
    }

    pub fn of(&self, block: [i32; 3]) -> BlockKind {
        self.of_blocks[self.number(block)]
    }

    pub fn holds(&self, block: [i32; 3]) -> bool {
        (0..3).all(|a| (0..self.counts[a]).contains(&block[a]))
    }

    /// Every block of the grid.
    pub fn held(&self) -> impl Iterator<Item = [i32; 3]> {
        each([0; 3], self.counts)
    }

    /// The blocks with surface. A block and its seven neighbours towards larger coordinates contain the samples of its cells:
    /// there is no surface where all eight are full, all are dead, and none counts as `mixed`.
    pub fn surface_blocks(&self, mixed: impl Fn([i32; 3]) -> bool + Sync) -> Vec<[i32; 3]> {
        let is_cut = |[x, y, z]: [i32; 3]| {
            let first = self.of([x, y, z]);
            let mut eight = each([0; 3], [2; 3]).map(|[i, j, k]| [x + i, y + j, z + k]);
            first == BlockKind::Mixed || eight.any(|block| self.of(block) != first || mixed(block))
        };
        let [x, y, z] = self.counts;
        let layer = |k: i32| each([-1, -1, k], [x, y, k + 1]).filter(|&block| is_cut(block)).collect::<Vec<_>>();
        (-1..z).into_par_iter().flat_map_iter(layer).collect()
    }
}

/// The samples of a block and of the first layers of its neighbours towards larger coordinates, from the blocks' bits.
pub(super) fn inside_rows(block: impl Fn([i32; 3]) -> Bits) -> Inside {
    let bits: [Bits; 8] = std::array::from_fn(|n| block([n & 1, n >> 1 & 1, n >> 2].map(|c| c as i32)));
    let mut out = [0; SIDE * SIDE];
    for k in 0..SIDE {
        for j in 0..SIDE {
            let half = (k / BLOCK) << 2 | (j / BLOCK) << 1;
            let row = |n: usize| bits[half | n][k % BLOCK] >> (BLOCK * (j % BLOCK));
            out[k * SIDE + j] = (row(0) & 0xff | (row(1) & 1) << BLOCK) as u16;
        }
    }
    out
}

fn each(lo: [i32; 3], hi: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (lo[2]..hi[2]).flat_map(move |z| (lo[1]..hi[1]).flat_map(move |y| (lo[0]..hi[0]).map(move |x| [x, y, z])))
}

/// Share of live voxels in cubes of 4^3: small enough to be sent after each view, smooth enough to be displayed.
pub struct Coarse {
    origin: [f64; 3],
    spacing: f64,
    counts: [usize; 3],
    shares: Vec<f32>,
}

impl Coarse {
    /// Voxels along the edge of a cube.
    pub const CUBE: usize = BLOCK / 2;
    /// The share at the surface.
    const LEVEL: f32 = 0.5;

    /// The shares of a carver's voxels.
    pub fn new(carver: &Carver) -> Self {
        let grid = carver.grid();
        let counts = carver.block_counts().map(|n| 2 * n);
        let middle = (Self::CUBE - 1) as f64 / 2.0 * grid.size();
        let mut shares = vec![0.0; counts.iter().product()];
        let blocks = carver.block_counts().map(|n| n as i32);
        for block in each([0; 3], blocks) {
            if carver.block_kind(block) == BlockKind::Dead {
                continue;
            }
            let bits = carver.block(block);
            for (n, half) in each([0; 3], [2; 3]).enumerate() {
                // Four bits of four rows, in four layers.
                let square = 0x0f0f_0f0f << (4 * (n & 1) + 32 * (n >> 1 & 1));
                let live: u32 = bits[4 * (n >> 2)..][..4].iter().map(|layer| (layer & square).count_ones()).sum();
                let at: [usize; 3] = std::array::from_fn(|a| (2 * block[a] + half[a]) as usize);
                shares[(at[2] * counts[1] + at[1]) * counts[0] + at[0]] = live as f32 / 64.0;
            }
        }
        Self { origin: std::array::from_fn(|a| grid.centre(a, 0) + middle), spacing: grid.size() * Self::CUBE as f64, counts, shares }
    }

    /// Share of live voxels in a cube. 0 outside of the grid.
    fn share(&self, at: [i32; 3]) -> f32 {
        // Negative coordinates wrap to huge ones.
        let at = at.map(|c| c as usize);
        let held = (0..3).all(|a| at[a] < self.counts[a]);
        if held { self.shares[(at[2] * self.counts[1] + at[1]) * self.counts[0] + at[0]] } else { 0.0 }
    }
}

impl Field for Coarse {
    fn origin(&self) -> [f64; 3] {
        self.origin
    }

    fn spacing(&self) -> f64 {
        self.spacing
    }

    fn blocks(&self) -> Vec<[i32; 3]> {
        each([-1; 3], self.counts.map(|n| n.div_ceil(BLOCK) as i32)).collect()
    }

    fn inside(&self, block: [i32; 3]) -> Inside {
        let mut out = [0; SIDE * SIDE];
        for (n, row) in out.iter_mut().enumerate() {
            for x in 0..SIDE {
                let within = [x, n % SIDE, n / SIDE];
                let at = std::array::from_fn(|a| block[a] * BLOCK as i32 + within[a] as i32);
                *row |= u16::from(self.share(at) > Self::LEVEL) << x;
            }
        }
        out
    }

    fn crossing(&self, at: [i32; 3], axis: usize) -> f64 {
        let mut next = at;
        next[axis] += 1;
        let (a, b) = (self.share(at), self.share(next));
        f64::from(Self::LEVEL - a) / f64::from(b - a)
    }
}
