//! From a set of pixels to an outline at sub-pixel position, and back to a mask.
//!
//! ```text
//!      cracks between pixels -> smoothed, 1 px steps -> profile of darkness along each normal
//!                                                              |
//!   outside ___________                                        v
//!                      \  e: where background turns into specimen, by a least-squares fit of
//!   inside              \_____     height * step(s - e) + rim * decay(s - e), blurred, neither below 0
//!                                                              |
//!      one e per step, chosen together (neighbours differ little) -> polygon -> pixel centres inside -> mask
//! ```
//! A pixel's width of dilation is 7 % of a larva's volume, so the edge is not where a threshold is crossed, which moves with
//! contrast, but where the fitted step stands, whatever its height.

use super::plane::{Plane, gaussian};
use super::settings::EdgeSettings;
use serde::{Deserialize, Serialize};

/// A closed outline in pixel coordinates (pixel centres at integers), the last vertex joined to the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Polygon {
    pub vertices: Vec<[f64; 2]>,
}

impl Polygon {
    /// Area enclosed, px^2.
    pub fn area_px2(&self) -> f64 {
        let n = self.vertices.len();
        let cross = |i: usize| {
            let ([u0, v0], [u1, v1]) = (self.vertices[i], self.vertices[(i + 1) % n]);
            u0 * v1 - u1 * v0
        };
        (0..n).map(cross).sum::<f64>().abs() / 2.0
    }
}

/// How sure one vertex of the refined outline is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePoint {
    /// Height of the fitted step, in standard deviations of one pixel's noise.
    pub contrast: f64,
    /// Standard error of the position, px; infinite where nothing could be fitted.
    pub error_px: f64,
    /// The vertex lies on a wall or on the frame's border, where the specimen's own edge cannot be seen.
    pub bounded: bool,
}

/// Follows the cracks around each connected set of true pixels: outer outlines only, clockwise on the screen.
pub(super) fn trace(inside: &[bool], width: usize, top: usize) -> Vec<Vec<[f64; 2]>> {
    let height = inside.len() / width;
    let is = |u: isize, v: isize| {
        (0..width as isize).contains(&u) && (0..height as isize).contains(&v) && inside[v as usize * width + u as usize]
    };
    // A crack that runs rightwards has an inside pixel below it and an outside pixel above it.
    let mut used = vec![false; inside.len()];
    let mut outlines = Vec::new();
    for start in 0..inside.len() {
        let (u, v) = ((start % width) as isize, (start / width) as isize);
        if used[start] || !is(u, v) || is(u, v - 1) {
            continue;
        }
        let (mut corner, mut way) = ((u, v), (1isize, 0isize));
        let mut outline = Vec::new();
        loop {
            outline.push([corner.0 as f64 - 0.5, corner.1 as f64 - 0.5 + top as f64]);
            if way == (1, 0) {
                used[corner.1 as usize * width + corner.0 as usize] = true;
            }
            corner = (corner.0 + way.0, corner.1 + way.1);
            // The pixels ahead of the corner, on the left (outside) and on the right (inside) of the way.
            let ahead = |side: (isize, isize)| {
                let u = corner.0 + (way.0 + side.0 - 1).div_euclid(2);
                let v = corner.1 + (way.1 + side.1 - 1).div_euclid(2);
                is(u, v)
            };
            let (left, right) = ((way.1, -way.0), (-way.1, way.0));
            way = if ahead(left) {
                left
            } else if ahead(right) {
                way
            } else {
                right
            };
            if corner == (u, v) && way == (1, 0) {
                break;
            }
        }
        let signed: f64 = (0..outline.len())
            .map(|i| {
                let ([u0, v0], [u1, v1]): ([f64; 2], [f64; 2]) = (outline[i], outline[(i + 1) % outline.len()]);
                u0 * v1 - u1 * v0
            })
            .sum();
        if signed > 0.0 {
            outlines.push(outline);
        }
    }
    outlines
}

/// Cyclic Gaussian smoothing.
fn smooth_cyclic(values: &[f64], sigma: f64) -> Vec<f64> {
    let kernel = gaussian(sigma);
    let (n, reach) = (values.len(), kernel.len() / 2);
    (0..n)
        .map(|i| kernel.iter().enumerate().map(|(k, &w)| f64::from(w) * values[(i + k + n * (reach / n + 1) - reach) % n]).sum())
        .collect()
}

