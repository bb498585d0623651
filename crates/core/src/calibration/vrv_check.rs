//! The VRV check: the paper's objective judges a calibration. The calibrated camera must leave as much as the camera as given,
//! and as much as a search for the largest volume.
//!
//! ```text
//!   camera as given ──────────────────────────────────── VRV before ──────────┐
//!   closed form ─┬─ least squares ───────────────────── VRV at the solution ──┼─ passed: less than neither
//!                └─ simplex over uy and gamma, bounded ─ the largest VRV ─────┘
//! ```
//! VRV is taken with epsilon 0, from the polygons of slices. An evaluation takes some tenths of a ms, so every turn is checked.

use super::free::Free;
use super::hull_slices::HullSlices;
use super::least_squares::GivenView;
use super::psi::Psi;
use super::search::Stop;
use super::simplex;
use super::tangents::TurnView;
use super::turn::Calibration;
use crate::geometry::Camera;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Largest error of the closed form, px and rad.
const UY_FAR_PX: f64 = 3.0;
const GAMMA_FAR: f64 = 0.3 * PI / 180.0;
/// The first steps are a fifteenth of that: 0.2 px and 0.02 deg. A sixteenth of those is 0.0125 px.
const STOP: Stop = Stop { evaluations: 60, share: 1.0 / 16.0 };
/// How much less a solution may leave, relative. A tenth of a px beside a larva's axis costs as much.
const TOLERANCE: f64 = 0.0025;

/// Share of the volume that no view misses by which changes of uy (px), gamma, alpha (rad) and the ratio of the angles by these
/// standard deviations change it. Each is applied to both sides, and the larger change counts.
pub(crate) fn hull_sd_share(camera: &Camera, views: &[TurnView], sd: [f64; 4]) -> f64 {
    let slices = HullSlices::new(views.iter().map(|v| v.columns).collect(), camera);
    let volume = |by: [f64; 4]| {
        let Camera { uy, gamma, alpha, .. } = *camera;
        let camera = Camera { uy: uy + by[0], gamma: gamma + by[1], alpha: alpha + by[2], ..camera.clone() };
        slices.volume_um3(&Psi::new(camera, views.iter().map(|v| v.omega * (1.0 + by[3])).collect()))
    };
    let here = volume([0.0; 4]);
    let change = |at: usize| {
        let by = |sign: f64| std::array::from_fn(|i| if i == at { sign * sd[i] } else { 0.0 });
        [1.0, -1.0].map(|sign| (volume(by(sign)) - here).abs()).into_iter().fold(0.0, f64::max)
    };
    // Where these profiles leave nothing, the hull is unknown by all of it.
    if here > 0.0 { (0..4).map(|at| (change(at) / here).powi(2)).sum::<f64>().sqrt() } else { 1.0 }
}

/// The result of the VRV check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum VrvVerdict {
    /// The calibrated camera leaves the most.
    Passed,
    /// Another axis leaves more: the solution is better than the camera as given, but not the best one.
    NotLargest,
    /// The camera as given leaves more: the views do not show one turn of one body, or that camera is the better one.
    Worse,
}

/// Volumes that no view misses (VRV), with three cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VrvCheck {
    /// With the camera as given and the ledger's angles, um^3.
    pub given_um3: f64,
    /// With the calibrated camera, um^3.
    pub solution_um3: f64,
    /// The largest that a search over uy and gamma finds, from the closed form and with the ledger's angles, um^3.
    pub search_um3: f64,
    /// Evaluations of the volume.
    pub evaluations: usize,
    /// The result.
    pub verdict: VrvVerdict,
}

/// Compares a calibration with the camera that it was given, and with a search from its start. `given` are all views that were
/// calibrated, with the ledger's angles.
pub fn check_vrv(found: &Calibration, camera: &Camera, given: &[GivenView]) -> VrvCheck {
    let ledger: Vec<f64> = given.iter().map(|v| v.omega).collect();
    let used: Vec<&GivenView> = given.iter().zip(&found.views).filter(|(_, state)| state.bad.is_none()).map(|(view, _)| view).collect();
    let slices = HullSlices::new(used.iter().map(|v| v.columns).collect(), &found.camera);
    let planned = |camera: &Camera| Psi::new(camera.clone(), used.iter().map(|v| v.omega).collect());
    let given_um3 = slices.volume_um3(&planned(camera));
    let solution_um3 = slices.volume_um3(&Psi::of(found, &ledger));
    let start = planned(&found.start);
    let free = Free::near(UY_FAR_PX, GAMMA_FAR);
    let searched = simplex::minimise(&free.reaches(&start), STOP, |values| -slices.volume_um3(&free.apply(&start, values)));
    let search_um3 = -searched.value;
    let least = |of_um3: f64| solution_um3 >= of_um3 * (1.0 - TOLERANCE);
    let verdict = match (least(given_um3), least(search_um3)) {
        (true, true) => VrvVerdict::Passed,
        (true, false) => VrvVerdict::NotLargest,
        (false, _) => VrvVerdict::Worse,
    };
    VrvCheck { given_um3, solution_um3, search_um3, evaluations: searched.evaluations + 2, verdict }
}
