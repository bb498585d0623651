//! The outline at sub-pixel position.
//!
//! ```text
//!      coarse outline, even steps -> darkness along each normal, averaged along the outline
//!                                            |
//!      one place per step where the darkness sets in, chosen together (neighbours differ little) -> polygon
//!                                            |
//!      the same along this polygon, even steps
//!                                            |
//!      blur of the frame, and whether its edges are sharp or rounded  <-- residuals of the clear ones
//!                                            |
//!      the places once more, with this blur -> polygon
//! ```
//! The coarse outline winds about the edge. Averaged along it, an edge is more blurred than it is: by up to 7 % in frames of a blur
//! of 1.4 px, which moves the edge of a body inwards by 0.2 px. So the blur is read along the edge itself.
//!
//! A dilation by one pixel is 7 % of a larva's volume. A threshold moves with contrast and blur, so the edge is not where one
//! is crossed, but where the fitted darkness begins (see [`super::onset`]). The blur of a frame is estimated from its own
//! edges.

use super::blur::{self, Models, SAME_BLUR};
use super::onset::{Kind, NEAR, Onsets, PER_PX, PER_WINDOW, SAMPLES, SHIFTS_PER_PX};
use crate::profile::body::bubble::Disc;
use crate::profile::raster::outline::{self, Outlines, Polygon, Smoother, normals, smooth_cyclic};
use crate::profile::raster::path::Path;
use crate::profile::raster::plane::{Plane, gaussian};
use crate::profile::settings::{EdgeSettings, REACH_PX};

/// The certainty of one vertex of the refined outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePoint {
    /// Height of the fitted darkness, in standard deviations of a pixel's noise.
    pub contrast: f64,
    /// Standard error of the position, px. Infinite where nothing could be fitted.
    pub error_px: f64,
    /// Whether the vertex lies on a wall, on the frame's border or at a bubble, where the specimen's own edge cannot be seen.
    pub bounded: bool,
}

/// Steps along the outline, px: the averaging along it makes nearer ones the same.
pub(in crate::profile) const STEP_PX: f64 = 2.0;

/// An outline nearer than this to the body is the body's, and the blur of the body's edge reaches as far, px.
const BODY_PX: f64 = 2.0;
/// How nearly a fringe's border is known, px, and how nearly once it is placed.
const FRINGE_PX: f64 = 2.5;
const FRINGE_AGAIN_PX: f64 = 1.0;
/// Along the edge itself the darkness is averaged over this many times the length: an edge that is straight there blurs no detail, and
/// noise moves edges inwards, because courses that may not be negative explain it on one side only.
const AGAIN: f64 = 2.5;
/// Cost of a shift that is not allowed.
const OUT_OF_REACH: f32 = 20.0;
/// Shifts per step of the first choice, which is made finer place by place.
const COARSE: usize = 4 * PER_WINDOW;

/// What limits a refined edge besides the picture itself.
pub(in crate::profile) struct Limits<'a> {
    /// Pixels of the window that belong to the specimen, for the local thickness.
    pub inside: &'a [bool],
    /// Those of them that were found without the fringe. A fringe's border is known nearly, and looking further would find the
    /// body's edge, which is so much darker.
    pub body: &'a [bool],
    /// What hides the edge: there the outline stays where it is.
    pub bubbles: &'a [Disc],
    /// Lowest and highest row that an edge may have in a column: the walls' inner lines.
    pub rows: &'a dyn Fn(f64) -> (f64, f64),
}

/// One step of an outline.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: [f64; 2],
    inward: [f64; 2],
    /// Samples as far as half the way through the specimen.
    seen: usize,
    /// The frame's border is no edge of the specimen, and a bubble's is none: the outline stays where it is.
    at_border: bool,
    /// How far outwards and inwards a fringe's border can lie, px: inwards nearer to the outline than to the body. `None` at the body's own
    /// edge.
    fringe: Option<[f64; 2]>,
    /// Shift chosen, and the darkness' height there.
    shift: usize,
    contrast: f32,
}

