//! Zebrafish larvae of 3, 4 and 5 days as smooth solids that can be integrated.
//!
//! ```text
//!   dorsal (-y)      ________---------_________________ .............  fin fold (thin, median)
//!              __/ o \   brain   somites               \==============>
//!   nose  (   ( eye )  [swim bladder]____notochord_______/ .............
//!              \__  \___( yolk )___yolk extension__/
//!   ventral (+y)     s = 0 ........................................ 1    x = length (s - 1/2)
//! ```
//! The body is star-shaped in every slice around its centre line: two half ellipses (dorsal and ventral height, one width)
//! with bulges for the eyes, all as smooth curves of s, closed by rounded caps. Yolk, bladder, notochord and eyes lie
//! inside it and are seen, not measured. The fin fold is a thin plate of its own: it casts a profile, so it counts in the
//! ideal hull, but not in the body.

use super::hull::ideal_hull;
use super::pigment::{self, Spot};
use super::solid::ellipsoid_mesh;
use super::spline::Spline;
use super::{Material, Mesh, Part, Placement, Specimen, Truth, Within};
use crate::scene::seeded::{Seeded, mixed};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const EYE: Material = Material { absorption_per_mm: [26.0, 27.0, 28.0], index_step: 0.0 };
const YOLK: Material = Material { absorption_per_mm: [2.0, 2.15, 2.5], index_step: 0.014 };
const NOTOCHORD: Material = Material { absorption_per_mm: [-0.5, -0.6, -0.9], index_step: -0.008 };
const BLADDER: Material = Material { absorption_per_mm: [-0.6, -0.7, -1.0], index_step: -0.16 };
const FIN: Material = Material { absorption_per_mm: [4.0, 4.2, 4.8], index_step: 0.06 };

/// Rings and segments of the drawn mesh, and of the one that is measured.
const DRAWN: (u32, u32) = (360, 144);
const MEASURED: (u32, u32) = (1600, 400);

/// What makes an age: body length, body volume, yolk and bladder.
struct Age {
    length_um: f64,
    volume_um3: f64,
    yolk: f64,
    bladder: f64,
}

#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum LarvaError {
    #[error("a larva of {found} dpf was asked for; there are phantoms of 3, 4 and 5 dpf")]
    Age { found: u8 },
}

/// One individual.
#[derive(Debug, Clone)]
pub struct Larva {
    dpf: u8,
    seed: u64,
    length_um: f64,
    /// Half width, and heights from the centre line up and down, of the unscaled fish.
    width: Spline,
    dorsal: Spline,
    ventral: Spline,
    bladder: f64,
    yolk: f64,
    /// Factor on all cross-sections that gives the body its volume.
    girth: f64,
    bend_y_um: f64,
    bend_z_um: f64,
    twist_phase: f64,
    fin_um: f64,
    finned: bool,
}

/// Where the eyes sit along the body, and how far they bulge.
const EYE_AT: f64 = 0.088;
const EYE_SPAN: f64 = 0.045;
const EYE_BULGE_UM: f64 = 30.0;

impl Larva {
    /// # Errors
    /// Refuses ages other than 3, 4 and 5 dpf.
    pub fn new(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        let age = match dpf {
            3 => Age { length_um: 3500.0, volume_um3: 2.40e8, yolk: 1.15, bladder: 0.0 },
            4 => Age { length_um: 3900.0, volume_um3: 2.66e8, yolk: 1.0, bladder: 0.7 },
            5 => Age { length_um: 4100.0, volume_um3: 3.05e8, yolk: 0.88, bladder: 1.0 },
            found => return Err(LarvaError::Age { found }),
        };
        let mut s = Seeded::new(seed ^ (u64::from(dpf) << 56));
        let mut vary = |sd: f64| 1.0 + s.normal(sd);
        let volume_um3 = age.volume_um3 * vary(0.05);
        let yolk = age.yolk * vary(0.04);
        let mut larva = Self {
            dpf,
            seed,
            length_um: age.length_um * vary(0.018),
            width: Spline::through(&varied(&WIDTH, &mut vary, |_| 1.0)),
            dorsal: Spline::through(&varied(&DORSAL, &mut vary, |_| 1.0)),
            ventral: Spline::through(&varied(&VENTRAL, &mut vary, |at| 1.0 + (yolk - 1.0) * (-((at - 0.30) / 0.10f64).powi(2)).exp())),
            bladder: age.bladder,
            yolk,
            girth: 1.0,
            bend_y_um: 22.0 * (vary(1.0) - 1.0),
            bend_z_um: 22.0 * (vary(1.0) - 1.0),
            twist_phase: TAU * vary(0.3),
            fin_um: 95.0 * vary(0.08),
            finned: true,
        };
        // Sections grow with the square of the girth. What the volume then is, the truth says.
        larva.girth = (volume_um3 / larva.body(DRAWN).volume()).sqrt();
        Ok(larva)
    }

