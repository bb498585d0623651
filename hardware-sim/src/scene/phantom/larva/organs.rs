//! The visible organs of a larva: eyes, brain, ear, yolk, pericardium, notochord, swim bladder. All lie inside the body, so they change
//! the brightness and never the outline.

use super::{Bladder, Condition, Larva, cap, smooth_step, stations};
use crate::scene::phantom::solid::ellipsoid_mesh;
use crate::scene::phantom::{Material, Mesh, Part, Within};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Skin and muscle: pale yellowish brown. The index is so near to that of water that the trunk has almost no rim.
pub const BODY: Material = Material { absorption_per_mm: [1.02, 1.13, 1.58], index_step: 0.011 };
/// The fin absorbs only 1 % of the light. Mostly its edge is visible.
pub const FIN: Material = Material { absorption_per_mm: [0.95, 1.0, 1.2], index_step: 0.016 };
const EYE: Material = Material { absorption_per_mm: [32.0, 33.0, 34.0], index_step: 0.0 };
const BRAIN: Material = Material { absorption_per_mm: [0.80, 0.85, 1.9], index_step: 0.0015 };
const YOLK: Material = Material { absorption_per_mm: [1.75, 1.95, 2.5], index_step: 0.019 };
/// Water in the body: the cavities of heart and ear, and the gap below the jaw.
const CLEAR: Material = Material { absorption_per_mm: [-0.9, -1.0, -1.4], index_step: -0.0025 };
/// The wall of the ear, which is visible as a thin ring.
const EAR: Material = Material { absorption_per_mm: [-0.7, -0.75, -0.9], index_step: -0.006 };
const NOTOCHORD: Material = Material { absorption_per_mm: [-4.0, -4.4, -6.2], index_step: -0.006 };
const BLADDER: Material = Material { absorption_per_mm: [-0.5, -0.6, -0.9], index_step: -0.085 };
/// The wall of a bladder without gas.
const COLLAPSED: Material = Material { absorption_per_mm: [1.0, 1.1, 1.5], index_step: 0.006 };

/// Smallest distance between organs and skin, um.
const SKIN_UM: f64 = 6.0;
pub const EYE_AT: f64 = 0.078;

/// The true values of an organ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrganTruth {
    /// Its volume.
    pub volume_um3: f64,
    /// The centre of its volume.
    pub centre_um: [f64; 3],
}

impl OrganTruth {
    fn of(mesh: &Mesh) -> Self {
        Self { volume_um3: mesh.volume(), centre_um: mesh.centroid() }
    }
}

impl Larva {
    pub(super) fn organs(&self) -> Vec<Part> {
        let part = |mesh: Mesh, material| Part { mesh, material: self.tinged(material), within_body: Within::Added };
        let [one, other] = self.eyes();
        let mut parts = vec![
            part(one.with(&other), EYE),
            part(self.yolk(), self.yolk_material()),
            part(self.notochord(), NOTOCHORD),
            part(self.brain(), BRAIN),
            part(self.clear_rooms(), CLEAR),
            part(self.ears(), EAR),
        ];
        if self.bladder > 0.0 {
            let material = if self.look.bladder == Bladder::NotInflated { COLLAPSED } else { BLADDER };
            parts.push(part(self.bladder_mesh(), material));
        }
        parts
    }

    /// A material with the tissue density of this individual.
    pub(super) fn tinged(&self, material: Material) -> Material {
        material.times(self.opacity)
    }

    /// Yolk is paler when less of it is left.
    fn yolk_material(&self) -> Material {
        let left = 0.35 + 0.65 * self.yolk;
        Material { absorption_per_mm: YOLK.absorption_per_mm.map(|a| left * a), ..YOLK }
    }

    /// The true values of both eyes, in the larva's own frame.
    pub fn true_eyes(&self) -> [OrganTruth; 2] {
        self.eyes().each_ref().map(OrganTruth::of)
    }