/// Finds edges; keeps its memory from frame to frame.
#[derive(Default)]
pub(in crate::profile) struct EdgeFinder {
    kernel: Vec<f32>,
    places: Vec<Place>,
    inward: Vec<[f64; 2]>,
    raw: Vec<[f32; SAMPLES]>,
    samples: Vec<[f32; SAMPLES]>,
    path: Path,
    /// The outlines along which the darkness was read last.
    along: Outlines,
    /// Those that are made from its places.
    placed: Outlines,
    smoother: Smoother,
    heights: Vec<f32>,
    shifts: Vec<f64>,
    smooth: Vec<f64>,
    models: Models,
    /// The points of an outline that nobody asks for.
    points: Vec<EdgePoint>,
    /// Blur of the newest frame, px, and the kind of its edges.
    seen_as: (f64, Kind),
}

/// What [`EdgeFinder::refine`] finds.
pub(in crate::profile) struct Refined {
    pub edge: Vec<Polygon>,
    /// How sure each vertex of each outline is.
    pub points: Vec<Vec<EdgePoint>>,
    /// The frame's blur by its edges. `None` where they do not determine it.
    pub blur_px: Option<f64>,
}

impl EdgeFinder {
    /// Moves outlines to where the darkness sets in, and says how blurred they are.
    pub fn refine(&mut self, outlines: &Outlines, darkness: &Plane, limits: &Limits, settings: &EdgeSettings) -> Refined {
        self.models.search_px = [settings.search_outside_px, settings.search_inside_px];
        let (mut kind, mut sigma, mut blur_px) = (Kind::Sharp, settings.blur_px, None);
        self.seen_as = (sigma, kind);
        self.approach(outlines, darkness, limits, settings);
        let along = std::mem::take(&mut self.along);
        if let Some((found, seen_as)) = self.blur(sigma, noise2(settings)) {
            blur_px = Some(found);
            if (found / sigma - 1.0).abs() > SAME_BLUR || seen_as != kind {
                (sigma, kind) = (found, seen_as);
                self.choose(&along, sigma, kind, settings);
                // The places have moved; once more, now that they are nearly right.
                if let Some((found, seen_as)) = self.blur(sigma, noise2(settings)) {
                    (sigma, kind, blur_px) = (found, seen_as, Some(found));
                }
            }
        }
        self.seen_as = (sigma, kind);
        let width = darkness.width;
        let of = |range: &std::ops::Range<usize>| {
            let (mut vertices, mut points) = (Vec::with_capacity(range.len()), Vec::with_capacity(range.len()));
            self.place(range.clone(), width, limits, settings, &mut vertices, &mut points);
            (Polygon { vertices }, points)
        };
        let (edge, points) = along.ranges.iter().map(of).unzip();
        self.along = along;
        Refined { edge, points, blur_px }
    }

    /// Reads the darkness along the outlines, and again along the edges that it shows there. Chooses the places of these.
    fn approach(&mut self, outlines: &Outlines, darkness: &Plane, limits: &Limits, settings: &EdgeSettings) {
        let (sigma, kind) = self.seen_as;
        self.look(outlines, darkness, limits, [settings.along_px, FRINGE_PX]);
        self.choose(outlines, sigma, kind, settings);
        let (mut placed, mut along) = (std::mem::take(&mut self.placed), std::mem::take(&mut self.along));
        let mut points = std::mem::take(&mut self.points);
        placed.clear();
        for range in &outlines.ranges {
            points.clear();
            let first = placed.points.len();
            self.place(range.clone(), darkness.width, limits, settings, &mut placed.points, &mut points);
            placed.ranges.push(first..placed.points.len());
        }
        outline::smoothed(&placed, settings.outline_smoothing_px / STEP_PX, STEP_PX, &mut self.smoother, &mut along);
        self.look(&along, darkness, limits, [AGAIN * settings.along_px, FRINGE_AGAIN_PX]);
        self.choose(&along, sigma, kind, settings);
        (self.placed, self.along, self.points) = (placed, along, points);
    }

