//! The swim bladder: an ellipsoid of gas, or two, fitted to the dark rim in all views at once.
//!
//! ```text
//!     .-"""-.        gas bends the light at its border past the lens: a dark rim,
//!    /  ___  \       and a bright middle, where the light passes straight;
//!   |  (   )  |      pigment and yolk are darkest where they are thickest, in the middle
//!    \  '-'  /
//!     '-...-'        edge: where the light rises along a ray outwards, out of the rim
//! ```
//! Ellipsoids at all places of the trunk are compared with some views: the outline with the highest contrast gives first places. From these an
//! ellipsoid is fitted to the edges. What it encloses decides whether it is gas. docs/organs.md has the definitions and the errors.

use super::ellipsoid::{Ellipse, Ellipsoid, Linear};
use super::fit::{EDGE_SD_PX, Edge, FORM, Fit, root_of_squares, solve};
use super::{Eyes, Lit};
use crate::parallel::prelude::*;
use crate::statistics::{median, upper_quantile};
use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Whether a larva has gas in its swim bladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum BladderState {
    /// It has gas.
    Inflated,
    /// It has none: not inflated, or missing.
    NotInflated,
    /// The views do not tell.
    Undecided,
}

/// Why a swim bladder has no volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum BladderMissing {
    /// Too few views.
    #[error("too few views show the specimen from different sides")]
    FewViews,
    /// The trunk is not known.
    #[error("neither the eyes nor the shape tell the head from the tail")]
    NoHead,
    /// The trunk is too dark.
    #[error("no light passes the trunk, so that gas in it would not be seen")]
    Opaque,
    /// Nothing looks like gas.
    #[error("nothing in the trunk has the dark rim and the bright middle of gas")]
    NoGas,
    /// Nothing looks like gas in the part of the larva that was measured.
    #[error("part of the larva was not measured, and may have the gas")]
    PartUnseen,
    /// Something looks a little like gas.
    #[error("something in the trunk is a little like gas, and not enough to decide")]
    Unclear,
}

/// One lobe of a swim bladder: the ellipsoid that its dark rim in all views shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Lobe {
    /// Volume of the ellipsoid.
    pub volume_um3: f64,
    /// Its standard deviation: by the views, the form and the place of the edges.
    pub volume_sd_um3: f64,
    /// Centre, in the frame of the mesh.
    pub centre_um: [f64; 3],
    /// Half axes, the longest first.
    pub half_axes_um: [f64; 3],
    /// The ellipsoid in the frame of the mesh, um^2: all x with (x - centre) S^-1 (x - centre) <= 1, as xx, yy, zz, xy, xz, yz of S.
    pub spread_um2: [f64; 6],
    /// Root mean square distance of the edges from its outlines, px.
    pub residual_px: f64,
}

/// The swim bladder of a larva.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SwimBladder {
    /// Whether it has gas.
    pub state: BladderState,
    /// Probability that it has gas, 0 to 1. `None` where it was not looked for.
    pub probability: Option<f64>,
    /// Why there is no volume. `None` where there is.
    pub reason: Option<BladderMissing>,
    /// The lobes with gas, that nearest to the snout first. Empty without a volume.
    pub lobes: Vec<Lobe>,
    /// Volume of the gas: the sum of the lobes.
    pub volume_um3: Option<f64>,
    /// Its standard deviation.
    pub volume_sd_um3: Option<f64>,
    /// Extent of the gas along the body.
    pub length_um: Option<f64>,
    /// Its standard deviation.
    pub length_sd_um: Option<f64>,
    /// Place of the middle of the gas along the body axis, from the snout. `None` where a part of the larva was not measured.
    pub along_um: Option<f64>,
    /// Its standard deviation.
    pub along_sd_um: Option<f64>,
    /// Distance of the middle of the gas from the middle of the eyes, along the body. `None` without two eyes.
    pub behind_eyes_um: Option<f64>,
    /// Its standard deviation.
    pub behind_eyes_sd_um: Option<f64>,
    /// How far the middle of the gas lies from the body axis towards the back. `None` where the back is not determined.
    pub above_axis_um: Option<f64>,
    /// Its standard deviation.
    pub above_axis_sd_um: Option<f64>,
}

