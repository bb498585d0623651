//! Slices at every column, smoothed along the capillary.

use crate::calibration::{Fit, Pose, Slice, Support, TurnView, fit, harmonics};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportSettings {
    /// Slices to either side that one is smoothed with.
    pub reach: usize,
    pub ridge: f64,
    pub most_harmonics: usize,
}

impl Default for SupportSettings {
    fn default() -> Self {
        Self { reach: 8, ridge: 0.0, most_harmonics: 8 }
    }
}

/// A slice of the specimen.
#[derive(Debug, Clone)]
pub struct Section {
    pub x_um: f64,
    pub support: Support,
    /// Of the slice's extent, what is hollow in the view that shows most of it.
    pub gap_share: f64,
}

#[derive(Debug, Clone)]
pub struct Sections {
    pub sections: Vec<Section>,
    pub step_um: f64,
    pub residual_sd_um: f64,
    /// Per view.
    pub without: Vec<Change>,
}

/// Every so many columns a slice is fitted twice, to know where tangents touch.
const COARSE: usize = 8;

impl Sections {
    pub fn of(pose: &Pose, views: &[TurnView], sd_um: f64, settings: SupportSettings) -> Option<Self> {
        let omegas: Vec<f64> = views.iter().map(|v| v.omega).collect();
        let series = harmonics(&omegas).min(settings.most_harmonics);
        let extents: Vec<(usize, usize)> = views.iter().filter_map(|v| v.columns.extent()).collect();
        let (from, to) = (extents.iter().map(|e| e.0).min()?, extents.iter().map(|e| e.1).max()?);
        let fitted = |slice: &Slice, rounds| fit(slice, series, sd_um, settings.ridge, rounds);
        let coarse: Vec<Option<Support>> = (from..=to + COARSE)
            .step_by(COARSE)
            .collect::<Vec<_>>()
            .par_iter()
            .map(|&u| {
                let x_um = pose.slice(u as f64);
                let first = fitted(&Slice::of(x_um, pose, views, None)?, 1)?;
                Some(fitted(&Slice::of(x_um, pose, views, Some(&first.support))?, 1)?.support)
            })
            .collect();
        let found: Vec<Option<(Slice, Fit)>> = (from..=to)
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
                let slice = Slice::of(pose.slice(u as f64), pose, views, near.as_ref())?;
                let fit = fitted(&slice, 2)?;
                (fit.support.coefficients[0] > 0.0).then_some((slice, fit))
            })
            .collect();
        // The longest stretch without a hole is the specimen.
        let (start, end) = longest(&found)?;
        let found: Vec<(Slice, Fit)> = found.into_iter().skip(start).take(end - start).flatten().collect();
        let step_um = (found.last()?.0.x_um - found.first()?.0.x_um) / (found.len().max(2) - 1) as f64;
        let residuals: Vec<f64> = found.iter().flat_map(|(_, f)| f.residuals.iter().copied()).collect();
        let residual_sd_um = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
        let raw: Vec<Support> = found.iter().map(|(_, f)| f.support.clone()).collect();
        let changes: Vec<Vec<Vec<f64>>> =
            found.par_iter().map(|(slice, fit)| (0..views.len()).map(|view| fit.without(slice, view)).collect()).collect();
        let smoothed: Vec<Option<(Section, Vec<Change>)>> = (0..raw.len())
            .into_par_iter()
            .map(|at| {
                let smoother = Smoother::new(&raw, at, settings.reach)?;
                let support = smoother.support()?;
                let slice = &found[at].0;
                let gap = slice.sights.iter().map(|s| s.tangent.gap_px).fold(0.0, f64::max);
                let gap_share = gap * step_um / (2.0 * support.coefficients[0]);
                let changes = (0..views.len()).map(|view| smoother.change(&support, |j| &changes[j][view])).collect();
                Some((Section { x_um: slice.x_um, support, gap_share }, changes))
            })
            .collect();
        let mut without = vec![Change::default(); views.len()];
        let mut sections = Vec::with_capacity(smoothed.len());
        for (section, changes) in smoothed.into_iter().flatten() {
            for (sum, change) in without.iter_mut().zip(&changes) {
                sum.add(change, step_um);
            }
            sections.push(section);
        }
        (sections.len() >= 5).then_some(Self { sections, step_um, residual_sd_um, without })
    }

    pub fn volume_um3(&self) -> f64 {
        let areas: Vec<f64> = self.sections.iter().map(|s| s.support.area_um2()).collect();
        let n = areas.len();
        if n < 2 {
            return 0.0;
        }
        let inner: f64 = areas.windows(2).map(|w| f64::midpoint(w[0], w[1])).sum::<f64>() * self.step_um;
        // The trapezia's own error, from the slopes at both ends.
        let bend = (areas[n - 1] - areas[n - 2] - (areas[1] - areas[0])) * self.step_um / 12.0;
        inner - bend + self.caps().iter().map(|c| c.volume_um3()).sum::<f64>()
    }

    /// What the profiles' errors make of the volume on average: harmonics that are none enclose less (jackknife).
    pub fn volume_bias_um3(&self) -> f64 {
        let n = self.without.len() as f64;
        (n - 1.0) / n * self.without.iter().map(|c| c.square).sum::<f64>()
    }

    pub fn volume_sd_um3(&self) -> f64 {
        jackknife_sd(self.without.iter().map(|c| c.linear))
    }

    pub fn area_sd_um2(&self) -> f64 {
        jackknife_sd(self.without.iter().map(|c| c.outline))
    }

    pub fn area_um2(&self) -> f64 {
        let rings: Vec<f64> = (0..self.sections.len()).map(|i| self.ring(i)).collect();
        let inner: f64 = rings.windows(2).map(|w| f64::midpoint(w[0], w[1])).sum::<f64>() * self.step_um;
        inner + self.caps().iter().map(|c| c.area_um2()).sum::<f64>()
    }

    /// Area of the surface per um of x: Int (h + h'') sqrt(1 + h_x^2) dtheta.
    fn ring(&self, at: usize) -> f64 {
        const DIRECTIONS: u32 = 96;
        let n = self.sections.len();
        let (before, after) = (at.saturating_sub(1), (at + 1).min(n - 1));
        let (a, here, b) = (&self.sections[before].support, &self.sections[at].support, &self.sections[after].support);
        let across = (after - before) as f64 * self.step_um;
        let centred = |s: &Support| -> Vec<f64> {
            let mut c = s.coefficients.clone();
            c.iter_mut().take(3).skip(1).for_each(|x| *x = 0.0);
            c
        };
        let (ca, cb) = (Support { coefficients: centred(a) }, Support { coefficients: centred(b) });
        let ch = Support { coefficients: centred(here) };
        (0..DIRECTIONS)
            .map(|i| {
                let theta = TAU * f64::from(i) / f64::from(DIRECTIONS);
                let radius = here.curvature_radius(theta);
                let (sin, cos) = theta.sin_cos();
                let drift = if here.coefficients.len() > 2 {
                    ((b.coefficients[1] - a.coefficients[1]) * cos + (b.coefficients[2] - a.coefficients[2]) * sin) / across
                } else {
                    0.0
                };
                let h = ch.at(theta)[0].max(1e-6);
                let slope = (cb.at(theta)[0].powi(2) - ca.at(theta)[0].powi(2)) / across / (2.0 * h) + drift;
                radius * slope.hypot(1.0)
            })
            .sum::<f64>()
            * TAU
            / f64::from(DIRECTIONS)
    }

    fn caps(&self) -> [Cap; 2] {
        let n = self.sections.len();
        let squares = |i: usize| self.sections[i].support.coefficients[0].powi(2);
        [(0, 1.min(n - 1)), (n - 1, n.saturating_sub(2))].map(|(end, next)| {
            let fall = ((squares(next) - squares(end)) / self.step_um).max(1e-9);
            let square = self.sections[end].support.area_um2().max(0.0) / std::f64::consts::PI;
            Cap { square_um2: square, length_um: (square / fall).min(2.0 * self.step_um) }
        })
    }
}

