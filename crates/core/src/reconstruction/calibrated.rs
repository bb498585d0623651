//! The calibration of a turn from its own views, compared with the given camera.

use super::Reconstruction;
use super::finned::Finned;
use super::turn::ObservedView;
use crate::calibration::{
    Calibration, CalibrationError, GivenView, GlassFound, Moved, Priors, TurnView, ViewState, VrvCheck, VrvVerdict, calibrate, check_vrv,
    exchanged, placed, placed_by_halves,
};
use crate::geometry::{Camera, Projection};
use crate::profile::Columns;
use crate::quality::{Places, TurnFinding, of_calibration};
use crate::range::{Range, Ranged};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// How a turn is calibrated, and the prior on the rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationSettings {
    /// Whether uy, gamma, alpha, the ratio of angles and each view's shift are determined from the turn itself. With `false` a turn is
    /// measured with `[optics]` as it stands.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "method")))]
    pub enabled: bool,
    /// Prior standard deviation of the roll gamma of the capillary against the rig's camera, deg. A larger value lets a turn
    /// differ more from `[optics]`.
    pub gamma_sd_deg: f64,
    /// Prior standard deviation of the tilt alpha of the capillary against the rig's camera, deg. A larger value lets a turn
    /// differ more from `[optics]`.
    pub alpha_sd_deg: f64,
    /// Prior standard deviation of the shift of a single view, px. A larger value lets views be shifted further.
    pub dy_sd_px: f64,
    /// Standard deviation of the scale of the rig (kx and ky), %. Three times as much is added to the standard deviation of the volume.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "operator")))]
    pub scale_sd_percent: f64,
    /// Standard deviation of an error that all edges have in common, outwards or inwards, px. A larger value gives a larger standard deviation
    /// of the volume.
    pub edge_sd_px: f64,
}

impl Default for CalibrationSettings {
    /// Edges of beads through frames of two renderers lie 0.06 to 0.13 px inside, those of larvae up to 0.15 px outside. Those of path-traced
    /// larvae whose body has a clear skin lie 0.25 px inside.
    fn default() -> Self {
        Self { enabled: true, gamma_sd_deg: 1.0, alpha_sd_deg: 1.0, dy_sd_px: 1.0, scale_sd_percent: 0.0, edge_sd_px: 0.15 }
    }
}

impl Ranged for CalibrationSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        gamma_sd_deg: 0.001, 10.0, "deg";
        alpha_sd_deg: 0.001, 1.0, "deg";
        dy_sd_px: 0.001, 10.0, "px";
        scale_sd_percent: 0.0, 10.0, "%";
        edge_sd_px: 0.0, 5.0, "px";
    ];
}

impl CalibrationSettings {
    pub(super) fn priors(&self) -> Priors {
        Priors {
            gamma_rad: self.gamma_sd_deg.to_radians(),
            alpha_rad: self.alpha_sd_deg.to_radians(),
            dy_px: self.dy_sd_px,
            ..Priors::default()
        }
    }
}

/// Why a turn is measured with the given camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotCalibrated {
    /// The settings do not ask for a calibration.
    #[error("calibration was not asked for")]
    NotAsked,
    /// The views do not determine a calibration.
    #[error(transparent)]
    Failed(#[from] CalibrationError),
    /// With the calibration the views agree less than with the given camera: the hull that no view misses is smaller.
    #[error(
        "the calibrated camera leaves {solution_um3:.4e} um^3 that no view misses, the camera as given {given_um3:.4e} um^3: the views do not \
         show one turn of one body. Look at views and angles, or take another turn"
    )]
    Worse {
        /// Volume of the hull that no view misses with the given camera, um^3.
        given_um3: f64,
        /// The same with the calibrated camera, um^3.
        solution_um3: f64,
    },
}

/// The axis is compared with the bore where its standard deviation is less than this, px. That of a sphere is not known.
const AXIS_KNOWN_PX: f64 = 1.0;

/// A turn whose views show less than this share of the camera's perspective is tried in the other sense. 8 good turns of 5 larvae of the emulated rig
/// had 0.90 to 1.16, and the same turns in the other sense -0.54 to 0.31.
const PERSPECTIVE_LEAST: f64 = 0.6;
/// A turn is reversed if the edges in the other sense lie within this share of their distance as recorded. It was 0.67 to 0.91 of those.
const REVERSED_SHARE: f64 = 0.95;
/// Fewer views tell too little of their sense.
const REVERSED_VIEWS_LEAST: usize = 8;

