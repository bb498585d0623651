//! Slices at every column, smoothed along the capillary.

use super::corners::{Corners, corners_in_radius};
use super::noise::area_bias_um2;
use super::smoothing::{Change, Smoother};
use crate::calibration::{Fit, Pose, Slice, SliceError, SlicesLost, Support, TurnView, basis, directions, fit, harmonics};
use crate::fins::{FinSlice, SharedFins};
use crate::parallel::prelude::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Slices to either side that the smoothing uses.
const REACH: usize = 8;

/// A slice of the specimen.
#[derive(Debug, Clone)]
pub(crate) struct Section {
    pub x_um: f64,
    /// Its outline without the fins that are known.
    pub support: Support,
    /// What these add. `None` where there are none.
    pub fins: Option<FinSlice>,
    /// Share of the slice's extent that is hollow, in the view that shows most of it.
    pub gap_share: f64,
}

/// A specimen as slices, from left to right.
#[derive(Debug, Clone)]
pub struct Sections {
    pub(crate) slices: Vec<Section>,
    /// Distance of two slices.
    pub(super) step_um: f64,
    /// Root of the mean square distance of the tangents from the fitted outlines.
    pub(super) residual_sd_um: f64,
    pub(super) harmonics: usize,
    /// Whether the specimen extends beyond the image on the left and on the right.
    pub(super) open: [bool; 2],
    /// Variance of the views' shifts, where it is known.
    pub(super) shift_variance_um2: f64,
    /// What corners may add to the mean radius of a slice, as a multiple of the amplitude of its last even harmonic.
    pub(super) corners_in_radius: f64,
    /// Whether fins were looked for.
    pub(crate) are_searched: bool,
    /// What errors of the edges add to the areas of all slices, um^2.
    pub(super) area_bias_um2: f64,
    /// What leaving out each view changes.
    pub(super) without: Vec<Change>,
    /// Share of the volume in slices beyond a hole, which do not count.
    pub(crate) cut_share: f64,
}

/// Directions in which the outline of a slice with fins is taken.
const DIRECTIONS: u32 = 360;

/// The directions, rad.
pub(super) fn all_around(directions: u32) -> impl Iterator<Item = f64> {
    (0..directions).map(move |i| TAU * f64::from(i) / f64::from(directions))
}

impl Section {
    /// Distance of the tangent of the outline whose normal points to `theta` from the axis, um.
    pub fn at(&self, theta: f64) -> f64 {
        self.support.at(theta)[0] + self.fins.as_ref().map_or(0.0, |fins| fins.at(theta))
    }

    /// The series nearest to the outline with its fins, of as many harmonics as that without.
    pub fn outline(&self) -> Support {
        let Some(fins) = &self.fins else { return self.support.clone() };
        let mut coefficients = self.support.coefficients.clone();
        let mut row = vec![0.0; coefficients.len()];
        for theta in all_around(DIRECTIONS) {
            let added = fins.at(theta) / f64::from(DIRECTIONS);
            basis(theta, &mut row);
            for (at, (sum, value)) in coefficients.iter_mut().zip(&row).enumerate() {
                *sum += added * value * if at == 0 { 1.0 } else { 2.0 };
            }
        }
        Support { coefficients }
    }

    /// Perimeter, um: `Int h dtheta`.
    pub fn perimeter_um(&self) -> f64 {
        let fins = self.fins.as_ref().map_or(0.0, |fins| all_around(DIRECTIONS).map(|theta| fins.at(theta)).sum());
        self.support.perimeter_um() + fins * TAU / f64::from(DIRECTIONS)
    }

    /// How its area treats corners. Those of fins that are known are in the outline.
    pub(super) fn corners(&self) -> Corners {
        if self.fins.is_some() { Corners::NotEstimated } else { Corners::of(self.support.coefficients.len() / 2) }
    }

    /// Area, um^2: `1/2 Int (h^2 - h'^2) dtheta`.
    pub fn area_um2(&self) -> f64 {
        if self.fins.is_none() {
            return self.corners().area_um2(&self.support);
        }
        let step = TAU / f64::from(DIRECTIONS);
        let h: Vec<f64> = all_around(DIRECTIONS).map(|theta| self.at(theta)).collect();
        let next = h.iter().skip(1).chain(&h[..1]);
        h.iter().zip(next).map(|(a, b)| a * a - ((b - a) / step).powi(2)).sum::<f64>() * step / 2.0
    }
}

