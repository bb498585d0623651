//! The voxel grid: `n = round(L / S)` voxels per axis, centred in the box.

use crate::range::{Range, Ranged};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// An axis-parallel box in world units: um, unless the cameras of a set have another unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
pub struct BoxUm {
    /// Least coordinate along each axis.
    pub min: [f64; 3],
    /// Largest coordinate along each axis.
    pub max: [f64; 3],
}

/// A box of a metre holds every capillary, wherever its axis is put.
const FURTHEST_UM: f64 = 1e6;

impl Ranged for BoxUm {
    const RANGES: &'static [Range<Self>] = ranges![
        min: -FURTHEST_UM, FURTHEST_UM, "um";
        max: -FURTHEST_UM, FURTHEST_UM, "um";
    ];
}

impl BoxUm {
    /// The paper's 5000 x 1000 x 1000 um around the origin.
    pub const PAPER: Self = Self { min: [-2500.0, -500.0, -500.0], max: [2500.0, 500.0, 500.0] };
}

/// A grid of voxels of one size. The centres of its voxels are projected into the views.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VoxelGrid {
    /// Centre of voxel (0, 0, 0).
    origin: [f64; 3],
    size: f64,
    counts: [usize; 3],
}

/// Why a box and a voxel size are no grid.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum GridError {
    /// The voxel size is not a number above 0.
    #[error("voxel size is {found}; it must be a finite number above 0")]
    Size {
        /// The size.
        found: f64,
    },
    /// The box is empty along an axis, or not finite.
    #[error("box: on axis {axis} it runs from {min} to {max}; the second must be larger and both finite")]
    Box {
        /// `x`, `y` or `z`.
        axis: char,
        /// Its lower end.
        min: f64,
        /// Its upper end.
        max: f64,
    },
    /// The box holds no voxel, or too many.
    #[error("the box holds {found:.0} voxels of size {size}; from 1 to {limit:.0} fit: choose another voxel size or box")]
    Count {
        /// Number of voxels.
        found: f64,
        /// Voxel size.
        size: f64,
        /// Most voxels.
        limit: f64,
    },
}

impl VoxelGrid {
    /// Most voxels of a grid.
    pub const MAX_VOXELS: f64 = 4e9;

    /// The grid of voxels of edge `size` in a box; both in world units.
    ///
    /// # Errors
    /// Names what is wrong with the box or the voxel size.
    pub fn new(bounds: BoxUm, size: f64) -> Result<Self, GridError> {
        if !(size.is_finite() && size > 0.0) {
            return Err(GridError::Size { found: size });
        }
        let mut origin = [0.0; 3];
        let mut counts = [0.0; 3];
        for axis in 0..3 {
            let (min, max) = (bounds.min[axis], bounds.max[axis]);
            if !(min.is_finite() && max.is_finite() && min < max) {
                return Err(GridError::Box { axis: ['x', 'y', 'z'][axis], min, max });
            }
            counts[axis] = ((max - min) / size).round();
            origin[axis] = f64::midpoint(min, max) - (counts[axis] - 1.0) / 2.0 * size;
        }
        let found = counts[0] * counts[1] * counts[2];
        if !(1.0..=Self::MAX_VOXELS).contains(&found) {
            return Err(GridError::Count { found, size, limit: Self::MAX_VOXELS });
        }
        Ok(Self { origin, size, counts: counts.map(|n| n as usize) })
    }

    /// Voxels along each axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Edge of a voxel (SD, the sampling density), in world units.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether there is no voxel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Coordinate of the centre of voxel `index` along `axis` (0 to 2), in world units.
    pub fn centre(&self, axis: usize, index: usize) -> f64 {
        self.origin[axis] + index as f64 * self.size
    }

    /// Volume of one voxel, in the cube of the world unit.
    pub fn voxel_volume(&self) -> f64 {
        self.size.powi(3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_grids_have_the_papers_sizes() {
        let of = |sd: f64| VoxelGrid::new(BoxUm::PAPER, sd).unwrap();
        assert_eq!(of(5.5).counts(), [909, 182, 182]);
        assert_eq!(of(6.93).counts(), [722, 144, 144]);
        let g = of(6.93);
        let middle = f64::midpoint(g.centre(0, 0), g.centre(0, 721));
        assert!(middle.abs() < 1e-9, "centred on the box");
    }

    #[test]
    fn impossible_grids_are_refused_with_their_numbers() {
        assert_eq!(VoxelGrid::new(BoxUm::PAPER, 0.0), Err(GridError::Size { found: 0.0 }));
        assert!(matches!(VoxelGrid::new(BoxUm::PAPER, 9000.0), Err(GridError::Count { .. })));
        let flat = BoxUm { min: [0.0; 3], max: [1.0, 0.0, 1.0] };
        assert_eq!(VoxelGrid::new(flat, 0.1), Err(GridError::Box { axis: 'y', min: 0.0, max: 0.0 }));
    }
}