    /// The same individual without its fin fold: body and hull then differ only by the body's own hollows.
    #[must_use]
    pub fn without_fins(mut self) -> Self {
        self.finned = false;
        self
    }

    /// Centre of the slice at `s`.
    fn centre(&self, s: f64) -> [f64; 3] {
        let arch = (2.0 * s - 1.0).powi(2) - 1.0 / 3.0;
        let wave = (TAU * s + self.twist_phase).sin();
        [self.length_um * (s - 0.5), self.bend_y_um * arch + self.girth * self.lift(s), self.bend_z_um * wave]
    }

    /// The body's axis lies higher where the yolk hangs below it.
    fn lift(&self, s: f64) -> f64 {
        -18.0 * self.yolk * (-((s - 0.55) / 0.2).powi(2)).exp() - 10.0 * s
    }

    /// Distance of the body's surface from the centre line at `s`; `theta` turns from ventral (0) by +z (pi/2) to dorsal.
    fn radius(&self, s: f64, theta: f64) -> f64 {
        self.outline(s).radius(theta)
    }

    fn outline(&self, s: f64) -> Outline {
        Outline {
            width: self.width.at(s),
            dorsal: self.dorsal.at(s),
            ventral: self.ventral.at(s),
            bulge: EYE_BULGE_UM * (-((s - EYE_AT) / EYE_SPAN).powi(2)).exp(),
            scale: self.girth * cap(s),
        }
    }

    fn body(&self, (rings, segments): (u32, u32)) -> Mesh {
        let rows: Vec<Vec<[f64; 3]>> = stations(rings).map(|s| self.ring(s, segments)).collect();
        Mesh::lofted(self.centre(0.0), &rows, self.centre(1.0))
    }

    fn ring(&self, s: f64, segments: u32) -> Vec<[f64; 3]> {
        let [x, y, z] = self.centre(s);
        let outline = self.outline(s);
        (0..segments)
            .map(|k| {
                let theta = TAU * f64::from(k) / f64::from(segments);
                let r = outline.radius(theta);
                [x, y + r * theta.cos(), z + r * theta.sin()]
            })
            .collect()
    }

    /// The fin fold's section at `s`: centre, half height and half thickness of a thin ellipse. It begins inside the body
    /// and ends behind it.
    fn fin_section(&self, s: f64) -> Option<([f64; 3], [f64; 2])> {
        if !(self.finned && FIN_FROM < s && s < FIN_TO) {
            return None;
        }
        let [x, y, z] = self.centre(s.min(1.0));
        let inside = s.min(1.0);
        let grown = |from: f64| smooth_step((s - from) / 0.16);
        let up = 0.6 * self.radius(inside, PI) + self.fin_um * grown(FIN_FROM);
        let down = 0.6 * self.radius(inside, 0.0) + self.fin_um * grown(FIN_FROM + 0.12);
        // The tail fin is rounded and a little wider than the fold before it.
        let tail = 1.0 + 0.35 * (-((s - 0.98) / 0.06).powi(2)).exp();
        let end = (1.0 - ((s - 0.94) / (FIN_TO - 0.94)).max(0.0).powi(2)).sqrt();
        let start = (1.0 - ((FIN_FROM + 0.02 - s) / 0.02).max(0.0).powi(2)).sqrt();
        let (up, down) = (up * tail * end * start, down * tail * end * start);
        let at = [x + self.length_um * (s - inside), y + (down - up) / 2.0, z];
        Some((at, [f64::midpoint(up, down), 7.0 * end * start]))
    }

    fn fin(&self, rings: u32, segments: u32) -> Option<Mesh> {
        let rows: Vec<Vec<[f64; 3]>> = self.fin_stations(rings).map(|s| self.fin_ring(s, segments)).collect();
        let middle = |row: &Vec<[f64; 3]>| {
            let opposite = row.len() / 2;
            std::array::from_fn(|i| f64::midpoint(row[0][i], row[opposite][i]))
        };
        let (first, last) = (rows.first().map(middle)?, rows.last().map(middle)?);
        Some(Mesh::lofted(first, &rows, last))
    }

