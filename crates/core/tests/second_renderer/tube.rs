//! Exact silhouettes of a specimen in a concentric glass tube: every ray is traced, face by face, by Snell's law.
//!
//! ```text
//!            outer face   bore
//!   h ──────────(─\      /──       d' = m d + (m c - sqrt(1 - m^2 (1 - c^2))) n      m = n1 / n2, c = -d n
//!   parallel    (   `─. (    line in the bore: what touches it on one side is an edge of the silhouette
//! ```
//! Each slice across the axis stands for itself, as for a telecentric lens that looks straight at the axis.

use crate::shape::Section;
use carved_core::profile::{Mask, Polygon};
use rayon::prelude::*;

type Vector = [f64; 2];

/// Indices of water and of borosilicate glass.
pub const WATER: f64 = 1.333;
pub const GLASS: f64 = 1.474;
/// Radius of the bore, um.
pub const BORE_UM: f64 = 300.0;

/// A tube with water inside. `None` as outer radius: no glass, and water everywhere.
#[derive(Debug, Clone, Copy)]
pub struct Tube {
    pub outer_um: Option<f64>,
    pub outside: f64,
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Where a ray from `from` along `along` enters a circle about the axis. `None` where it passes by.
fn enters(from: Vector, along: Vector, radius: f64) -> Option<Vector> {
    let middle = dot(from, along);
    let root = middle * middle - dot(from, from) + radius * radius;
    (root >= 0.0).then(|| {
        let way = -middle - root.sqrt();
        [0, 1].map(|i| from[i] + way * along[i])
    })
}

/// The direction behind a face at `at` of a circle about the axis. `None` where the ray is reflected totally.
fn refracted(at: Vector, along: Vector, radius: f64, from: f64, to: f64) -> Option<Vector> {
    let normal = at.map(|a| a / radius);
    let (m, c) = (from / to, -dot(along, normal));
    let root = 1.0 - m * m * (1.0 - c * c);
    (root >= 0.0).then(|| [0, 1].map(|i| m * along[i] + (m * c - root.sqrt()) * normal[i]))
}

impl Tube {
    pub const NONE: Self = Self { outer_um: None, outside: WATER };

    pub fn of(outer_um: Option<f64>) -> Self {
        Self { outer_um, ..Self::NONE }
    }

    /// A point of the line in the bore of the ray that comes in at height `h`, and its direction; across the axis and in depth.
    fn line(&self, h: f64) -> Option<[Vector; 2]> {
        let (from, along) = ([h, -1e4], [0.0, 1.0]);
        let Some(outer) = self.outer_um else { return Some([from, along]) };
        let at = enters(from, along, outer)?;
        let along = refracted(at, along, outer, self.outside, GLASS)?;
        let at = enters(at, along, BORE_UM)?;
        Some([at, refracted(at, along, BORE_UM, GLASS, WATER)?])
    }

    /// Heights of the upper and of the lower edge of a slice turned by `omega`, um.
    fn edges(&self, hull: &Section, omega: f64) -> [f64; 2] {
        let (sin, cos) = omega.sin_cos();
        let turned: Vec<Vector> = hull.iter().map(|[y, z]| [y * cos - z * sin, y * sin + z * cos]).collect();
        let farthest = 0.999 * BORE_UM * WATER / self.outside;
        [-1.0, 1.0].map(|side| {
            // Whether the ray at this height passes outside of every corner.
            let passes = |h: f64| {
                let Some([at, along]) = self.line(h) else { return true };
                turned.iter().all(|p| side * ((p[0] - at[0]) * along[1] - (p[1] - at[1]) * along[0]) < 0.0)
            };
            let (mut inside, mut outside) = (-side * farthest, side * farthest);
            for _ in 0..32 {
                let middle = f64::midpoint(inside, outside);
                if passes(middle) { outside = middle } else { inside = middle }
            }
            outside
        })
    }
}

/// The convex slices of a specimen, all at even steps.
#[derive(Debug, Clone)]
pub struct Slices {
    first_um: f64,
    step_um: f64,
    pub hulls: Vec<Section>,
}

/// A silhouette: its outline, and the pixels whose centres it covers.
pub struct Silhouette {
    pub mask: Mask,
    pub outline: Polygon,
}

/// Width, height and scale of the pictures, px and um.
pub const SIZE: [usize; 2] = [1024, 200];
pub const PX_UM: f64 = 5.4;
/// Column and row of the axis.
pub const ORIGIN_PX: [f64; 2] = [511.5, 99.5];

impl Slices {
    /// Slices whose middle lies `off_um` from the axis. They are scaled until they reach to `fill` of the bore.
    pub fn of(hulls: &[Section], step_um: f64, off_um: f64, fill: f64) -> Self {
        let off = [0.6 * off_um, 0.8 * off_um];
        let placed = |scale: f64| -> Vec<Section> {
            hulls.iter().map(|hull| hull.iter().map(|p| [0, 1].map(|i| scale * p[i] + off[i])).collect()).collect()
        };
        let reach = |hulls: &[Section]| hulls.iter().flatten().map(|[y, z]| y.hypot(*z)).fold(0.0, f64::max);
        let (mut low, mut high) = (0.1, 2.0);
        for _ in 0..40 {
            let middle = f64::midpoint(low, high);
            if reach(&placed(middle)) > fill * BORE_UM { high = middle } else { low = middle }
        }
        Self { first_um: -(hulls.len() as f64 - 1.0) / 2.0 * step_um, step_um, hulls: placed(low) }
    }

    pub fn hull_um3(&self) -> f64 {
        self.hulls.iter().map(|hull| crate::shape::area(hull)).sum::<f64>() * self.step_um
    }

    /// Rows of the upper and lower edge of each slice when the specimen has turned by `omega`, px.
    pub fn edges(&self, tube: &Tube, omega: f64) -> Vec<[f64; 2]> {
        let row = |um: f64| ORIGIN_PX[1] + um / PX_UM;
        self.hulls.par_iter().map(|hull| tube.edges(hull, omega).map(row)).collect()
    }

    /// What a telecentric camera sees: the silhouette between these rows.
    pub fn silhouette(&self, edges: &[[f64; 2]]) -> Silhouette {
        let column = |slice: usize| ORIGIN_PX[0] + (self.first_um + slice as f64 * self.step_um) / PX_UM;
        let at = |side: usize| edges.iter().enumerate().map(move |(i, e)| [column(i), e[side]]);
        let outline = Polygon { vertices: at(1).chain(at(0).rev()).collect() };
        let mut mask = Mask::empty(SIZE[0], SIZE[1]);
        for u in 0..SIZE[0] {
            let slice = ((u as f64 - column(0)) * PX_UM / self.step_um).round();
            if let Some([upper, lower]) = usize::try_from(slice as i64).ok().and_then(|slice| edges.get(slice)) {
                (0..SIZE[1]).filter(|v| (*upper..*lower).contains(&(*v as f64))).for_each(|v| mask.set(u, v, true));
            }
        }
        Silhouette { mask, outline }
    }
}
