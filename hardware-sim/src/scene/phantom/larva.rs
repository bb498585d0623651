//! Zebrafish larvae of 2 to 7 dpf as smooth solids that can be integrated.
//!
//! ```text
//!   dorsal (-y)      ________---------_________________ .............  fin fold (thin, median)
//!              __/ o \   brain   somites               \==============>
//!   nose  (   ( eye )  [swim bladder]____notochord_______/ .............
//!              \__  \___( yolk )___yolk extension__/
//!   ventral (+y)     s = 0 ........................................ 1    x = length (s - 1/2)
//! ```
//! The body is star-shaped in every slice around its centre line. A slice consists of two half ellipses (dorsal and ventral height, one
//! width) with bulges for the eyes. All are smooth curves of s, closed by rounded caps. Yolk, bladder, notochord and eyes lie inside the
//! body: they are visible, but not measured. The fin fold is a separate thin plate, and so is each pectoral fin. They are part of the
//! outline, so they count in the ideal hull, but not in the body.

mod look;
mod organs;
mod pectoral;
mod shape;
mod skin;

use super::hull::ideal_hull;
use super::truth::AskedTruth;
use super::{Mesh, Part, Placement, Specimen, Truth, Within};
use crate::scene::seeded::Seeded;
pub use look::{Bladder, Condition, Look};
use organs::EYE_AT;
pub use organs::OrganTruth;
use shape::{Age, Shape};
use std::f64::consts::{PI, TAU};

/// Rings and segments of the drawn mesh, and of the mesh for the true values.
const DRAWN: (u32, u32) = (360, 144);
const MEASURED: (u32, u32) = (1600, 400);

#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum LarvaError {
    #[error("a larva of {found} dpf was asked for; there are phantoms of {first} to {last} dpf")]
    Age { found: u8, first: u8, last: u8 },
}

/// One individual.
#[derive(Debug, Clone)]
pub struct Larva {
    dpf: u8,
    seed: u64,
    length_um: f64,
    /// The drawing from the side, in thousandths of the length.
    shape: Shape,
    bladder: f64,
    /// The amount of yolk: 1 at 3 dpf.
    yolk: f64,
    /// Factor on all cross-sections that gives the body its volume.
    girth: f64,
    /// Factor on the absorption of all tissue.
    opacity: f64,
    bend_y_um: f64,
    bend_z_um: f64,
    twist_phase: f64,
    fin_um: f64,
    finned: bool,
    look: Look,
}

/// Size of the bulges of the eyes, along the body and outwards.
const EYE_SPAN: f64 = 0.040;
const EYE_BULGE: f64 = 7.0;

impl Larva {
    /// # Errors
    /// The age is not 2 to 7 dpf.
    pub fn new(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        let age = Age::of(dpf).ok_or(LarvaError::Age { found: dpf, first: Age::FIRST, last: Age::LAST })?;
        Ok(Self::individual(dpf, &age, seed, Look::default()))
    }

    /// The same individual with another appearance.
    #[must_use]
    pub fn with_look(self, look: Look) -> Self {
        match Age::of(self.dpf) {
            Some(age) => Self { finned: self.finned, ..Self::individual(self.dpf, &age, self.seed, look) },
            None => self,
        }
    }

    fn individual(dpf: u8, age: &Age, seed: u64, look: Look) -> Self {
        let mut s = Seeded::new(seed ^ (u64::from(dpf) << 56));
        let mut vary = |sd: f64| 1.0 + s.normal(sd);
        let volume_um3 = age.volume_um3 * vary(0.05);
        let youth = (age.youth + 0.12 * (vary(1.0) - 1.0)).clamp(0.0, age.youth.max(1.0) + 0.1);
        let length_um = age.length_um * vary(0.018);
        let [dorsal, ventral, width] = [swelling(&mut vary), swelling(&mut vary), swelling(&mut vary)];
        let trunk = |s: f64| 1.0 - (1.0 - look.trunk) * smooth_step((s - EYE_AT - 0.015) / 0.06);
        let shape = |swollen: f64| {
            let vary: [Box<dyn Fn(f64) -> f64>; 3] = [
                Box::new(|s| look.height * dorsal(s)),
                Box::new(|s| look.height * ventral(s) * (1.0 + swollen * look.condition.swelling(s))),
                Box::new(|s| trunk(s) * width(s)),
            ];
            Shape::new(youth, &vary)
        };
        let (shorter, smaller) = if look.condition == Condition::Short { (0.8, 0.75) } else { (1.0, 1.0) };
        let mut larva = Self {
            dpf,
            seed,
            length_um: shorter * length_um,
            shape: shape(0.0),
            bladder: if look.condition == Condition::NoSwimBladder { 0.0 } else { age.bladder },
            yolk: (0.35 + 0.65 * youth) * age.yolk_left,
            girth: 1.0,
            opacity: 1.35 * vary(0.12) * look.density,
            bend_y_um: 22.0 * (vary(1.0) - 1.0),
            bend_z_um: 22.0 * (vary(1.0) - 1.0),
            twist_phase: TAU * vary(0.3),
            fin_um: 85.0 * vary(0.08),
            finned: true,
            look,
        };
        // The area of sections grows with the square of the girth. The volume is computed from the mesh.
        larva.girth = (smaller * volume_um3 / larva.body(DRAWN).volume()).sqrt();
        // Fluid is added to the volume.
        larva.shape = shape(1.0);
        larva
    }

