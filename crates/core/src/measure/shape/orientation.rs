//! Which end is the head, and which side is the back.
//!
//! ```text
//!      area                                     centres of the slices, seen from the side
//!    |  __                                     dorsal
//!    | /  \___                                    ___________________   trunk and tail
//!    |/       \________                  head \__/                      carried lower: head and yolk
//!    +-----------------> s                     ventral
//!      ^ first moment: the thicker end
//! ```

use super::Vector;
use super::axis::{STATIONS, upright};
use super::body::Slices;
use crate::statistics::fit;
use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// An end of the body by its place along the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// At low x.
    Left,
    /// At high x.
    Right,
}

/// The head is at the thicker end. A larva whose tail is cut off by the frame still has it there; one without its head does
/// not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Head {
    /// `null` where both ends are alike: stations then begin on the left.
    pub end: Option<End>,
    /// 0 where the ends are alike, 1 from a first moment of 0.1 on.
    pub confidence: f64,
    /// First moment of the slices' areas about the axis' middle, over the sum of the areas times half the length: how far the
    /// volume's centre lies from the middle towards the first station. 0 for a body whose ends are alike, 1/2 for a cone, some
    /// 0.4 for a larva.
    pub first_moment: f64,
}

/// The moment of a bead has an error of 0.002. Ten times that is not chance.
const ALIKE: f64 = 0.02;
/// A quarter of a larva's.
const SURE: f64 = 0.1;

impl Head {
    /// Seen from the first end of the axis, which is the left one.
    pub(super) fn of(slices: &Slices) -> Self {
        let half = slices.axis.length_um() / 2.0;
        let areas = slices.flats.iter().map(|f| f.area_um2);
        let moment = slices.s_um.iter().zip(areas.clone()).map(|(s, area)| (half - s) * area).sum::<f64>();
        let first_moment = moment / (half * areas.sum::<f64>());
        let end = (first_moment.abs() > ALIKE).then_some(if first_moment > 0.0 { End::Left } else { End::Right });
        Self { end, confidence: ((first_moment.abs() - ALIKE) / (SURE - ALIKE)).clamp(0.0, 1.0), first_moment }
    }

    /// Whether the axis must be reversed for the head to come first.
    pub(super) fn is_last(&self) -> bool {
        self.end == Some(End::Right)
    }

    /// Seen from the head.
    pub(super) fn first(self) -> Self {
        Self { first_moment: if self.is_last() { -self.first_moment } else { self.first_moment }, ..self }
    }
}

/// The back, as far as the shape determines it: the yolk of a larva hangs below the line of head and trunk.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Dorsal {
    /// Unit vector towards the back, in the coordinates of the mesh and across its long direction. `null` where the shape does
    /// not determine it: heights are then along the longer direction of the slices, and which of its ends is up means nothing.
    pub direction: Option<[f64; 3]>,
    /// 0 where it is not determined; 1 where the belly is as full as a young larva's and the slices as flat as a trunk.
    pub confidence: f64,
    /// How much longer than wide the slices are in one common direction: mean of (a - b) / (a + b) of their second moments. 0
    /// for round slices, and for slices with different long directions. That direction is the median plane.
    pub median_share: f64,
    /// How far the centres of the slices between 10 and 42 % of the length bulge out of a parabola through all of them, in the
    /// median plane, over the length. A body that is only arched has 0.
    pub belly_share: f64,
}

/// Median shares of phantoms are at least 0.27, those of a round body with the errors of its mesh below 0.02.
const MEDIAN_LEAST: f64 = 0.1;
const MEDIAN_SURE: f64 = 0.25;
/// Belly shares of phantoms are 0.0099 to 0.025 in their median plane, and up to 0.0066 across it, where only their bend
/// contributes.
const BELLY_LEAST: f64 = 0.007;
const BELLY_SURE: f64 = 0.015;
/// Position of a yolk, share of the length from the head.
const YOLK_AT: f64 = 0.26;
const YOLK_HALF: f64 = 0.16;
/// Slices at either end that are left out: caps and the tail fin's tip.
const ENDS: usize = STATIONS / 20;

impl Dorsal {
    /// Returns also the direction of the belly, or where it is not determined the longer direction of the slices, downwards.
    pub(super) fn of(slices: &Slices, head: &Head) -> (Self, Vector) {
        // A slice's longer direction as a number of twice its angle: such numbers can be added, whichever way the direction is
        // taken.
        let [mut real, mut imaginary] = [0.0; 2];
        for flat in &slices.flats {
            let [a, mixed, b] = flat.spread;
            real += (a - b) / (a + b);
            imaginary += 2.0 * mixed / (a + b);
        }
        let median_share = real.hypot(imaginary) / STATIONS as f64;
        let (sin, cos) = (imaginary.atan2(real) / 2.0).sin_cos();
        let middle = slices.planes[STATIONS / 2];
        let long = upright(middle.across[0] * cos + middle.across[1] * sin, slices.direction());
        let bulge_um = bulge_um(slices, long, head.is_last());
        let belly_share = bulge_um.abs() / slices.axis.length_um();
        let share = |found: f64, least: f64, sure: f64| ((found - least) / (sure - least)).clamp(0.0, 1.0);
        let confidence = match head.end {
            Some(_) => share(median_share, MEDIAN_LEAST, MEDIAN_SURE) * share(belly_share, BELLY_LEAST, BELLY_SURE),
            None => 0.0,
        };
        let ventral = if confidence > 0.0 { long * bulge_um.signum() } else { long * (if long.y < 0.0 { -1.0 } else { 1.0 }) };
        let direction = (confidence > 0.0).then(|| (-ventral).into());
        (Self { direction, confidence, median_share, belly_share }, ventral)
    }
}

/// The height of a bump (raised cosine) at the yolk, from a least-squares fit of 1, s, s^2 and the bump.
fn bulge_um(slices: &Slices, towards: Vector, head_is_last: bool) -> f64 {
    let row = |(station, centre): (usize, Vector)| {
        let from_left = (station as f64 + 0.5) / STATIONS as f64;
        let s = if head_is_last { 1.0 - from_left } else { from_left };
        let from_yolk = (s - YOLK_AT) / YOLK_HALF;
        let bump = if from_yolk.abs() < 1.0 { f64::midpoint(1.0, (PI * from_yolk).cos()) } else { 0.0 };
        (Vector4::new(1.0, s, s * s, bump), (centre - slices.planes[0].at).dot(&towards), 1.0)
    };
    // The four functions are independent at these places, so there is a solution.
    fit(slices.centres().enumerate().take(STATIONS - ENDS).skip(ENDS).map(row), Matrix4::zeros()).map_or(0.0, |found| found[3])
}
