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

use crate::profile::settings::REACH_PX;

/// Samples along a normal: from `REACH_PX` outside to `REACH_PX` inside.
pub(in crate::profile) const PER_PX: usize = 2;
pub(in crate::profile) const SAMPLES: usize = 2 * REACH_PX * PER_PX + 1;
/// Positions per px that the fit tries. The residual rises much faster on one side of the edge than on the other, so that a
/// parabola through positions further apart would move the edge: by up to 0.06 px at 8 per px, and 0.02 px at 32.
pub(in crate::profile) const SHIFTS_PER_PX: usize = 32;
/// Every so many shifts have a window of their own. The others use the nearest one's.
pub(in crate::profile) const PER_WINDOW: usize = 4;

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

/// The fit of one shift at one place.
#[derive(Debug, Clone, Copy)]
pub(in crate::profile) struct Fit {
    /// Energy of the samples about the free level, and its unexplained part.
    pub energy: f32,
    pub residual: f32,
    /// Height of step and rim together with that of the root one pixel inside.
    pub height: f32,
    /// Samples in the window.
    pub samples: usize,
}

/// The samples that the shifts near its own explain.
struct Window {
    from: usize,
    upto: usize,
    /// `first[n]`: the basis of its own shift over the first `n` samples.
    first: Vec<Basis>,
    /// The bases over all samples of the shifts from [`NEAR`] before to `NEAR` after its own.
    near: Vec<Basis>,
}

/// The profiles of a shift by sample, so that all are summed together.
type Shift = [Vector; SAMPLES];

/// The profiles of a shift over the samples of a window, with the free level projected out. Their products are the matrix `N` of
/// the normal equations. With `N = L L'` and `W = L^-1`, a right-hand side `r` gives `z = W r`, the solution `x = W' z`, and the
/// explained energy `z z`. So a fit needs no equations to be solved.
#[derive(Debug, Clone, Copy)]
struct Basis {
    /// The rows of `W`.
    rows: [Vector; COURSES],
    /// Sums of the profiles times the inverse weight of the level.
    level: Vector,
}

/// How far the window of a fit lies from its shift at most, in shifts.
pub(in crate::profile) const NEAR: usize = 5 * PER_WINDOW;

/// The blurred profiles at every shift.
pub(in crate::profile) struct Onsets {
    shifts: Vec<Shift>,
    /// Those of every [`PER_WINDOW`]th shift.
    windows: Vec<Window>,
    first_px: f64,
    used: [bool; COURSES],
}

/// The profiles that the edges of a frame show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::profile) enum Kind {
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
        let used = [true, true, true, kind == Kind::Rounded];
        let index = |s: f64| ((s + REACH_PX as f64) * PER_PX as f64).round().clamp(0.0, (SAMPLES - 1) as f64) as usize;
        let window = |k: i32| {
            let e = f64::from(k) / per_px;
            (index(e - (WINDOW_PX + 1.5 * sigma)), index(e + WINDOW_PX + sigma) + 1)
        };
        let place = |k: i32| f64::from(k) / per_px;
        let shifts: Vec<Shift> =
            (first..=last.max(first)).map(|k| courses.at(|i| i as f64 / PER_PX as f64 - REACH_PX as f64 - place(k))).collect();
        let windows = (0..shifts.len())
            .step_by(PER_WINDOW)
            .map(|k| {
                let (from, upto) = window(first + k as i32);
                let basis = |k: usize, end: usize| Basis::over(&shifts[k.min(shifts.len() - 1)][from..end], used);
                let first = (from..=upto).map(|end| basis(k, end)).collect();
                let near = (0..=2 * NEAR).map(|n| basis((k + n).saturating_sub(NEAR), upto)).collect();
                Window { from, upto, first, near }
            })
            .collect();
        Self { shifts, windows, first_px: place(first), used }
    }

    pub fn count(&self) -> usize {
        self.shifts.len()
    }

    /// Place of a shift, px inwards. The shift may lie between two steps.
    pub fn place_px(&self, shift: f64) -> f64 {
        self.first_px + shift / SHIFTS_PER_PX as f64
    }

    /// The samples that the window of a shift contains; the shift is a multiple of [`PER_WINDOW`].
    pub fn seen<'a>(&self, window: usize, samples: &'a [f32]) -> WindowSamples<'a> {
        debug_assert!(window.is_multiple_of(PER_WINDOW));
        let w = &self.windows[window / PER_WINDOW];
        let (from, upto) = (w.from.min(samples.len()), w.upto.min(samples.len()));
        let values = &samples[from..upto];
        let (mut sum, mut squares) = (0.0f32, 0.0f32);
        for &y in values {
            sum += y;
            squares += y * y;
        }
        let energy = (squares - sum * sum * free(values.len())).max(0.0);
        WindowSamples { window, from, complete: upto == w.upto, values, sum, energy }
    }

    /// Least-squares fit of the profiles of shift `k` to the samples of a window.
    pub fn fit(&self, k: usize, seen: &WindowSamples) -> Fit {
        let window = &self.windows[seen.window / PER_WINDOW];
        let n = seen.values.len();
        let courses = &self.shifts[k][seen.from..seen.from + n];
        let built;
        let basis = match (k + NEAR).checked_sub(seen.window).and_then(|off| window.near.get(off)) {
            Some(near) if seen.complete => near,
            _ if k == seen.window => &window.first[n],
            _ => {
                built = Basis::over(courses, self.used);
                &built
            }
        };
        let mut right: Vector = [0.0; COURSES];
        for (y, courses) in seen.values.iter().zip(courses) {
            for i in 0..COURSES {
                right[i] += y * courses[i];
            }
        }
        right.iter_mut().zip(&basis.level).for_each(|(right, level)| *right -= level * seen.sum);
        let (height, explained) = basis.non_negative(&right);
        Fit { energy: seen.energy, residual: (seen.energy - explained).max(0.0), height, samples: n }
    }
}