/// The body in which a bladder is looked for.
pub(crate) struct Trunk {
    /// Centres of slices at equal distances, head first where the head is known, um.
    pub centres: Vec<[f64; 3]>,
    /// Radii of circles of the slices' areas, um.
    pub radii_um: Vec<f64>,
    /// Whether the shape tells the head.
    pub has_head: bool,
    /// The direction of the back, where it is determined.
    pub back: Option<[f64; 3]>,
    /// Whether a part of the larva was not measured.
    pub is_bound: bool,
}

/// Views that determine an ellipsoid.
const LEAST_VIEWS: usize = 6;
/// Slices that a body needs.
const LEAST_SLICES: usize = 10;
/// Views and rays of the first comparison.
const COARSE_VIEWS: usize = 8;
const COARSE_RAYS: usize = 12;
/// Half widths of the ellipsoids that are compared, um, and their half lengths over these.
const WIDTHS_UM: [f64; 4] = [42.0, 60.0, 85.0, 115.0];
const ASPECTS: [f64; 2] = [1.6, 2.5];
/// Distances of their centres across and along the body, um.
const CROSS_UM: f64 = 30.0;
const ALONG_UM: f64 = 35.0;
/// Shares of the length between which they lie. Eyes end at 0.13, and the ears at 0.16.
const BETWEEN: [f64; 2] = [0.17, 0.42];
/// So many places, this far from each other, are tried.
const PLACES: usize = 6;
const APART_UM: f64 = 60.0;
/// Contrast between outside and inside that counts, so that one black spot does not make an outline.
const COUNTS: [f64; 2] = [-0.3, 0.8];
/// What is compared lies this far from an outline, px.
const BESIDE_PX: f64 = 2.0;

/// Rays per lobe and view.
const RAYS: usize = 36;
/// Step along a ray, px.
const STEP_PX: f64 = 0.25;
/// A rise is that of the light within so many px to either side.
const NEAR_PX: f64 = 2.0;
/// An edge is where the light rises by this much at least, and with this contrast.
const LEAST_RISE: f64 = 0.04;
const LEAST_CONTRAST: f64 = 0.25;
/// Share of the way from the light in the rim to that outside at which the edge lies. Yolk and pigment beside the gas darken what is outside,
/// so that less than the half is right: 0.42 in the frames of one renderer and 0.46 in those of the other.
const LEVEL: f64 = 0.44;
/// How far around the outline edges are looked for, in distances from the centre, pass by pass.
const RANGES: [f64; 6] = [0.5, 0.4, 0.3, 0.25, 0.2, 0.15];
/// Passes of lobes that are known roughly.
const REFINED: usize = 3;
/// Newton's steps per pass.
const STEPS: usize = 4;
/// Edges this near to the outline of the other lobe are left out, px.
const CLEAR_PX: f64 = 2.0;
/// Edges this near to the outline are on it, px.
const ON_PX: f64 = 1.5;
/// Half axes of a lobe, um.
const HALF_AXES_UM: [f64; 2] = [22.0, 400.0];
/// Log odds of an ellipsoid that is worth looking for a second one.
const WORTH_A_SECOND: f64 = -1.0;
/// Least log odds of either of two. Beside gas, gas is more likely than elsewhere.
const SECOND: f64 = -2.5;
/// An ellipsoid is in the body where this share of its smallest half axis, on top of its distance from the axis, is at most so many radii of
/// the slice. Slices are higher than wide.
const WITHIN: f64 = 0.8;
const MOST_OUT: f64 = 1.15;
/// A second lobe is at least this part of the first.
const LEAST_PART: f64 = 0.04;
/// The rim is looked at so far inside the outline, px, and no further than this share of the way to the middle.
const RIM_PX: f64 = 3.0;
const RIM_SHARE: f64 = 0.3;
/// The rim of gas is closed: its light is that which so much of it does not exceed. A ring of pigment spots has gaps.
const CLOSED: f64 = 0.75;
/// Added to both lights, so that noise in dark pixels makes no ratio.
const NO_LIGHT: f64 = 0.02;
/// Places along the axis at which the light through the trunk is looked at, and the least share of the light that passes one of them.
const LIT_PLACES: usize = 6;
const LEAST_LIGHT: f64 = 0.04;
/// The ends of what is not decided.
const UNDECIDED: [f64; 2] = [0.05, 0.95];
/// Standard deviation of the place of the snout, px.
const SNOUT_SD_PX: f64 = 1.5;

