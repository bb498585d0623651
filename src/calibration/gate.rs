//! The paper's objective as the judge of a calibration: it must leave as much as a search for the most that can be left.
//!
//! ```text
//!   closed form ─┬─ least squares ───────────────────── VRV at the solution ─┐
//!                └─ simplex over uy and gamma, bounded ─ the largest VRV ─────┴─ passed: not less, up to the voxels' grain
//! ```

use super::free::Free;
use super::objective::{Objective, Optimised, Optimiser, Vrv, optimise};
use super::psi::Psi;
use super::search::Stop;
use super::turn::Calibration;
use crate::carver::{CarveError, Runs};
use crate::geometry::VoxelGrid;
use crate::statistics::mean;
use std::f64::consts::PI;

/// The closed form is off by less than this, px and rad.
const UY_FAR_PX: f64 = 3.0;
const GAMMA_FAR: f64 = 0.3 * PI / 180.0;
/// First steps are a fifteenth of that, 0.2 px and 0.02 deg; a sixteenth of those, 0.0125 px, is what a volume of some 1e5 voxels tells.
const STOP: Stop = Stop { evaluations: 60, share: 1.0 / 16.0 };

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Voxels that no view misses: at the solution, and at most.
    pub vrv_solution: u64,
    pub vrv_simplex: u64,
    /// What the solution may have less, voxels.
    pub tolerance: u64,
    pub evaluations: usize,
    pub passed: bool,
}

/// Holds a calibration against a search from its start. `views` are those that were calibrated, all of them, with the ledger's angles.
///
/// # Errors
/// Refuses a calibration whose views were all left out.
pub fn gate(found: &Calibration, views: &[(&Runs, f64)], grid: VoxelGrid) -> Result<Gate, CarveError> {
    let ledger: Vec<f64> = views.iter().map(|v| v.1).collect();
    let used = || views.iter().zip(&found.views).filter(|(_, state)| state.bad.is_none());
    let runs: Vec<&Runs> = used().map(|((runs, _), _)| *runs).collect();
    let mut vrv = Vrv::new(runs, grid, 0.0)?;
    let vrv_solution = vrv.voxels(&Psi::of(found, &ledger))?;
    let start = Psi::new(found.start.clone(), used().map(|((_, omega), _)| *omega).collect());
    let tolerance = tolerance(used().map(|((runs, _), _)| *runs), found, grid.size());
    let mut objective = Objective::Vrv(Box::new(vrv));
    let Optimised { after, evaluations, .. } =
        optimise(&start, &Free::near(UY_FAR_PX, GAMMA_FAR), &mut objective, Optimiser::NelderMead, STOP)?;
    let vrv_simplex = (after / grid.voxel_volume()).round() as u64;
    Ok(Gate { vrv_solution, vrv_simplex, tolerance, evaluations: evaluations + 1, passed: vrv_solution + tolerance >= vrv_simplex })
}

/// Two volumes that are equal differ by chance in where the grid lies to their surface. A voxel that the surface cuts counts or
/// not: of all shares inside, evenly, the variance is 1/6. A slender body's surface is pi times its profile's area, so `n` voxels
/// are cut; neighbours that help one another make it less. Of the difference of two counts, one of them the largest of some 50,
/// four standard deviations: `4 sqrt(n / 3)`.
fn tolerance<'a>(runs: impl Iterator<Item = &'a Runs>, found: &Calibration, size_um: f64) -> u64 {
    let areas: Vec<f64> = runs.map(|r| r.area_px() as f64).collect();
    let mean_um2 = mean(&areas) / (found.camera.kx * found.camera.ky);
    let cut = PI * mean_um2 / (size_um * size_um);
    (4.0 * (cut / 3.0).sqrt()).ceil() as u64
}
