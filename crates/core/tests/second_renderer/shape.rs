//! Specimens: implicit solids and thin sheets, cut into slices across the axis of rotation.
//!
//! ```text
//!   x along the axis, y down, z away from the camera (um); slice k lies at x = k step
//!
//!        . - - .   skin: polar polygon around the spine, from an implicit solid
//!      /  (eye)  \        organs: ellipses
//!     |     +-----|====   sheets (fins): thin polygons
//!      \         /
//!        ' - - '
//! ```
//! The polygons are the specimen: pictures and truth are both made from them, so that their finite number of corners is not an error.

use crate::random::Random;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

pub type Point = [f64; 3];
/// Corners `[y, z]` of a polygon in a slice, um, in one sense of rotation.
pub type Section = Vec<[f64; 2]>;

/// Corners of the outline of a solid.
const CORNERS: usize = 128;
/// No section reaches further than this from its centre, um.
const REACH_UM: f64 = 600.0;

/// What light meets in a material.
#[derive(Debug, Clone, Copy)]
pub struct Material {
    /// Absorption of red, green and blue, per um.
    pub absorption_per_um: [f32; 3],
    /// Refractive index less that of the medium around it.
    pub index: f32,
}

impl Material {
    /// A material that absorbs blue most, like tissue with melanin.
    pub fn brown(absorption_per_um: f64, index: f64) -> Self {
        Self { absorption_per_um: [0.9, 1.0, 1.25].map(|c| (c * absorption_per_um) as f32), index: index as f32 }
    }
}

/// A body of one material. `sections[i]` lies in slice `first + i`; it may be empty.
#[derive(Debug, Clone)]
pub struct Part {
    pub material: Material,
    pub first: isize,
    pub sections: Vec<Section>,
    pub kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The outer surface of the specimen without its fins.
    Skin,
    /// Lies inside the skin.
    Organ,
    /// A thin sheet, part of the silhouette but not of the body.
    Fin,
}

impl Part {
    pub fn section(&self, slice: isize) -> Option<&Section> {
        usize::try_from(slice - self.first).ok().and_then(|i| self.sections.get(i)).filter(|s| !s.is_empty())
    }

    /// Parts of the ellipsoid with one half axis along x and two in the slice, turned by `roll_rad` about x.
    fn ellipsoid(at: Point, half: [f64; 3], roll_rad: f64, material: Material, kind: Kind, step_um: f64) -> Self {
        let (first, last) = (((at[0] - half[0]) / step_um).ceil() as isize, ((at[0] + half[0]) / step_um).floor() as isize);
        let corners = ((half[1].max(half[2]) * 1.2) as usize).clamp(12, CORNERS);
        let (sin, cos) = roll_rad.sin_cos();
        let section = |slice: isize| {
            let share = (1.0 - ((slice as f64 * step_um - at[0]) / half[0]).powi(2)).max(0.0).sqrt();
            let corner = |i: usize| {
                let (s, c) = (TAU * i as f64 / corners as f64).sin_cos();
                let (up, side) = (share * half[1] * c, share * half[2] * s);
                [at[1] - up * cos - side * sin, at[2] - up * sin + side * cos]
            };
            (0..corners).map(corner).collect()
        };
        Self { material, first, sections: (first..=last).map(section).collect(), kind }
    }
}

/// A specimen at rest in the capillary at angle 0.
#[derive(Debug, Clone)]
pub struct Specimen {
    /// Distance of two slices, um.
    pub step_um: f64,
    pub parts: Vec<Part>,
}

impl Specimen {
    /// Volume inside the skin, um^3.
    pub fn body_um3(&self) -> f64 {
        let skins = self.parts.iter().filter(|p| p.kind == Kind::Skin);
        skins.flat_map(|p| &p.sections).map(|s| area(s)).sum::<f64>() * self.step_um
    }

    /// Volume of the ideal visual hull, um^3: each slice across the axis filled to its convex outline, fins included.
    pub fn hull_um3(&self) -> f64 {
        self.hulls().map(|hull| area(&hull)).sum::<f64>() * self.step_um
    }

