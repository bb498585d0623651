//! The evidence of all views at each point of a slice where the free edge of a fin may be.
//!
//! ```text
//!   slice:   centre + r (cos phi, sin phi)      every view in which the point stands out of what is known there adds its response
//!            from the body outwards             T = sum of responses / sqrt(views)
//! ```

use super::body::Known;
use super::{FinSlice, centre};
use crate::geometry::Lookup;
use crate::parallel::prelude::*;
use crate::profile::FinBorders;
use crate::statistics::upper_median;
use std::f64::consts::TAU;

/// Directions in which a slice is searched.
pub(super) const DIRECTIONS: usize = 180;
/// Depth from the body's edge within which fins are searched, px. A radius step is one px.
const REACH_PX: f64 = 36.0;
/// A point counts in a view from this far beyond the margin of the body's blur on, px.
const BEYOND_PX: f64 = 1.6;
/// Least radius, px: within it the directions are not apart.
const RADIUS_LEAST_PX: f64 = 6.0;
/// Fewest half-views that tell anything.
const VIEWS_LEAST: u16 = 3;
/// Evidence that neither speaks for a fin nor against it, at least, and per root of the number of half-views. Where only few of
/// them show the point, each must show more.
const BAR: f32 = 2.5;
const BAR_PER_VIEW: f32 = 0.9;
const BAR_PER_VIEW_FEW: f32 = 1.6;
/// Share of the half-views below which they are few.
pub(super) const FEW: f64 = 0.15;

/// Largest median evidence of all points that as many half-views show, in the turns that the bars of the search were set with.
const USUAL: f32 = 0.7;
/// One in so many points is asked for it, and at least so many are needed.
const EVERY: usize = 7;
const POINTS_LEAST: usize = 200;

/// One view as it is pooled.
#[derive(Debug, Clone)]
pub(super) struct Sight<'a> {
    pub borders: &'a FinBorders,
    pub lookup: Lookup,
    /// Rows of the upper and lower edge of what is known, by column. NaN where nothing is known.
    pub edges: Vec<[f64; 2]>,
}

/// A slice that is searched.
#[derive(Debug, Clone)]
pub(super) struct Station {
    pub x_um: f64,
    /// y and z of the body's centre, um.
    pub centre_um: [f64; 2],
    /// The radius steps that are searched in each direction.
    radii: Vec<(u16, u16)>,
}

/// The evidence in one slice, by direction and radius step.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    /// Sum of the responses over the root of their number.
    pub pooled: Vec<f32>,
    /// Number of half-views that show the point.
    pub views: Vec<u16>,
    /// Evidence beyond that of chance. Negative infinity where there can be no fin.
    pub score: Vec<f32>,
}

impl Evidence {
    /// Mean response of the half-views in a cell, in their standard deviations.
    pub fn response(&self, cell: usize) -> f64 {
        f64::from(self.pooled[cell]) / f64::from(self.views[cell].max(1)).sqrt()
    }
}

/// The points that are searched.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    pub stations: Vec<Station>,
    /// Number of radius steps.
    pub radii: usize,
    pub step_um: f64,
    /// Cosine and sine of each direction.
    pub directions: Vec<[f64; 2]>,
    /// What is taken off the evidence of so many half-views.
    excess: Vec<f32>,
}

impl Grid {
    /// Every `step`-th slice around its body, in a bore of radius `bore_um`. `margin_px` is the margin of the body's blur.
    pub fn new(slices: &[FinSlice], step: usize, bore_um: f64, margin_px: f64, px_um: f64) -> Self {
        let angle = |a: usize| a as f64 * TAU / DIRECTIONS as f64;
        let directions: Vec<[f64; 2]> = (0..DIRECTIONS).map(|a| [angle(a).cos(), angle(a).sin()]).collect();
        let stations: Vec<Station> = slices
            .iter()
            .step_by(step)
            .map(|slice| {
                let [y, z] = centre(&slice.body);
                let range = |(a, [cos, sin]): (usize, &[f64; 2])| {
                    let beside = y * cos + z * sin;
                    let body_px = (slice.body.at(angle(a))[0] - beside) / px_um;
                    let first = (body_px + margin_px + BEYOND_PX).max(RADIUS_LEAST_PX);
                    // The ray leaves the bore where |centre + r n| = bore.
                    let is_known = slice.known != Known::Nothing;
                    let room = if is_known { beside * beside - (y * y + z * z) + bore_um * bore_um } else { 0.0 };
                    let last = if room > 0.0 { ((room.sqrt() - beside) / px_um).min(first + REACH_PX) } else { 0.0 };
                    let first = first.ceil() as u16;
                    (first, (last.floor().max(0.0) as u16 + 1).max(first))
                };
                Station { x_um: slice.x_um, centre_um: [y, z], radii: directions.iter().enumerate().map(range).collect() }
            })
            .collect();
        let radii = stations.iter().flat_map(|s| &s.radii).filter(|r| r.1 > r.0).map(|r| usize::from(r.1)).max().unwrap_or(0);
        Self { stations, radii, step_um: px_um, directions, excess: Vec::new() }
    }

    /// The point in a direction at a radius step of a station, y and z in um.
    pub fn point(&self, at: usize, direction: usize, radius_px: f64) -> [f64; 2] {
        let ([y, z], [cos, sin], r) = (self.stations[at].centre_um, self.directions[direction], radius_px * self.step_um);
        [y + r * cos, z + r * sin]
    }