fn jackknife_sd(without: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let n = without.len() as f64;
    let mean = without.clone().sum::<f64>() / n;
    ((n - 1.0) / n * without.map(|d| (d - mean).powi(2)).sum::<f64>()).sqrt()
}

/// What lies beyond the last slice: a paraboloid.
#[derive(Debug, Clone, Copy)]
struct Cap {
    /// Of the radius at its base.
    square_um2: f64,
    length_um: f64,
}

impl Cap {
    fn volume_um3(self) -> f64 {
        std::f64::consts::FRAC_PI_2 * self.square_um2 * self.length_um
    }

    fn area_um2(self) -> f64 {
        let (r2, d) = (self.square_um2, self.length_um);
        if d <= 1e-9 {
            return std::f64::consts::PI * r2;
        }
        let r = r2.sqrt();
        std::f64::consts::PI * r / (6.0 * d * d) * ((r2 + 4.0 * d * d).powf(1.5) - r2 * r)
    }
}

fn longest(found: &[Option<(Slice, Fit)>]) -> Option<(usize, usize)> {
    let mut best = (0, 0);
    let mut start = 0;
    for (i, f) in found.iter().enumerate() {
        if f.is_none() {
            start = i + 1;
        } else if i + 1 - start > best.1 - best.0 {
            best = (start, i + 1);
        }
    }
    (best.1 - best.0 >= 5).then_some(best)
}