/// A calibration that passed the comparison with the given camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// The calibration.
    pub calibration: Calibration,
    /// The hulls that no view misses (VRV), by which it was judged.
    pub vrv: VrvCheck,
}

/// The views of a turn sorted by angle, and their calibration.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// Views in the order of observing, sorted by angle: every order of acquisition gives the same bits.
    pub(super) order: Vec<usize>,
    /// The calibration; its views are in that order.
    pub(super) found: Result<Judged, NotCalibrated>,
}

impl Calibrated {
    /// The state of each view, in the order of observing. Empty without a calibration.
    pub fn states(&self) -> Vec<ViewState> {
        let Ok(judged) = &self.found else { return Vec::new() };
        let mut by_view: Vec<(usize, ViewState)> = self.order.iter().copied().zip(judged.calibration.views.iter().copied()).collect();
        by_view.sort_by_key(|(i, _)| *i);
        by_view.into_iter().map(|(_, state)| state).collect()
    }

    /// Whether the specimen moved during the turn.
    pub fn has_moved(&self) -> bool {
        self.found.as_ref().is_ok_and(|judged| judged.calibration.moved.is_some())
    }

    /// The views that count, each with the projection through which it is carved.
    pub(super) fn used(&self, of: &Reconstruction) -> Vec<(usize, Projection)> {
        let projection = |at: usize, i: usize| match &self.found {
            Ok(Judged { calibration: c, .. }) => c.views[at].bad.is_none().then(|| c.projection(at, of.observed[i].omega)),
            Err(_) => Some(of.camera.projection(of.observed[i].omega)),
        };
        self.order.iter().enumerate().filter_map(|(at, &i)| Some((i, projection(at, i)?))).collect()
    }
}

/// Views sorted by angle.
pub(super) fn given<'a>(observed: &'a [ObservedView], order: &[usize]) -> Vec<GivenView<'a>> {
    order.iter().map(|&i| GivenView { columns: &observed[i].columns, omega: observed[i].omega }).collect()
}

impl Reconstruction {
    /// What the calibration shows of the turn, beside what the comparison of the views shows. `numbers` are those of the views in the order of
    /// observing. `middle_v` is the row of the middle of the bore, px, where the walls are known.
    pub fn turn_findings(&self, finned: &Finned, numbers: &[u32], middle_v: Option<f64>) -> Vec<TurnFinding> {
        let Finned { views: observed, fins, calibrated } = finned;
        let states = calibrated.states();
        let found = calibrated.found.as_ref().ok().map(|judged| &judged.calibration);
        let is_bad = |i: usize| states.get(i).is_some_and(|state| state.bad.is_some());
        let with = |columns: fn(&ObservedView) -> &Columns| -> Vec<TurnView> {
            let posed = observed.iter().enumerate().map(|(i, view)| TurnView {
                columns: columns(view),
                omega: found.map_or(view.omega, |c| c.angle(view.omega)),
                dy_px: states.get(i).map_or(0.0, |state| state.dy_px),
            });
            posed.collect()
        };
        let views = with(|view| view.body.as_ref().unwrap_or(&view.columns));
        let counts: Vec<bool> = (0..views.len()).map(|i| !is_bad(i)).collect();
        let camera = found.map_or(&self.camera, |c| &c.camera);
        let bodies = placed(camera, &views, &counts);
        let places = Places {
            exchanged: exchanged(camera, &views, &counts, &bodies),
            bodies,
            by_halves: placed_by_halves(camera, &views, &counts),
            with_common_fins: fins.is_searched().then(|| placed(camera, &with(|view| &view.columns), &counts)),
        };
        let bad: Vec<usize> = (0..views.len()).filter(|&i| is_bad(i)).collect();
        let axis_off_px = found.filter(|c| c.sd.uy_px < AXIS_KNOWN_PX).zip(middle_v).map(|(c, middle_v)| c.camera.uy - middle_v);
        let mut findings = of_calibration(&places, numbers, &bad, axis_off_px);
        findings.extend(found.and_then(|found| self.reversed(found)));
        findings
    }

