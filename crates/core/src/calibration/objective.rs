//! The objectives that a search over cameras maximises: the volume that the profiles leave, or how well they agree.
//!
//! ```text
//!   psi ─┬─ Vrv        voxels that no view misses                         (the paper's)
//!        └─ Coherence  share of the profiles that the hull fills again    (sub-pixel, nearly free)
//! ```
//! VRV is taken with epsilon 0. With a tolerance each voxel may leave out the views that it likes: with 0.05 the volume has two
//! maxima, half a pixel to either side of the true axis, and both exceed the value at the truth.

use super::coherence::coherence;
use super::free::{Free, Parameter};
use super::psi::Psi;
use super::search::{Minimum, Stop};
use super::simplex;
use crate::carver::{CarveError, ResidualVolume, Runs};
use crate::geometry::VoxelGrid;
use crate::profile::Columns;

/// The paper's objective: the number of voxels that the views leave. Beyond the image's sides nothing lives.
#[derive(Debug, Clone)]
pub struct Vrv<'a> {
    volume: ResidualVolume,
    runs: Vec<&'a Runs>,
    voxel_um3: f64,
}

impl<'a> Vrv<'a> {
    /// Objective over the runs of some masks, one per view. `epsilon` is the share of the views that may miss a voxel.
    ///
    /// # Errors
    /// A tolerance outside `0..1` and a set without views.
    pub fn new(runs: Vec<&'a Runs>, grid: VoxelGrid, epsilon: f64) -> Result<Self, CarveError> {
        if runs.is_empty() {
            return Err(CarveError::NoViews);
        }
        Ok(Self { volume: ResidualVolume::new(grid, epsilon)?, runs, voxel_um3: grid.voxel_volume() })
    }

    /// Number of voxels that the views leave at `psi`.
    ///
    /// # Errors
    /// None for a `psi` of as many views as there are profiles.
    pub fn voxels(&mut self, psi: &Psi) -> Result<u64, CarveError> {
        self.volume.count(self.runs.iter().enumerate().map(|(view, &runs)| (runs, psi.projection(view))))
    }

    /// Volume that the views leave at `psi`, um^3.
    ///
    /// # Errors
    /// None for a `psi` of as many views as there are profiles.
    pub fn volume_um3(&mut self, psi: &Psi) -> Result<f64, CarveError> {
        Ok(self.voxels(psi)? as f64 * self.voxel_um3)
    }
}

/// What a search maximises.
#[derive(Debug)]
pub enum Objective<'a> {
    /// Volume left, um^3.
    Vrv(Box<Vrv<'a>>),
    /// Mean overlap of hull and profile, 0 to 1.
    Coherence(Vec<&'a Columns>),
}

impl Objective<'_> {
    /// The value at `psi`.
    ///
    /// # Errors
    /// None for a `psi` of as many views as there are profiles.
    pub fn value(&mut self, psi: &Psi) -> Result<f64, CarveError> {
        match self {
            Self::Vrv(vrv) => vrv.volume_um3(psi),
            Self::Coherence(columns) => Ok(coherence(columns, psi)),
        }
    }
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimised {
    /// The best camera, angles and shifts.
    pub psi: Psi,
    /// The objective at the start.
    pub before: f64,
    /// The objective at the result.
    pub after: f64,
    /// Evaluations of the objective.
    pub evaluations: usize,
    /// Whether the search ended because its steps were small enough.
    pub converged: bool,
    /// Parameters that ended at the end of their range: the best value may lie beyond.
    pub on_bound: Vec<Parameter>,
}

/// Maximises an objective over the free parameters by the simplex of Nelder and Mead, within their bounds and held by their priors.
///
/// # Errors
/// Those of the objective.
pub fn optimise(start: &Psi, free: &Free, objective: &mut Objective, stop: Stop) -> Result<Optimised, CarveError> {
    let before = objective.value(start)?;
    let mut failed = None;
    let reaches = free.reaches(start);
    let loss = |values: &[f64]| {
        let psi = free.apply(start, values);
        // Only ratios count: another unit of the objective must not change the weight of the priors.
        objective.value(&psi).map_or_else(
            |error| {
                failed.get_or_insert(error);
                f64::INFINITY
            },
            |value| free.cost(start, &psi) - value.ln(),
        )
    };
    let Minimum { at, evaluations, converged, .. } = simplex::minimise(&reaches, stop, loss);
    if let Some(error) = failed {
        return Err(error);
    }
    let psi = free.apply(start, &at);
    let after = objective.value(&psi)?;
    let on_bound = free.on_bound(start, &at);
    Ok(Optimised { psi, before, after, evaluations: evaluations + 2, converged, on_bound })
}
