//! How and where the darkness begins at a specimen's edge: a least-squares fit at one place of the outline.
//!
//! ```text
//!      step: a plate, a fin     rims: light bent away,       root: a round body, whose thickness
//!           ________            at a fin and at a body        ___---    grows as the root of the depth
//!          |                      |\     |'-.               .-'
//!   ______/                   ____/ '.___/    '-.     _____/
//!         e                       e      e                 e
//!      y(s) = level + a step(s - e) + c rim(s - e) + d rim'(s - e) + q root(s - e),   all blurred;   a, c, d, q >= 0
//! ```
//! Which of the profiles an edge shows depends on the specimen and on the light, so each place of the outline has its own
//! mixture. All of them begin at the edge and none may be negative: the edge is where the darkness begins, whatever its
//! profile. The level outside is free, but held near 0 by what is known about the background.

/// Samples along a normal: from `REACH_PX` outside to `REACH_PX` inside.
pub(super) const PER_PX: usize = 2;
pub(super) const REACH_PX: usize = 9;
pub(super) const SAMPLES: usize = 2 * REACH_PX * PER_PX + 1;
/// Positions per px that the fit tries.
pub(super) const SHIFTS_PER_PX: usize = 8;

/// Depths at which the dark rim has faded to half. In bright field an edge shows this rim where it refracts the light: a fin's
/// is about as thin as the blur, that of a round body grows with its radius.
const RIMS_PX: [f64; 2] = [1.0, 4.0];
/// Uncertainty of the background, standard deviations of a pixel's noise.
const LEVEL_SIGMA: f32 = 0.7;
/// Reach of the fit on either side of the edge, in addition to the blur. More of the inside would show pigment and organs.
const WINDOW_PX: f64 = 1.5;

/// The profiles of darkness: step, two rims, root.
const COURSES: usize = 4;
type Vector = [f32; COURSES];
type Matrix = [[f32; COURSES]; COURSES];

/// The fit of one shift at one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Energy of the samples about the free level, and its unexplained part.
    pub energy: f32,
    pub residual: f32,
    /// Height of step and rim together with that of the root one pixel inside.
    pub height: f32,
    /// Samples in the window.
    pub samples: usize,
}

/// One shift: the samples that it explains, and the profiles over them.
struct Shift {
    from: usize,
    upto: usize,
    /// By sample, so that all profiles are summed together.
    courses: [Vector; SAMPLES],
    /// `grams[n]`: products of the profiles over the first `n` samples of the window, and their sums.
    grams: Vec<(Matrix, Vector)>,
    /// The same over all samples of the windows of the shifts from [`NEAR`] before to `NEAR` after this one.
    near: Vec<(Matrix, Vector)>,
}

/// How far the window of a fit lies from its shift, in shifts.
pub(super) const NEAR: usize = 5;

/// The blurred profiles at every shift.
pub(super) struct Onsets {
    shifts: Vec<Shift>,
    first_px: f64,
    used: [bool; COURSES],
}

/// The profiles that the edges of a frame show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Kind {
    /// Step and rims: the edge refracts the light.
    #[default]
    Sharp,
    /// Root as well: nothing refracts the light, and the darkness grows with the thickness alone.
    Rounded,
}

impl Onsets {
    /// For edges with a blur of `sigma` px, which are searched up to `search_px` outside and inside.
    pub fn new(sigma: f64, kind: Kind, search_px: [f64; 2]) -> Self {
        let per_px = SHIFTS_PER_PX as f64;
        let (first, last) = ((-search_px[0] * per_px).round() as i32, (search_px[1] * per_px).round() as i32);
        let courses = Courses::new(sigma);
        let index = |s: f64| ((s + REACH_PX as f64) * PER_PX as f64).round().clamp(0.0, (SAMPLES - 1) as f64) as usize;
        let window = |k: i32| {
            let e = f64::from(k) / per_px;
            (index(e - (WINDOW_PX + 1.5 * sigma)), index(e + WINDOW_PX + sigma) + 1)
        };
        let shifts = (first..=last.max(first))
            .map(|k| {
                let e = f64::from(k) / per_px;
                let (from, upto) = window(k);
                let courses = courses.at(|i| i as f64 / PER_PX as f64 - REACH_PX as f64 - e);
                let near = (k - NEAR as i32..=k + NEAR as i32).map(|other| {
                    let (from, upto) = window(other);
                    gram_over(&courses, from, upto)
                });
                Shift { from, upto, grams: grams(&courses, from, upto), near: near.collect(), courses }
            })
            .collect();
        Self { shifts, first_px: f64::from(first) / per_px, used: [true, true, true, kind == Kind::Rounded] }
    }