/// What an ellipsoid looks like.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Logarithm of the light in the middle over that in the brighter parts of the rim, mean of the views.
    core: f64,
    /// Share of the rays with an edge on the outline.
    share: f64,
    /// Root mean square distance of the edges from the outlines, px.
    residual_px: f64,
}

impl Look {
    /// Logarithm of the odds for gas against anything else. docs/organs.md has the larvae that it is taken from.
    fn log_odds(&self) -> f64 {
        let sum = 10.8 * (self.core.min(1.2) - 0.25) + 14.4 * (self.share - 0.6) + 5.4 * (0.6 - self.residual_px.min(1.5)) - 2.4;
        // What is dark without a bright middle is no gas, however sharp its outline is.
        sum.min(20.0 * (self.core - 0.2))
    }
}

/// An ellipsoid with its look.
struct Found {
    fit: Fit,
    look: Look,
}

impl SwimBladder {
    /// From the views that count, the body and the eyes.
    pub(crate) fn find(views: &[Lit], trunk: Option<&Trunk>, eyes: &Eyes) -> Self {
        let found = match looked(views, trunk, eyes) {
            Ok((course, lobes, log_odds)) => Self::of(&course, lobes, log_odds, eyes),
            Err(reason) => Self::without(BladderState::Undecided, None, reason),
        };
        if trunk.is_some_and(|trunk| trunk.is_bound) { found.of_a_part() } else { found }
    }

    /// What holds of it where a part of the larva was not measured: the gas may be there, and the snout too.
    #[must_use]
    pub fn of_a_part(self) -> Self {
        if self.state == BladderState::NotInflated {
            return Self::without(BladderState::Undecided, None, BladderMissing::PartUnseen);
        }
        Self { along_um: None, along_sd_um: None, ..self }
    }

    fn without(state: BladderState, probability: Option<f64>, reason: BladderMissing) -> Self {
        Self {
            state,
            probability,
            reason: Some(reason),
            lobes: Vec::new(),
            volume_um3: None,
            volume_sd_um3: None,
            length_um: None,
            length_sd_um: None,
            along_um: None,
            along_sd_um: None,
            behind_eyes_um: None,
            behind_eyes_sd_um: None,
            above_axis_um: None,
            above_axis_sd_um: None,
        }
    }

