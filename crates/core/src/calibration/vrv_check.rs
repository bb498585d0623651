//! The paper's objective as the judge of a calibration: it must leave as much as the camera as given does, and as a search for the
//! most that can be left.
//!
//! ```text
//!   camera as given ──────────────────────────────────── VRV before ──────────┐
//!   closed form ─┬─ least squares ───────────────────── VRV at the solution ──┼─ passed: less than neither
//!                └─ simplex over uy and gamma, bounded ─ the largest VRV ─────┘
//! ```
//! VRV with eps = 0 of the slices' polygons: some tenths of a ms an evaluation, so that every turn is judged.

use super::free::Free;
use super::hull_slices::HullSlices;
use super::least_squares::GivenView;
use super::psi::Psi;
use super::search::Stop;
use super::simplex;
use super::turn::Calibration;
use crate::geometry::Camera;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The closed form is off by less than this, px and rad.
const UY_FAR_PX: f64 = 3.0;
const GAMMA_FAR: f64 = 0.3 * PI / 180.0;
/// First steps are a fifteenth of that, 0.2 px and 0.02 deg; a sixteenth of those is 0.0125 px.
const STOP: Stop = Stop { evaluations: 60, share: 1.0 / 16.0 };
/// What a solution may leave less: a tenth of a px beside a larva's axis costs as much.
const TOLERANCE: f64 = 0.0025;

/// What the gate says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VrvVerdict {
    Passed,
    /// Another axis leaves more: the solution is better than the camera as given, but not the best.
    NotLargest,
    /// The camera as given leaves more: the views do not show one turn of one body, or that camera is better.
    Worse,
}

/// Volumes that no view misses, um^3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VrvCheck {
    /// With the camera as given and the ledger's angles.
    pub given_um3: f64,
    pub solution_um3: f64,
    /// The largest that a search over uy and gamma from the closed form found, with the ledger's angles.
    pub search_um3: f64,
    pub evaluations: usize,
    pub verdict: VrvVerdict,
}

/// Holds a calibration against the camera that it was given and against a search from its start. `given` are the views that were
/// calibrated, all of them, with the ledger's angles.
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
