//! Finds the spot that goes around as a point on the outside of the glass does.
//!
//! ```text
//!   column u alike in all views │ phase by phase: v = axis + R sin(omega + phase), most ink ── least squares: a, b, c
//! ```

use super::MarkError;
use crate::profile::Spot;
use crate::statistics::{self, upper_median};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;

/// A view of the turn with its dark spots.
#[derive(Debug, Clone, Copy)]
pub struct MarkView<'a> {
    /// Angle as recorded, rad. Its sign is what is to be determined.
    pub omega: f64,
    /// Dark spots, the darkest first.
    pub spots: &'a [Spot],
}

/// A mark that was followed around the turn.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkTrack {
    /// Views given.
    pub views: usize,
    /// Views in which the mark was found.
    pub seen: usize,
    /// Column of the mark, px.
    pub u_px: f64,
    /// Row of the axis in that column, px, by the mark itself.
    pub axis_px: f64,
    /// Coefficient of cos omega in `v = axis + b cos omega + c sin omega`, px.
    pub b_px: f64,
    /// Coefficient of sin omega, px.
    pub c_px: f64,
    /// Half the distance of the outer walls in that column, px.
    pub wall_px: f64,
    /// Root mean square distance along v, px.
    pub residual_px: f64,
    /// How far the mark moves outwards in u with its depth, px: `u = u_px + .. + out n`. `n` runs from -1 to 1 and is the
    /// nearness of the mark if positive omega moves the near wall to larger v.
    pub out_px: f64,
    /// Standard deviation of `out_px`, px.
    pub out_sd_px: f64,
    /// Ink of the next spot that goes around over that of the mark, and its column, px. `None` where there is no other.
    pub rival: Option<(f64, f64)>,
}

impl MarkTrack {
    /// Radius of the mark's circle in the picture, px.
    pub fn amplitude_px(&self) -> f64 {
        self.b_px.hypot(self.c_px)
    }

    /// Place of the mark at an angle (rad): down the picture from the axis, and nearness as in `out_px`, both in radii.
    pub fn at(&self, omega: f64) -> [f64; 2] {
        let (sin, cos) = omega.sin_cos();
        let a = self.amplitude_px();
        [(self.b_px * cos + self.c_px * sin) / a, (self.c_px * cos - self.b_px * sin) / a]
    }

    /// The spot of a view that is nearest to where the mark should be. `None` where none is within 0.4 radii.
    pub fn nearest(&self, view: &MarkView) -> Option<Spot> {
        let row = self.axis_px + self.amplitude_px() * self.at(view.omega)[0];
        let off = |s: &Spot| (s.u_px - self.u_px).hypot(s.v_px - row);
        view.spots.iter().min_by(|a, b| off(a).total_cmp(&off(b))).filter(|s| off(s) < BESIDE * self.wall_px).copied()
    }
}

/// Fewer views do not determine a circle.
const VIEWS_LEAST: usize = 8;
/// Least share of the views in which the mark is found.
const SEEN_LEAST: f64 = 0.6;
/// Widest arc without the mark, deg: a third of the turn leaves the circle undetermined.
const GAP_MOST_DEG: f64 = 120.0;
/// Largest difference of the mark's column between views, px: a roll of 2.5 deg and the perspective move it by some px.
const COLUMN_PX: f64 = 7.0;
/// How far a spot may lie from the circle: a share of the radius during the search, and px at the end.
const SOUGHT: f64 = 0.08;
const NEAR_PX: f64 = 4.0;
/// Reach of the search for the mark after one turn, share of the radius.
const BESIDE: f64 = 0.4;
/// Number of phases that are tried: a step moves the dot by less than `SOUGHT`.
const PHASES: usize = 120;
/// Number of fits. Each uses the spots near to the one before.
const ROUNDS: usize = 4;

const RADIUS_OFF_PERCENT: f64 = 6.0;
const RESIDUAL_MOST_PX: f64 = 2.5;
const RIVAL_MOST: f64 = 0.5;

/// Follows the mark around the turn. `glass` gives, for a column, the row of the axis and the distance of the outer wall from
/// it, px.
///
/// # Errors
/// [`MarkError`] with what was found and what is needed.
pub fn track(views: &[MarkView], glass: impl Fn(f64) -> [f64; 2]) -> Result<MarkTrack, MarkError> {
    if views.len() < VIEWS_LEAST {
        return Err(MarkError::FewViews { found: views.len(), needed: VIEWS_LEAST });
    }
    let needed = ((SEEN_LEAST * views.len() as f64).ceil() as usize).max(VIEWS_LEAST);
    let mut ways = ways(views, &glass);
    ways.sort_by(|a, b| b.ink_px.total_cmp(&a.ink_px));
    let most_seen = ways.iter().map(|w| w.seen).max().unwrap_or(0);
    let around: Vec<&Way> = ways.iter().filter(|w| w.seen >= needed).collect();
    let Some(&best) = around.first() else { return Err(MarkError::NotFound { seen: most_seen, views: views.len(), needed }) };
    let [axis, wall_px] = glass(best.u_px);
    let mut way = *best;
    let mut fit = [0.0; 3];
    let mut on: Vec<(f64, Spot)> = Vec::new();
    for round in 0..ROUNDS {
        let near = if round == 0 { SOUGHT * wall_px } else { NEAR_PX };
        on = views.iter().filter_map(|v| Some((v.omega, way.spot(v, axis, near)?))).collect();
        fit = circle(&on, axis).ok_or(MarkError::NotFound { seen: on.len(), views: views.len(), needed })?;
        way = Way { u_px: upper_median(on.iter().map(|(_, s)| s.u_px).collect()), fit, ..way };
    }
    if on.len() < needed {
        return Err(MarkError::NotFound { seen: on.len(), views: views.len(), needed });
    }
    let [offset, b_px, c_px] = fit;
    let found_px = b_px.hypot(c_px);
    if (found_px / wall_px - 1.0).abs() > RADIUS_OFF_PERCENT / 100.0 {
        return Err(MarkError::Radius { found_px, wall_px, most_percent: RADIUS_OFF_PERCENT });
    }
    let found_deg = gap_deg(on.iter().map(|(omega, _)| *omega));
    if found_deg > GAP_MOST_DEG {
        return Err(MarkError::Gap { found_deg, most_deg: GAP_MOST_DEG });
    }
    let squares: f64 = on.iter().map(|(omega, s)| (s.v_px - way.row(*omega, axis)).powi(2)).sum();
    let residual_px = (squares / (on.len() as f64 - 3.0)).sqrt();
    if residual_px > RESIDUAL_MOST_PX {
        return Err(MarkError::Residual { found_px: residual_px, most_px: RESIDUAL_MOST_PX });
    }
    let other = |w: &&&Way| (w.u_px - way.u_px).abs() > 2.0 * COLUMN_PX || way.apart(w) > 0.5;
    let rival = around.iter().find(other).map(|w| (w.ink_px / best.ink_px, w.u_px));
    if let Some((share, rival_u_px)) = rival.filter(|(share, _)| *share > RIVAL_MOST) {
        return Err(MarkError::Rival { u_px: way.u_px, rival_u_px, share, most: RIVAL_MOST });
    }
    let found = MarkTrack {
        views: views.len(),
        seen: on.len(),
        u_px: way.u_px,
        axis_px: axis + offset,
        b_px,
        c_px,
        wall_px,
        residual_px,
        out_px: 0.0,
        out_sd_px: 0.0,
        rival,
    };
    Ok(columns(found, &on))
}