    /// The same individual without its fin fold and pectoral fins. Body and hull then differ only by the hollows of the body.
    #[must_use]
    pub fn without_fins(mut self) -> Self {
        self.finned = false;
        self
    }

    /// A thousandth of the length, across the body.
    fn unit_um(&self) -> f64 {
        1e-3 * self.length_um * self.girth
    }

    /// The point of the median plane at `s` and a height of the drawing.
    fn lateral(&self, s: f64, height: f64) -> [f64; 3] {
        let arch = (2.0 * s - 1.0).powi(2) - 1.0 / 3.0;
        let wave = (TAU * s + self.twist_phase).sin();
        // Where the body is deepest, its middle is on the axis of the specimen.
        let y = self.bend_y_um * arch + self.unit_um() * (height - self.shape.middle);
        let [bent_y, bent_z] = self.bend_of_condition(s);
        [self.length_um * (s - 0.5), y + bent_y, self.bend_z_um * wave + bent_z]
    }

    /// Shift of the body at `s` by a bent tail or a curled body.
    fn bend_of_condition(&self, s: f64) -> [f64; 2] {
        let off_um = match self.look.condition {
            Condition::BentTail => BENT_TAIL_UM * ((s - BENT_FROM) / (1.0 - BENT_FROM)).max(0.0).powi(2),
            Condition::Curled => CURLED_UM * ((2.0 * s - 1.0).powi(2) - 1.0 / 3.0),
            _ => return [0.0, 0.0],
        };
        // Each individual is bent to its own side: towards the belly or sideways, because the tail is high in the bore.
        let (sin, cos) = (1.4 * (self.twist_phase * 3.0).sin()).sin_cos();
        [off_um * cos, off_um * sin]
    }

    /// Centre of the slice at `s`.
    fn centre(&self, s: f64) -> [f64; 3] {
        self.lateral(s, self.shape.centre.at(s))
    }

    /// Distance of the body's surface from the centre line at `s`; `theta` turns from ventral (0) by +z (pi/2) to dorsal.
    fn radius(&self, s: f64, theta: f64) -> f64 {
        self.outline(s).radius(theta)
    }