/// Vertices at equal steps of about `step` along a closed outline.
fn resample(outline: &[[f64; 2]], step: f64) -> Vec<[f64; 2]> {
    let n = outline.len();
    let side = |i: usize| {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    };
    let length: f64 = (0..n).map(side).sum();
    let count = ((length / step).round() as usize).max(8);
    let mut out = Vec::with_capacity(count);
    let (mut i, mut before) = (0, 0.0);
    for k in 0..count {
        let target = length * k as f64 / count as f64;
        while i + 1 < n && before + side(i) < target {
            before += side(i);
            i += 1;
        }
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        let part = ((target - before) / side(i).max(1e-12)).clamp(0.0, 1.0);
        out.push([a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]);
    }
    out
}

/// Smooths the staircase of cracks away and resamples it at 1 px.
fn smooth_outline(outline: &[[f64; 2]], sigma_px: f64) -> Vec<[f64; 2]> {
    let axis = |c: usize| smooth_cyclic(&outline.iter().map(|p| p[c]).collect::<Vec<_>>(), sigma_px);
    let (u, v) = (axis(0), axis(1));
    let smooth: Vec<[f64; 2]> = u.into_iter().zip(v).map(|(u, v)| [u, v]).collect();
    resample(&smooth, 1.0)
}

/// Unit normals that point inside a clockwise outline.
fn normals(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let n = points.len();
    (0..n)
        .map(|i| {
            let (a, b) = (points[(i + n - 2) % n], points[(i + 2) % n]);
            let (du, dv) = (b[0] - a[0], b[1] - a[1]);
            let length = du.hypot(dv).max(1e-9);
            [-dv / length, du / length]
        })
        .collect()
}

/// Samples along a normal: from `-REACH_PX` outside to `REACH_PX` inside.
const PER_PX: usize = 2;
pub(super) const REACH_PX: usize = 9;
const SAMPLES: usize = 2 * REACH_PX * PER_PX + 1;
/// Positions that the fit tries per px.
const SHIFTS_PER_PX: usize = 4;

/// What the fit says of one shift at one vertex.
#[derive(Clone, Copy)]
struct Fit {
    /// Share of the samples' energy left unexplained, weighed so that a strong edge counts more.
    cost: f32,
    contrast: f32,
}

/// Length over which the dark rim decays that an edge shows in bright field where it bends the light away. A fin's rim is
/// thinner than the blur; a round body's is wider than the window, and the step stands for it.
const RIM_PX: f64 = 0.5;

/// The blurred step and rim at every shift, ready to be fitted: least squares by two dot products. Both rise at the edge and
/// may not be negative, so that no mixture of them puts the edge elsewhere.
struct Model {
    shifts: Vec<f64>,
    /// Per shift: the samples of its window, and step and rim over all samples.
    windows: Vec<(std::ops::Range<usize>, [f32; SAMPLES], [f32; SAMPLES])>,
}

impl Model {
    /// For edges that `sigma` px of blur have spread.
    fn new(sigma: f64, settings: &EdgeSettings) -> Self {
        let per_px = SHIFTS_PER_PX as f64;
        let (first, last) = ((-settings.search_outside_px * per_px).round() as i32, (settings.search_inside_px * per_px).round() as i32);
        let shifts: Vec<f64> = (first..=last.max(first)).map(|k| f64::from(k) / per_px).collect();
        let index = |s: f64| ((s + REACH_PX as f64) * PER_PX as f64).round().clamp(0.0, (SAMPLES - 1) as f64) as usize;
        let windows = shifts
            .iter()
            .map(|&e| {
                let (from, to) = (index(e - settings.outside_px), index(e + settings.inside_px));
                let s = |k: usize| k as f64 / PER_PX as f64 - REACH_PX as f64 - e;
                let step = std::array::from_fn(|k| normal_cdf(s(k) / sigma) as f32);
                // An exponential that starts at the edge, convolved with the blur.
                let decay = |s: f64| (sigma * sigma / (2.0 * RIM_PX * RIM_PX) - s / RIM_PX).exp() * normal_cdf(s / sigma - sigma / RIM_PX);
                // Far from the edge the formula is a huge number times nearly nothing; there is no rim there.
                let rim = std::array::from_fn(|k| if s(k).abs() < 8.0 * sigma { decay(s(k)) as f32 } else { 0.0 });
                (from..to + 1, step, rim)
            })
            .collect();
        Self { shifts, windows }
    }