    fn of(course: &Course, mut lobes: Vec<Found>, log_odds: f64, eyes: &Eyes) -> Self {
        let probability = 1.0 / (1.0 + (-log_odds).exp());
        let [least, most] = UNDECIDED;
        if probability < least {
            return Self::without(BladderState::NotInflated, Some(probability), BladderMissing::NoGas);
        }
        if probability <= most {
            return Self::without(BladderState::Undecided, Some(probability), BladderMissing::Unclear);
        }
        lobes.sort_by(|a, b| course.along_um(a.fit.body.centre).total_cmp(&course.along_um(b.fit.body.centre)));
        let volumes: Vec<f64> = lobes.iter().map(|lobe| lobe.fit.body.volume_um3()).collect();
        let sds: Vec<f64> = lobes.iter().map(|lobe| lobe.fit.volume_sd_um3()).collect();
        let volume: f64 = volumes.iter().sum();
        let middle = lobes.iter().zip(&volumes).map(|(lobe, part)| lobe.fit.body.centre * *part).sum::<Vector3<f64>>() / volume;
        let (on_axis, direction) = course.nearest(middle);
        let ends = lobes.iter().map(|Found { fit, .. }| {
            let [at, reach] = [(fit.body.centre - middle).dot(&direction), fit.body.reach_um(direction)];
            [at - reach, at + reach]
        });
        let [front, rear] = ends.fold([f64::MAX, f64::MIN], |[front, rear], [from, to]| [front.min(from), rear.max(to)]);
        let px = |of: f64| lobes.iter().map(|lobe| of / lobe.fit.px_per_um()).fold(0.0, f64::max);
        let residual = lobes.iter().map(|lobe| lobe.fit.residual_px).fold(0.0, f64::max);
        let centre_sd = root_of_squares(lobes.iter().zip(&volumes).map(|(lobe, part)| lobe.fit.centre_sd_um() * part / volume));
        let of_eyes = match eyes.eyes[..] {
            [a, b] => Some((Vector3::from(a.centre_um) + Vector3::from(b.centre_um)) / 2.0),
            _ => None,
        };
        // Both eyes are off by at most what their distance is off.
        let eyes_sd = eyes.distance_sd_um.unwrap_or(0.0) / 2.0;
        let above = course.back.map(|back| (middle - on_axis).dot(&back));
        Self {
            state: BladderState::Inflated,
            probability: Some(probability),
            reason: None,
            volume_um3: Some(volume),
            // The place of the edges is off in both lobes by the same amount.
            volume_sd_um3: Some(sds.iter().sum()),
            length_um: Some(rear - front),
            length_sd_um: Some(root_of_squares([2.0 * px(EDGE_SD_PX), 2.0 * px(FORM * residual), centre_sd].into_iter())),
            along_um: Some(course.along_um(middle)),
            along_sd_um: Some(root_of_squares([centre_sd, px(SNOUT_SD_PX)].into_iter())),
            behind_eyes_um: of_eyes.map(|eyes| (middle - eyes).dot(&course.mean_direction(eyes, middle))),
            behind_eyes_sd_um: of_eyes.map(|_| root_of_squares([centre_sd, eyes_sd].into_iter())),
            above_axis_um: above,
            above_axis_sd_um: above.map(|_| centre_sd),
            lobes: lobes.iter().zip(volumes.iter().zip(&sds)).map(|(lobe, (volume, sd))| lobe.lobe(*volume, *sd)).collect(),
        }
    }
}

/// The axis of the body from the snout on.
struct Course {
    centres: Vec<Vector3<f64>>,
    radii_um: Vec<f64>,
    back: Option<Vector3<f64>>,
    step_um: f64,
}

impl Course {
    /// `None` where the head is not known.
    fn of(trunk: &Trunk, eyes: &Eyes) -> Option<Self> {
        let n = trunk.centres.len().min(trunk.radii_um.len());
        if n < LEAST_SLICES {
            return None;
        }
        let mut centres: Vec<Vector3<f64>> = trunk.centres[..n].iter().copied().map(Vector3::from).collect();
        let mut radii_um = trunk.radii_um[..n].to_vec();
        let of_eyes: Vec<Vector3<f64>> = eyes.eyes.iter().map(|eye| Vector3::from(eye.centre_um)).collect();
        let nearest = |at: &Vector3<f64>| (0..n).min_by(|&i, &j| (centres[i] - at).norm().total_cmp(&(centres[j] - at).norm()));
        // Eyes are surer than the shape.
        let is_reversed = if of_eyes.len() == 2 { of_eyes.iter().filter_map(nearest).all(|i| 2 * i > n) } else { false };
        if !trunk.has_head && of_eyes.len() < 2 {
            return None;
        }
        if is_reversed {
            centres.reverse();
            radii_um.reverse();
        }
        let length: f64 = centres.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let step_um = length / (n as f64 - 1.0);
        // The back was read from slices whose head is at the other end.
        let back = trunk.back.filter(|_| !is_reversed).map(Vector3::from);
        (step_um > 0.0).then_some(Self { centres, radii_um, back, step_um })
    }

    fn length_um(&self) -> f64 {
        self.step_um * self.centres.len() as f64
    }