    /// Moves other outlines of the same frame, with the blur that [`Self::refine`] found in it.
    pub fn refine_again(&mut self, outlines: &Outlines, darkness: &Plane, limits: &Limits, settings: &EdgeSettings) -> Vec<Polygon> {
        self.approach(outlines, darkness, limits, settings);
        let (along, mut points) = (std::mem::take(&mut self.along), std::mem::take(&mut self.points));
        let of = |range: &std::ops::Range<usize>| {
            points.clear();
            let mut vertices = Vec::with_capacity(range.len());
            self.place(range.clone(), darkness.width, limits, settings, &mut vertices, &mut points);
            Polygon { vertices }
        };
        let edge = along.ranges.iter().map(of).collect();
        (self.along, self.points) = (along, points);
        edge
    }

    /// Reads the darkness along all normals, averaged along the outlines over `along_px`. A fringe's border is at most `fringe_px` away.
    fn look(&mut self, outlines: &Outlines, darkness: &Plane, limits: &Limits, [along_px, fringe_px]: [f64; 2]) {
        let last_u = (darkness.width - 1) as f64;
        gaussian(along_px / STEP_PX, &mut self.kernel);
        self.places.clear();
        self.samples.clear();
        for outline in outlines.each() {
            self.inward.clear();
            normals(outline, &mut self.inward);
            self.raw.clear();
            self.raw.extend(outline.iter().zip(&self.inward).map(|(p, n)| {
                std::array::from_fn(|k| {
                    let s = k as f64 / PER_PX as f64 - REACH_PX as f64;
                    darkness.sample(p[0] + s * n[0], p[1] + s * n[1])
                })
            }));
            let first = self.samples.len();
            self.samples.resize(first + self.raw.len(), [0.0; SAMPLES]);
            smooth_cyclic(self.raw.as_flattened(), SAMPLES, &self.kernel, self.samples[first..].as_flattened_mut());
            self.places.extend(outline.iter().zip(&self.inward).map(|(&at, &inward)| {
                let body_px = (0..2 * REACH_PX).map(|k| k as f64 / 2.0).find(|s| is_in(limits.body, darkness, at, inward, *s));
                let body_px = body_px.unwrap_or(f64::INFINITY);
                let is_fringe = body_px > BODY_PX;
                let deep = half_thickness(at, inward, darkness, limits.inside);
                // The fit of a fringe must not see the body behind it.
                let deep = if is_fringe { deep.min((body_px - BODY_PX).max(1.0)) } else { deep };
                Place {
                    at,
                    inward,
                    seen: (((REACH_PX as f64 + deep) * PER_PX as f64) as usize + 1).min(SAMPLES),
                    fringe: is_fringe.then_some([fringe_px, fringe_px.min(body_px / 2.0)]),
                    at_border: at[0] < 0.5 || at[0] > last_u - 0.5 || limits.bubbles.iter().any(|b| b.near(at)),
                    shift: 0,
                    contrast: 0.0,
                }
            }));
        }
    }

    /// Chooses a shift for every place, neighbours together.
    fn choose(&mut self, outlines: &Outlines, sigma: f64, kind: Kind, settings: &EdgeSettings) {
        let model = self.models.get(sigma, kind);
        let noise2 = noise2(settings);
        for range in &outlines.ranges {
            self.path.costs.clear();
            self.heights.clear();
            for i in range.clone() {
                let place = &self.places[i];
                for k in (0..model.count()).step_by(COARSE) {
                    let (cost, height) = if place.at_border {
                        (model.place_px(k as f64).abs() as f32, 0.0)
                    } else if place.fringe.is_some_and(|[out_px, in_px]| !(-out_px..=in_px).contains(&model.place_px(k as f64))) {
                        (OUT_OF_REACH, 0.0)
                    } else {
                        let fit = model.fit(k, &model.seen(k, &self.samples[i][..place.seen]));
                        if fit.samples == 0 {
                            // Beyond the middle of something thin.
                            self.path.costs.push(OUT_OF_REACH);
                            self.heights.push(0.0);
                            continue;
                        }
                        // Share of the samples' energy left unexplained; a strong edge counts more.
                        ((2.0 * fit.residual - fit.energy) / (noise2 * fit.samples as f32 + fit.energy), fit.height)
                    };
                    self.path.costs.push(cost);
                    self.heights.push(height);
                }
            }
            let states = model.count().div_ceil(COARSE);
            let px = COARSE as f32 / SHIFTS_PER_PX as f32;
            self.path.cheapest(range.len(), states, settings.stiffness as f32 * px * px);
            for (step, i) in range.clone().enumerate() {
                let place = &mut self.places[i];
                place.contrast = self.heights[step * states + self.path.chosen[step]];
                place.shift = self.path.chosen[step] * COARSE;
            }
        }
    }