    pub fn count(&self) -> usize {
        self.shifts.len()
    }

    /// Place of a shift, px inwards. The shift may lie between two steps.
    pub fn place_px(&self, shift: f64) -> f64 {
        self.first_px + shift / SHIFTS_PER_PX as f64
    }

    /// Least-squares fit of the profiles of shift `k` to the samples, over the window of shift `window`.
    pub fn fit(&self, k: usize, window: usize, samples: &[f32]) -> Fit {
        let shift = &self.shifts[k];
        let w = &self.shifts[window];
        let (from, upto) = (w.from.min(samples.len()), w.upto.min(samples.len()));
        let n = upto - from;
        let (gram, sums) = match (window + NEAR).checked_sub(k).and_then(|off| shift.near.get(off)) {
            _ if k == window => shift.grams[n],
            Some(near) if n == w.upto - w.from => *near,
            _ => gram_over(&shift.courses, from, upto),
        };
        let seen = &samples[from..upto];
        let (mut sum, mut yy) = (0.0f32, 0.0f32);
        for &y in seen {
            sum += y;
            yy += y * y;
        }
        let mut right: Vector = [0.0; COURSES];
        for (y, courses) in seen.iter().zip(&shift.courses[from..upto]) {
            right.iter_mut().zip(courses).for_each(|(sum, c)| *sum += y * c);
        }
        // The free level is projected out; a ridge keeps it near 0.
        let free = 1.0 / (n as f32 + 1.0 / (LEVEL_SIGMA * LEVEL_SIGMA));
        let mut normal = gram;
        for i in 0..COURSES {
            for j in 0..COURSES {
                normal[i][j] -= sums[i] * sums[j] * free;
            }
            normal[i][i] += 2e-5;
            right[i] -= sums[i] * sum * free;
        }
        let energy = (yy - sum * sum * free).max(0.0);
        let (heights, explained) = non_negative(&normal, &right, self.used);
        Fit { energy, residual: (energy - explained).max(0.0), height: heights.iter().sum(), samples: n }
    }
}

/// Products of the profiles over the first samples of a window, for every number of them.
fn grams(courses: &[Vector; SAMPLES], from: usize, upto: usize) -> Vec<(Matrix, Vector)> {
    let mut gram = ([[0.0; COURSES]; COURSES], [0.0; COURSES]);
    let mut all = vec![gram];
    for at in &courses[from..upto] {
        add_to(&mut gram, at);
        all.push(gram);
    }
    all
}

fn gram_over(courses: &[Vector; SAMPLES], from: usize, upto: usize) -> (Matrix, Vector) {
    let mut gram = ([[0.0; COURSES]; COURSES], [0.0; COURSES]);
    courses[from..upto].iter().for_each(|at| add_to(&mut gram, at));
    gram
}

fn add_to((gram, sums): &mut (Matrix, Vector), at: &Vector) {
    for (row, a) in gram.iter_mut().zip(at) {
        row.iter_mut().zip(at).for_each(|(product, b)| *product += a * b);
    }
    sums.iter_mut().zip(at).for_each(|(sum, value)| *sum += value);
}

/// Non-negative least squares: solved without constraint, and again without the most negative coefficient until none is
/// negative. Returns the solution and the energy that it explains.
fn non_negative(normal: &Matrix, right: &Vector, mut used: [bool; COURSES]) -> (Vector, f32) {
    for _ in 0..COURSES {
        let x = solved(normal, right, used);
        let worst = (0..COURSES).filter(|&i| used[i]).min_by(|&i, &j| x[i].total_cmp(&x[j]));
        match worst {
            Some(i) if x[i] < 0.0 => used[i] = false,
            _ => return (x, x.iter().zip(right).map(|(a, b)| a * b).sum()),
        }
    }
    ([0.0; COURSES], 0.0)
}