    /// The point of the axis at a distance from the snout, the direction of the axis there and the radius of the body.
    fn at(&self, along_um: f64) -> (Vector3<f64>, Vector3<f64>, f64) {
        let n = self.centres.len();
        let at = (along_um / self.step_um - 0.5).clamp(0.0, n as f64 - 1.0);
        let i = (at as usize).min(n - 2);
        let part = at - i as f64;
        let (before, after) = (i.saturating_sub(1), (i + 2).min(n - 1));
        let direction = (self.centres[after] - self.centres[before]).try_normalize(0.0).unwrap_or(Vector3::x());
        (self.centres[i] * (1.0 - part) + self.centres[i + 1] * part, direction, self.radii_um[i])
    }

    /// Distance from the snout of the place on the axis that is nearest to a point.
    fn along_um(&self, point: Vector3<f64>) -> f64 {
        let i = (0..self.centres.len()).min_by(|&i, &j| (self.centres[i] - point).norm().total_cmp(&(self.centres[j] - point).norm()));
        let along = (i.unwrap_or(0) as f64 + 0.5) * self.step_um;
        let (at, direction, _) = self.at(along);
        along + (point - at).dot(&direction)
    }

    /// Whether an ellipsoid lies in the body. A bubble in the water beside it does not.
    fn holds(&self, body: &Ellipsoid) -> bool {
        let (at, _, radius_um) = self.at(self.along_um(body.centre));
        let [.., smallest] = body.half_axes_um();
        (body.centre - at).norm() + WITHIN * smallest <= MOST_OUT * radius_um
    }

    fn nearest(&self, point: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (at, direction, _) = self.at(self.along_um(point));
        (at, direction)
    }

    /// The direction of the axis between two places.
    fn mean_direction(&self, from: Vector3<f64>, to: Vector3<f64>) -> Vector3<f64> {
        let ends = [from, to].map(|point| self.nearest(point).0);
        (ends[1] - ends[0]).try_normalize(0.0).unwrap_or_else(|| self.nearest(to).1)
    }
}

/// What is most like a bladder: its lobes and the logarithm of its odds.
fn looked(views: &[Lit], trunk: Option<&Trunk>, eyes: &Eyes) -> Result<(Course, Vec<Found>, f64), BladderMissing> {
    if views.len() < LEAST_VIEWS {
        return Err(BladderMissing::FewViews);
    }
    let course = trunk.and_then(|trunk| Course::of(trunk, eyes)).ok_or(BladderMissing::NoHead)?;
    if !is_lit(views, &course) {
        return Err(BladderMissing::Opaque);
    }
    let tried: Vec<Option<Found>> = places(views, &course).into_par_iter().map(|place| Found::of(views, place, None, &RANGES)).collect();
    let mut tried: Vec<Found> = tried.into_iter().flatten().filter(|found| course.holds(&found.fit.body)).collect();
    tried.sort_by(|a, b| b.look.log_odds().total_cmp(&a.look.log_odds()));
    let others: Vec<Ellipsoid> = tried.iter().skip(1).map(|found| found.fit.body).collect();
    let Some(first) = tried.into_iter().next() else { return Ok((course, Vec::new(), f64::MIN)) };
    // A second lobe makes the first no less likely.
    let of_first = first.look.log_odds();
    let lobes = if of_first > WORTH_A_SECOND { with_second(views, &course, first, &others) } else { vec![first] };
    let log_odds = lobes.iter().map(|lobe| lobe.look.log_odds()).fold(of_first, f64::max);
    Ok((course, lobes, log_odds))
}

/// Whether light passes the trunk in any place.
fn is_lit(views: &[Lit], course: &Course) -> bool {
    let [from, to] = BETWEEN.map(|share| share * course.length_um());
    (0..LIT_PLACES).any(|k| {
        let (centre, along, radius) = course.at(from + (to - from) * (k as f64 + 0.5) / LIT_PLACES as f64);
        let body = Ellipsoid { centre, spread: prolate(along, radius, radius) };
        let lights = views.iter().filter_map(|view| light(view, body.seen(&Linear::of(view.projection, centre)?).centre));
        median(lights.collect()).is_some_and(|light| light > LEAST_LIGHT)
    })
}