    /// The blur of the frame, px, and the kind of its edges: those that explain all its clear edges best. `None` where too few
    /// are clear.
    fn blur(&mut self, near: f64, noise2: f32) -> Option<(f64, Kind)> {
        let clear = |least: f32| move |place: &&Place| !place.at_border && place.contrast >= least && place.seen + 4 >= SAMPLES;
        let enough = |least: f32| self.places.iter().filter(clear(least)).count() >= BLUR_PLACES;
        let &(least, rounded_better) = BLUR_CONTRASTS.iter().find(|(least, _)| enough(*least))?;
        let every = self.places.iter().filter(clear(least)).count().div_ceil(BLUR_PLACES * 2);
        let (places, samples, models) = (&self.places, &self.samples, &mut self.models);
        let residual = |blur_px: f64, kind: Kind| {
            let model = models.get(blur_px, kind);
            let chosen = places.iter().zip(samples).filter(|(place, _)| clear(least)(place)).step_by(every);
            // In units of the noise. The geometric mean is led by the edges that the model describes: a fin or a speck beside an edge looks
            // like blur.
            let of = |(p, samples): (&Place, &[f32; SAMPLES])| f64::from(1.0 + settle(model, p.shift, &samples[..p.seen]).1 / noise2).ln();
            let (sum, n) = chosen.map(of).fold((0.0, 0.0), |(sum, n), ln| (sum + ln, n + 1.0));
            (sum / f64::max(n, 1.0)).exp()
        };
        Some(blur::estimated(near, rounded_better, residual))
    }

    /// Places the edge of one outline between the shifts, and adds the certainty of its vertices to `points`.
    fn place(
        &mut self,
        range: std::ops::Range<usize>,
        width: usize,
        limits: &Limits,
        settings: &EdgeSettings,
        vertices: &mut Vec<[f64; 2]>,
        points: &mut Vec<EdgePoint>,
    ) {
        let last_u = (width - 1) as f64;
        let (sigma, kind) = self.seen_as;
        let model = self.models.get(sigma, kind);
        let (places, samples) = (&self.places[range.clone()], &self.samples[range]);
        self.shifts.clear();
        self.shifts.extend(places.iter().zip(samples).map(|(place, samples)| {
            let shift = if place.at_border { place.shift as f64 } else { settle(model, place.shift, &samples[..place.seen]).0 };
            model.place_px(shift)
        }));
        gaussian(settings.shift_smoothing_px / STEP_PX, &mut self.kernel);
        self.smooth.clear();
        self.smooth.resize(self.shifts.len(), 0.0);
        smooth_cyclic(&self.shifts, 1, &self.kernel, &mut self.smooth);
        // A blurred step of height a under white noise of 1 is placed to sqrt(2 sqrt(pi) blur) / a per sample and pixel;
        // averaging along the outline divides by the root of what it averages.
        let spread = (2.0 * std::f64::consts::PI.sqrt() * sigma).sqrt() * f64::from(noise2(settings)).sqrt();
        let moved = places.iter().zip(&self.smooth).enumerate().map(|(i, (place, shift))| {
            let shift = if place.at_border { *shift } else { shift - blur_moves_px(curvature_per_px(places, i), sigma) };
            let u = (place.at[0] + shift * place.inward[0]).clamp(-0.5, last_u + 0.5);
            let (least, most) = (limits.rows)(u);
            let free = place.at[1] + shift * place.inward[1];
            let contrast = f64::from(place.contrast);
            points.push(EdgePoint {
                contrast,
                error_px: if contrast > 0.0 { spread / contrast } else { f64::INFINITY },
                bounded: place.at_border || free - least < 0.5 || most - free < 0.5,
            });
            [u, free.max(least).min(most)]
        });
        vertices.extend(moved);
    }
}