    /// The evidence of these views in a station.
    pub fn pooled(&self, at: usize, sights: &[Sight]) -> Evidence {
        let (station, radii) = (&self.stations[at], self.radii);
        let cells = DIRECTIONS * radii;
        let (mut pooled, mut views) = (vec![0.0f32; cells], vec![0u16; cells]);
        for sight in sights {
            self.add(station, sight, &mut pooled, &mut views);
        }
        let few = (FEW * 2.0 * sights.len() as f64) as f32;
        let score = pooled
            .iter_mut()
            .zip(&views)
            .map(|(sum, &n)| {
                if n < VIEWS_LEAST {
                    return f32::NEG_INFINITY;
                }
                let root = f32::from(n).sqrt();
                *sum = *sum / root - self.excess.get(usize::from(n)).unwrap_or(&0.0);
                *sum - BAR.max(root * if f32::from(n) < few { BAR_PER_VIEW_FEW } else { BAR_PER_VIEW })
            })
            .collect();
        Evidence { pooled, views, score }
    }

    /// Adds the responses of one view.
    fn add(&self, station: &Station, sight: &Sight, sums: &mut [f32], views: &mut [u16]) {
        let Station { x_um, centre_um: [y, z], radii } = station;
        let rows = sight.lookup.rows();
        let image = |y: f64, z: f64| {
            let [y, z] = sight.lookup.apparent([y, z]);
            rows.map(|r| r[0] * x_um + r[1] * y + r[2] * z + r[3])
        };
        let base = image(*y, *z);
        if base[2] <= 0.0 {
            return;
        }
        let middle = base[1] / base[2];
        let least = sight.borders.margin_px() + BEYOND_PX;
        for (a, (&(first, end), [cos, sin])) in radii.iter().zip(&self.directions).enumerate() {
            if end <= first {
                continue;
            }
            let seen = |j: f64| {
                let [u, v, w] = image(y + j * self.step_um * cos, z + j * self.step_um * sin);
                (w > 0.0).then(|| (u / w, v / w))
            };
            let last = f64::from(end - 1);
            // Along a ray across the slice the row changes evenly, through glass by a parabola, and the column by less than a px.
            let (Some((_, v_first)), Some((_, v_last)), Some((u, v_middle))) =
                (seen(f64::from(first)), seen(last), seen(f64::midpoint(f64::from(first), last)))
            else {
                continue;
            };
            let lower = v_last > middle;
            let sign = if lower { 1.0 } else { -1.0 };
            let column = u.round();
            if !(column >= 0.0 && column < sight.edges.len() as f64) {
                continue;
            }
            let column = column as usize;
            let edge = sight.edges[column][usize::from(lower)];
            let edge = if edge.is_nan() { middle } else { edge };
            let per_step = if end - first > 1 { (v_last - v_first) / (last - f64::from(first)) } else { 0.0 };
            // The first step that stands out far enough.
            let (out, gain) = (sign * (v_first - edge), sign * per_step);
            let begin = if out >= least {
                first
            } else if sign * (v_last - edge) < least || gain <= 0.0 {
                continue;
            } else {
                (first + ((least - out) / gain).ceil() as u16).min(end)
            };
            let (top, responses) = sight.borders.column(column, lower);
            let cells = a * self.radii + usize::from(begin)..a * self.radii + usize::from(end);
            // How far the parabola is beside the straight line, per square of a step.
            let steps = last - f64::from(first);
            let bend = if steps > 1.0 { 4.0 * (f64::midpoint(v_first, v_last) - v_middle) / (steps * steps) } else { 0.0 };
            let at = f64::from(begin - first);
            let mut row = (v_first + at * per_step - bend * at * (steps - at) - top as f64) as f32;
            let (mut per_step, bend) = ((per_step + bend * (2.0 * at + 1.0 - steps)) as f32, 2.0 * bend as f32);
            for (sum, n) in sums[cells.clone()].iter_mut().zip(&mut views[cells]) {
                let whole = row.floor();
                let index = whole as usize;
                if whole >= 0.0
                    && index + 1 < responses.len()
                    && let Some(response) = FinBorders::between(responses[index], responses[index + 1], row - whole)
                {
                    *sum += response;
                    *n += 1;
                }
                row += per_step;
                per_step += bend;
            }
        }
    }

    /// The evidence in all stations. Light and dust that turn with the glass show something at every point, in some turns more than in others:
    /// what all points show beyond the usual is taken off, here and from now on.
    pub fn without_excess(&mut self, sights: &[Sight]) -> Vec<Evidence> {
        let mut evidence = self.all(0..self.stations.len(), sights);
        let mut by_views = vec![Vec::new(); 2 * sights.len() + 1];
        for e in &evidence {
            for cell in (0..e.views.len()).step_by(EVERY).filter(|&cell| e.views[cell] >= VIEWS_LEAST) {
                by_views[usize::from(e.views[cell])].push(f64::from(e.pooled[cell]));
            }
        }
        let excess = |n: usize| {
            let reach = (n / 4).max(1);
            let near: Vec<f64> = by_views[n.saturating_sub(reach)..(n + reach + 1).min(by_views.len())].concat();
            if near.len() < POINTS_LEAST { 0.0 } else { (upper_median(near) as f32 - USUAL).max(0.0) }
        };
        self.excess = (0..by_views.len()).into_par_iter().map(excess).collect();
        for Evidence { pooled, views, score } in &mut evidence {
            for ((pooled, score), &n) in pooled.iter_mut().zip(score).zip(&*views) {
                *pooled -= self.excess[usize::from(n)];
                *score -= self.excess[usize::from(n)];
            }
        }
        evidence
    }

    /// The evidence in these stations.
    pub fn all(&self, stations: std::ops::Range<usize>, sights: &[Sight]) -> Vec<Evidence> {
        stations.into_par_iter().map(|at| self.pooled(at, sights)).collect()
    }
}