/// Coefficients of the waves that are not counted as shifts of single views: the second and the fourth harmonic of the angle.
const WAVES: usize = 4;
/// Least slices of a specimen.
const SLICES_LEAST: usize = 5;

/// Why views do not show a stretch of slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SectionsError {
    /// No view shows the specimen.
    #[error("no view shows the specimen")]
    NoProfile,
    /// The views have no long enough stretch of slices in common.
    #[error("the longest stretch of slices that the views have in common has {longest}; {SLICES_LEAST} are needed. {lost}")]
    ShortStretch {
        /// Slices of the longest stretch.
        longest: usize,
        /// The slices without an outline, by cause.
        lost: SlicesLost,
    },
    /// Smoothing leaves too few slices.
    #[error("{found} of {of} slices enclose something after they were smoothed along the capillary; {SLICES_LEAST} are needed")]
    FewSmoothed {
        /// Slices left.
        found: usize,
        /// Slices before.
        of: usize,
    },
}

/// Every so many columns a slice is fitted twice, which shows where its tangents touch.
const COARSE: usize = 8;

impl Sections {
    /// The slices that these views show. `sd_um` is the standard deviation of an edge, um; `open` says whether the specimen goes on
    /// beyond the image on the left and on the right.
    ///
    /// # Errors
    /// [`SectionsError`], with the cause.
    pub fn of(pose: &Pose, views: &[TurnView], sd_um: f64, open: [bool; 2]) -> Result<Self, SectionsError> {
        Self::with_fins(pose, views, sd_um, open, &SharedFins::default())
    }