    /// Whether the views fit better if all angles have the other sense. Parallel rays show the mirror image of the specimen then, which fits as well.
    /// Rays that spread, or that the glass turns, do not. It is tried only where they are not as the camera says.
    fn reversed(&self, found: &Calibration) -> Option<TurnFinding> {
        let is_turned_back = found.glass.is_some_and(|glass| glass.is_sense_right == Some(false));
        let is_doubtful = is_turned_back || found.perspective.is_some_and(|share| share < PERSPECTIVE_LEAST);
        // The perspective of few views says little. What the glass shows has a significance of its own.
        if !is_doubtful || !is_turned_back && self.observed.len() < REVERSED_VIEWS_LEAST {
            return None;
        }
        let residual_px = |sense: f64| {
            let mut views: Vec<GivenView> =
                self.observed.iter().map(|view| GivenView { columns: &view.columns, omega: sense * view.omega }).collect();
            views.sort_by(|a, b| a.omega.total_cmp(&b.omega));
            let calibration = calibrate(&self.camera, &views, self.settings.calibration.priors()).ok()?;
            Some(calibration.residual_sd_um * self.camera.ky)
        };
        let (found_px, reversed_px) = (residual_px(1.0)?, residual_px(-1.0)?);
        (reversed_px < REVERSED_SHARE * found_px).then_some(TurnFinding::Reversed { found_px, reversed_px })
    }

    /// Calibrates on the views so far and compares the result with the given camera.
    pub fn calibrate(&self) -> Calibrated {
        self.calibrate_on(&self.observed)
    }

    /// The same on the views with other edges.
    pub(super) fn calibrate_on(&self, observed: &[ObservedView]) -> Calibrated {
        let settings = &self.settings.calibration;
        let mut order: Vec<usize> = (0..observed.len()).collect();
        order.sort_by(|&a, &b| observed[a].omega.total_cmp(&observed[b].omega));
        let given = given(observed, &order);
        let judged = || {
            if !settings.enabled {
                return Err(NotCalibrated::NotAsked);
            }
            let calibration = calibrate(&self.camera, &given, settings.priors())?;
            self.judge(calibration, &given)
        };
        let found = judged();
        Calibrated { order, found }
    }

    /// Accepts a calibration whose hull that no view misses is not smaller than with the given camera.
    pub(super) fn judge(&self, calibration: Calibration, given: &[GivenView]) -> Result<Judged, NotCalibrated> {
        match check_vrv(&calibration, &self.camera, given) {
            VrvCheck { verdict: VrvVerdict::Worse, given_um3, solution_um3, .. } => Err(NotCalibrated::Worse { given_um3, solution_um3 }),
            vrv => Ok(Judged { calibration, vrv }),
        }
    }
}

/// The calibration of a turn as it is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CalibrationRecord {
    /// The camera with which the numbers were made.
    pub psi: Camera,
    /// Standard deviation of uy, px.
    pub uy_sd_px: f64,
    /// Standard deviation of gamma, rad.
    pub gamma_sd_rad: f64,
    /// Standard deviation of alpha, rad.
    pub alpha_sd_rad: f64,
    /// True angles over the ledger's.
    pub rho: f64,
    /// Standard deviation of `rho`.
    pub rho_sd: f64,
    /// Residual of the profiles' edges against the model, standard deviation, um.
    pub residual_sd_um: f64,
    /// Passes of the solver.
    pub passes: usize,
    /// Whether the last pass changed nothing of importance.
    pub converged: bool,
    /// The view from which on the specimen lay elsewhere. `None` if it did not move.
    pub moved: Option<Moved>,
    /// What the views say of the capillary's glass. `None` where the camera has none, or they say nothing of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub glass: Option<GlassFound>,
    /// Volumes of the hull that no view misses: with this camera, the given one, and the best one that a search finds.
    #[serde(default)]
    pub vrv: Option<VrvCheck>,
}

impl From<&Judged> for CalibrationRecord {
    fn from(Judged { calibration: c, vrv }: &Judged) -> Self {
        Self {
            psi: c.camera.clone(),
            uy_sd_px: c.sd.uy_px,
            gamma_sd_rad: c.sd.gamma_rad,
            alpha_sd_rad: c.sd.alpha_rad,
            rho: c.rho,
            rho_sd: c.sd.rho,
            residual_sd_um: c.residual_sd_um,
            passes: c.passes,
            converged: c.converged,
            moved: c.moved,
            glass: c.glass,
            vrv: Some(*vrv),
        }
    }
}