    /// Least squares of the samples on step and rim at shift `k`, in that shift's own window.
    fn fit(&self, k: usize, samples: &[f32], noise2: f32) -> Fit {
        let window = self.windows[k].0.clone();
        let (a, c, yy, explained) = self.solve(k, samples, &window);
        Fit { cost: (yy - 2.0 * explained) / (noise2 * window.len() as f32 + yy), contrast: a + c }
    }

    /// Follows the residual from shift `k` down to its least value near by, in `window` for all shifts, so that they explain
    /// the same samples; then between the shifts by a parabola. Gives the place, in shifts, and the residual there.
    fn settle(&self, k: usize, samples: &[f32], window: &std::ops::Range<usize>) -> (f64, f64) {
        const NEAR: usize = 4;
        let residual = |k: usize| {
            let (_, _, yy, explained) = self.solve(k, samples, window);
            f64::from(yy - explained)
        };
        let (first, last) = (k.saturating_sub(NEAR), (k + NEAR).min(self.shifts.len() - 1));
        let row: Vec<f64> = (first..=last).map(residual).collect();
        let best = (0..row.len()).min_by(|&a, &b| row[a].total_cmp(&row[b])).unwrap_or(0);
        if best == 0 || best + 1 == row.len() {
            return ((first + best) as f64, row[best]);
        }
        let (a, b, c) = (row[best - 1], row[best], row[best + 1]);
        let bend = a - 2.0 * b + c;
        let part = if bend <= 1e-9 { 0.0 } else { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) };
        ((first + best) as f64 + part, b - 0.25 * (a - c) * part)
    }

    /// Heights of step and rim, the energy of the samples in `window`, and what of it the two explain.
    fn solve(&self, k: usize, samples: &[f32], window: &std::ops::Range<usize>) -> (f32, f32, f32, f32) {
        let (_, step, rim) = &self.windows[k];
        let window = window.start.min(samples.len())..window.end.min(samples.len());
        let (mut ss, mut sr, mut rr, mut ys, mut yr, mut yy) = (1e-6f32, 0.0, 1e-6f32, 0.0, 0.0, 0.0);
        for ((&y, &s), &r) in samples[window.clone()].iter().zip(&step[window.clone()]).zip(&rim[window]) {
            ss += s * s;
            sr += s * r;
            rr += r * r;
            ys += y * s;
            yr += y * r;
            yy += y * y;
        }
        let det = (ss * rr - sr * sr).max(1e-6);
        let (mut a, mut c) = ((ys * rr - yr * sr) / det, (yr * ss - ys * sr) / det);
        if a < 0.0 {
            (a, c) = (0.0, (yr / rr).max(0.0));
        } else if c < 0.0 {
            (a, c) = ((ys / ss).max(0.0), 0.0);
        }
        // Twice the product less the square: right also where a height was held at 0.
        let explained = 2.0 * (a * ys + c * yr) - (a * a * ss + 2.0 * a * c * sr + c * c * rr);
        (a, c, yy, explained)
    }
}

fn normal_pdf(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Abramowitz and Stegun 26.2.17, within 7.5e-8.
fn normal_cdf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let poly = t * (0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let upper = normal_pdf(x) * poly;
    if x >= 0.0 { 1.0 - upper } else { upper }
}

/// What limits a refined edge besides the picture itself.
pub(super) struct Limits<'a> {
    /// Pixels of the window that belong to the specimen, for the local thickness.
    pub inside: &'a [bool],
    /// Lowest and highest row that an edge may have in a column: the walls' inner lines.
    pub rows: &'a dyn Fn(f64) -> (f64, f64),
}