    fn fin_stations(&self, rings: u32) -> impl Iterator<Item = f64> + use<> {
        let rings = if self.finned { rings } else { 0 };
        stations(rings).map(|t| FIN_FROM + (FIN_TO - FIN_FROM) * t)
    }

    fn fin_ring(&self, s: f64, segments: u32) -> Vec<[f64; 3]> {
        let Some(([x, y, z], [height, thickness])) = self.fin_section(s) else { return Vec::new() };
        (0..segments)
            .map(|k| {
                let (sin, cos) = (TAU * f64::from(k) / f64::from(segments)).sin_cos();
                [x, y + height * cos, z + thickness * sin]
            })
            .collect()
    }

    /// Slices of everything that casts a profile, for the ideal hull.
    fn sections(&self, rings: u32, segments: u32) -> Vec<(f64, Vec<[f64; 2]>)> {
        let flat = |ring: Vec<[f64; 3]>| ring.into_iter().map(|p| [p[1], p[2]]).collect::<Vec<_>>();
        let behind = self.fin_stations(rings).filter(|&s| s > 1.0);
        let mut sections: Vec<(f64, Vec<[f64; 2]>)> = stations(rings)
            .chain(behind)
            .map(|s| {
                let mut points = if s <= 1.0 { flat(self.ring(s, segments)) } else { Vec::new() };
                points.extend(flat(self.fin_ring(s, segments)));
                (self.length_um * (s - 0.5), points)
            })
            .collect();
        let tip = self.centre(0.0);
        sections.insert(0, (tip[0], vec![[tip[1], tip[2]]]));
        if !self.finned {
            let tip = self.centre(1.0);
            sections.push((tip[0], vec![[tip[1], tip[2]]]));
        }
        sections
    }

    fn truth(&self) -> Truth {
        let body = self.body(MEASURED);
        let hull = ideal_hull(&self.sections(MEASURED.0, MEASURED.1));
        Truth {
            volume_um3: body.volume(),
            area_um2: body.area(),
            hull_volume_um3: hull.volume_um3,
            hull_area_um2: hull.area_um2,
            length_um: self.length_um,
            diameter_um: None,
        }
    }

    pub fn specimen(&self) -> Specimen {
        let mut parts = vec![Part { mesh: self.body(DRAWN), material: Material::TISSUE, within_body: Within::Added }];
        parts.extend(self.fin(160, 48).map(|mesh| Part { mesh, material: FIN, within_body: Within::Replaced }));
        parts.extend(self.organs());
        let fins = if self.finned { "" } else { " without fins" };
        Specimen {
            name: format!("larva of {} dpf{fins}, seed {}", self.dpf, self.seed),
            parts,
            spots: self.spots(),
            placement: Placement::default(),
            truth: self.truth(),
        }
    }

    fn organs(&self) -> Vec<Part> {
        let g = self.girth;
        let (sin_side, mut parts) = ([1.0, -1.0], Vec::new());
        let head = self.centre(EYE_AT);
        let half_width = self.radius(EYE_AT, FRAC_PI_2);
        let eyes = sin_side.map(|side| {
            let at = [head[0], head[1] - 6.0 * g, head[2] + side * (half_width - 94.0 * g)];
            ellipsoid_mesh(at, [0.037 * self.length_um, 118.0 * g, 70.0 * g], 48, 48)
        });
        parts.push(Part { mesh: eyes[0].clone().with(&eyes[1]), material: EYE, within_body: Within::Added });

        let at = self.centre(0.295);
        let depth = self.ventral.at(0.295) * g;
        let yolk = ellipsoid_mesh([at[0], at[1] + depth * 0.42, at[2]], [0.088 * self.length_um, depth * 0.54, 150.0 * g], 64, 64);
        let behind = self.centre(0.45);
        let below = self.ventral.at(0.45) * g;
        let extension =
            ellipsoid_mesh([behind[0], behind[1] + below * 0.52, behind[2]], [0.09 * self.length_um, below * 0.26, 45.0 * g], 48, 32);
        parts.push(Part { mesh: yolk.with(&extension), material: YOLK, within_body: Within::Added });

        let rows: Vec<Vec<[f64; 3]>> = stations(120)
            .map(|t| {
                let s = 0.20 + 0.76 * t;
                let [x, y, z] = self.centre(s);
                let r = 0.30 * g * self.dorsal.at(s).min(self.width.at(s)) * (1.0 - (2.0 * t - 1.0).powi(8)).sqrt();
                let up = 0.22 * g * self.dorsal.at(s);
                (0..24).map(|k| (TAU * f64::from(k) / 24.0).sin_cos()).map(|(sin, cos)| [x, y - up + r * cos, z + r * sin]).collect()
            })
            .collect();
        if let (Some(first), Some(last)) = (rows.first(), rows.last()) {
            parts.push(Part {
                mesh: Mesh::lofted(middle_of(first), &rows, middle_of(last)),
                material: NOTOCHORD,
                within_body: Within::Added,
            });
        }

        if self.bladder > 0.0 {
            let at = self.centre(0.30);
            let size = g * self.bladder.cbrt();
            let bladder = ellipsoid_mesh([at[0], at[1] - 20.0 * g, at[2]], [175.0 * size, 72.0 * size, 72.0 * size], 64, 48);
            parts.push(Part { mesh: bladder, material: BLADDER, within_body: Within::Added });
        }
        parts
    }