    /// The true values of the gas in the swim bladder, in the larva's own frame. `None` without gas.
    pub fn true_bladder(&self) -> Option<OrganTruth> {
        (self.bladder > 0.0 && self.look.bladder != Bladder::NotInflated).then(|| OrganTruth::of(&self.bladder_mesh()))
    }

    /// The swim bladder, below the gut line, which covers its upper side with pigment.
    fn bladder_mesh(&self) -> Mesh {
        let size = self.bladder.cbrt();
        let lobe = |s: f64, [a, b, c]: [f64; 3]| {
            let at = self.lateral(s, self.shape.gut_line.at(BLADDER_AT) + 20.0 * size);
            let half = [a * size * self.length_um, b * size * self.unit_um(), c * size * self.unit_um()];
            self.tucked(ellipsoid_mesh(at, half, 64, 48))
        };
        match self.look.bladder {
            Bladder::OneLobe => lobe(BLADDER_AT, [0.046, 25.0, 22.0]),
            // They nearly touch.
            Bladder::TwoLobes => {
                lobe(BLADDER_AT - 0.031 * size, [0.019, 18.0, 17.0]).with(&lobe(BLADDER_AT + 0.020 * size, [0.031, 24.0, 22.0]))
            }
            Bladder::NotInflated => lobe(BLADDER_AT, [0.030, 6.0, 6.0]),
        }
    }

    /// Both eyes, below the middle of the head. Their distance is the width of the head.
    fn eyes(&self) -> [Mesh; 2] {
        let u = self.unit_um();
        let [x, y, z] = self.lateral(EYE_AT, self.shape.centre.at(EYE_AT) + 18.0);
        let half_width = self.radius(EYE_AT, FRAC_PI_2);
        [1.0, -1.0].map(|side| {
            let half = [0.044 * self.length_um, 46.0 * u, 25.0 * u];
            self.tucked(ellipsoid_mesh([x, y, z + side * (half_width - 27.0 * u)], half, 48, 48))
        })
    }

    fn brain(&self) -> Mesh {
        let u = self.unit_um();
        let lobe = |s: f64, below_back: f64, half: [f64; 3]| {
            let at = self.lateral(s, self.shape.centre.at(s) - self.shape.dorsal.at(s) * cap(s) + below_back);
            self.tucked(ellipsoid_mesh(at, [half[0] * self.length_um, half[1] * u, half[2] * u], 40, 32))
        };
        lobe(0.045, 38.0, [0.03, 30.0, 30.0]).with(&lobe(0.088, 28.0, [0.036, 25.0, 34.0])).with(&lobe(0.15, 21.0, [0.05, 17.0, 26.0]))
    }

    /// The pericardium in front of the yolk, and the gap below the jaw.
    fn clear_rooms(&self) -> Mesh {
        let u = self.unit_um();
        let room =
            |[x, y, z]: [f64; 3], [a, b, c]: [f64; 3]| self.tucked(ellipsoid_mesh([x, y, z], [a * self.length_um, b * u, c * u], 40, 32));
        let belly = |s: f64| self.shape.centre.at(s) + self.shape.ventral.at(s);
        let jaw = 0.094;
        let size = 0.55 + 0.45 * self.yolk;
        let mut rooms = room(self.heart(), [0.034 * size, 38.0 * size, 44.0 * size]);
        // Fluid lies between the organ and the moved belly.
        for (condition, s, half) in
            [(Condition::HeartOedema, 0.148, [0.040, 36.0, 52.0]), (Condition::YolkOedema, 0.25, [0.085, 26.0, 54.0])]
        {
            if self.look.condition == condition {
                rooms = rooms.with(&room(self.lateral(s, belly(s) - 0.8 * half[1]), half));
            }
        }
        rooms.with(&room(self.lateral(jaw, belly(jaw) - 14.0), [0.030, 4.0, 14.0]))
    }

    fn ears(&self) -> Mesh {
        let half = [0.017 * self.length_um, 16.0 * self.unit_um(), 14.0 * self.unit_um()];
        let ear = |side: f64| self.tucked(ellipsoid_mesh(self.ear(side), half, 40, 32));
        ear(1.0).with(&ear(-1.0))
    }

