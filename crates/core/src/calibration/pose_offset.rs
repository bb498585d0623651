//! The pose of a specimen in one view against another view from the same direction: the closure view against view 0.
//!
//! ```text
//!   edges of both views ── distances from each slice's support function ── their differences d
//!   d = across sign - along sign edge_slope - turn h'        least squares with Tukey's weights
//!   variance = what the fit changes by when a stretch of an edge is left out (jackknife)
//!            + what an error of 0.1 px that a whole edge has in common makes of the fit + what the prior leaves open
//! ```
//! Errors of the model in that direction are in both views and cancel. Errors of neighbouring edges are alike (a fin is lost
//! over a stretch), so the jackknife leaves out stretches and not single slices.

use super::screen::{row, trimmed_rms};
use super::support::Support;
use super::tangents::{Pose, Side, TurnView};
use crate::statistics::mad_sd;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Offset of the specimen's pose between two views from the same direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PoseOffset {
    /// To the right in the image, px.
    pub along_px: f64,
    /// Down the image, px.
    pub across_px: f64,
    /// About the capillary's axis, rad.
    pub turn_rad: f64,
    /// Distance of the later view's edges from the model's, px: root of the mean square without the largest 5 %.
    pub rms_px: f64,
    /// Standard deviations. `None` in records of versions that did not compute them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<PoseOffsetSd>,
}

/// Standard deviations of a pose offset by the edges of the two views. The turn of a nearly round specimen is hardly
/// observable: its standard deviation is then near that of the prior, 10 deg.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PoseOffsetSd {
    /// Of `along_px`, px.
    pub along_px: f64,
    /// Of `across_px`, px.
    pub across_px: f64,
    /// Of `turn_rad`, rad.
    pub turn_rad: f64,
}

/// Prior standard deviations of across (px), along (px) and turn (rad), for edges that scatter by 1 px. They decide only what
/// the edges leave open.
const PRIOR_SD: [f64; 3] = [10.0, 10.0, 10.0 * std::f64::consts::PI / 180.0];
/// Number of stretches of each edge whose errors are taken as independent.
const STRETCHES: usize = 8;
/// Standard deviation of the error that a whole edge has in common in two frames of a specimen at rest, px. Segmentation is no
/// better. With it, two frames of rendered larvae at rest differ by 0.5 to 0.8 of the stated standard deviation (root of the
/// mean square of 28 to 32).
const COMMON_PX: f64 = 0.1;
/// Number of fits. Each uses the weights of the one before.
const ROUNDS: usize = 12;
/// A residual of so many standard deviations has no weight (Tukey's biweight; 95 % as efficient as least squares for normal
/// errors).
const TUKEY: f64 = 4.685;
/// Least standard deviation of an edge, px.
const SD_LEAST_PX: f64 = 0.05;

/// One edge of a slice, in both views.
struct Pair {
    /// 0 for the upper edge, 1 for the lower one.
    side: usize,
    /// Number of the stretch along the specimen, below [`STRETCHES`].
    stretch: usize,
    row: Vector3<f64>,
    differs_px: f64,
}

/// The pose in view `again` less that in view `first`. `None` where the views share no slices.
pub(crate) fn pose_offset(
    pose: &Pose,
    first: &TurnView,
    again: &TurnView,
    slices: impl ExactSizeIterator<Item = (f64, Support)>,
) -> Option<PoseOffset> {
    let ky = pose.camera().ky;
    let per_stretch = slices.len().div_ceil(STRETCHES).max(1);
    let (mut pairs, mut left_px): (Vec<Pair>, Vec<f64>) = (Vec::new(), Vec::new());
    for (at, (x_um, support)) in slices.enumerate() {
        for (number, side) in Side::BOTH.into_iter().enumerate() {
            let [before, after] = [first, again].map(|view| pose.tangent(x_um, view, side, Some(&support)));
            let (Some(before), Some(after)) = (before, after) else { continue };
            let [off_before, off_after] = [before, after].map(|t| (t.offset_um - support.at(t.theta)[0]) * ky);
            let edge_slope = f64::midpoint(before.edge_slope, after.edge_slope);
            pairs.push(Pair {
                side: number,
                stretch: at / per_stretch,
                row: row(side.sign(), edge_slope, support.at(after.theta)[1] * ky),
                differs_px: off_after - off_before,
            });
            left_px.push(off_after);
        }
    }
    let Fitted { found, .. } = fitted(&pairs, |_| true)?;
    let variance = variance(&pairs)?;
    Some(PoseOffset {
        along_px: found[1],
        across_px: found[0],
        turn_rad: found[2],
        rms_px: trimmed_rms(left_px.into_iter()),
        sd: Some(PoseOffsetSd { along_px: variance[1].sqrt(), across_px: variance[0].sqrt(), turn_rad: variance[2].sqrt() }),
    })
}

struct Fitted {
    /// Across (px), along (px) and turn (rad).
    found: Vector3<f64>,
    inverse: Matrix3<f64>,
    /// One per pair; 0 for pairs that are left out.
    weights: Vec<f64>,
}

fn prior() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::from(PRIOR_SD).map(|sd| 1.0 / (sd * sd)))
}