    /// Area of the ideal visual hull, um^2: the edges of each slice's convex outline, sloped as the next outline lies in their direction.
    pub fn hull_um2(&self) -> f64 {
        let hulls: Vec<Section> = self.hulls().collect();
        let ends = hulls.iter().find(|h| !h.is_empty()).into_iter().chain(hulls.iter().rfind(|h| !h.is_empty()));
        let rings = hulls.windows(2).filter(|pair| pair.iter().all(|h| !h.is_empty())).map(|pair| {
            let edge = |i: usize| {
                let (a, b) = (pair[0][i], pair[0][(i + 1) % pair[0].len()]);
                let along = [b[0] - a[0], b[1] - a[1]];
                let length = along[0].hypot(along[1]);
                let reach = |h: &Section| h.iter().map(|p| (p[0] * along[1] - p[1] * along[0]) / length).fold(f64::NEG_INFINITY, f64::max);
                if length > 0.0 { length * self.step_um.hypot(reach(&pair[1]) - reach(&pair[0])) } else { 0.0 }
            };
            (0..pair[0].len()).map(edge).sum::<f64>()
        });
        rings.sum::<f64>() + ends.map(|h| area(h)).sum::<f64>()
    }

    /// The convex outline of each slice.
    pub fn hulls(&self) -> impl Iterator<Item = Section> {
        self.slices().map(|slice| convex_hull(self.corners(slice)))
    }

    /// Distance of the farthest corner from the axis, um.
    pub fn radius_um(&self) -> f64 {
        self.slices().flat_map(|slice| self.corners(slice)).map(|[y, z]| y.hypot(z)).fold(0.0, f64::max)
    }

    /// Whether a point lies inside the skin.
    pub fn contains(&self, [x, y, z]: Point) -> bool {
        let slice = (x / self.step_um).round() as isize;
        let crosses = |a: [f64; 2], b: [f64; 2]| (a[0] > y) != (b[0] > y) && z < a[1] + (y - a[0]) / (b[0] - a[0]) * (b[1] - a[1]);
        let inside = |s: &Section| (0..s.len()).filter(|&i| crosses(s[i], s[(i + 1) % s.len()])).count() % 2 == 1;
        self.parts.iter().filter(|p| p.kind == Kind::Skin).filter_map(|p| p.section(slice)).any(inside)
    }

    /// All slices with a section.
    pub fn slices(&self) -> std::ops::Range<isize> {
        let first = self.parts.iter().map(|p| p.first).min().unwrap_or(0);
        first..self.parts.iter().map(|p| p.first + p.sections.len() as isize).max().unwrap_or(first)
    }

    fn corners(&self, slice: isize) -> Vec<[f64; 2]> {
        self.parts.iter().filter_map(|p| p.section(slice)).flatten().copied().collect()
    }

    /// An ellipsoid turned about y and z. With three equal half axes it is a bead.
    pub fn ellipsoid(at: Point, half_um: [f64; 3], [turn_y, turn_z]: [f64; 2], material: Material, step_um: f64) -> Self {
        let ((sy, cy), (sz, cz)) = (turn_y.sin_cos(), turn_z.sin_cos());
        // The rows are the axes of the ellipsoid.
        let axes = [[cz * cy, sz * cy, -sy], [-sz, cz, 0.0], [cz * sy, sz * sy, cy]];
        let q = |i: usize, j: usize| (0..3).map(|k| axes[k][i] * axes[k][j] / half_um[k].powi(2)).sum::<f64>();
        let form = move |p: Point| {
            let d: Point = std::array::from_fn(|i| p[i] - at[i]);
            (0..3).map(|k| ((0..3).map(|i| axes[k][i] * d[i]).sum::<f64>() / half_um[k]).powi(2)).sum::<f64>() - 1.0
        };
        // The centre of a slice is where the form is least.
        let det = q(1, 1) * q(2, 2) - q(1, 2) * q(1, 2);
        let drift = [(q(1, 2) * q(0, 2) - q(2, 2) * q(0, 1)) / det, (q(1, 2) * q(0, 1) - q(1, 1) * q(0, 2)) / det];
        let centre = move |x: f64| [at[1] + drift[0] * (x - at[0]), at[2] + drift[1] * (x - at[0])];
        let reach = half_um.into_iter().fold(0.0, f64::max);
        let (first, sections) = cut(step_um, [at[0] - reach, at[0] + reach], centre, form);
        Self { step_um, parts: vec![Part { material, first, sections, kind: Kind::Skin }] }
    }