/// Edges that determine the blur: so high that noise adds nothing. Where a frame has too few, fainter ones are used. Rounded
/// courses explain a sharp edge a little better too, since they have more freedom, and roundness looks like blur. So they are
/// believed only where they explain this many times more. Of high edges, those of a clear skin over a darker body have 3.2 to
/// 11, and sharp ones of larvae out of focus up to 3.1. Taken as sharp, a clear skin's edge is found 0.2 to 0.3 px inside, and
/// more of its fins is missed.
const BLUR_CONTRASTS: [(f32, f64); 2] = [(25.0, 3.2), (8.0, 2.0)];
/// Fewer clear places than this do not determine a frame's blur. More than twice as many only cost time.
const BLUR_PLACES: usize = 60;

/// How far inwards a blur moves a curved edge, px. To first order a Gaussian blur moves every level of a disc by half its variance
/// over the radius, whatever the profile of its darkness.
fn blur_moves_px(curvature_per_px: f64, sigma_px: f64) -> f64 {
    /// A tip is narrower than the first order allows for.
    const MOST_PX: f64 = 0.1;
    (0.5 * sigma_px * sigma_px * curvature_per_px).clamp(-MOST_PX, MOST_PX)
}

/// Curvature of a closed outline around a place, positive where it is convex.
fn curvature_per_px(places: &[Place], i: usize) -> f64 {
    /// Reach to either side, in steps.
    const REACH: usize = 5;
    let n = places.len();
    if n <= 2 * REACH {
        return 0.0;
    }
    let ([ax, ay], [bx, by]) = (places[(i + n - REACH) % n].inward, places[(i + REACH) % n].inward);
    (ax * by - ay * bx).atan2(ax * bx + ay * by) / (2 * REACH) as f64 / STEP_PX
}

/// Variance that averaging along the outline leaves of a pixel's noise.
fn noise2(settings: &EdgeSettings) -> f32 {
    1.0 / (2.0 * std::f32::consts::PI.sqrt() * settings.along_px as f32).max(1.0)
}

/// Follows the residual from shift `k` downhill to its least value near by, in one window for all shifts, so that they explain
/// the same samples: by windows first, then by single shifts, then between them by a parabola. Gives the place, in shifts, and
/// the residual there.
fn settle(model: &Onsets, k: usize, samples: &[f32]) -> (f64, f32) {
    const ROUNDS: usize = 4;
    let mut window = k / PER_WINDOW * PER_WINDOW;
    let mut rounds = 0;
    loop {
        rounds += 1;
        let (first, last) = (window.saturating_sub(NEAR), (window + NEAR).min(model.count() - 1));
        let seen = model.seen(window, samples);
        let mut row = [f32::NAN; 2 * NEAR + 1];
        let mut residual = |j: usize| {
            let known = &mut row[j - first];
            if known.is_nan() {
                *known = model.fit(j, &seen).residual;
            }
            *known
        };
        let mut best = window;
        let mut go = |best: &mut usize, stride: usize| loop {
            let here = residual(*best);
            if *best >= first + stride && residual(*best - stride) < here {
                *best -= stride;
            } else if *best + stride <= last && residual(*best + stride) < here {
                *best += stride;
            } else {
                break;
            }
        };
        go(&mut best, PER_WINDOW);
        if best != window && rounds < ROUNDS {
            window = best;
            continue;
        }
        go(&mut best, PER_WINDOW / 2);
        go(&mut best, 1);
        if best == first || best == last {
            return (best as f64, residual(best));
        }
        let (a, b, c) = (residual(best - 1), residual(best), residual(best + 1));
        let bend = a - 2.0 * b + c;
        let part = if bend <= 1e-9 { 0.0 } else { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) };
        return (best as f64 + f64::from(part), (b - 0.25 * (a - c) * part).max(0.0));
    }
}