/// The fit to the pairs for which `counts` is true. `None` where there are none.
fn fitted(pairs: &[Pair], counts: impl Fn(&Pair) -> bool) -> Option<Fitted> {
    let counted: Vec<bool> = pairs.iter().map(counts).collect();
    if !counted.contains(&true) {
        return None;
    }
    let mut weights: Vec<f64> = counted.iter().map(|c| f64::from(u8::from(*c))).collect();
    let mut round = 0;
    loop {
        let (mut normal, mut right) = (prior(), Vector3::zeros());
        for (pair, weight) in pairs.iter().zip(&weights) {
            normal += *weight * pair.row * pair.row.transpose();
            right += *weight * pair.differs_px * pair.row;
        }
        let inverse = normal.try_inverse()?;
        let found = inverse * right;
        round += 1;
        if round == ROUNDS {
            return Some(Fitted { found, inverse, weights });
        }
        let left = |pair: &Pair| pair.differs_px - pair.row.dot(&found);
        let sizes: Vec<f64> = pairs.iter().zip(&counted).filter(|(_, counts)| **counts).map(|(pair, _)| left(pair)).collect();
        let sd = mad_sd(&sizes).max(SD_LEAST_PX);
        for ((weight, pair), counts) in weights.iter_mut().zip(pairs).zip(&counted) {
            let far = left(pair) / (TUKEY * sd);
            *weight = if *counts && far.abs() < 1.0 { (1.0 - far * far).powi(2) } else { 0.0 };
        }
    }
}

/// Variances of across (px^2), along (px^2) and turn (rad^2).
fn variance(pairs: &[Pair]) -> Option<Vector3<f64>> {
    let Fitted { found, inverse, weights } = fitted(pairs, |_| true)?;
    let pieces: Vec<(usize, usize)> = (0..STRETCHES)
        .flat_map(|stretch| (0..Side::BOTH.len()).map(move |side| (side, stretch)))
        .filter(|piece| pairs.iter().any(|p| (p.side, p.stretch) == *piece))
        .collect();
    let without = pieces.iter().filter_map(|piece| fitted(pairs, |p| (p.side, p.stretch) != *piece));
    let square = |v: Vector3<f64>| v.component_mul(&v);
    let n = pieces.len() as f64;
    let jackknife = (n - 1.0) / n * without.map(|fit| square(fit.found - found)).sum::<Vector3<f64>>();
    let of_side = |side: usize| {
        let edge = pairs.iter().zip(&weights).filter(|(p, _)| p.side == side).map(|(p, weight)| *weight * p.row);
        square(COMMON_PX * (inverse * edge.sum::<Vector3<f64>>()))
    };
    let common = of_side(0) + of_side(1);
    let open = (inverse * prior() * inverse).diagonal();
    Some(jackknife + common + open)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slices whose support function has this slope, px per rad; both edges are seen turned by `turn` rad and 2 px lower.
    fn pairs(slope_px: impl Fn(f64) -> f64, turn: f64, noise_px: f64) -> Vec<Pair> {
        let mut state = 9u64;
        let mut noise = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) as f64 / f64::from(1u32 << 31) - 0.5) * noise_px * 12f64.sqrt()
        };
        let pair = |at: usize, number: usize, side: Side, noise: f64| {
            let row = row(side.sign(), 0.2 * (at as f64 / 60.0).cos(), side.sign() * slope_px(at as f64));
            let differs_px = Vector3::new(2.0, 0.0, turn).dot(&row) + noise;
            Pair { side: number, stretch: at / 50, row, differs_px }
        };
        (0..400)
            .flat_map(|at| Side::BOTH.into_iter().enumerate().map(move |(number, side)| (at, number, side)))
            .map(|(at, number, side)| pair(at, number, side, noise()))
            .collect()
    }

    fn stated(pairs: &[Pair]) -> (Vector3<f64>, Vector3<f64>) {
        (fitted(pairs, |_| true).unwrap().found, variance(pairs).unwrap().map(f64::sqrt))
    }

    #[test]
    fn a_turn_is_known_as_well_as_the_edges_tell_it() {
        let body = |at: f64| 20.0 * (at / 30.0).sin();
        let (found, sd) = stated(&pairs(body, 0.1, 0.3));
        // 800 edges of 0.3 px with slopes of 14 px per rad in the mean: 0.0008 rad; a few of these, and a whole edge's 0.1 px.
        assert!((found[2] - 0.1).abs() < 0.003 && (found[0] - 2.0).abs() < 0.05, "{found}");
        assert!((0.0005..0.01).contains(&sd[2]) && sd[0] < 0.1, "{sd}");
        let (_, thinner) = stated(&pairs(|at| body(at) / 20.0, 0.1, 0.3));
        assert!(thinner[2] > 10.0 * sd[2], "a tenth of the slope and less: {sd} {thinner}");
        let (found, round) = stated(&pairs(|_| 0.0, 0.1, 0.3));
        assert!(found[2].abs() < 1e-9 && (round[2] - PRIOR_SD[2]).abs() < 1e-9 && (found[0] - 2.0).abs() < 0.05, "{found} {round}");
    }

    /// A fin that one of the two views lacks for a stretch is no turn.
    #[test]
    fn a_stretch_that_is_wrong_does_not_turn_the_specimen() {
        let mut lacking = pairs(|at| 20.0 * (at / 30.0).sin(), 0.0, 0.1);
        lacking.iter_mut().filter(|p| p.side == 0 && p.stretch == 2).for_each(|p| p.differs_px += 8.0);
        let (found, sd) = stated(&lacking);
        assert!(found[2].abs() < 3.0 * sd[2] && found[2].abs() < 0.005, "{found} {sd}");
        assert!(fitted(&[], |_| true).is_none());
    }
}