fn directions(n: usize) -> Vec<Vector2<f64>> {
    let direction = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
        Vector2::new(cos, sin)
    };
    (0..n).map(direction).collect()
}

fn light(view: &Lit, at: Vector2<f64>) -> Option<f64> {
    view.shade.at((at.x, at.y))
}

fn contrast(outside: f64, inside: f64) -> f64 {
    (outside - inside) / (outside + inside + 0.05)
}

/// Mean contrast between what lies outside and inside the outline.
fn ringed(views: &[(&Lit, Linear)], body: &Ellipsoid, directions: &[Vector2<f64>]) -> f64 {
    let [least, most] = COUNTS;
    let (mut sum, mut n) = (0.0, 0.0);
    for (view, linear) in views {
        let seen = body.seen(linear);
        let Some(root) = seen.spread.cholesky() else { continue };
        for direction in directions {
            let to = root.l() * direction;
            let part = (BESIDE_PX / to.norm()).max(0.1);
            if let Some((inside, outside)) = light(view, seen.centre + (1.0 - part) * to).zip(light(view, seen.centre + (1.0 + part) * to))
            {
                sum += contrast(outside, inside).clamp(least, most);
                n += 1.0;
            }
        }
    }
    if n > 0.0 { sum / n } else { 0.0 }
}

/// The ellipsoids along the trunk whose outlines have the highest contrast.
fn places(views: &[Lit], course: &Course) -> Vec<Ellipsoid> {
    /// Ellipsoids of one slice that are kept.
    const OF_SLICE: usize = 4;
    let [from, to] = BETWEEN.map(|share| share * course.length_um());
    let steps = ((to - from) / ALONG_UM).ceil().max(1.0) as usize;
    let few = COARSE_VIEWS.min(views.len());
    let few: Vec<&Lit> = (0..few).map(|k| &views[k * views.len() / few]).collect();
    let directions = directions(COARSE_RAYS);
    let best_first = |found: &mut Vec<(f64, Ellipsoid)>| found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let of_slice = |k: usize| {
        let (centre, along, radius) = course.at(from + (to - from) * (k as f64 + 0.5) / steps as f64);
        let linear: Vec<(&Lit, Linear)> = few.iter().filter_map(|v| Some((*v, Linear::of(v.projection, centre)?))).collect();
        let mut found = Vec::new();
        for b in WIDTHS_UM {
            let reach = (1.15 * radius - b).max(0.0);
            let m = (reach / CROSS_UM) as i32;
            for (y, z) in (-m..=m).flat_map(|y| (-m..=m).map(move |z| (y, z))) {
                let off = Vector3::new(0.0, f64::from(y), f64::from(z)) * CROSS_UM;
                for aspect in ASPECTS.into_iter().filter(|_| off.norm() <= reach) {
                    let body = Ellipsoid { centre: centre + off, spread: prolate(along, aspect * b, b) };
                    found.push((ringed(&linear, &body, &directions), body));
                }
            }
        }
        best_first(&mut found);
        found.truncate(OF_SLICE);
        found
    };
    let slices: Vec<Vec<(f64, Ellipsoid)>> = (0..steps).into_par_iter().map(of_slice).collect();
    let mut found: Vec<(f64, Ellipsoid)> = slices.into_iter().flatten().collect();
    best_first(&mut found);
    let mut kept: Vec<Ellipsoid> = Vec::new();
    for (_, body) in found {
        if kept.len() < PLACES && kept.iter().all(|k| (k.centre - body.centre).norm() > APART_UM) {
            kept.push(body);
        }
    }
    kept
}

/// The spread of an ellipsoid of half length `a` along a direction and half width `b`.
fn prolate(along: Vector3<f64>, a: f64, b: f64) -> Matrix3<f64> {
    Matrix3::identity() * b * b + along * along.transpose() * (a * a - b * b)
}

