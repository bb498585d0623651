//! The voxel residual volume (VRV): how many voxels a set of views leaves. Calibration maximises it over the cameras.

use super::{CarveError, Hull, Leaves, Runs, tally};
use crate::geometry::{Projection, VoxelGrid};

/// Counts what views leave of one grid, again and again: once warm it asks for no more memory.
#[derive(Debug, Clone)]
pub struct ResidualVolume {
    hull: Hull,
    epsilon: f64,
}

impl ResidualVolume {
    /// # Errors
    /// Refuses a tolerance outside `0..1`.
    pub fn new(grid: VoxelGrid, epsilon: f64) -> Result<Self, CarveError> {
        Ok(Self { hull: Hull::new(grid, tally(1, epsilon)?), epsilon })
    }

    /// The voxels that live when these views are all there are.
    ///
    /// # Errors
    /// Refuses a set without views.
    pub fn count<'a>(&mut self, views: impl ExactSizeIterator<Item = (&'a Runs, Projection)>) -> Result<u64, CarveError> {
        self.hull.reset(tally(views.len(), self.epsilon)?);
        for (runs, projection) in views {
            self.hull.observe(runs, Leaves::default(), &projection);
        }
        Ok(self.hull.live)
    }
}
