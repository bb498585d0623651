//! The definition of a miss, voxel by voxel. Every quicker way must give the same to the last bit.

use super::Runs;
use crate::geometry::{Lookup, VoxelGrid};

/// The sides of the image beyond which the specimen goes on. A voxel beyond such a side is judged by the last column of the
/// image there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Leaves {
    /// The specimen extends beyond the left side.
    pub left: bool,
    /// The specimen extends beyond the right side.
    pub right: bool,
}

impl Leaves {
    pub(super) fn any(self) -> bool {
        self.left || self.right
    }
}

/// Generous relative bound for the rounding of one row of a projection: four products, three sums and a quotient, half an ulp
/// each.
pub(super) const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// The centres of the grid's voxels along each axis.
pub(super) type Centres = [Vec<f64>; 3];

pub(super) fn centres(grid: &VoxelGrid) -> Centres {
    std::array::from_fn(|a| (0..grid.counts()[a]).map(|i| grid.centre(a, i)).collect())
}

/// One view of one grid.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub runs: &'a Runs,
    pub leaves: Leaves,
    pub rows: &'a [[f64; 4]; 3],
    pub lookup: &'a Lookup,
    pub centres: &'a Centres,
}

impl<'a> View<'a> {
    pub fn new(runs: &'a Runs, leaves: Leaves, lookup: &'a Lookup, centres: &'a Centres) -> Self {
        Self { runs, leaves, rows: lookup.rows(), lookup, centres }
    }

    /// Largest magnitude of the terms of each row of the projection: the scale of its rounding errors.
    pub fn magnitude(&self) -> [f64; 3] {
        let far = self.centres.each_ref().map(|c| c[0].abs().max(c[c.len() - 1].abs()));
        self.rows.map(|r| r[0].abs() * far[0] + r[1].abs() * far[1] + r[2].abs() * far[2] + r[3].abs())
    }

    /// The part of each row of the projection that a row of voxels along x has in common. It rounds as [`Projection::project`]
    /// does. Through glass it is that of where the row is seen.
    pub fn rest(&self, j: usize, k: usize) -> [f64; 3] {
        let [y, z] = self.lookup.apparent([self.centres[1][j], self.centres[2][k]]);
        self.rows.map(|r| (r[1] * y + r[2] * z) + r[3])
    }

    /// `u + 0.5` and `v + 0.5` of voxel `i` of a row, and its depth.
    pub fn image(&self, i: usize, rest: &[f64; 3]) -> [f64; 3] {
        let x = self.centres[0][i];
        let [u, v, w]: [f64; 3] = std::array::from_fn(|c| self.rows[c][0] * x + rest[c]);
        [u / w + 0.5, v / w + 0.5, w]
    }

    /// Whether the view covers the centre of voxel `i` of a row.
    pub fn covers(&self, i: usize, rest: &[f64; 3]) -> bool {
        let [mut u, v, w] = self.image(i, rest);
        let (width, height) = (self.runs.width(), self.runs.height());
        // A specimen that leaves the image continues as in the last column.
        if self.leaves.left && u < 0.0 {
            u = 0.0;
        } else if self.leaves.right && u >= width as f64 {
            u = (width - 1) as f64;
        }
        // Within these limits truncation is floor.
        let seen = w > 0.0 && u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64;
        seen && self.runs.covers(u as usize, v as usize)
    }
}