    /// Pigment: stripes of melanophores along the back, the belly and the flank, a cap on the head; texture; the fin's edge.
    fn spots(&self) -> Vec<Spot> {
        let mut seeded = Seeded::new(mixed(self.seed ^ 0x5107));
        let mut spots = Vec::new();
        // Angle from ventral, its spread, first and last s, how many, size.
        let stripes = [
            (PI, 0.22, 0.05, 0.24, 34, 15.0),
            (PI, 0.30, 0.22, 0.97, 64, 11.0),
            (0.0, 0.30, 0.46, 0.97, 46, 10.0),
            (0.0, 0.75, 0.20, 0.42, 30, 13.0),
            (FRAC_PI_2 - 0.25, 0.10, 0.34, 0.80, 18, 9.0),
            (-FRAC_PI_2 + 0.25, 0.10, 0.34, 0.80, 18, 9.0),
            (FRAC_PI_2 + 0.45, 0.20, 0.14, 0.24, 7, 11.0),
            (-FRAC_PI_2 - 0.45, 0.20, 0.14, 0.24, 7, 11.0),
        ];
        for (middle, spread, from, to, count, size_um) in stripes {
            for _ in 0..count {
                let s = seeded.between(from, to);
                let theta = middle + seeded.normal(spread);
                let (sin, cos) = theta.sin_cos();
                let size = size_um * seeded.between(0.6, 1.25) * (1.15 - 0.6 * s);
                // The cell lies under the skin by its own thickness, so it never shows outside the body.
                let depth = (1.0 - (size + 6.0) / self.radius(s, theta)).max(0.0);
                pigment::melanophore(self.within(s, theta, depth), [0.0, -sin, cos], size, &mut seeded, &mut spots);
            }
        }
        self.add_texture(&mut seeded, &mut spots);
        for s in self.fin_stations(900) {
            for p in [0usize, 24] {
                if let Some(&at_um) = self.fin_ring(s, 48).get(p)
                    && (s >= 1.0 || (at_um[1] - self.centre(s)[1]).abs() > self.radius(s, if p == 0 { 0.0 } else { PI }))
                {
                    spots.push(Spot { at_um, radius_um: 4.0, density: 0.16 });
                }
            }
        }
        spots
    }
}

impl Larva {
    /// A place in the body: `depth` 0 is its centre line, 1 its surface.
    fn within(&self, s: f64, theta: f64, depth: f64) -> [f64; 3] {
        let [x, y, z] = self.centre(s);
        let r = depth * self.radius(s, theta);
        [x, y + r * theta.cos(), z + r * theta.sin()]
    }

    /// Tissue is not clear: soft lighter and darker clouds all through it, and the oblique seams between the somites.
    fn add_texture(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        for _ in 0..420 {
            let s = seeded.between(0.02, 0.9);
            let at_um = self.within(s, seeded.between(0.0, TAU), 0.85 * seeded.between(0.0, 1.0).sqrt());
            let radius_um = seeded.between(10.0, 45.0) * (1.1 - 0.7 * s);
            spots.push(Spot { at_um, radius_um, density: seeded.normal(0.12) * (1.1 - 0.7 * s) });
        }
        for seam in 0..34 {
            let at = 0.33 + 0.018 * f64::from(seam);
            for step in -6..=6 {
                // A chevron that points to the head, on both flanks.
                let height = f64::from(step) / 6.0;
                let s = at + 0.016 * height.abs();
                for side in [-1.0, 1.0] {
                    let theta = side * (FRAC_PI_2 - 1.1 * height);
                    spots.push(Spot { at_um: self.within(s, theta, 0.75), radius_um: 7.0, density: 0.07 });
                }
            }
        }
    }
}