/// Solves the equations of the unknowns in use by Cholesky decomposition. The others are 0.
fn solved(normal: &Matrix, right: &Vector, used: [bool; COURSES]) -> Vector {
    let mut lower = [[0.0f32; COURSES]; COURSES];
    let mut x = [0.0f32; COURSES];
    for i in (0..COURSES).filter(|&i| used[i]) {
        let mut y = right[i];
        for j in (0..i).filter(|&j| used[j]) {
            let sum: f32 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            lower[i][j] = (normal[i][j] - sum) / lower[j][j];
            y -= lower[i][j] * x[j];
        }
        let sum: f32 = (0..i).map(|k| lower[i][k] * lower[i][k]).sum();
        lower[i][i] = (normal[i][i] - sum).max(1e-6).sqrt();
        x[i] = y / lower[i][i];
    }
    for i in (0..COURSES).rev().filter(|&i| used[i]) {
        let sum: f32 = (i + 1..COURSES).filter(|&k| used[k]).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    x
}

/// The blurred profiles over the depth, at every distance that samples and shifts can have.
struct Courses {
    table: Vec<Vector>,
}

/// Greatest depth of the table, px, and its steps per px.
const DEPTH_PX: usize = 2 * REACH_PX + 2;
const STEPS_PER_PX: usize = if PER_PX > SHIFTS_PER_PX { PER_PX } else { SHIFTS_PER_PX };

impl Courses {
    fn new(sigma: f64) -> Self {
        // With cells this fine the sum approximates the integral of the blur, and no cell contains the edge.
        const CELLS: usize = 16;
        let cell = 1.0 / CELLS as f64;
        let reach = (4.0 * sigma * CELLS as f64).ceil() as i64;
        let weight = |d: i64| (-0.5 * ((d as f64 + 0.5) * cell / sigma).powi(2)).exp();
        let weights: Vec<f64> = (-reach..reach).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        let sharp: Vec<[f64; COURSES]> = (0..(DEPTH_PX * CELLS) as i64 + reach).map(|c| course((c as f64 + 0.5) * cell)).collect();
        let (first, last) = (-((DEPTH_PX * STEPS_PER_PX) as i64), (DEPTH_PX * STEPS_PER_PX) as i64);
        let blurred = |step: i64| {
            let at = step * (CELLS / STEPS_PER_PX) as i64;
            let mut mean = [0.0; COURSES];
            for (d, w) in (-reach..reach).zip(&weights) {
                if let Some(value) = usize::try_from(at + d).ok().and_then(|c| sharp.get(c)) {
                    mean.iter_mut().zip(value).for_each(|(m, v)| *m += w * v);
                }
            }
            mean.map(|m| (m / sum) as f32)
        };
        Self { table: (first..=last).map(blurred).collect() }
    }

    /// The profiles at the depths of all samples.
    fn at(&self, depth_px: impl Fn(usize) -> f64) -> [Vector; SAMPLES] {
        std::array::from_fn(|i| {
            let step = (depth_px(i) * STEPS_PER_PX as f64).round() + (DEPTH_PX * STEPS_PER_PX) as f64;
            self.table[(step.max(0.0) as usize).min(self.table.len() - 1)]
        })
    }
}

/// The profiles at a depth inside, before blur.
fn course(depth_px: f64) -> [f64; COURSES] {
    // The deflection of a ray grows with the slope of the thickness, which falls with the root of the depth. The light that the
    // lens still collects falls with the fourth power of that slope.
    let rim = |half: f64| 1.0 / (1.0 + (depth_px / half).powi(2));
    [1.0, rim(RIMS_PX[0]), rim(RIMS_PX[1]), depth_px.sqrt()]
}

/// The noiseless samples of a normal on which darkness begins at depth `begins`: the profiles with these heights, blurred by
/// sums over a hundredth of a px, on a level.
#[cfg(test)]
pub(super) fn blurred_samples(begins: f64, blur: f64, heights: [f64; COURSES], level: f64) -> [f32; SAMPLES] {
    const STEP: f64 = 0.01;
    std::array::from_fn(|i| {
        let depth = i as f64 / PER_PX as f64 - REACH_PX as f64 - begins;
        let reach = (5.0 * blur / STEP) as i32;
        let (mut sum, mut weights) = (0.0, 0.0);
        for k in -reach..=reach {
            let off = (f64::from(k) + 0.5) * STEP;
            let weight = (-0.5 * (off / blur).powi(2)).exp();
            weights += weight;
            if depth + off > 0.0 {
                sum += weight * course(depth + off).iter().zip(heights).map(|(c, h)| c * h).sum::<f64>();
            }
        }
        (level + sum / weights) as f32
    })
}