/// The samples in a window.
pub(in crate::profile) struct WindowSamples<'a> {
    window: usize,
    from: usize,
    /// Whether the window has no samples beyond these.
    complete: bool,
    values: &'a [f32],
    sum: f32,
    energy: f32,
}

/// Inverse weight of the free level, which is projected out. A ridge keeps the level near 0.
fn free(samples: usize) -> f32 {
    1.0 / (samples as f32 + 1.0 / (LEVEL_SIGMA * LEVEL_SIGMA))
}

impl Basis {
    /// The basis of the profiles in use over these samples.
    fn over(courses: &[Vector], used: [bool; COURSES]) -> Self {
        const RIDGE: f64 = 2e-5;
        let free = f64::from(free(courses.len()));
        let sum = |of: &dyn Fn(&Vector) -> f32| courses.iter().map(|c| f64::from(of(c))).sum::<f64>();
        let sums: [f64; COURSES] = std::array::from_fn(|i| sum(&|c| c[i]));
        // By Cholesky decomposition, row by row: `lower` is L, and `inverse` is W.
        let (mut lower, mut inverse) = ([[0.0f64; COURSES]; COURSES], [[0.0f64; COURSES]; COURSES]);
        for i in (0..COURSES).filter(|&i| used[i]) {
            for j in 0..i {
                let normal = sum(&|c| c[i] * c[j]) - sums[i] * sums[j] * free;
                let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
                lower[i][j] = (normal - known) / lower[j][j];
            }
            let normal = sum(&|c| c[i] * c[i]) - sums[i] * sums[i] * free + RIDGE;
            lower[i][i] = (normal - (0..i).map(|k| lower[i][k] * lower[i][k]).sum::<f64>()).max(1e-6).sqrt();
            let unit = |j: usize| if j == i { 1.0 } else { 0.0 };
            inverse[i] = std::array::from_fn(|j| (unit(j) - (0..i).map(|k| lower[i][k] * inverse[k][j]).sum::<f64>()) / lower[i][i]);
        }
        Self { rows: inverse.map(|row| row.map(|value| value as f32)), level: sums.map(|sum| (sum * free) as f32) }
    }

    /// Non-negative least squares: the solution without constraint, and again without the most negative coefficient until none is
    /// negative. A coefficient stays 0 where its column of `W` is projected out of `z` and of the other columns. Returns the sum of
    /// the coefficients and the energy that they explain.
    fn non_negative(&self, right: &Vector) -> (f32, f32) {
        let mut rows = self.rows;
        let mut z = rows.map(|row| dot(&row, right));
        for _ in 0..COURSES {
            let x = sum_of_rows(&rows, &z);
            let worst = (1..COURSES).fold(0, |worst, i| if x[i] < x[worst] { i } else { worst });
            if x[worst] >= 0.0 {
                return (x.iter().sum(), dot(&z, &z));
            }
            let out = rows.map(|row| row[worst]);
            let scale = 1.0 / dot(&out, &out);
            let shares = sum_of_rows(&rows, &out).map(|share| share * scale);
            let share_of_z = dot(&out, &z) * scale;
            for ((row, z), out) in rows.iter_mut().zip(&mut z).zip(out) {
                for i in 0..COURSES {
                    row[i] -= out * shares[i];
                }
                row[worst] = 0.0;
                *z -= out * share_of_z;
            }
        }
        (0.0, 0.0)
    }
}

/// Rows times their weights, summed.
fn sum_of_rows(rows: &[Vector; COURSES], weights: &Vector) -> Vector {
    let mut sum: Vector = [0.0; COURSES];
    for (row, weight) in rows.iter().zip(weights) {
        for i in 0..COURSES {
            sum[i] += weight * row[i];
        }
    }
    sum
}

fn dot(a: &Vector, b: &Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + (a[2] * b[2] + a[3] * b[3])
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
        const CELLS: usize = 32;
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
pub(in crate::profile) fn blurred_samples(begins: f64, blur: f64, heights: [f64; COURSES], level: f64) -> [f32; SAMPLES] {
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