/// The lobe, and another one before or behind it where there is one.
fn with_second(views: &[Lit], course: &Course, first: Found, others: &[Ellipsoid]) -> Vec<Found> {
    let (_, along) = course.nearest(first.fit.body.centre);
    let (a, volume) = (first.fit.body.reach_um(along), first.fit.body.volume_um3());
    let b = (volume * 0.75 / std::f64::consts::PI / a).sqrt();
    // What was found beside it, and ellipsoids before and behind it.
    let is_beside = |own: &Ellipsoid, other: &Ellipsoid, least: f64| {
        (other.centre - own.centre).dot(&along).abs() > least * (own.reach_um(along) + other.reach_um(along))
    };
    let mut starts: Vec<Ellipsoid> = others.iter().filter(|other| is_beside(&first.fit.body, other, 0.6)).copied().collect();
    for (side, part) in [1.0, -1.0].into_iter().flat_map(|side| [0.6, 1.0].map(|part| (side, part))) {
        let own = part * a.min(1.5 * b);
        starts.push(Ellipsoid { centre: first.fit.body.centre + side * (0.85 * a + own) * along, spread: prolate(along, own, part * b) });
    }
    let pair = |start: Ellipsoid| {
        let refined = &RANGES[RANGES.len() - REFINED..];
        // Each is fitted without the edges of the other, so that neither reaches into the other.
        let other = Found::of(views, start, Some(&first.fit.body), &RANGES[1..])?;
        let own = Found::of(views, first.fit.body, Some(&other.fit.body), &RANGES[1..])?;
        let other = Found::of(views, other.fit.body, Some(&own.fit.body), refined)?;
        let own = Found::of(views, own.fit.body, Some(&other.fit.body), refined)?;
        let part = other.fit.body.volume_um3() / own.fit.body.volume_um3();
        let is_in = course.holds(&own.fit.body) && course.holds(&other.fit.body);
        (is_in && is_beside(&own.fit.body, &other.fit.body, 0.75) && (LEAST_PART..1.0 / LEAST_PART).contains(&part)).then_some([own, other])
    };
    let worse = |pair: &[Found; 2]| pair[0].look.log_odds().min(pair[1].look.log_odds());
    let pairs: Vec<Option<[Found; 2]>> = starts.into_par_iter().map(pair).collect();
    let best = pairs.into_iter().flatten().max_by(|x, y| worse(x).total_cmp(&worse(y)));
    match best.filter(|pair| worse(pair) > SECOND) {
        Some(pair) => pair.into(),
        None => vec![first],
    }
}

/// The strongest rise of the light along a ray outwards near the outline.
fn edge(view: &Lit, centre: Vector2<f64>, direction: Vector2<f64>, reach: f64, range: f64) -> Option<Vector2<f64>> {
    let half = (range * reach).max(NEAR_PX);
    let (from, to) = ((reach - half).max(0.5), reach + half + 2.0 * NEAR_PX);
    let at = |i: usize| from + i as f64 * STEP_PX;
    let samples: Vec<f64> = (0..=((to - from) / STEP_PX) as usize).map_while(|i| light(view, centre + at(i) * direction)).collect();
    let near = (NEAR_PX / STEP_PX) as usize;
    let mut best: Option<(f64, usize, [f64; 2])> = None;
    for i in 1..samples.len().saturating_sub(2 * near) {
        let inside = samples[i.saturating_sub(near)..=i].iter().copied().fold(f64::MAX, f64::min);
        let outside = samples[i..=i + near].iter().copied().fold(0.0, f64::max);
        let rise = contrast(outside, inside);
        // Of two alike the nearer one.
        let value = rise * (1.0 - 0.5 * ((at(i) - reach) / half).abs().min(1.0));
        if outside - inside > LEAST_RISE && rise > LEAST_CONTRAST && best.is_none_or(|b| value > b.0) {
            best = Some((value, i, [inside, outside]));
        }
    }
    let (_, i, [inside, outside]) = best?;
    let level = inside + LEVEL * (outside - inside);
    let k = (i.saturating_sub(near) + 1..=i + near).find(|&k| samples[k - 1] <= level && samples[k] > level)?;
    let part = (level - samples[k - 1]) / (samples[k] - samples[k - 1]);
    Some(centre + (at(k - 1) + part * STEP_PX) * direction)
}