    /// A larva in a bore of radius `bore_um`. The seed decides its size, bend, pose and pigment.
    pub fn larva(seed: u64, fins: Option<Fins>, bladder: Bladder, bore_um: f64, step_um: f64) -> Self {
        Larva::of(seed, bore_um).specimen(fins, bladder, bore_um, step_um)
    }
}

/// The swim bladder of a larva. All but the usual one are made for tests of the bladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bladder {
    /// A small ellipsoid of gas, as just inflated.
    Usual,
    /// 1.6 times as wide and 1.4 times as long, below the notochord.
    Large,
    /// Two ellipsoids of gas behind each other, the smaller one in front.
    TwoLobes,
    /// A tube of tissue without gas under dense pigment.
    NotInflated,
    /// Nothing.
    Absent,
}

/// Centres and half axes of the gas in the larva of this seed, um.
pub fn gas(seed: u64, bladder: Bladder, bore_um: f64) -> Vec<(Point, [f64; 3])> {
    Larva::of(seed, bore_um).gas(bladder)
}

/// Centres and half axes of the eyes of the larva of this seed, um.
pub fn eyes(seed: u64, bore_um: f64) -> [(Point, [f64; 3]); 2] {
    let larva = Larva::of(seed, bore_um);
    [-1.0, 1.0].map(|side| larva.eye(side))
}

/// Direction (y, z) of the back at the head of the larva of this seed.
pub fn back(seed: u64, bore_um: f64) -> [f64; 2] {
    let (sin, cos) = Larva::of(seed, bore_um).roll(0.085).sin_cos();
    [-cos, -sin]
}

/// How strongly the fins of a larva show.
#[derive(Debug, Clone, Copy)]
pub struct Fins {
    /// Absorption of the fin fold, per um. 0.0015 makes a fold of 10 um 1.5 % darker than the water.
    pub fold_per_um: f64,
    /// Absorption of the pectoral fins, per um.
    pub pectoral_per_um: f64,
}

/// The solid where `form` is negative, cut at the slices of `span`; it must be star-shaped around `centre` in each slice.
fn cut(
    step_um: f64,
    [from, to]: [f64; 2],
    centre: impl Fn(f64) -> [f64; 2] + Sync,
    form: impl Fn(Point) -> f64 + Sync,
) -> (isize, Vec<Section>) {
    let (first, last) = ((from / step_um).ceil() as isize, (to / step_um).floor() as isize);
    let section = |slice: isize| {
        let x = slice as f64 * step_um;
        let [y, z] = centre(x);
        if form([x, y, z]) >= 0.0 {
            return Section::new();
        }
        let corner = |i: usize| {
            let (sin, cos) = (TAU * i as f64 / CORNERS as f64).sin_cos();
            let r = root(|r| form([x, y + r * cos, z + r * sin]));
            [y + r * cos, z + r * sin]
        };
        (0..CORNERS).map(corner).collect()
    };
    (first, (first..=last).into_par_iter().map(section).collect())
}

/// The root of a function that is negative at 0 and positive at `REACH_UM`, by the Illinois method.
fn root(f: impl Fn(f64) -> f64) -> f64 {
    let (mut a, mut b) = (0.0, REACH_UM);
    let (mut fa, mut fb) = (f(a), f(b));
    for _ in 0..60 {
        let c = (a * fb - b * fa) / (fb - fa);
        let fc = f(c);
        if (b - a).abs() < 1e-4 || fc.abs() < 1e-7 {
            return c;
        }
        if (fc < 0.0) == (fb < 0.0) {
            fa *= 0.5;
        } else {
            (a, fa) = (b, fb);
        }
        (b, fb) = (c, fc);
    }
    b
}