/// The image of a circle, tried or fitted.
#[derive(Debug, Clone, Copy)]
struct Way {
    u_px: f64,
    /// Offset down from the middle between the walls, and coefficients of cos and sin of omega, px.
    fit: [f64; 3],
    seen: usize,
    ink_px: f64,
}

impl Way {
    fn row(&self, omega: f64, axis: f64) -> f64 {
        let [a, b, c] = self.fit;
        axis + a + b * omega.cos() + c * omega.sin()
    }

    /// The darkest spot near to the circle.
    fn spot(&self, view: &MarkView, axis: f64, near_px: f64) -> Option<Spot> {
        let row = self.row(view.omega, axis);
        view.spots.iter().find(|s| (s.u_px - self.u_px).abs() < COLUMN_PX && (s.v_px - row).abs() < near_px).copied()
    }

    /// Difference of the phases of two circles, rad.
    fn apart(&self, other: &Self) -> f64 {
        let phase = |w: &Self| w.fit[1].atan2(w.fit[2]);
        let d = phase(self) - phase(other);
        (d - TAU * (d / TAU).round()).abs()
    }
}

/// The best circle through each column that has spots.
fn ways(views: &[MarkView], glass: impl Fn(f64) -> [f64; 2]) -> Vec<Way> {
    let mut columns: Vec<f64> = views.iter().flat_map(|v| v.spots.iter().map(|s| s.u_px)).collect();
    columns.sort_by(f64::total_cmp);
    columns.dedup_by(|a, b| *a - *b < COLUMN_PX / 2.0);
    let best = |u_px: f64| {
        let [axis, wall_px] = glass(u_px);
        let tried = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / PHASES as f64).sin_cos();
            let way = Way { u_px, fit: [0.0, wall_px * sin, wall_px * cos], seen: 0, ink_px: 0.0 };
            let on: Vec<Spot> = views.iter().filter_map(|v| way.spot(v, axis, SOUGHT * wall_px)).collect();
            Way { seen: on.len(), ink_px: on.iter().map(|s| s.ink_px).sum(), ..way }
        };
        (0..PHASES).map(tried).max_by(|a, b| a.ink_px.total_cmp(&b.ink_px))
    };
    columns.into_iter().filter_map(best).collect()
}

/// Least squares of v - axis on 1, cos and sin.
fn circle(on: &[(f64, Spot)], axis: f64) -> Option<[f64; 3]> {
    let row = |(omega, spot): &(f64, Spot)| (Vector3::new(1.0, omega.cos(), omega.sin()), spot.v_px - axis, 1.0);
    statistics::fit(on.iter().map(row), Matrix3::zeros()).map(Into::into)
}

/// Fits the course of u: the roll goes with the row, the perspective with the depth.
fn columns(track: MarkTrack, on: &[(f64, Spot)]) -> MarkTrack {
    let row = |(omega, spot): &(f64, Spot)| {
        let [down, near] = track.at(*omega);
        (Vector3::new(1.0, down, near), spot.u_px, 1.0)
    };
    let normal: Matrix3<f64> = on.iter().map(|s| row(s).0 * row(s).0.transpose()).sum();
    let Some((fit, inverse)) = statistics::fit(on.iter().map(row), Matrix3::zeros()).zip(normal.try_inverse()) else { return track };
    let squares: f64 = on.iter().map(row).map(|(row, u, _)| (u - row.dot(&fit)).powi(2)).sum();
    let variance = squares / (on.len() as f64 - 3.0);
    MarkTrack { u_px: fit[0], out_px: fit[2], out_sd_px: (variance * inverse[(2, 2)]).sqrt(), ..track }
}

/// The widest arc without an angle.
fn gap_deg(omegas: impl Iterator<Item = f64>) -> f64 {
    let mut angles: Vec<f64> = omegas.map(|a| a.rem_euclid(TAU)).collect();
    angles.sort_by(f64::total_cmp);
    angles.extend(angles.first().map(|a| a + TAU));
    angles.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max).to_degrees()
}
