//! The voxel residual volume (VRV): the number of voxels that a set of views leaves. Calibration maximises it over the cameras.

use super::{CarveError, Hull, Leaves, Runs, tally};
use crate::geometry::{Projection, VoxelGrid};

/// Counts what sets of views leave of one grid. After the first count it allocates no more memory.
#[derive(Debug, Clone)]
pub struct ResidualVolume {
    hull: Hull,
    epsilon: f64,
}

impl ResidualVolume {
    /// An empty count over a grid. `epsilon` is the share of the views that may miss a voxel.
    ///
    /// # Errors
    /// A tolerance outside `0..1`.
    pub fn new(grid: VoxelGrid, epsilon: f64) -> Result<Self, CarveError> {
        Ok(Self { hull: Hull::new(grid, tally(1, epsilon)?), epsilon })
    }

    /// Number of voxels that live when these views are all views.
    ///
    /// # Errors
    /// A set without views.
    pub fn count<'a>(&mut self, views: impl ExactSizeIterator<Item = (&'a Runs, Projection)>) -> Result<u64, CarveError> {
        self.hull.reset(tally(views.len(), self.epsilon)?);
        for (runs, projection) in views {
            self.hull.observe(runs, Leaves::default(), &projection);
        }
        Ok(self.hull.live)
    }
}