/// An outline with what is seen along its normals and the shift chosen at each vertex.
struct Followed {
    points: Vec<[f64; 2]>,
    inward: Vec<[f64; 2]>,
    /// Darkness along each normal, as far as half the way through the specimen.
    seen: Vec<Vec<f32>>,
    /// Shift of the configured model, and the step's height there.
    chosen: Vec<(usize, f64)>,
    at_border: Vec<bool>,
}

/// Follows an outline to where the darkness steps up, with the configured blur.
fn follow(cracks: &[[f64; 2]], darkness: &Plane, limits: &Limits, model: &Model, settings: &EdgeSettings) -> Followed {
    let points = smooth_outline(cracks, settings.outline_smoothing_px);
    let inward = normals(&points);
    let samples = straighten(&points, &inward, darkness, settings);
    let noise2 = noise2(settings);
    let last_u = (darkness.width - 1) as f64;
    let at_border: Vec<bool> = points.iter().map(|p| p[0] < 0.5 || p[0] > last_u - 0.5).collect();
    let seen: Vec<Vec<f32>> = points
        .iter()
        .zip(&inward)
        .zip(&samples)
        .map(|((p, n), profile)| {
            let deep = half_thickness(p, n, darkness, limits.inside);
            let upto = ((REACH_PX as f64 + deep) * PER_PX as f64) as usize + 1;
            profile[..upto.min(SAMPLES)].to_vec()
        })
        .collect();
    let fits: Vec<Vec<Fit>> = at_border
        .iter()
        .zip(&seen)
        .map(|(border, seen)| {
            (0..model.shifts.len())
                .map(|k| {
                    if *border {
                        // The frame's border is no edge of the specimen: the outline stays where it is.
                        return Fit { cost: model.shifts[k].abs() as f32, contrast: 0.0 };
                    }
                    model.fit(k, seen, noise2)
                })
                .collect()
        })
        .collect();
    let chosen = choose(&fits, settings.stiffness as f32).iter().zip(&fits).map(|(&k, f)| (k, f64::from(f[k].contrast).abs())).collect();
    Followed { points, inward, seen, chosen, at_border }
}

/// The edge of which the blur is told: so high a step that noise adds nothing, seen to its full depth.
const BLUR_CONTRAST: f64 = 20.0;
/// Fewer vertices than this don't tell a frame's blur.
const BLUR_VERTICES: usize = 100;
const BLUR_STEP_PX: f64 = 0.1;
/// Softness that a specimen's edge has by itself and averaging along it adds, px: on the emulated rig the best fit of a
/// larva stands at 1.17 px where the edge is placed right with 1.0 px, and 1.0 of 1.17 is left when squares are subtracted.
const OWN_BLUR_PX: f64 = 0.61;

/// The blur of a frame, px: that at which the models explain its clear edges best, all vertices together; none where too
/// few are clear or the best lies at an end of the range.
fn blur_px(outlines: &[Followed], settings: &EdgeSettings) -> Option<f64> {
    let clear: Vec<(&[f32], usize, f64)> = outlines
        .iter()
        .flat_map(|o| o.seen.iter().zip(&o.chosen).zip(&o.at_border))
        .filter(|((seen, (_, contrast)), border)| !*border && *contrast >= BLUR_CONTRAST && seen.len() + 4 >= SAMPLES)
        .map(|((seen, (k, contrast)), _)| (&seen[..], *k, *contrast))
        .collect();
    if clear.len() < BLUR_VERTICES {
        return None;
    }
    let residual = |sigma: f64| {
        let model = Model::new(sigma, settings);
        clear.iter().map(|(seen, k, contrast)| model.settle(*k, seen, &model.windows[*k].0).1 / (contrast * contrast)).sum::<f64>()
    };
    let row: Vec<(f64, f64)> = (5..=22).map(|k| f64::from(k) * BLUR_STEP_PX).map(|sigma| (sigma, residual(sigma))).collect();
    let best = (0..row.len()).min_by(|&a, &b| row[a].1.total_cmp(&row[b].1))?;
    if best == 0 || best + 1 == row.len() {
        return None;
    }
    let (a, b, c) = (row[best - 1].1, row[best].1, row[best + 1].1);
    let bend = a - 2.0 * b + c;
    let found = row[best].0 + if bend > 0.0 { BLUR_STEP_PX * 0.5 * (a - c) / bend } else { 0.0 };
    Some((found * found - OWN_BLUR_PX * OWN_BLUR_PX).max(0.0).sqrt())
}