/// The body's outline in one slice.
struct Outline {
    width: f64,
    dorsal: f64,
    ventral: f64,
    bulge: f64,
    scale: f64,
}

impl Outline {
    fn radius(&self, theta: f64) -> f64 {
        let (sin, cos) = theta.sin_cos();
        let height = if cos >= 0.0 { self.ventral } else { self.dorsal };
        let ellipse = 1.0 / ((cos / height).powi(2) + (sin / self.width).powi(2)).sqrt();
        // Below a millionth of a micrometre the bulge is not worth its two exponentials.
        let around = if self.bulge > 1e-6 { (9.0 * (sin - 1.0)).exp() + (9.0 * (-sin - 1.0)).exp() } else { 0.0 };
        self.scale * (ellipse + self.bulge * around)
    }
}

const FIN_FROM: f64 = 0.40;
const FIN_TO: f64 = 1.03;

/// Half width, dorsal and ventral height along the body, um. Read off lateral and dorsal views of larvae; the caps are
/// put on by [`cap`].
const WIDTH: [[f64; 2]; 12] = [
    [0.0, 140.0],
    [0.05, 182.0],
    [0.10, 198.0],
    [0.16, 205.0],
    [0.24, 196.0],
    [0.32, 180.0],
    [0.42, 140.0],
    [0.52, 112.0],
    [0.65, 86.0],
    [0.80, 56.0],
    [0.92, 30.0],
    [1.0, 16.0],
];
const DORSAL: [[f64; 2]; 12] = [
    [0.0, 135.0],
    [0.05, 178.0],
    [0.10, 200.0],
    [0.16, 200.0],
    [0.24, 190.0],
    [0.32, 178.0],
    [0.42, 160.0],
    [0.52, 142.0],
    [0.65, 115.0],
    [0.80, 80.0],
    [0.92, 44.0],
    [1.0, 22.0],
];
const VENTRAL: [[f64; 2]; 12] = [
    [0.0, 128.0],
    [0.05, 165.0],
    [0.10, 186.0],
    [0.16, 205.0],
    [0.24, 252.0],
    [0.32, 256.0],
    [0.42, 186.0],
    [0.52, 136.0],
    [0.65, 102.0],
    [0.80, 70.0],
    [0.92, 40.0],
    [1.0, 20.0],
];

fn varied(knots: &[[f64; 2]], vary: &mut impl FnMut(f64) -> f64, by: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    knots.iter().map(|&[s, value]| [s, value * by(s) * vary(0.02)]).collect()
}

fn middle_of(ring: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|i| ring.iter().map(|p| p[i]).sum::<f64>() / ring.len() as f64)
}

/// Closes the body at both ends like an ellipsoid: over a fifteenth of the length at the nose, a fiftieth at the tail.
fn cap(s: f64) -> f64 {
    let end = |from_end: f64, over: f64| {
        let t = (1.0 - from_end / over).max(0.0);
        (1.0 - t * t).max(0.0).sqrt()
    };
    end(s, 0.065) * end(1.0 - s, 0.02)
}

fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// `n` places between 0 and 1, without both, denser towards the ends where the caps curve.
fn stations(n: u32) -> impl Iterator<Item = f64> {
    (1..n).map(move |i| (1.0 - (PI * f64::from(i) / f64::from(n)).cos()) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume as Int Int r^2 / 2 dtheta dx, which shares nothing with the meshes.
    fn integrated(larva: &Larva, slices: u32, turns: u32) -> f64 {
        let mut sum = 0.0;
        for i in 0..slices {
            let outline = larva.outline((f64::from(i) + 0.5) / f64::from(slices));
            sum += (0..turns).map(|k| outline.radius(TAU * f64::from(k) / f64::from(turns)).powi(2)).sum::<f64>();
        }
        sum / 2.0 * TAU / f64::from(turns) * larva.length_um / f64::from(slices)
    }

    #[test]
    fn the_truth_has_converged() {
        for dpf in [3, 4, 5] {
            let larva = Larva::new(dpf, 11).unwrap();
            let truth = larva.truth();
            let coarser = larva.body((800, 200));
            let hull = ideal_hull(&larva.sections(800, 200));
            let off = |a: f64, b: f64| (a / b - 1.0).abs();
            println!(
                "{dpf} dpf: V {:.5e} ({:.1e} against half the mesh, {:.1e} against the integral), A {:.5e} ({:.1e}); hull V {:.5e} ({:.1e}), A {:.5e} ({:.1e})",
                truth.volume_um3,
                off(coarser.volume(), truth.volume_um3),
                off(integrated(&larva, 20_000, 720), truth.volume_um3),
                truth.area_um2,
                off(coarser.area(), truth.area_um2),
                truth.hull_volume_um3,
                off(hull.volume_um3, truth.hull_volume_um3),
                truth.hull_area_um2,
                off(hull.area_um2, truth.hull_area_um2),
            );
            // Errors fall with the square of the mesh: against half the mesh it shows three times what is left.
            assert!(off(coarser.volume(), truth.volume_um3) < 3e-4);
            assert!(off(coarser.area(), truth.area_um2) < 3e-4);
            assert!(off(hull.volume_um3, truth.hull_volume_um3) < 3e-4);
            assert!(off(hull.area_um2, truth.hull_area_um2) < 1e-3);
            assert!(off(integrated(&larva, 20_000, 720), truth.volume_um3) < 1e-4);
            // What is drawn is what is measured, within its facets: (2 pi / 144)^2 / 6 = 3.2e-4, and the rings.
            assert!(off(larva.body(DRAWN).volume(), truth.volume_um3) < 1e-3);
        }
    }

    #[test]
    fn ages_have_their_sizes_and_individuals_differ() {
        for (dpf, volume, area) in [(3, 2.4e8, 3.13e6), (4, 2.66e8, 3.26e6), (5, 3.05e8, 3.55e6)] {
            for seed in 0..4 {
                let truth = Larva::new(dpf, seed).unwrap().truth();
                assert!((truth.volume_um3 / volume - 1.0).abs() < 0.2, "{dpf} dpf, seed {seed}: {truth:?}");
                assert!((truth.area_um2 / area - 1.0).abs() < 0.2, "{dpf} dpf, seed {seed}: {truth:?}");
            }
        }
        let volume = |seed| Larva::new(4, seed).unwrap().truth().volume_um3;
        assert!((volume(1) - volume(2)).abs() > 1e5);
        assert!((volume(1) - volume(1)).abs() < f64::EPSILON);
        assert_eq!(Larva::new(6, 0).unwrap_err(), LarvaError::Age { found: 6 });
    }

    #[test]
    fn the_hull_holds_the_body_and_fins_add_to_it() {
        for dpf in [3, 4, 5] {
            let larva = Larva::new(dpf, 3).unwrap();
            let (finned, bare) = (larva.truth(), larva.clone().without_fins().truth());
            assert!(bare.hull_volume_um3 >= bare.volume_um3, "{bare:?}");
            assert!(bare.hull_volume_um3 < 1.02 * bare.volume_um3, "a bare body is nearly convex in its slices: {bare:?}");
            assert!(finned.hull_volume_um3 > 1.01 * bare.hull_volume_um3, "{finned:?}");
            assert!((finned.volume_um3 - bare.volume_um3).abs() < 1.0, "fins are no part of the body");
        }
    }

    #[test]
    fn organs_lie_inside_the_body_and_all_parts_are_closed() {
        for (dpf, seed) in [(3, 1), (4, 2), (5, 3), (5, 4)] {
            let larva = Larva::new(dpf, seed).unwrap();
            for part in larva.organs() {
                let mesh = part.mesh.closed().unwrap();
                for v in &mesh.vertices {
                    let s = v[0] / larva.length_um + 0.5;
                    let [_, y, z] = larva.centre(s);
                    let (dy, dz) = (v[1] - y, v[2] - z);
                    let room = larva.radius(s, dz.atan2(dy)) - dy.hypot(dz);
                    assert!(room > 0.0, "{dpf} dpf, seed {seed}: an organ sticks out by {:.1} um at s = {s:.3} ({dy:.0}, {dz:.0})", -room);
                }
            }
            larva.body(DRAWN).closed().unwrap();
            larva.fin(160, 48).unwrap().closed().unwrap();
        }
    }
}