impl Found {
    /// Fitted to the edges near `body`, without those of `other`.
    fn of(views: &[Lit], body: Ellipsoid, other: Option<&Ellipsoid>, ranges: &[f64]) -> Option<Self> {
        let [least, most] = HALF_AXES_UM;
        let directions = directions(RAYS);
        let mut fit = Fit { body, linear: Vec::new(), edges: Vec::new(), residual_px: 0.0 };
        for &range in ranges {
            let linear: Vec<Linear> = views.iter().map(|view| Linear::of(view.projection, fit.body.centre)).collect::<Option<_>>()?;
            let mut edges = Vec::new();
            for (view, (lit, linear)) in views.iter().zip(&linear).enumerate() {
                let (own, other) = (fit.body.seen(linear), other.map(|other| other.seen(linear)));
                for &direction in &directions {
                    let reach = own.reach(direction);
                    let Some(at) = edge(lit, own.centre, direction, reach, range) else { continue };
                    let outside = own.centre + (reach + NEAR_PX) * direction;
                    if other.is_none_or(|other| other.beyond(at) > CLEAR_PX && other.beyond(outside) > CLEAR_PX) {
                        edges.push(Edge { view, at });
                    }
                }
            }
            let (body, residual_px) = solve(&linear, &edges, fit.body, None, STEPS)?;
            if !body.half_axes_um().iter().all(|half| (least..most).contains(half)) {
                return None;
            }
            fit = Fit { body, linear, edges, residual_px };
        }
        let look = Look::of(views, &fit, other, &directions)?;
        Some(Self { fit, look })
    }

    fn lobe(&self, volume_um3: f64, volume_sd_um3: f64) -> Lobe {
        let body = &self.fit.body;
        Lobe {
            volume_um3,
            volume_sd_um3,
            centre_um: body.centre.into(),
            half_axes_um: body.half_axes_um(),
            spread_um2: body.spread_um2(),
            residual_px: self.fit.residual_px,
        }
    }
}

impl Look {
    fn of(views: &[Lit], fit: &Fit, other: Option<&Ellipsoid>, directions: &[Vector2<f64>]) -> Option<Self> {
        let seen: Vec<Ellipse> = fit.linear.iter().map(|linear| fit.body.seen(linear)).collect();
        let on = fit.edges.iter().filter(|edge| seen[edge.view].beyond(edge.at).abs() < ON_PX).count();
        // Rays towards the other lobe are not expected to have an edge.
        let expected: usize = seen
            .iter()
            .zip(&fit.linear)
            .map(|(own, linear)| {
                let other = other.map(|other| other.seen(linear));
                let is_free = |d: &&Vector2<f64>| other.is_none_or(|other| other.beyond(own.centre + own.reach(**d) * **d) > CLEAR_PX);
                directions.iter().filter(is_free).count()
            })
            .sum();
        let cores: Vec<f64> = views
            .iter()
            .zip(&seen)
            .filter_map(|(view, own)| {
                let rim = |d: &Vector2<f64>| {
                    let reach = own.reach(*d);
                    light(view, own.centre + (reach - RIM_PX.min(RIM_SHARE * reach)) * d)
                };
                let core = |d: &Vector2<f64>| light(view, own.centre + 0.12 * own.reach(*d) * d);
                let rim = upper_quantile(directions.iter().filter_map(rim).collect(), CLOSED)?;
                let core = median(directions.iter().step_by(6).filter_map(core).collect())?;
                Some(((core + NO_LIGHT) / (rim + NO_LIGHT)).ln())
            })
            .collect();
        (expected > 0 && !cores.is_empty()).then(|| Self {
            core: cores.iter().sum::<f64>() / cores.len() as f64,
            share: on as f64 / expected as f64,
            residual_px: fit.residual_px,
        })
    }
}