/// Variance that averaging along the outline leaves of a pixel's noise.
fn noise2(settings: &EdgeSettings) -> f32 {
    1.0 / (2.0 * std::f32::consts::PI.sqrt() * settings.along_px as f32).max(1.0)
}

impl Followed {
    /// Places the edge between the shifts.
    fn place(&self, width: usize, limits: &Limits, model: &Model, settings: &EdgeSettings) -> (Polygon, Vec<EdgePoint>) {
        let last_u = (width - 1) as f64;
        let shifts: Vec<f64> = self
            .seen
            .iter()
            .zip(&self.chosen)
            .zip(&self.at_border)
            .map(|((seen, (k, _)), border)| {
                let at = if *border { *k as f64 } else { model.settle(*k, seen, &model.windows[*k].0).0 };
                model.shifts[0] + at / SHIFTS_PER_PX as f64
            })
            .collect();
        let shifts = smooth_cyclic(&shifts, settings.shift_smoothing_px);
        let mut vertices = Vec::with_capacity(self.points.len());
        let mut record = Vec::with_capacity(self.points.len());
        for (i, (p, n)) in self.points.iter().zip(&self.inward).enumerate() {
            let u = (p[0] + shifts[i] * n[0]).clamp(-0.5, last_u + 0.5);
            let (least, most) = (limits.rows)(u);
            let free = p[1] + shifts[i] * n[1];
            let v = free.max(least).min(most);
            let contrast = self.chosen[i].1;
            // A blurred step of height a under white noise of 1 is placed to sqrt(2 sqrt(pi) blur) / a per sample and pixel;
            // averaging along the outline divides by the root of what it averages.
            let spread = (2.0 * std::f64::consts::PI.sqrt() * settings.blur_px).sqrt() * f64::from(noise2(settings)).sqrt();
            let error_px = if contrast > 0.0 { spread / contrast } else { f64::INFINITY };
            let bounded = self.at_border[i] || free - least < 0.5 || most - free < 0.5;
            vertices.push([u, v]);
            record.push(EdgePoint { contrast, error_px, bounded });
        }
        (Polygon { vertices }, record)
    }
}

/// Moves outlines to where the darkness steps up, and says how blurred they are.
pub(super) fn refine(outlines: &[Vec<[f64; 2]>], darkness: &Plane, limits: &Limits, settings: &EdgeSettings) -> Refined {
    let model = Model::new(settings.blur_px, settings);
    let followed: Vec<Followed> = outlines.iter().map(|o| follow(o, darkness, limits, &model, settings)).collect();
    let (edge, points) = followed.iter().map(|f| f.place(darkness.width, limits, &model, settings)).unzip();
    Refined { edge, points, blur_px: blur_px(&followed, settings) }
}

/// What [`refine`] finds.
pub(super) struct Refined {
    pub edge: Vec<Polygon>,
    /// How sure each vertex of each outline is.
    pub points: Vec<Vec<EdgePoint>>,
    /// The frame's blur as its edges tell it; none where they don't.
    pub blur_px: Option<f64>,
}

/// Darkness along every normal, averaged along the outline.
fn straighten(points: &[[f64; 2]], inward: &[[f64; 2]], darkness: &Plane, settings: &EdgeSettings) -> Vec<[f32; SAMPLES]> {
    let raw: Vec<[f32; SAMPLES]> = points
        .iter()
        .zip(inward)
        .map(|(p, n)| {
            std::array::from_fn(|k| {
                let s = k as f64 / PER_PX as f64 - REACH_PX as f64;
                darkness.sample(p[0] + s * n[0], p[1] + s * n[1])
            })
        })
        .collect();
    let kernel = gaussian(settings.along_px);
    let (count, reach) = (raw.len(), kernel.len() / 2);
    (0..count)
        .map(|i| {
            let mut mean = [0.0f32; SAMPLES];
            for (k, &w) in kernel.iter().enumerate() {
                let from = &raw[(i + k + count * (reach / count + 1) - reach) % count];
                for (m, r) in mean.iter_mut().zip(from) {
                    *m += w * r;
                }
            }
            mean
        })
        .collect()
}