    fn outline(&self, s: f64) -> Outline {
        Outline {
            width: self.shape.width.at(s),
            dorsal: self.shape.dorsal.at(s),
            ventral: self.shape.ventral.at(s),
            bulge: EYE_BULGE * self.look.eyes * (-((s - EYE_AT) / EYE_SPAN).powi(2)).exp(),
            scale: self.unit_um() * cap(s),
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
        // The tail fin is rounded and a little higher than the fold in front of it.
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

    /// Slices of body and fin fold, for the ideal hull.
    fn sections(&self, rings: u32, segments: u32) -> Vec<(f64, Vec<[f64; 2]>)> {
        let flat = |ring: Vec<[f64; 3]>| ring.into_iter().map(|p| [p[1], p[2]]).collect::<Vec<_>>();
        let behind = self.fin_stations(rings).filter(|&s| s > 1.0);
        let mut sections: Vec<(f64, Vec<[f64; 2]>)> = stations(rings)
            .chain(behind)
            .map(|s| {
                let mut points = if s <= 1.0 { flat(self.ring(s, segments)) } else { Vec::new() };
                points.extend(flat(self.fin_ring(s, segments)));
                points.extend(flat(self.pectoral_points(s, segments)));
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
        let mut parts = vec![Part { mesh: self.body(DRAWN), material: self.tinged(organs::BODY), within_body: Within::Added }];
        let fin = organs::FIN.times(self.look.fin_contrast);
        parts.extend(self.fin(160, 48).map(|mesh| Part { mesh, material: fin, within_body: Within::Replaced }));
        parts.extend(self.pectorals(120, 32));
        parts.extend(self.organs());
        let measured = self.clone();
        let fins = if self.finned { "" } else { " without fins" };
        let sick = match self.look.condition {
            Condition::Healthy => String::new(),
            condition => format!(", {condition:?}"),
        };
        Specimen {
            name: format!("larva of {} dpf{fins}{sick}, seed {}", self.dpf, self.seed),
            parts,
            spots: self.spots(),
            placement: Placement::default(),
            truth: AskedTruth::by(move || measured.truth()),
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
        // Below 1e-6 um the bulge is negligible, and the two exponentials are slow.
        let around = if self.bulge > 1e-6 { (9.0 * (sin - 1.0)).exp() + (9.0 * (-sin - 1.0)).exp() } else { 0.0 };
        self.scale * (ellipse + self.bulge * around)
    }
}

/// Where a bent tail begins, and how far the end of the tail is from its place.
const BENT_FROM: f64 = 0.5;
const BENT_TAIL_UM: f64 = 330.0;
/// Distance between the ends and the middle of a curled body, in the direction of the bend, times 2/3.
const CURLED_UM: f64 = 240.0;

const FIN_FROM: f64 = 0.40;
const FIN_TO: f64 = 1.03;

/// The variation of an individual along a curve: a factor of three slow waves around 1.
fn swelling(vary: &mut dyn FnMut(f64) -> f64) -> impl Fn(f64) -> f64 + use<> {
    let waves = [1.0, 2.0, 3.5].map(|turns| (turns, vary(0.015) - 1.0, TAU * vary(0.3)));
    move |s| 1.0 + waves.iter().map(|(turns, by, phase)| by * (TAU * turns * s + phase).sin()).sum::<f64>()
}

/// Closes the body at both ends like an ellipsoid: over 1/15 of the length at the nose and 1/50 at the tail.
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

/// `n` positions between 0 and 1, without both ends. They are denser towards the ends, where the caps curve.
fn stations(n: u32) -> impl Iterator<Item = f64> {
    (1..n).map(move |i| (1.0 - (PI * f64::from(i) / f64::from(n)).cos()) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume as Int Int r^2 / 2 dtheta dx, which does not use the meshes.
    fn integrated(larva: &Larva, slices: u32, turns: u32) -> f64 {
        let mut sum = 0.0;
        for i in 0..slices {
            let outline = larva.outline((f64::from(i) + 0.5) / f64::from(slices));
            sum += (0..turns).map(|k| outline.radius(TAU * f64::from(k) / f64::from(turns)).powi(2)).sum::<f64>();
        }
        sum / 2.0 * TAU / f64::from(turns) * larva.length_um / f64::from(slices)
    }

    #[test]
    fn the_true_values_have_converged() {
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
            // Errors decrease with the square of the mesh size, so the difference to the half mesh is three times the remaining error.
            assert!(off(coarser.volume(), truth.volume_um3) < 3e-4);
            assert!(off(coarser.area(), truth.area_um2) < 3e-4);
            assert!(off(hull.volume_um3, truth.hull_volume_um3) < 3e-4);
            assert!(off(hull.area_um2, truth.hull_area_um2) < 1e-3);
            assert!(off(integrated(&larva, 20_000, 720), truth.volume_um3) < 1e-4);
            // The drawn mesh agrees with the true values within its facets: (2 pi / 144)^2 / 6 = 3.2e-4, and the rings.
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
        assert_eq!(Larva::new(8, 0).unwrap_err(), LarvaError::Age { found: 8, first: 2, last: 7 });
        assert!(Larva::new(1, 0).is_err());
    }

    #[test]
    fn the_hull_holds_the_body_and_fins_add_to_it() {
        for dpf in [3, 4, 5] {
            let larva = Larva::new(dpf, 3).unwrap();
            let (finned, bare) = (larva.truth(), larva.clone().without_fins().truth());
            assert!(bare.hull_volume_um3 >= bare.volume_um3, "{bare:?}");
            assert!(bare.hull_volume_um3 < 1.02 * bare.volume_um3, "a bare body is nearly convex in its slices: {bare:?}");
            assert!(finned.hull_volume_um3 > 1.01 * bare.hull_volume_um3, "{finned:?}");
            assert!((finned.volume_um3 - bare.volume_um3).abs() < 1.0, "fins do not belong to the body");
        }
    }

    #[test]
    fn organs_lie_inside_the_body_and_all_parts_are_closed() {
        let reference = [(3, 1), (4, 2), (5, 3), (5, 4)].map(|(dpf, seed)| (dpf, seed, Look::default()));
        let drawn = (2..=7).map(|dpf| (dpf, 5, Look::healthy(dpf, 5)));
        let sick = Condition::SICK.map(|condition| (4, 6, Look { condition, ..Look::healthy(4, 6) }));
        let bladders = [Bladder::TwoLobes, Bladder::NotInflated].map(|bladder| (6, 7, Look { bladder, ..Look::healthy(6, 7) }));
        for (dpf, seed, look) in reference.into_iter().chain(drawn).chain(sick).chain(bladders) {
            let larva = Larva::new(dpf, seed).unwrap().with_look(look);
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
            for part in larva.pectorals(120, 32) {
                part.mesh.closed().unwrap();
            }
        }
    }

    #[test]
    fn the_default_look_is_the_reference_larva() {
        let larva = Larva::new(4, 8).unwrap();
        let again = larva.clone().with_look(Look::healthy(4, 8)).with_look(Look::default());
        assert_eq!(again.truth(), larva.truth());
        let (one, other) = (larva.specimen(), again.specimen());
        assert_eq!(one.spots, other.spots);
        assert!(one.parts.iter().zip(&other.parts).all(|(a, b)| a.mesh.vertices == b.mesh.vertices && a.material == b.material));
        // A body, a fin fold, six kinds of organs and a swim bladder, as before there were looks.
        assert_eq!([one.parts.len(), other.parts.len()], [9, 9]);
        assert_eq!(one.spots.len(), 22_842, "the spots of the reference larva have changed");
    }

    /// The part of a slice of a pectoral fin that lies in the body, in points of its outline.
    fn rooted(larva: &Larva, s: f64, side: f64) -> usize {
        let [_, y, z] = larva.centre(s);
        let ring = larva.pectoral_ring(s, side, 64);
        ring.iter().filter(|p| (p[1] - y).hypot(p[2] - z) < larva.radius(s, (p[2] - z).atan2(p[1] - y))).count()
    }

    #[test]
    fn each_slice_of_a_pectoral_fin_is_rooted_in_the_body_and_most_reach_out_of_it() {
        for (dpf, seed) in [(3, 1), (4, 2), (5, 3), (7, 4)] {
            let larva = Larva::new(dpf, seed).unwrap().with_look(Look::healthy(dpf, seed));
            for side in [1.0, -1.0] {
                let inside: Vec<usize> = (1..100).map(|i| rooted(&larva, 0.175 + 0.080 * f64::from(i) / 100.0, side)).collect();
                assert!(inside.iter().all(|&n| n > 0), "{dpf} dpf: a slice of the fin is apart from the body: {inside:?}");
                assert!(inside.iter().filter(|&&n| n < 60).count() > 60, "{dpf} dpf: the fin hardly leaves the body: {inside:?}");
            }
        }
        let bud = Larva::new(2, 1).unwrap().with_look(Look::healthy(2, 1));
        assert!(bud.pectorals(120, 32).is_empty());
    }

    #[test]
    fn the_hull_with_pectoral_fins_is_that_of_the_meshes() {
        for (dpf, condition) in [(4, Condition::Healthy), (5, Condition::BentTail)] {
            let larva = Larva::new(dpf, 3).unwrap().with_look(Look { condition, ..Look::healthy(dpf, 3) });
            let truth = larva.truth();
            // Slices of the meshes that are drawn, which the exact values do not use.
            let mut meshes = vec![larva.body((500, 160)), larva.fin(500, 64).unwrap()];
            meshes.extend(larva.pectorals(200, 64).into_iter().map(|part| part.mesh));
            let [low, high] = [0, 1].map(|end| {
                meshes.iter().map(|m| m.bounds()[0][end]).fold(larva.centre(0.0)[0], if end == 0 { f64::min } else { f64::max })
            });
            let cuts = 1500;
            let sections: Vec<(f64, Vec<[f64; 2]>)> = (0..cuts)
                .map(|i| low + (high - low) * (f64::from(i) + 0.5) / f64::from(cuts))
                .map(|x| (x, meshes.iter().flat_map(|mesh| mesh.section(x)).collect()))
                .collect();
            let hull = ideal_hull(&sections);
            let off = hull.volume_um3 / truth.hull_volume_um3 - 1.0;
            assert!(off.abs() < 6e-4, "{dpf} dpf, {condition:?}: {off:.1e}");
            let without = Larva { look: Look { pectoral_per_mm: None, ..larva.look }, ..larva.clone() };
            let added = truth.hull_volume_um3 / without.truth().hull_volume_um3 - 1.0;
            assert!(added > 0.002, "{dpf} dpf: the fins add {added:.1e} to the hull");
            assert!((without.truth().volume_um3 - truth.volume_um3).abs() < 1.0, "pectoral fins do not belong to the body");
        }
    }

    #[test]
    fn each_condition_changes_what_it_names() {
        let larva = |condition| Larva::new(5, 2).unwrap().with_look(Look { condition, ..Look::healthy(5, 2) });
        let healthy = larva(Condition::Healthy);
        let (volume, specimen) = (healthy.truth().volume_um3, healthy.specimen());
        for condition in [Condition::HeartOedema, Condition::YolkOedema] {
            let more = larva(condition).truth().volume_um3 / volume - 1.0;
            assert!((0.01..0.3).contains(&more), "{condition:?} adds {more:.3}");
        }
        for condition in [Condition::BentTail, Condition::Curled] {
            let bent = larva(condition);
            assert!((bent.truth().volume_um3 / volume - 1.0).abs() < 1e-9, "a bend keeps the volume");
            let tail = [bent.centre(1.0), healthy.centre(1.0)];
            assert!((tail[0][1] - tail[1][1]).hypot(tail[0][2] - tail[1][2]) > 100.0, "{condition:?}: {tail:?}");
        }
        let short = larva(Condition::Short).truth();
        assert!((short.length_um / healthy.truth().length_um - 0.8).abs() < 1e-9 && short.volume_um3 < 0.8 * volume, "{short:?}");
        let black = |specimen: &Specimen| specimen.spots.iter().filter(|spot| spot.density > 0.6).count();
        assert!(black(&larva(Condition::Unpigmented).specimen()) * 20 < black(&specimen));
        assert_eq!(larva(Condition::NoSwimBladder).specimen().parts.len() + 1, specimen.parts.len());
    }

    #[test]
    fn the_gas_of_each_form_of_swim_bladder_has_a_volume() {
        let larva = |dpf, bladder| Larva::new(dpf, 2).unwrap().with_look(Look { bladder, ..Look::healthy(dpf, 2) });
        let gas = |dpf, bladder| larva(dpf, bladder).true_bladder();
        let (one, two) = (gas(5, Bladder::OneLobe).unwrap(), gas(5, Bladder::TwoLobes).unwrap());
        assert!(gas(5, Bladder::NotInflated).is_none() && gas(3, Bladder::OneLobe).is_none());
        let none = larva(5, Bladder::OneLobe).with_look(Look { condition: Condition::NoSwimBladder, ..Look::healthy(5, 2) });
        assert!(none.true_bladder().is_none());
        // 4/3 pi times the half axes, less the facets.
        let (unit, length) = (larva(5, Bladder::OneLobe).unit_um(), larva(5, Bladder::OneLobe).length_um);
        let ball = |[a, b, c]: [f64; 3]| 4.0 / 3.0 * PI * a * length * b * c * unit * unit;
        assert!((one.volume_um3 / ball([0.046, 25.0, 22.0]) - 1.0).abs() < 0.01, "{one:?}");
        let of_both = ball([0.019, 18.0, 17.0]) + ball([0.031, 24.0, 22.0]);
        assert!((two.volume_um3 / of_both - 1.0).abs() < 0.01, "{two:?}, {of_both:e}");
        assert!((one.centre_um[0] - length * (organs::BLADDER_AT - 0.5)).abs() < 1.0, "{one:?}");
    }

    #[test]
    fn a_quarter_of_the_drawn_larvae_is_sick_and_all_conditions_occur() {
        let drawn: Vec<Condition> = (0..400).map(|seed| Look::drawn(4, seed).condition).collect();
        let sick = drawn.iter().filter(|&&c| c != Condition::Healthy).count();
        // 100 with a standard deviation of 9.
        assert!((70..130).contains(&sick), "{sick}");
        assert!(Condition::SICK.iter().all(|c| drawn.contains(c)));
        let contrast: Vec<f64> = (0..400).map(|seed| Look::drawn(4, seed).fin_contrast).collect();
        assert!(
            contrast.iter().all(|c| (0.249..2.51).contains(c)) && contrast.iter().any(|&c| c < 0.35) && contrast.iter().any(|&c| c > 1.8)
        );
    }
}