    /// Middle of the heart.
    pub(super) fn heart(&self) -> [f64; 3] {
        let s = HEART_AT;
        self.lateral(s, self.shape.centre.at(s) + self.shape.ventral.at(s) - 28.0)
    }

    /// Middle of the ear on one side.
    pub(super) fn ear(&self, side: f64) -> [f64; 3] {
        let s = 0.137;
        let [x, y, z] = self.lateral(s, self.shape.centre.at(s) - 20.0);
        [x, y, z + side * 0.55 * self.radius(s, FRAC_PI_2)]
    }

    /// The yolk with its extension, from below the gut line to the skin of the belly.
    fn yolk(&self) -> Mesh {
        let (from, to) = (0.157, 0.60);
        self.tube(140, 64, |t| {
            let s = from + (to - from) * t;
            let belly = self.shape.centre.at(s) + 0.985 * self.shape.ventral.at(s);
            // The swim bladder presses a hollow into its upper side.
            let hollow = 40.0 * self.bladder.cbrt() * (-((s - BLADDER_AT) / 0.06).powi(2)).exp();
            let top = self.shape.gut_line.at(s) + 6.0;
            // The extension is a rod along the belly.
            let ball = 1.0 - smooth_step((s - 0.31) / 0.11);
            let height = (belly - top) * (ball * (0.45 + 0.55 * self.yolk) + (1.0 - ball) * (0.18 + 0.32 * self.yolk));
            let height = height.min(belly - top - hollow);
            let front = (1.0 - (1.0 - t / 0.2).max(0.0).powi(2)).sqrt();
            let end = (1.0 - ((t - 0.9) / 0.1).max(0.0).powi(2)).sqrt();
            let half = height / 2.0 * front.min(end);
            let middle = belly - height / 2.0 - (1.0 - front) * 6.0;
            (s, middle, [half, half.min(0.9 * self.shape.width.at(s))])
        })
    }

    fn notochord(&self) -> Mesh {
        self.tube(120, 24, |t| {
            let s = 0.165 + 0.80 * t;
            let r = (8.2 - 4.8 * t) * (1.0 - (2.0 * t - 1.0).powi(8)).sqrt();
            (s, self.shape.notochord.at(s), [r, r])
        })
    }

    /// A closed tube. `section` returns s, the height of the middle and the half axes, in thousandths of the length, at t from 0 to 1.
    fn tube(&self, rings: u32, segments: u32, section: impl Fn(f64) -> (f64, f64, [f64; 2])) -> Mesh {
        let u = self.unit_um();
        let rows: Vec<Vec<[f64; 3]>> = stations(rings)
            .map(|t| {
                let (s, height, [b, c]) = section(t);
                let [x, y, z] = self.lateral(s, height);
                (0..segments)
                    .map(|k| (TAU * f64::from(k) / f64::from(segments)).sin_cos())
                    .map(|(sin, cos)| [x, y + b * u * cos, z + c * u * sin])
                    .collect()
            })
            .collect();
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Mesh::default() };
        self.tucked(Mesh::lofted(middle_of(first), &rows, middle_of(last)))
    }

    /// A mesh that is moved inwards where it is too near to the skin.
    fn tucked(&self, mesh: Mesh) -> Mesh {
        mesh.mapped(|[x, y, z]| {
            let s = x / self.length_um + 0.5;
            let [_, cy, cz] = self.centre(s);
            let (dy, dz) = (y - cy, z - cz);
            let reach = dy.hypot(dz);
            let room = (self.radius(s, dz.atan2(dy)) - SKIN_UM).max(0.0);
            if reach <= room { [x, y, z] } else { [x, cy + dy * room / reach, cz + dz * room / reach] }
        })
    }
}

pub const BLADDER_AT: f64 = 0.262;
const HEART_AT: f64 = 0.152;

fn middle_of(ring: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|i| ring.iter().map(|p| p[i]).sum::<f64>() / ring.len() as f64)
}