/// The course of a larva. Its own coordinates are `share`, of the length from the snout, and `up` (towards the back) and `side` from the
/// spine, um.
struct Larva {
    length_um: f64,
    /// Scale of everything across the spine.
    girth: f64,
    /// `-1` with the head to the left, else `1`.
    facing: f64,
    offset_um: [f64; 2],
    slope: [f64; 2],
    /// Displacement of the tail by bending, um.
    bend_um: [f64; 2],
    roll_rad: f64,
    /// Roll of the tail against the head, rad.
    twist_rad: f64,
    /// Half axes of the yolk, um.
    yolk_um: [f64; 3],
    seed: u64,
}

/// An ellipsoid that bulges the skin, with the sine and cosine of its roll, and the reach of the rounding where it meets the trunk.
struct Lump {
    at: Point,
    half: [f64; 3],
    sin: f64,
    cos: f64,
    reach_um: f64,
}

/// Half height and half width of the trunk, um, by share of the length from the snout.
const TRUNK: [[f64; 3]; 9] = [
    [0.00, 60.0, 70.0],
    [0.06, 150.0, 160.0],
    [0.13, 185.0, 165.0],
    [0.22, 175.0, 135.0],
    [0.35, 150.0, 105.0],
    [0.50, 115.0, 80.0],
    [0.70, 80.0, 55.0],
    [0.90, 42.0, 28.0],
    [1.00, 20.0, 12.0],
];
/// Distance of the outer side of an eye from the spine before scaling, um. The eyes are the widest place.
const EYES_UM: f64 = 262.0;

