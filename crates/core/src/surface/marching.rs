//! Welded marching cubes over the blocks that can hold surface.
//!
//! ```text
//!  blocks ─ inside bits ─> crossed edges, cut cells      counted, block by block
//!                             │ sums of the counts: where each block's vertices and triangles go
//!                             └──────────────────────> vertices, triangles    written there, block by block
//! ```
//! Every crossed edge of the lattice belongs to the block of its lower end, which numbers it by its rank among the block's
//! crossed edges. A cell finds the vertices of its twelve edges by a bit count in one of eight blocks. No hash of vertices and
//! no merging is needed, and the mesh is the same on any number of threads. Blocks are ordered slice by slice along x, so that
//! neighbouring vertices are also near each other in memory.

use super::cube::{EDGES, TRIANGLES};
use super::{Field, Inside, Mesh, SIDE};
use crate::carver::BLOCK;
use crate::parallel::prelude::*;

/// The crossed edges of a block, and which of its samples are inside.
struct Crossings {
    block: [i32; 3],
    /// Bit `8 y + x` of word `8 axis + z`.
    edges: [u64; 3 * BLOCK],
    /// Number of edges in the words before.
    ranks: [u16; 3 * BLOCK],
    inside: Inside,
    triangles: usize,
    first_vertex: u32,
}

/// Extracts the surface of a field as a closed mesh.
pub fn extract(field: &impl Field) -> Mesh {
    let mut blocks = field.blocks();
    blocks.sort_unstable_by_key(|&block| key(block));
    blocks.dedup();
    let mut active: Vec<Crossings> = blocks.par_iter().filter_map(|&block| crossings(field, block)).collect();
    let (mut vertices, mut triangles) = (0, 0);
    for block in &mut active {
        block.first_vertex = vertices as u32;
        vertices += block.vertices();
        triangles += block.triangles;
    }
    let mut mesh = Mesh { vertices: vec![[0.0; 3]; vertices], triangles: vec![[0; 3]; triangles] };
    let places = pieces(&mut mesh.vertices, active.iter().map(Crossings::vertices));
    active.par_iter().zip(places).for_each(|(block, out)| block.place(field, out));
    let places = pieces(&mut mesh.triangles, active.iter().map(|block| block.triangles));
    active.par_iter().zip(places).for_each(|(block, out)| block.join(&active, out));
    mesh
}

/// Sorts blocks slice by slice along x, the long axis of a specimen.
fn key([x, y, z]: [i32; 3]) -> [i32; 3] {
    [x, z, y]
}

/// Cuts a list into consecutive pieces of these lengths.
fn pieces<T>(mut rest: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    lengths.map_while(|n| rest.split_off_mut(..n)).collect()
}

fn crossings(field: &impl Field, block: [i32; 3]) -> Option<Crossings> {
    let inside = field.inside(block);
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
    let mut rank = 0;
    let ranks = edges.map(|word| {
        rank += word.count_ones() as u16;
        rank - word.count_ones() as u16
    });
    let mut found = Crossings { block, edges, ranks, inside, triangles: 0, first_vertex: 0 };
    let mut triangles = 0;
    found.cut_cells(|_, pattern| triangles += TRIANGLES[pattern].len());
    found.triangles = triangles;
    Some(found)
}

impl Crossings {
    fn vertices(&self) -> usize {
        const LAST: usize = 3 * BLOCK - 1;
        usize::from(self.ranks[LAST]) + self.edges[LAST].count_ones() as usize
    }

    fn vertex(&self, axis: usize, [x, y, z]: [usize; 3]) -> u32 {
        let (word, bit) = (axis * BLOCK + z, BLOCK * y + x);
        self.first_vertex + u32::from(self.ranks[word]) + (self.edges[word] & ((1 << bit) - 1)).count_ones()
    }

    /// Calls `each` with every cell that has corners on both sides, and with the pattern of its inside corners.
    fn cut_cells(&self, mut each: impl FnMut([usize; 3], usize)) {
        for z in 0..BLOCK {
            for y in 0..BLOCK {
                let rows = [z * SIDE + y, z * SIDE + y + 1, (z + 1) * SIDE + y, (z + 1) * SIDE + y + 1].map(|r| self.inside[r]);
                let some = rows.iter().fold(0, |bits, row| bits | row | row >> 1);
                let all = rows.iter().fold(u16::MAX, |bits, row| bits & row & row >> 1);
                let mut cut = some & !all & 0xff;
                while cut != 0 {
                    let x = cut.trailing_zeros() as usize;
                    cut &= cut - 1;
                    let pattern = rows.iter().rev().fold(0, |bits, row| bits << 2 | (row >> x & 3));
                    each([x, y, z], usize::from(pattern));
                }
            }
        }
    }

    /// Writes the block's vertices.
    fn place(&self, field: &impl Field, out: &mut [[f64; 3]]) {
        let (origin, spacing) = (field.origin(), field.spacing());
        let mut out = out.iter_mut();
        for (word, &bits) in self.edges.iter().enumerate() {
            let (axis, z) = (word / BLOCK, word % BLOCK);
            let mut left = bits;
            while left != 0 {
                let bit = left.trailing_zeros() as usize;
                left &= left - 1;
                let within = [bit % BLOCK, bit / BLOCK, z];
                let at: [i32; 3] = std::array::from_fn(|a| self.block[a] * BLOCK as i32 + within[a] as i32);
                let mut place = at.map(f64::from);
                place[axis] += field.crossing(at, axis);
                if let Some(vertex) = out.next() {
                    *vertex = std::array::from_fn(|a| origin[a] + place[a] * spacing);
                }
            }
        }
    }

    /// Writes the block's triangles.
    fn join(&self, active: &[Self], out: &mut [[u32; 3]]) {
        // The block itself and its seven neighbours towards larger coordinates, which may own the edges of its last cells.
        let around: [Option<&Self>; 8] = std::array::from_fn(|n| {
            let wanted: [i32; 3] = std::array::from_fn(|a| self.block[a] + (n >> a & 1) as i32);
            active.binary_search_by_key(&key(wanted), |b| key(b.block)).ok().map(|at| &active[at])
        });
        let mut out = out.iter_mut();
        self.cut_cells(|cell, pattern| {
            let corner = |edge: u8| {
                let (start, axis) = EDGES[edge as usize];
                let at: [usize; 3] = std::array::from_fn(|a| cell[a] + (start >> a & 1));
                let owner = (0..3).fold(0, |n, a| n | (at[a] / BLOCK) << a);
                // A field that lists its blocks correctly has them all.
                around[owner].map_or(0, |b| b.vertex(axis, at.map(|c| c % BLOCK)))
            };
            for (triangle, to) in TRIANGLES[pattern].iter().zip(out.by_ref()) {
                *to = triangle.map(corner);
            }
        });
    }
}