/// What leaving out a view does to one slice, and, summed up, to the specimen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Change {
    /// To the area of a slice (um^2) or the volume (um^3): in proportion to the change, and its square.
    linear: f64,
    square: f64,
    /// To the perimeter (um) or the area (um^2).
    outline: f64,
}

impl Change {
    fn add(&mut self, other: &Self, step_um: f64) {
        self.linear += other.linear * step_um;
        self.square += other.square * step_um;
        self.outline += other.outline * step_um;
    }
}

/// Each coefficient by the parabola nearest to it and its neighbours. What is smoothed is the centre, the square of the mean
/// radius and the shape, the other harmonics against the radius: where the specimen ends in an ellipsoid, these are a parabola
/// and constants.
struct Smoother<'a> {
    near: &'a [Support],
    first: usize,
    even: Vec<f64>,
    /// A thin slice tells its shape badly.
    by_size: Vec<f64>,
}

impl<'a> Smoother<'a> {
    fn new(raw: &'a [Support], at: usize, reach: usize) -> Option<Self> {
        let window = (2 * reach + 1).min(raw.len());
        let first = at.saturating_sub(reach).min(raw.len() - window);
        let near = &raw[first..first + window];
        let even = parabola(&vec![1.0; window], at - first)?;
        let by_size = parabola(&near.iter().map(|s| s.coefficients[0].powi(2)).collect::<Vec<_>>(), at - first)?;
        Some(Self { near, first, even, by_size })
    }

    fn mean(weights: &[f64], values: impl Iterator<Item = f64>) -> f64 {
        weights.iter().zip(values).map(|(w, v)| w * v).sum()
    }

    /// Nothing beyond the specimen's end, where the parabola falls below nothing.
    fn support(&self) -> Option<Support> {
        let of = |k: usize| self.near.iter().map(move |s| s.coefficients[k]);
        let square = Self::mean(&self.even, of(0).map(|r| r * r));
        let radius = (square > 0.0).then(|| square.sqrt())?;
        let coefficients = (0..self.near[0].coefficients.len()).map(|k| match k {
            0 => radius,
            1 | 2 => Self::mean(&self.even, of(k)),
            _ => radius * Self::mean(&self.by_size, of(k).zip(of(0)).map(|(c, r)| c / r)),
        });
        Some(Support { coefficients: coefficients.collect() })
    }

    /// What changes of the raw slices' coefficients do to the smoothed one's area and perimeter.
    fn change<'c>(&self, smooth: &Support, raw_change: impl Fn(usize) -> &'c [f64]) -> Change {
        let radius = smooth.coefficients[0];
        let near = || self.near.iter().enumerate().map(|(j, s)| (&s.coefficients, raw_change(self.first + j)));
        let wider = Self::mean(&self.even, near().map(|(c, d)| c[0] * d[0])) / radius;
        let mut change = Change { linear: 2.0 * radius * wider, square: wider * wider, outline: 2.0 * PI * wider };
        for k in 3..smooth.coefficients.len() {
            let shape = Self::mean(&self.by_size, near().map(|(c, d)| (d[k] - c[k] / c[0] * d[0]) / c[0]));
            let by = radius * shape + wider * smooth.coefficients[k] / radius;
            let harmonic = k.div_ceil(2) as f64;
            change.linear += (1.0 - harmonic * harmonic) * smooth.coefficients[k] * by;
            change.square += (1.0 - harmonic * harmonic) / 2.0 * by * by;
        }
        change.linear *= PI;
        change.square *= PI;
        change
    }
}

/// What each of some even places counts, by its weight, in the value at place `at` of the parabola nearest to them.
fn parabola(weights: &[f64], at: usize) -> Option<Vec<f64>> {
    let row = |i: usize| {
        let u = i as f64 - at as f64;
        Vector3::new(1.0, u, u * u)
    };
    let normal: Matrix3<f64> = weights.iter().enumerate().map(|(i, w)| *w * row(i) * row(i).transpose()).sum();
    let first = normal.cholesky()?.solve(&Vector3::x());
    Some(weights.iter().enumerate().map(|(i, w)| w * row(i).dot(&first)).collect())
}