impl Larva {
    fn of(seed: u64, bore_um: f64) -> Self {
        let mut r = Random::new(seed);
        let fill = r.uniform(0.84, 0.93);
        let length_um = r.uniform(3300.0, 4000.0);
        let offset_um = [r.normal(), r.normal()].map(|n| 0.015 * bore_um * n.clamp(-1.5, 1.5));
        let yolk = r.uniform(0.75, 1.05);
        Self {
            length_um,
            girth: (fill * bore_um / EYES_UM).min(1.15),
            facing: if r.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 },
            offset_um,
            slope: [0.004 * r.normal().clamp(-2.0, 2.0), 0.004 * r.normal().clamp(-2.0, 2.0)],
            bend_um: [r.uniform(-60.0, 60.0), r.uniform(-90.0, 90.0)],
            roll_rad: r.uniform(0.0, TAU),
            twist_rad: r.uniform(-0.25, 0.25),
            yolk_um: [r.uniform(330.0, 430.0), 165.0 * yolk, 150.0 * yolk],
            seed,
        }
    }

    /// Share of the length at position x.
    fn share(&self, x: f64) -> f64 {
        0.5 - self.facing * x / self.length_um
    }

    fn x(&self, share: f64) -> f64 {
        (0.5 - share) * self.facing * self.length_um
    }

    fn spine(&self, x: f64) -> Point {
        let q = self.share(x);
        let curve = (q - 0.35).max(0.0) / 0.65;
        let across = |i: usize| self.offset_um[i] + self.slope[i] * x + self.bend_um[i] * curve * curve * (1.3 - 0.3 * curve);
        [x, across(0), across(1)]
    }

    fn roll(&self, share: f64) -> f64 {
        self.roll_rad + self.twist_rad * share
    }

    /// The point `up` and `side` um from the spine.
    fn beside(&self, share: f64, up: f64, side: f64) -> Point {
        let [x, y, z] = self.spine(self.x(share));
        let (sin, cos) = self.roll(share).sin_cos();
        [x, y - up * cos - side * sin, z - up * sin + side * cos]
    }

    /// Half height and half width of the trunk, um.
    fn trunk(&self, share: f64) -> [f64; 2] {
        let q = share.clamp(0.0, 1.0);
        let i = TRUNK.iter().rposition(|row| row[0] <= q).unwrap_or(0).min(TRUNK.len() - 2);
        let (low, high) = (TRUNK[i], TRUNK[i + 1]);
        let part = (q - low[0]) / (high[0] - low[0]);
        let part = part * part * (3.0 - 2.0 * part) * 0.5 + part * 0.5;
        [1, 2].map(|k| self.girth * (low[k] + part * (high[k] - low[k])))
    }

    fn eye(&self, side: f64) -> (Point, [f64; 3]) {
        let half = [140.0, 125.0 * self.girth, 72.0 * self.girth];
        (self.beside(0.085, 15.0 * self.girth, side * (EYES_UM * self.girth - half[2])), half)
    }

    fn yolk(&self) -> (Point, [f64; 3]) {
        let half = [self.yolk_um[0], self.yolk_um[1] * self.girth, self.yolk_um[2] * self.girth];
        (self.beside(0.25, (225.0 - self.yolk_um[1]) * -self.girth, 0.0), half)
    }

    /// Lobes of the swim bladder that hold gas.
    fn gas(&self, bladder: Bladder) -> Vec<(Point, [f64; 3])> {
        let lobe =
            |share: f64, up: f64, [a, b, c]: [f64; 3]| (self.beside(share, up * self.girth, 0.0), [a, b * self.girth, c * self.girth]);
        match bladder {
            Bladder::Usual => vec![lobe(0.26, 70.0, [130.0, 45.0, 50.0])],
            Bladder::Large => vec![lobe(0.27, 50.0, [185.0, 78.0, 74.0])],
            Bladder::TwoLobes => {
                let apart = 265.0 / self.length_um;
                vec![lobe(0.22, 52.0, [95.0, 58.0, 56.0]), lobe(0.22 + apart, 50.0, [165.0, 74.0, 70.0])]
            }
            Bladder::NotInflated | Bladder::Absent => Vec::new(),
        }
    }

    /// About the distance from the surface of the body, um, negative inside: the smooth union of a generalised cylinder with sections
    /// across the curved spine, a head, and the skin over yolk and eyes.
    fn form(&self, p: Point, lumps: &[Lump]) -> f64 {
        let mut s = p[0];
        for _ in 0..2 {
            let (c, ahead) = (self.spine(s), self.spine(s + 1.0));
            let t: Point = std::array::from_fn(|i| ahead[i] - c[i]);
            s += (0..3).map(|i| (p[i] - c[i]) * t[i]).sum::<f64>() / (0..3).map(|i| t[i] * t[i]).sum::<f64>();
        }
        let q = self.share(s);
        let c = self.spine(s);
        let (sin, cos) = self.roll(q.clamp(0.0, 1.0)).sin_cos();
        let (dy, dz) = (p[1] - c[1], p[2] - c[2]);
        let (up, side) = (-dy * cos - dz * sin, -dy * sin + dz * cos);
        let [a, b] = self.trunk(q);
        let beyond = ((-q).max(q - 1.0).max(0.0) * self.length_um) / 60.0;
        let trunk = ((up / a).powi(2) + (side / b).powi(2) + beyond * beyond).sqrt() - 1.0;
        let head = ((q - 0.09) * self.length_um / 330.0).powi(2) + ((up / 195.0).powi(2) + (side / 190.0).powi(2)) / self.girth.powi(2);
        let mut found = smooth_least(trunk * a.min(b), (head.sqrt() - 1.0) * 190.0 * self.girth, 30.0);
        for lump in lumps {
            let along = p[0] - lump.at[0];
            if along.abs() < lump.half[0] + 150.0 {
                let (dy, dz) = (p[1] - lump.at[1], p[2] - lump.at[2]);
                let d = [along, -dy * lump.cos - dz * lump.sin, -dy * lump.sin + dz * lump.cos];
                let distance = ((0..3).map(|i| (d[i] / lump.half[i]).powi(2)).sum::<f64>().sqrt() - 1.0) * lump.half[2];
                found = smooth_least(found, distance, lump.reach_um);
            }
        }
        found
    }

    /// The skin over the yolk and the eyes.
    fn lumps(&self) -> [Lump; 3] {
        let over = |(at, half): (Point, [f64; 3]), skin_um: f64, q: f64, reach_um: f64| {
            let (sin, cos) = self.roll(q).sin_cos();
            Lump { at, half: half.map(|h| h + skin_um), sin, cos, reach_um }
        };
        [over(self.yolk(), 8.0, 0.25, 40.0), over(self.eye(-1.0), 6.0, 0.085, 15.0), over(self.eye(1.0), 6.0, 0.085, 15.0)]
    }

    fn specimen(&self, fins: Option<Fins>, bladder: Bladder, bore_um: f64, step_um: f64) -> Specimen {
        let centre = |x: f64| [self.spine(x)[1], self.spine(x)[2]];
        let half = self.length_um / 2.0;
        let lumps = self.lumps();
        let (first, sections) = cut(step_um, [-half - 80.0, half + 80.0], centre, |p| self.form(p, &lumps));
        let mut r = Random::new(self.seed ^ 0xb0d7);
        let tissue = Material::brown(r.uniform(0.002, 0.0055), 0.022);
        let mut parts = vec![Part { material: tissue, first, sections, kind: Kind::Skin }];
        let mut organ = |(at, half): (Point, [f64; 3]), q: f64, material: Material| {
            parts.push(Part::ellipsoid(at, half, self.roll(q), material, Kind::Organ, step_um));
        };
        for side in [-1.0, 1.0] {
            organ(self.eye(side), 0.085, Material::brown(0.035, 0.01));
        }
        organ(self.yolk(), 0.25, Material::brown(r.uniform(0.001, 0.004), 0.012));
        for lobe in self.gas(bladder) {
            organ(lobe, 0.26, Material::brown(0.004, -0.25));
        }
        if bladder == Bladder::NotInflated {
            organ((self.beside(0.26, 70.0 * self.girth, 0.0), [110.0, 18.0, 18.0]), 0.26, Material::brown(0.006, 0.008));
            // The pigment that covers a swim bladder.
            let mut r = Random::new(self.seed ^ 0x91a5);
            for _ in 0..60 {
                let at = self.beside(0.26 + 0.03 * r.normal(), 95.0 * self.girth, 25.0 * r.normal());
                let size = r.uniform(8.0, 16.0);
                organ((at, [1.5 * size, 0.6 * size, size]), 0.26, Material::brown(0.06, 0.0));
            }
        }
        // Muscle, gut and brain as lumps, some denser and some clearer than the tissue around them.
        for _ in 0..40 {
            let q = r.uniform(0.04, 0.9);
            let [a, b] = self.trunk(q);
            let size = r.uniform(0.15, 0.45) * b;
            let (up, side) = (r.uniform(-0.5, 0.5) * a, r.uniform(-0.5, 0.5) * b);
            let lump = Material::brown(r.uniform(0.0, 0.006), r.uniform(-0.006, 0.006));
            organ((self.beside(q, up, side), [size * r.uniform(1.0, 3.0), size, size]), q, lump);
        }
        // Pigment: a stripe along the back, rows along both sides and the belly, and blots on the head.
        let dense = r.uniform(60.0, 200.0) as usize;
        for _ in 0..dense {
            let q = r.uniform(0.05, 0.95);
            let row = [0.0, 0.0, 1.75, -1.75, PI][(r.uniform(0.0, 5.0) as usize).min(4)] + 0.12 * r.normal();
            let [a, b] = self.trunk(q);
            let size = r.uniform(8.0, 30.0);
            let at = self.beside(q, (a - 10.0) * row.cos(), (b - 10.0) * row.sin());
            organ((at, [size * r.uniform(1.0, 2.5), 6.0 + 0.3 * size, 6.0 + 0.3 * size]), q, Material::brown(0.12, 0.0));
        }
        if let Some(fins) = fins {
            self.fins(&mut parts, fins, &mut r, bore_um, step_um);
        }
        Specimen { step_um, parts }
    }

    fn fins(&self, parts: &mut Vec<Part>, fins: Fins, r: &mut Random, bore_um: f64, step_um: f64) {
        let mut sheet = |material: Material, [from, to]: [f64; 2], of: &dyn Fn(f64) -> Section| {
            let (a, b) = (self.x(from).min(self.x(to)), self.x(from).max(self.x(to)));
            let (first, last) = ((a / step_um).ceil() as isize, (b / step_um).floor() as isize);
            let inside = |corners: Section| {
                let within = |[y, z]: [f64; 2]| {
                    let shrink = (0.98 * bore_um / y.hypot(z)).min(1.0);
                    [y * shrink, z * shrink]
                };
                corners.into_iter().map(within).collect()
            };
            let sections = (first..=last).map(|k| inside(of(self.share(k as f64 * step_um)))).collect();
            parts.push(Part { material, first, sections, kind: Kind::Fin });
        };
        let yz = |[_, y, z]: Point| [y, z];
        // The fold grows behind the yolk and ends in a round tail fin.
        let (back, belly, tail) = (r.uniform(70.0, 130.0), r.uniform(60.0, 120.0), r.uniform(110.0, 170.0));
        let end = 1.0 + r.uniform(0.04, 0.07);
        let fold = |q: f64| {
            let height = |most: f64, from: f64| {
                let grown = ((q - from) / 0.2).clamp(0.0, 1.0);
                let wide = most + (tail - most) * ((q - 0.85) / 0.12).clamp(0.0, 1.0);
                let round = ((q - 0.94) / (end - 0.94)).clamp(0.0, 1.0);
                (self.trunk(q)[0] + wide * grown) * (1.0 - round * round).max(0.0).sqrt()
            };
            let (up, down) = (height(back, 0.40), height(belly, 0.48));
            let corner = |up: f64, side: f64| yz(self.beside(q, up, side));
            vec![corner(up, 2.0), corner(0.0, 6.0), corner(-down, 2.0), corner(-down, -2.0), corner(0.0, -6.0), corner(up, -2.0)]
        };
        sheet(Material::brown(fins.fold_per_um, 0.012), [0.40, end], &fold);
        // Pectoral fins: leaves behind the gills, with a free tip.
        for side in [-1.0, 1.0] {
            let (from, long) = (r.uniform(0.17, 0.19), r.uniform(0.075, 0.095));
            let (spread, lift) = (r.uniform(25.0, 70.0), r.uniform(-0.6, 0.2));
            let leaf = |q: f64| {
                let part = ((q - from) / long).clamp(0.0, 1.0);
                let root_um = self.trunk(q)[1] - 12.0 + spread * part;
                let tip_um = root_um + 100.0 * self.girth * (PI * part.powf(0.8)).sin().max(0.0).sqrt();
                let at = |d: f64, thick: f64| {
                    let (sin, cos) = lift.sin_cos();
                    yz(self.beside(q, d * sin + thick * cos, side * (d * cos - thick * sin)))
                };
                vec![at(root_um, 6.0), at(tip_um, 3.0), at(tip_um, -3.0), at(root_um, -6.0)]
            };
            sheet(Material::brown(fins.pectoral_per_um, 0.015), [from, from + long], &leaf);
        }
    }
}

/// The lesser of two distances, rounded over `reach` (um) where they are alike.
fn smooth_least(a: f64, b: f64, reach: f64) -> f64 {
    let near = (1.0 - (a - b).abs() / reach).max(0.0);
    a.min(b) - near * near * reach / 4.0
}

/// Area of a polygon, um^2.
pub fn area(section: &[[f64; 2]]) -> f64 {
    let n = section.len();
    (0..n).map(|i| section[i][0] * section[(i + 1) % n][1] - section[i][1] * section[(i + 1) % n][0]).sum::<f64>().abs() / 2.0
}

/// The convex hull of points, by Andrew's monotone chain.
pub fn convex_hull(mut points: Vec<[f64; 2]>) -> Section {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut hull = Section::new();
    for pass in 0..2 {
        let start = hull.len();
        let mut add = |p: [f64; 2]| {
            while hull.len() >= start + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            hull.push(p);
        };
        if pass == 0 {
            points.iter().copied().for_each(&mut add);
        } else {
            points.iter().rev().copied().for_each(&mut add);
        }
        hull.pop();
    }
    hull
}