    /// The same with fins, by which the edges of the views were amended. The series then describes the body alone, so it needs no
    /// harmonics for their corners.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub(crate) fn with_fins(
        pose: &Pose,
        views: &[TurnView],
        sd_um: f64,
        open: [bool; 2],
        fins: &SharedFins,
    ) -> Result<Self, SectionsError> {
        let (series, from, to) = span(views)?;
        let omegas: Vec<f64> = views.iter().map(|view| view.omega).collect();
        let coarse: Vec<Option<Support>> = (from..to + 2 * COARSE)
            .into_par_iter()
            .step_by(COARSE)
            .map(|u| touched(pose.slice(u as f64), pose, views, series, sd_um).ok())
            .collect();
        let found: Vec<Result<(Slice, Fit), SliceError>> = (from..=to)
            .into_par_iter()
            .map(|u| {
                let (at, part) = ((u - from) / COARSE, ((u - from) % COARSE) as f64 / COARSE as f64);
                let near = match (&coarse[at], &coarse[at + 1]) {
                    (Some(a), Some(b)) => Some(Support {
                        coefficients: a.coefficients.iter().zip(&b.coefficients).map(|(a, b)| a + part * (b - a)).collect(),
                    }),
                    (Some(a), None) => Some(a.clone()),
                    (None, Some(b)) => Some(b.clone()),
                    (None, None) => None,
                };
                let mut slice = Slice::of(pose.slice(u as f64), pose, views, near.as_ref())?;
                let in_slice = fins.in_slice(slice.x_um);
                if let Some(fins) = in_slice {
                    slice.sights.iter_mut().for_each(|s| s.tangent.offset_um -= fins.at(s.tangent.theta));
                }
                let fit = fit(&slice, series, sd_um, 2)?;
                let fins_um =
                    in_slice.map_or(0.0, |fins| all_around(DIRECTIONS).map(|theta| fins.at(theta)).sum::<f64>() / f64::from(DIRECTIONS));
                if fit.support.coefficients[0] + fins_um > 0.0 { Ok((slice, fit)) } else { Err(SliceError::Empty) }
            })
            .collect();
        // The longest stretch without a hole is the specimen.
        let (start, end) = longest(&found);
        if end - start < SLICES_LEAST {
            return Err(SectionsError::ShortStretch { longest: end - start, lost: SlicesLost::among(&found) });
        }
        let areas = |slices: &[Result<(Slice, Fit), SliceError>]| -> f64 {
            slices.iter().flatten().map(|(_, fit)| fit.support.coefficients[0].powi(2)).sum()
        };
        let cut_share = 1.0 - areas(&found[start..end]) / areas(&found);
        let found: Vec<(Slice, Fit)> = found.into_iter().skip(start).take(end - start).flatten().collect();
        let step_um = (found[found.len() - 1].0.x_um - found[0].0.x_um) / (found.len() - 1) as f64;
        let residuals: Vec<f64> = found.iter().flat_map(|(_, f)| f.residuals.iter().copied()).collect();
        let residual_sd_um = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
        let raw: Vec<Support> = found.iter().map(|(_, f)| f.support.clone()).collect();
        let changes: Vec<Vec<Vec<f64>>> =
            found.par_iter().map(|(slice, fit)| (0..views.len()).map(|view| fit.without(slice, view)).collect()).collect();
        let seen_from = directions(&omegas);
        let smoothed: Vec<Option<(Section, Vec<Change>, f64)>> = (0..raw.len())
            .into_par_iter()
            .map(|at| {
                let smoother = Smoother::new(&raw, at, REACH)?;
                let support = smoother.support()?;
                let slice = &found[at].0;
                let gap = slice.sights.iter().map(|s| s.tangent.gap_px).fold(0.0, f64::max);
                let fins = fins.in_slice(slice.x_um).cloned();
                let mut section = Section { x_um: slice.x_um, support, fins, gap_share: 0.0 };
                let outline = section.outline();
                section.gap_share = gap / pose.camera().ky / (2.0 * outline.coefficients[0]);
                let changes = (0..views.len()).map(|view| smoother.change(&section, &outline, |j| &changes[j][view])).collect();
                let bias_um2 = area_bias_um2(&section, &smoother, &found, at, seen_from);
                Some((section, changes, bias_um2))
            })
            .collect();
        let mut without = vec![Change::default(); views.len()];
        let mut slices = Vec::with_capacity(smoothed.len());
        let mut bias_um2 = 0.0;
        for (section, changes, bias) in smoothed.into_iter().flatten() {
            for (sum, change) in without.iter_mut().zip(&changes) {
                sum.add(change, step_um);
            }
            bias_um2 += bias;
            slices.push(section);
        }
        if slices.len() < SLICES_LEAST {
            return Err(SectionsError::FewSmoothed { found: slices.len(), of: raw.len() });
        }
        Ok(Self {
            slices,
            step_um,
            residual_sd_um,
            harmonics: series,
            open,
            are_searched: fins.is_searched(),
            corners_in_radius: corners_in_radius(&omegas, series),
            shift_variance_um2: shift_variance(pose, views, series),
            area_bias_um2: bias_um2,
            without,
            cut_share,
        })
    }
}

/// Variance of the views' shifts, from their part that is observable and no wave: their mean and odd harmonics are gauge directions, and a
/// shift that varies evenly with the angle, as of rays that the glass turns, is no error of single views.
fn shift_variance(pose: &Pose, views: &[TurnView], series: usize) -> f64 {
    let free = views.len().saturating_sub(1 + 2 * series.div_ceil(2));
    let waves = if free < WAVES + 3 { 0 } else { WAVES };
    let rows = DMatrix::from_fn(views.len(), waves, |i, n| {
        let (sin, cos) = ((2 * (n / 2 + 1)) as f64 * views[i].omega).sin_cos();
        if n % 2 == 0 { cos } else { sin }
    });
    let shifts = DVector::from_iterator(views.len(), views.iter().map(|view| view.dy_px));
    let right = rows.tr_mul(&shifts);
    let explained = rows.tr_mul(&rows).cholesky().map_or(0.0, |normal| right.dot(&normal.solve(&right)));
    let px2 = (shifts.norm_squared() - explained).max(0.0) / (free - waves).max(2) as f64;
    px2 / pose.camera().ky.powi(2)
}

