//! The fields that a carver carries: occupancy voxel by voxel, and the share of live voxels on a coarser lattice.

use super::{Field, Inside, SIDE};
use crate::carver::{BLOCK, Bits, BlockKind, Carver};

/// 1 in live voxels, 0 elsewhere: the paper's binary volume.
pub struct Occupancy<'a>(pub &'a Carver);

impl Field for Occupancy<'_> {
    fn origin(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.0.grid().centre(a, 0))
    }

    fn spacing(&self) -> f64 {
        self.0.grid().size()
    }

    /// A block and its seven neighbours towards larger coordinates hold the samples of its cells: there is no surface
    /// where all eight are full, or all dead.
    fn blocks(&self) -> Vec<[i32; 3]> {
        let counts = self.0.block_counts().map(|n| n as i32);
        let stride = counts.map(|n| n as usize + 2);
        // One layer more on each side than there are blocks.
        let mut kinds = vec![BlockKind::Dead; stride.iter().product()];
        let at = |[x, y, z]: [i32; 3]| ((z + 1) as usize * stride[1] + (y + 1) as usize) * stride[0] + (x + 1) as usize;
        for block in each([0; 3], counts) {
            kinds[at(block)] = self.0.block_kind(block);
        }
        each([-1; 3], counts)
            .filter(|&[x, y, z]| {
                let first = kinds[at([x, y, z])];
                first == BlockKind::Mixed || (1..8).any(|n| kinds[at([x + (n & 1), y + (n >> 1 & 1), z + (n >> 2)])] != first)
            })
            .collect()
    }

    fn inside(&self, [x, y, z]: [i32; 3]) -> Inside {
        let bits: [Bits; 8] = std::array::from_fn(|n| {
            let n = n as i32;
            self.0.block([x + (n & 1), y + (n >> 1 & 1), z + (n >> 2)])
        });
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

    /// Half way: nothing is known but that one of the two lives.
    fn crossing(&self, _at: [i32; 3], _axis: usize) -> f64 {
        0.5
    }
}

fn each(lo: [i32; 3], hi: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (lo[2]..hi[2]).flat_map(move |z| (lo[1]..hi[1]).flat_map(move |y| (lo[0]..hi[0]).map(move |x| [x, y, z])))
}

/// Share of live voxels in cubes of 4^3: small enough to be sent after each view, smooth enough to be looked at.
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

    /// Share of live voxels in a cube; none outside the grid.
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