/// Half the way through the specimen along a normal: the fit must not look out of the other side of a fin.
fn half_thickness(p: &[f64; 2], n: &[f64; 2], window: &Plane, inside: &[bool]) -> f64 {
    let is = |s: f64| {
        let (u, v) = ((p[0] + s * n[0]).round(), (p[1] + s * n[1]).round() - window.top as f64);
        u >= 0.0 && v >= 0.0 && u < window.width as f64 && v < window.height as f64 && inside[v as usize * window.width + u as usize]
    };
    let thick = (1..=2 * REACH_PX).take_while(|&s| is(s as f64)).count();
    (thick as f64 / 2.0).max(1.0)
}

/// One shift per vertex: the cheapest closed path in which neighbours differ by at most two states.
fn choose(fits: &[Vec<Fit>], stiffness: f32) -> Vec<usize> {
    // Going round twice and keeping the second half closes the path: what the start was forgets itself within a few steps.
    let (n, states) = (fits.len(), fits[0].len());
    let mut cost = vec![0.0f32; states];
    let mut came: Vec<Vec<u8>> = Vec::with_capacity(2 * n);
    for i in 0..2 * n {
        let mut next = vec![f32::INFINITY; states];
        let mut from = vec![0u8; states];
        for (k, slot) in next.iter_mut().enumerate() {
            for (j, before) in cost.iter().enumerate().take(k + 3).skip(k.saturating_sub(2)) {
                let apart = (j as f32 - k as f32) / SHIFTS_PER_PX as f32;
                let total = before + stiffness * apart * apart;
                if total < *slot {
                    *slot = total;
                    from[k] = (j + 2 - k) as u8;
                }
            }
            *slot += fits[i % n][k].cost;
        }
        let least = next.iter().copied().fold(f32::INFINITY, f32::min);
        cost = next.iter().map(|c| c - least).collect();
        came.push(from);
    }
    let mut k = (0..states).min_by(|&a, &b| cost[a].total_cmp(&cost[b])).unwrap_or(0);
    let mut path = vec![0; 2 * n];
    for i in (0..2 * n).rev() {
        path[i] = k;
        k = k + usize::from(came[i][k]) - 2;
    }
    // The middle of the two rounds is free of both ends.
    let half = n / 2;
    (0..n).map(|i| path[if i >= half { i } else { i + n }]).collect()
}