/// Volume and area to a per mille, from every eighth slice without smoothing. It serves to see how they change with the pose.
/// `None` where none of these slices encloses anything.
pub(super) fn rough(pose: &Pose, views: &[TurnView], sd_um: f64) -> Option<[f64; 2]> {
    let (series, from, to) = span(views).ok()?;
    let corners = Corners::of(series);
    let slices: Vec<Option<[f64; 2]>> = (from..to + 1)
        .into_par_iter()
        .step_by(COARSE)
        .map(|u| {
            let support = touched(pose.slice(u as f64), pose, views, series, sd_um).ok()?;
            // A slice at the specimen's end has few edges, and its harmonics may outweigh its radius: such an outline encloses
            // nothing.
            let area_um2 = corners.area_um2(&support);
            (area_um2 > 0.0).then(|| [area_um2, support.perimeter_um()])
        })
        .collect();
    let step_um = pose.slice(to as f64) - pose.slice(from as f64);
    let step_um = step_um * COARSE as f64 / (to - from) as f64;
    let sum = slices.iter().flatten().fold([0.0; 2], |sum, s| [sum[0] + s[0], sum[1] + s[1]]);
    (sum[0] > 0.0).then(|| sum.map(|s| s * step_um))
}

/// Harmonics, and the first and last column in which any view shows the specimen.
fn span(views: &[TurnView]) -> Result<(usize, usize, usize), SectionsError> {
    let omegas: Vec<f64> = views.iter().map(|v| v.omega).collect();
    let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.columns.extent()).collect();
    let ends = extents.iter().map(|e| e.0).min().zip(extents.iter().map(|e| e.1).max());
    let (from, to) = ends.ok_or(SectionsError::NoProfile)?;
    Ok((harmonics(&omegas), from, to.max(from + 1)))
}

/// A slice that is fitted twice: the first fit shows where its tangents touch, and so which column to read.
fn touched(x_um: f64, pose: &Pose, views: &[TurnView], series: usize, sd_um: f64) -> Result<Support, SliceError> {
    let first = fit(&Slice::of(x_um, pose, views, None)?, series, sd_um, 1)?;
    Ok(fit(&Slice::of(x_um, pose, views, Some(&first.support))?, series, sd_um, 1)?.support)
}

/// The longest stretch of slices without a hole, from its first to before its end.
fn longest<T>(found: &[Result<T, SliceError>]) -> (usize, usize) {
    let mut best = (0, 0);
    let mut start = 0;
    for (i, f) in found.iter().enumerate() {
        if f.is_err() {
            start = i + 1;
        } else if i + 1 - start > best.1 - best.0 {
            best = (start, i + 1);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;
    use crate::profile::Columns;
    use std::f64::consts::{FRAC_PI_2, TAU};

    /// Each view shows two bars of 10 px with 4 px between them: a sixth of 24 px is hollow, whatever the scales are.
    #[test]
    fn a_hollow_slice_is_as_hollow_at_any_scale_along_the_capillary() {
        let (width, height) = (80, 60);
        let bars = |v: usize| (18..28).contains(&v) || (32..42).contains(&v);
        let coverage: Vec<u8> =
            (0..width * height).map(|i| if (10..70).contains(&(i % width)) && bars(i / width) { 255 } else { 0 }).collect();
        let columns = Columns::from_coverage(width, height, &coverage);
        for kx in [0.09, 0.18, 0.54] {
            let (ky, f) = (0.18, 60_000.0);
            let camera = Camera {
                f,
                kx,
                ky,
                ux: 40.0,
                uy: 29.5,
                s: 0.0,
                alpha: 0.0,
                gamma: 0.0,
                phi: FRAC_PI_2,
                width: 80,
                height: 60,
                glass: None,
            };
            let views: Vec<TurnView> =
                (0..12).map(|i| TurnView { columns: &columns, omega: TAU * f64::from(i) / 12.0, dy_px: 0.0 }).collect();
            let found = Sections::of(&Pose::new(&camera), &views, 1.0, [false; 2]).unwrap();
            let middle = &found.slices[found.slices.len() / 2];
            // Rays that lean by a thousandth, and a series of few harmonics.
            assert!((middle.gap_share - 4.0 / 24.0).abs() < 0.003, "kx = {kx}: {}", middle.gap_share);
        }
    }
}