/// Whether the pixel at depth `s` along a normal belongs to a set of the window's pixels.
fn is_in(set: &[bool], window: &Plane, p: [f64; 2], n: [f64; 2], s: f64) -> bool {
    let (u, v) = ((p[0] + s * n[0]).round(), (p[1] + s * n[1]).round() - window.top as f64);
    u >= 0.0 && v >= 0.0 && u < window.width as f64 && v < window.height as f64 && set[v as usize * window.width + u as usize]
}

/// Half the way through the specimen along a normal: the fit must not look out of the other side of a fin.
fn half_thickness(p: [f64; 2], n: [f64; 2], window: &Plane, inside: &[bool]) -> f64 {
    /// The edge may lie so far outside the pixels that were found.
    const OUTSIDE_PX: usize = 4;
    let is_inside = |s: &usize| is_in(inside, window, p, n, *s as f64);
    let first = (1..=OUTSIDE_PX).find(is_inside).unwrap_or(1);
    let thick = (first..=2 * REACH_PX).take_while(is_inside).count();
    (thick as f64 / 2.0).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::onset::blurred_samples;
    use super::*;
    use crate::profile::Mask;
    use crate::profile::raster::outline::{Crossings, Smoother, rasterise, smoothed, trace};
    use crate::profile::synthetic::{Noise, blurred_step, plane};

    const SIZE: usize = 120;
    const CENTRE: (f64, f64) = (60.3, 58.8);

    /// What is found of a disc of `radius` and `height` under white noise of 1, from a coarse outline around it.
    fn refined(radius: f64, height: f64, coarse: f64, blur: f64) -> Refined {
        refined_as(radius, coarse, |depth| height * blurred_step(depth, blur))
    }

    /// What is found of a disc whose darkness depends on the depth alone, under white noise of 1.
    fn refined_as(radius: f64, coarse: f64, darkness: impl Fn(f64) -> f64) -> Refined {
        let mut noise = Noise::new(7);
        let depth = |u: f64, v: f64| radius - (u - CENTRE.0).hypot(v - CENTRE.1);
        let darkness = plane(SIZE, SIZE, |u, v| darkness(depth(u, v)) + noise.next());
        let inside: Vec<bool> = (0..SIZE * SIZE).map(|i| depth((i % SIZE) as f64, (i / SIZE) as f64) > -coarse).collect();
        let (mut cracks, mut outlines) = (Outlines::default(), Outlines::default());
        trace(&inside, SIZE, 0, 12, &mut Vec::new(), &mut cracks);
        smoothed(&cracks, EdgeSettings::default().outline_smoothing_px, STEP_PX, &mut Smoother::default(), &mut outlines);
        let limits = Limits { inside: &inside, body: &inside, bubbles: &[], rows: &|_| (-1e9, 1e9) };
        EdgeFinder::default().refine(&outlines, &darkness, &limits, &EdgeSettings::default())
    }

    /// Darkness at a depth in a round body of this radius, px, with a skin: light that is bent at both surfaces and absorbed on its way, of
    /// a lamp whose directions have a standard deviation of 18 degrees. A pixel is 5.4 um.
    fn darkness_of_a_round_body(radius: f64, skin: f64, depth: f64) -> f64 {
        const WATER: f64 = 1.333;
        const SKIN: f64 = 1.36;
        const BODY: f64 = 1.37;
        const SKIN_PER_PX: f64 = 0.0065;
        const BODY_PER_PX: f64 = 0.0227;
        let height = radius - depth;
        if height >= radius {
            return 0.0;
        }
        let half = |radius: f64, height: f64| (radius * radius - height * height).max(0.0).sqrt();
        let (in_skin, core) = (height * WATER / SKIN, radius - skin);
        let mut bent = (height / radius).asin() - (in_skin / radius).asin();
        let mut absorbed = 2.0 * SKIN_PER_PX * (half(radius, in_skin) - half(core, in_skin));
        if in_skin < core {
            let in_body = in_skin * SKIN / BODY;
            bent += (in_skin / core).asin() - (in_body / core).asin();
            absorbed += 2.0 * BODY_PER_PX * half(core, in_body);
        }
        1.0 - (-absorbed - 0.5 * (2.0 * bent.to_degrees() / 18.0).powi(2)).exp()
    }

    /// A clear skin makes the darkness begin slowly, over a body that is darker. The edge is the skin's. Here every place has the same skin,
    /// which the blur explains in part. Taken as sharp, these edges are 0.1, 0.6 and 1.4 px inside.
    #[test]
    fn the_edge_of_a_clear_skin_is_not_that_of_the_body() {
        const STEP: f64 = 0.02;
        let (radius, blur) = (40.0, 1.0);
        let off = [1.0, 2.0, 3.0].map(|skin| {
            let blurred = |depth: f64| {
                let offs = (-200..=200).map(|k| f64::from(k) * STEP);
                let weighed = offs.map(|off| (darkness_of_a_round_body(radius, skin, depth + off), (-0.5 * (off / blur).powi(2)).exp()));
                let (sum, weights) = weighed.fold((0.0, 0.0), |(sum, weights), (dark, weight)| (sum + weight * dark, weights + weight));
                100.0 * sum / weights
            };
            let edge = refined_as(radius, 2.0, blurred).edge;
            (edge[0].area_px2() / std::f64::consts::PI).sqrt() - radius
        });
        assert!(off.iter().all(|off| off.abs() < 0.36), "radius found, less the true one, of skins of 1, 2 and 3 px: {off:.3?}");
    }

    /// The radius comes back at any contrast, however small the disc and however far the coarse outline is off. 250 px of
    /// outline, each placed to about 0.25 px at a contrast of 12, average to 0.03 px. A blur that is not Gaussian, because pixels are read
    /// between their centres, moves a step inwards by 0.02 px at its own standard deviation.
    #[test]
    fn a_disc_keeps_its_radius_at_any_contrast() {
        let mut off = Vec::new();
        for (radius, height, coarse, tolerance) in
            [(40.0, 100.0, 3.0, 0.05), (40.3, 20.0, 4.0, 0.09), (39.6, 12.0, 2.0, 0.09), (39.6, 6.0, 2.0, 0.2), (12.0, 60.0, 3.5, 0.05)]
        {
            let edge = refined(radius, height, coarse, 1.0).edge;
            assert_eq!(edge.len(), 1);
            let found = (edge[0].area_px2() / std::f64::consts::PI).sqrt();
            if (found - radius).abs() >= tolerance {
                off.push((radius, height, found));
            }
        }
        assert!(off.is_empty(), "radius, height, found: {off:.3?}");
    }

    /// The border of a fin that stands out 4 to 6 px from a body 14 times as dark stays the fin's, to 1.2 px: the
    /// blur of the body reaches its border. The body's edge is within reach.
    #[test]
    fn the_border_of_a_narrow_fin_is_not_drawn_to_the_body() {
        const BODY: f64 = 30.0;
        for width in [4.0, 5.0, 6.0] {
            let mut noise = Noise::new(11);
            let depth = |u: f64, v: f64| BODY - (u - CENTRE.0).hypot(v - CENTRE.1);
            let darkness = plane(SIZE, SIZE, |u, v| {
                let depth = depth(u, v);
                37.0 * blurred_step(depth, 1.0) + 3.0 * blurred_step(depth + width, 1.0) + noise.next()
            });
            let set = |out: f64| -> Vec<bool> { (0..SIZE * SIZE).map(|i| depth((i % SIZE) as f64, (i / SIZE) as f64) > -out).collect() };
            let (inside, body) = (set(width), set(0.0));
            let (mut cracks, mut outlines) = (Outlines::default(), Outlines::default());
            trace(&inside, SIZE, 0, 12, &mut Vec::new(), &mut cracks);
            smoothed(&cracks, EdgeSettings::default().outline_smoothing_px, STEP_PX, &mut Smoother::default(), &mut outlines);
            let limits = Limits { inside: &inside, body: &body, bubbles: &[], rows: &|_| (-1e9, 1e9) };
            let edge = EdgeFinder::default().refine(&outlines, &darkness, &limits, &EdgeSettings::default()).edge;
            let found = (edge[0].area_px2() / std::f64::consts::PI).sqrt() - BODY;
            assert!((found - width).abs() < 1.2, "{found:.2} for {width}");
        }
    }

    /// Reading between the pixels blurs a little more: a straight line between two has, over all places, a variance of 1/6 px^2.
    #[test]
    fn the_blur_of_a_disc_comes_back() {
        let mut off = Vec::new();
        for blur in [0.6, 0.8, 1.0, 1.25, 1.6, 2.0] {
            let found = refined(40.0, 80.0, 2.0, blur).blur_px.unwrap();
            let read = (blur * blur + 1.0f64 / 6.0).sqrt();
            if (found / read - 1.0).abs() >= 0.04 {
                off.push((blur, found));
            }
        }
        assert!(off.is_empty(), "blur, found: {off:.3?}");
    }

    #[test]
    fn the_mask_covers_as_much_as_the_outline_encloses() {
        let corner = |k: i32| {
            let a = f64::from(k) * std::f64::consts::TAU / 500.0;
            [CENTRE.0 + 30.0 * a.cos(), CENTRE.1 + 30.0 * a.sin()]
        };
        let circle = Polygon { vertices: (0..500).map(corner).collect() };
        let mut mask = Mask::empty(SIZE, SIZE);
        rasterise(std::slice::from_ref(&circle), &mut mask, &mut Crossings::default());
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
        let mut cracks = Outlines::default();
        trace(&inside, 8, 0, 1, &mut Vec::new(), &mut cracks);
        let polygons: Vec<Polygon> = cracks.each().map(|vertices| Polygon { vertices: vertices.to_vec() }).collect();
        let mut mask = Mask::empty(8, 5);
        rasterise(&polygons, &mut mask, &mut Crossings::default());
        let back: Vec<bool> = mask.data().iter().map(|&p| p != 0).collect();
        assert_eq!(back, inside);
    }

    /// Where the fit places the beginning of a mixture of courses: the shift that is chosen first, then downhill.
    fn placed(model: &Onsets, samples: &[f32]) -> f64 {
        let noise2 = noise2(&EdgeSettings::default());
        let cost = |k: usize| {
            let fit = model.fit(k, &model.seen(k, samples));
            (2.0 * fit.residual - fit.energy) / (noise2 * fit.samples as f32 + fit.energy)
        };
        let first = (0..model.count()).step_by(COARSE).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap();
        model.place_px(settle(model, first, samples).0)
    }

    /// Step, a fin's rim, a body's rim and root, each alone and mixed, at any place between the shifts and under any blur, are
    /// placed to 0.05 px. That is without noise, by the model that is the truth: courses that may not be negative make the
    /// residual kink at the edge, where a parabola between shifts errs by up to half of one.
    #[test]
    fn darkness_begins_where_it_begins_whatever_its_course() {
        let (step, fin, body, root) = ([1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
        let mixtures = [step, fin, body, root, [1.0, 2.0, 0.0, 0.0], [0.5, 0.0, 1.0, 0.0], [1.0, 0.5, 0.5, 0.3]];
        for mixture in mixtures {
            for blur in [0.6, 1.0, 1.5] {
                let kind = if mixture[3] > 0.0 { Kind::Rounded } else { Kind::Sharp };
                let model = Onsets::new(blur, kind, [3.5, 6.5]);
                for begins in [-1.37, 0.0, 0.11, 0.62, 2.93] {
                    let place = |level| placed(&model, &blurred_samples(begins, blur, mixture.map(|m| 20.0 * m), level));
                    let (found, lifted) = (place(0.0), place(0.5));
                    assert!((found - begins).abs() < 0.05, "{mixture:?}, blur {blur}: {found:.3} for {begins}");
                    // A background that is off by half a pixel's noise moves an edge of 20 by less than the bias above.
                    assert!((lifted - found).abs() < 0.15, "{mixture:?}, blur {blur}: {lifted:.3} on a level, {found:.3} without");
                }
            }
        }
    }
}