/// Marks every pixel whose centre an outline encloses (a vertex order that winds around it, in either sense).
pub(super) fn rasterise(polygons: &[Polygon], mask: &mut super::Mask) {
    let (w, h) = (mask.width(), mask.height());
    let mut crossings: Vec<Vec<(f64, i32)>> = vec![Vec::new(); h];
    for polygon in polygons {
        crossings.iter_mut().for_each(Vec::clear);
        let n = polygon.vertices.len();
        for i in 0..n {
            let ([u0, v0], [u1, v1]) = (polygon.vertices[i], polygon.vertices[(i + 1) % n]);
            let (from, to, way) = if v0 <= v1 { (v0, v1, 1) } else { (v1, v0, -1) };
            let first = from.ceil().max(0.0) as usize;
            // Half open: a vertex on a row belongs to the side below it only.
            let mut v = first;
            while (v as f64) < to && v < h {
                let part = (v as f64 - v0) / (v1 - v0);
                crossings[v].push((u0 + part * (u1 - u0), way));
                v += 1;
            }
        }
        for (v, row) in crossings.iter_mut().enumerate() {
            row.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut winding = 0;
            for pair in row.windows(2) {
                winding += pair[0].1;
                if winding != 0 {
                    let from = pair[0].0.ceil().max(0.0) as usize;
                    let mut u = from;
                    while (u as f64) < pair[1].0 && u < w {
                        mask.set(u, v, true);
                        u += 1;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Mask;
    use crate::profile::settings::EdgeSettings;

    const SIZE: usize = 120;
    const CENTRE: (f64, f64) = (60.3, 58.8);

    /// A disc of `radius` and `height`, as blurred as the settings say, with white noise of 1, and a coarse outline around it.
    fn disc(radius: f64, height: f64, coarse: f64) -> (Plane, Vec<bool>) {
        let mut seed = 7u64;
        let mut uniform = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f64 / f64::from(1u32 << 31)
        };
        let mut plane = Plane::filled(SIZE, SIZE, 0, 0.0);
        let mut inside = vec![false; SIZE * SIZE];
        for v in 0..SIZE {
            for u in 0..SIZE {
                let depth = radius - (u as f64 - CENTRE.0).hypot(v as f64 - CENTRE.1);
                // Twelve uniform numbers make a normal one.
                let noise = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                plane.data[v * SIZE + u] = (height * normal_cdf(depth / EdgeSettings::default().blur_px) + noise) as f32;
                inside[v * SIZE + u] = depth > -coarse;
            }
        }
        (plane, inside)
    }

    fn refined(plane: &Plane, inside: &[bool]) -> Polygon {
        let outlines = trace(inside, SIZE, 0);
        assert_eq!(outlines.len(), 1);
        let limits = Limits { inside, rows: &|_| (-1e9, 1e9) };
        refine(&outlines, plane, &limits, &EdgeSettings::default()).edge.remove(0)
    }

    /// The radius comes back at any contrast and however far the coarse outline is off. 250 px of outline, each placed to about
    /// 0.25 px at a contrast of 12, average to 0.03 px; 0.1 px leaves room for the curvature, by which a blurred disc's half-level
    /// lies blur^2 / (2 radius) = 0.012 px inside its edge. At 6 the noise of one vertex is 0.5 px, a good part of the search,
    /// and the choice among shifts is no longer symmetric: 0.2 px is what is promised there.
    #[test]
    fn a_disc_keeps_its_radius_at_any_contrast() {
        for (radius, height, coarse, tolerance) in
            [(40.0, 100.0, 3.0, 0.1), (40.3, 20.0, 4.0, 0.1), (39.6, 12.0, 2.0, 0.1), (39.6, 6.0, 2.0, 0.2), (12.0, 60.0, 3.5, 0.1)]
        {
            let (plane, inside) = disc(radius, height, coarse);
            let found = (refined(&plane, &inside).area_px2() / std::f64::consts::PI).sqrt();
            assert!((found - radius).abs() < tolerance, "radius {radius}, height {height}, coarse {coarse}: found {found:.3}");
        }
    }

    #[test]
    fn the_mask_covers_as_much_as_the_outline_encloses() {
        let circle = Polygon {
            vertices: (0..500)
                .map(|k| {
                    let a = f64::from(k) * std::f64::consts::TAU / 500.0;
                    [CENTRE.0 + 30.0 * a.cos(), CENTRE.1 + 30.0 * a.sin()]
                })
                .collect(),
        };
        let mut mask = Mask::empty(SIZE, SIZE);
        rasterise(std::slice::from_ref(&circle), &mut mask);
        for v in 0..SIZE {
            for u in 0..SIZE {
                let distance = (u as f64 - CENTRE.0).hypot(v as f64 - CENTRE.1);
                if (distance - 30.0).abs() > 0.01 {
                    assert_eq!(mask.get(u, v), distance < 30.0, "pixel {u}, {v} at {distance:.3} px");
                }
            }
        }
    }

    /// Tracing then filling gives the same pixels back, for pieces that touch at corners and at the window's border.
    #[test]
    fn cracks_enclose_exactly_their_pixels() {
        let rows = ["##......", "##..##..", "..######", "...##...", "#......."];
        let inside: Vec<bool> = rows.iter().flat_map(|r| r.chars().map(|c| c == '#')).collect();
        let polygons: Vec<Polygon> = trace(&inside, 8, 0).into_iter().map(|vertices| Polygon { vertices }).collect();
        let mut mask = Mask::empty(8, 5);
        rasterise(&polygons, &mut mask);
        let back: Vec<bool> = mask.data().iter().map(|&p| p != 0).collect();
        assert_eq!(back, inside);
    }
}
