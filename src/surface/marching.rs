//! Welded marching cubes over the blocks that can hold surface.
//!
//! Every crossed edge of the lattice belongs to the block of its lower end, which numbers it by its rank among the
//! block's crossed edges. A cell finds the vertices of its twelve edges by a bit count in one of eight blocks: no hash
//! of vertices, no merging afterwards, and the same mesh on any number of threads.

use super::cube::{EDGES, TRIANGLES};
use super::{Field, Mesh, SIDE, Samples};
use crate::carver::BLOCK;
use rayon::prelude::*;

/// A block's crossed edges and which of its samples are inside.
struct Crossings {
    block: [i32; 3],
    /// Bit `8 y + x` of word `8 axis + z`.
    edges: [u64; 3 * BLOCK],
    /// Edges in the words before.
    ranks: [u32; 3 * BLOCK],
    /// Bit x of row `SIDE z + y`.
    inside: [u16; SIDE * SIDE],
    vertices: Vec<[f64; 3]>,
    first: u32,
}

/// The surface of a field at its level.
pub fn extract(field: &impl Field) -> Mesh {
    let mut blocks = field.blocks();
    blocks.sort_unstable_by_key(|&[x, y, z]| [z, y, x]);
    blocks.dedup();
    let mut active: Vec<Crossings> =
        blocks.par_iter().map_init(|| [0.0; SIDE * SIDE * SIDE], |samples, &block| crossings(field, block, samples)).flatten().collect();
    let mut first = 0;
    for block in &mut active {
        block.first = first;
        first += block.vertices.len() as u32;
    }
    let triangles = active.par_iter().map(|block| triangles(&active, block)).collect::<Vec<_>>().concat();
    Mesh { vertices: active.into_iter().flat_map(|b| b.vertices).collect(), triangles }
}

fn crossings(field: &impl Field, block: [i32; 3], samples: &mut Samples) -> Option<Crossings> {
    field.samples(block, samples);
    let level = field.level();
    let mut inside = [0u16; SIDE * SIDE];
    for (row, values) in inside.iter_mut().zip(samples.chunks_exact(SIDE)) {
        *row = values.iter().enumerate().fold(0, |bits, (x, &v)| bits | u16::from(v > level) << x);
    }
    if inside.iter().all(|&row| row == inside[0]) && (inside[0] == 0 || inside[0] == (1 << SIDE) - 1) {
        return None;
    }
    let mut edges = [0u64; 3 * BLOCK];
    for z in 0..BLOCK {
        for y in 0..BLOCK {
            let row = inside[z * SIDE + y];
            let beyond = [row >> 1, inside[z * SIDE + y + 1], inside[(z + 1) * SIDE + y]];
            for axis in 0..3 {
                edges[axis * BLOCK + z] |= u64::from((row ^ beyond[axis]) & 0xff) << (BLOCK * y);
            }
        }
    }
    let mut ranks = [0; 3 * BLOCK];
    let mut vertices = Vec::new();
    let (origin, spacing) = (field.origin(), field.spacing());
    for (word, &bits) in edges.iter().enumerate() {
        ranks[word] = vertices.len() as u32;
        let (axis, z) = (word / BLOCK, word % BLOCK);
        let mut left = bits;
        while left != 0 {
            let bit = left.trailing_zeros() as usize;
            left &= left - 1;
            let at = [bit % BLOCK, bit / BLOCK, z];
            let index = (at[2] * SIDE + at[1]) * SIDE + at[0];
            let (a, b) = (samples[index], samples[index + [1, SIDE, SIDE * SIDE][axis]]);
            let mut vertex: [f64; 3] = std::array::from_fn(|c| f64::from(block[c] * BLOCK as i32) + at[c] as f64);
            vertex[axis] += f64::from(level - a) / f64::from(b - a);
            vertices.push(std::array::from_fn(|c| origin[c] + vertex[c] * spacing));
        }
    }
    Some(Crossings { block, edges, ranks, inside, vertices, first: 0 })
}

impl Crossings {
    fn vertex(&self, axis: usize, [x, y, z]: [usize; 3]) -> u32 {
        let (word, bit) = (axis * BLOCK + z, BLOCK * y + x);
        self.first + self.ranks[word] + (self.edges[word] & ((1 << bit) - 1)).count_ones()
    }
}

fn triangles(active: &[Crossings], block: &Crossings) -> Vec<[u32; 3]> {
    // The block itself and its seven neighbours towards larger coordinates, where its last cells' edges may live.
    let around: [Option<&Crossings>; 8] = std::array::from_fn(|n| {
        let wanted: [i32; 3] = std::array::from_fn(|a| block.block[a] + (n >> a & 1) as i32);
        let key = |[x, y, z]: [i32; 3]| [z, y, x];
        active.binary_search_by_key(&key(wanted), |b| key(b.block)).ok().map(|at| &active[at])
    });
    let mut out = Vec::new();
    for z in 0..BLOCK {
        for y in 0..BLOCK {
            let rows = [z * SIDE + y, z * SIDE + y + 1, (z + 1) * SIDE + y, (z + 1) * SIDE + y + 1].map(|r| block.inside[r]);
            if rows.iter().all(|&r| r == rows[0]) && (rows[0] == 0 || rows[0] == (1 << SIDE) - 1) {
                continue;
            }
            for x in 0..BLOCK {
                let pattern = rows.iter().enumerate().fold(0, |bits, (n, row)| bits | (row >> x & 3) << (2 * n));
                for triangle in &TRIANGLES[usize::from(pattern)] {
                    let corners = triangle.map(|edge| {
                        let (start, axis) = EDGES[edge as usize];
                        let at: [usize; 3] = std::array::from_fn(|a| [x, y, z][a] + (start >> a & 1));
                        let owner = (0..3).fold(0, |n, a| n | (at[a] / BLOCK) << a);
                        around[owner].map(|b| b.vertex(axis, at.map(|c| c % BLOCK)))
                    });
                    // A field keeps its promise of blocks when all three are there.
                    if let [Some(a), Some(b), Some(c)] = corners {
                        out.push([a, b, c]);
                    }
                }
            }
        }
    }
    out
}
