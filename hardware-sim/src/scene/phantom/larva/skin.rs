//! Marks on and in a larva: pigment cells, the grain of its tissue, the borders of its muscle segments, the edge of the fin.

use super::organs::BLADDER_AT;
use super::{Condition, Larva, smooth_step};
use crate::scene::phantom::pigment::{Spot, melanophore};
use crate::scene::seeded::{Seeded, mixed};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A field of pigment cells: angle from the belly and its spread, first and last s, number, size, length over width.
struct Field {
    theta: f64,
    spread: f64,
    s: [f64; 2],
    count: u32,
    size_um: f64,
    stretch: f64,
}

const fn field(theta: f64, spread: f64, s: [f64; 2], count: u32, size_um: f64, stretch: f64) -> Field {
    Field { theta, spread, s, count, size_um, stretch }
}

const FIELDS: [Field; 12] = [
    // The cap on the head, its irregular border, and single cells in front of it.
    field(PI, 0.22, [0.07, 0.165], 30, 30.0, 1.0),
    field(PI, 0.42, [0.05, 0.165], 20, 24.0, 1.0),
    field(PI, 0.75, [0.015, 0.09], 10, 20.0, 1.0),
    // The back.
    field(PI, 0.12, [0.16, 0.45], 44, 13.0, 2.2),
    field(PI, 0.11, [0.42, 0.98], 66, 10.0, 2.6),
    // The belly behind the gut.
    field(0.0, 0.20, [0.58, 0.98], 34, 11.0, 1.8),
    // Yolk, on both sides.
    field(0.95, 0.35, [0.19, 0.36], 4, 20.0, 1.0),
    field(-0.95, 0.35, [0.19, 0.36], 4, 20.0, 1.0),
    // The row on the flank.
    field(FRAC_PI_2 + 0.12, 0.06, [0.36, 0.82], 12, 9.0, 2.6),
    field(-FRAC_PI_2 - 0.12, 0.06, [0.36, 0.82], 12, 9.0, 2.6),
    // Behind the ear.
    field(FRAC_PI_2 + 0.5, 0.2, [0.13, 0.2], 2, 12.0, 1.0),
    field(-FRAC_PI_2 - 0.5, 0.2, [0.13, 0.2], 2, 12.0, 1.0),
];

/// The pigment that larvae have in addition to [`FIELDS`] at [`super::Look::stripes`] 1.
const STRIPES: [Field; 9] = [
    // The stripe along the back, nearly without gaps, and the wider one over head and gut.
    field(PI, 0.16, [0.15, 0.97], 260, 15.0, 2.2),
    field(PI, 0.35, [0.10, 0.42], 90, 19.0, 1.6),
    // The stripe along the belly.
    field(0.0, 0.22, [0.40, 0.97], 120, 13.0, 2.0),
    // Rows of blots on both flanks.
    field(FRAC_PI_2 + 0.40, 0.14, [0.17, 0.88], 30, 15.0, 1.8),
    field(-FRAC_PI_2 - 0.40, 0.14, [0.17, 0.88], 30, 15.0, 1.8),
    field(FRAC_PI_2 - 0.45, 0.18, [0.20, 0.80], 14, 14.0, 1.6),
    field(-FRAC_PI_2 + 0.45, 0.18, [0.20, 0.80], 14, 14.0, 1.6),
    // The head between and before the eyes.
    field(PI, 0.60, [0.02, 0.15], 40, 20.0, 1.0),
    field(PI, 0.25, [0.08, 0.20], 40, 24.0, 1.2),
];

impl Larva {
    pub(super) fn spots(&self) -> Vec<Spot> {
        let mut seeded = Seeded::new(mixed(self.seed ^ 0x5107));
        let mut spots = Vec::new();
        // Cells concentrate their pigment in light and spread it in the dark.
        let dispersed = seeded.between(0.75, 1.2);
        for field in &FIELDS {
            let few_or_many = seeded.between(0.7, 1.25);
            for _ in 0..(f64::from(field.count) * few_or_many).round() as u32 {
                let s = seeded.between(field.s[0], field.s[1]);
                let theta = field.theta + seeded.normal(field.spread);
                self.add_cell(s, theta, field.size_um * dispersed * seeded.between(0.6, 1.35), field.stretch, &mut seeded, &mut spots);
            }
        }
        self.add_gut_line(&mut seeded, &mut spots);
        self.add_yolk_blotches(&mut seeded, &mut spots);
        self.add_stripes(dispersed, &mut spots);
        if self.look.condition == Condition::Unpigmented {
            spots.clear();
        }
        self.add_ears_and_heart(&mut seeded, &mut spots);
        self.add_grain(&mut seeded, &mut spots);
        self.add_seams(&mut spots);
        self.add_fin_edge(&mut seeded, &mut spots);
        spots
    }

    /// The pigment of [`super::Look::stripes`]. Its numbers come from their own stream, so that the other marks do not change.
    fn add_stripes(&self, dispersed: f64, spots: &mut Vec<Spot>) {
        let mut seeded = Seeded::new(mixed(self.seed ^ 0x5712));
        for field in &STRIPES {
            for _ in 0..(f64::from(field.count) * self.look.stripes * seeded.between(0.8, 1.2)).round() as u32 {
                let s = seeded.between(field.s[0], field.s[1]);
                let theta = field.theta + seeded.normal(field.spread);
                self.add_cell(s, theta, field.size_um * dispersed * seeded.between(0.7, 1.3), field.stretch, &mut seeded, spots);
            }
        }
    }

    /// A pigment cell under the skin.
    fn add_cell(&self, s: f64, theta: f64, size_um: f64, stretch: f64, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        let around = self.radius(s, theta).max(20.0);
        let place = |along_um: f64, across_um: f64| {
            let (s, theta) = ((s + stretch * along_um / self.length_um).clamp(0.005, 0.995), theta + across_um / around);
            self.within(s, theta, (1.0 - 5.0 / self.radius(s, theta).max(1.0)).max(0.0))
        };
        melanophore(place, size_um, seeded, spots);
    }

    /// The dark line from behind the eye over yolk or bladder to the tail: pigment that covers gut and body cavity from above.
    fn add_gut_line(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        let u = self.unit_um();
        let steps = 620;
        // Its thickness varies.
        let mut clot = 1.0;
        for i in 0..steps {
            let s = 0.112 + 0.86 * f64::from(i) / f64::from(steps);
            clot += 0.12 * (1.0 - clot) + seeded.normal(0.17);
            // Continuous over the yolk, interrupted behind it.
            let dark = clot.clamp(0.15 + 0.6 * (1.0 - smooth_step((s - 0.34) / 0.1)), 1.3);
            // Broad over the yolk, thin at the tail.
            let breadth = 26.0 * (1.0 - smooth_step((s - 0.3) / 0.35)) * smooth_step((s - 0.10) / 0.06) + 3.0;
            let thick = (0.8 + 1.5 * (-((s - 0.25) / 0.09f64).powi(2)).exp() - 0.35 * smooth_step((s - 0.6) / 0.3)) * dark.max(0.45);
            for _ in 0..3 {
                let along = s + seeded.normal(0.002);
                let [x, y, z] = self.lateral(along, self.shape.gut_line.at(along) + seeded.normal(1.3 * thick));
                let radius_um = 7.0 * thick.max(0.5) * seeded.between(0.4, 1.2);
                let density = seeded.between(0.15, 0.55) * dark;
                spots.push(Spot { at_um: [x, y, z + seeded.normal(0.5) * breadth * u], radius_um, density });
            }
            // Cells below it on the flanks of the gut.
            if s > 0.33 && s < 0.72 && seeded.between(0.0, 1.0) < 0.13 {
                let drop = seeded.between(-2.0, 12.0);
                let [_, y, _] = self.lateral(s, self.shape.gut_line.at(s) + drop);
                let [_, cy, _] = self.centre(s);
                let side = if seeded.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
                let theta = side * (FRAC_PI_2 - ((y - cy) / self.radius(s, FRAC_PI_2).max(20.0)).clamp(-1.2, 1.2));
                self.add_cell(s, theta, 22.0 * seeded.between(0.6, 1.2), 0.8, seeded, spots);
            }
        }
        if self.bladder > 0.0 {
            for _ in 0..90 {
                let s = BLADDER_AT + seeded.normal(0.016);
                let [x, y, z] = self.lateral(s, self.shape.gut_line.at(s) + seeded.between(-2.0, 9.0));
                let at_um = [x, y, z + seeded.normal(8.0) * u];
                spots.push(Spot { at_um, radius_um: seeded.between(8.0, 16.0), density: seeded.between(0.4, 1.2) });
            }
        }
    }

    /// Pigment on the upper half and front of the yolk: soft spots, because most of them are out of focus.
    fn add_yolk_blotches(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        for _ in 0..26 {
            let s = seeded.between(0.165, 0.37);
            let theta = seeded.normal(0.3) + if seeded.between(0.0, 1.0) < 0.5 { 1.05 } else { -1.05 };
            let size_um = seeded.between(14.0, 30.0);
            for _ in 0..7 {
                let along = s + seeded.normal(0.6) * size_um / self.length_um;
                let at_um = self.within(along, theta + seeded.normal(0.6) * size_um / self.radius(s, theta), 0.86);
                spots.push(Spot { at_um, radius_um: size_um * seeded.between(0.4, 0.8), density: seeded.between(0.12, 0.42) });
            }
        }
        // The crescent at its front.
        for _ in 0..70 {
            let (sin, cos) = seeded.between(-1.3, 1.0).sin_cos();
            let front = self.shape.gut_line.at(0.2) + 62.0;
            let [x, y, z] = self.lateral(0.208 - 0.045 * cos, front + 48.0 * sin);
            let at_um = [x, y, z + seeded.normal(22.0) * self.unit_um()];
            spots.push(Spot { at_um, radius_um: seeded.between(8.0, 20.0), density: seeded.between(0.05, 0.35) * self.yolk });
        }
    }

    /// Two otoliths on each side, and the heart, which is grey and uneven in the clear pericardium.
    fn add_ears_and_heart(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        let u = self.unit_um();
        for side in [1.0, -1.0] {
            let [x, y, z] = self.ear(side);
            for (dx, dy, radius_um) in [(-6.0, 8.0, 9.0), (7.0, 1.0, 12.0)] {
                let at_um = [x + (dx + seeded.normal(1.5)) * u, y + (dy + seeded.normal(1.5)) * u, z];
                spots.push(Spot { at_um, radius_um, density: 0.55 });
                spots.push(Spot { at_um, radius_um: 0.6 * radius_um, density: -0.22 });
            }
        }
        let [x, y, z] = self.heart();
        for _ in 0..60 {
            let at_um = [x + seeded.normal(10.0) * u, y - 6.0 * u + seeded.normal(13.0) * u, z + seeded.normal(12.0) * u];
            spots.push(Spot { at_um, radius_um: seeded.between(6.0, 18.0), density: seeded.between(0.0, 0.08) });
        }
    }

    /// The texture of the tissue: grain, soft clouds, and the globules of the yolk.
    fn add_grain(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        for _ in 0..4800 {
            let s = seeded.between(0.01, 0.97);
            let at_um = self.within(s, seeded.between(0.0, TAU), seeded.between(0.0, 1.0).sqrt());
            spots.push(Spot { at_um, radius_um: seeded.between(3.5, 8.0), density: seeded.normal(0.06) * (1.2 - 0.8 * s) });
        }
        for _ in 0..420 {
            let s = seeded.between(0.02, 0.9);
            let at_um = self.within(s, seeded.between(0.0, TAU), 0.85 * seeded.between(0.0, 1.0).sqrt());
            let radius_um = seeded.between(10.0, 38.0) * (1.1 - 0.7 * s);
            spots.push(Spot { at_um, radius_um, density: seeded.normal(0.13).max(-0.07) * (1.1 - 0.7 * s) });
        }
        // Muscle fibres: streaks along the trunk.
        for _ in 0..260 {
            let (s, theta, depth) = (seeded.between(0.17, 0.93), seeded.normal(0.9) + PI, seeded.between(0.3, 0.95));
            let (density, length) = (seeded.normal(0.06), seeded.between(5.0, 16.0) as u32);
            for step in 0..length {
                let at_um = self.within((s + 5.0 * f64::from(step) / self.length_um).min(0.98), theta, depth);
                spots.push(Spot { at_um, radius_um: 4.5, density });
            }
        }
        // The skin is rougher. It makes the edge of the image uneven where rays are tangent to it.
        for _ in 0..2200 {
            let s = seeded.between(0.005, 0.97);
            let theta = seeded.between(0.0, TAU);
            let at_um = self.within(s, theta, 1.0 - 5.0 / self.radius(s, theta).max(10.0));
            spots.push(Spot { at_um, radius_um: seeded.between(3.0, 9.0), density: (seeded.normal(0.08) + 0.05) * (1.3 - 0.9 * s) });
        }
        // The cartilages of jaw and gills.
        for bar in 0..6 {
            let (from, lean) = (0.03 + 0.021 * f64::from(bar), seeded.between(-0.035, -0.012));
            for step in 0..16 {
                let t = f64::from(step) / 15.0;
                let s = from + lean * t;
                let [x, y, z] = self.lateral(s, self.shape.centre.at(s) + self.shape.ventral.at(s) * (0.97 - 0.35 * t));
                let at_um = [x, y, z + seeded.normal(12.0)];
                spots.push(Spot { at_um, radius_um: 6.0, density: seeded.between(0.02, 0.09) });
            }
        }
        for _ in 0..260 {
            let s = seeded.between(0.17, 0.37);
            let at_um = self.within(s, seeded.normal(0.7), seeded.between(0.2, 0.95));
            spots.push(Spot {
                at_um,
                radius_um: seeded.between(9.0, 42.0),
                density: seeded.normal(0.15).max(-0.12) * (0.35 + 0.65 * self.yolk),
            });
        }
    }

    /// The oblique borders between the muscle segments: chevrons that point to the head, on both flanks.
    fn add_seams(&self, spots: &mut Vec<Spot>) {
        for seam in 0..36 {
            let at = 0.20 + 0.0205 * f64::from(seam);
            for step in -14i32..=14 {
                let height = f64::from(step) / 14.0;
                let s = at + 0.020 * height.abs();
                for side in [-1.0, 1.0] {
                    // Over the yolk only the dorsal half is visible.
                    let theta = side * (FRAC_PI_2 + 1.25 * height);
                    if height > -0.1 || s > 0.40 {
                        spots.push(Spot { at_um: self.within(s, theta, 0.9), radius_um: 3.6, density: 0.09 });
                    }
                }
            }
        }
    }

    /// The edge of the fin: a line of a few grey levels. Its darkness does not depend on the spacing of the stations.
    fn add_fin_edge(&self, seeded: &mut Seeded, spots: &mut Vec<Spot>) {
        let density_per_um = self.look.fin_contrast * seeded.between(0.005, 0.010);
        let rings: Vec<(f64, Vec<[f64; 3]>)> = self.fin_stations(900).map(|s| (s, self.fin_ring(s, 48))).collect();
        for (p, theta) in [(0usize, 0.0), (24, PI)] {
            for pair in rings.windows(2) {
                let (s, Some(&before), Some(&at_um)) = (pair[1].0, pair[0].1.get(p), pair[1].1.get(p)) else { continue };
                if s >= 1.0 || (at_um[1] - self.centre(s)[1]).abs() > self.radius(s, theta) {
                    let step_um = (at_um[0] - before[0]).hypot(at_um[1] - before[1]);
                    spots.push(Spot { at_um, radius_um: 4.0, density: density_per_um * step_um });
                }
            }
        }
    }

    /// A point in the body. `depth` 0 is the centre line, 1 the surface.
    fn within(&self, s: f64, theta: f64, depth: f64) -> [f64; 3] {
        let [x, y, z] = self.centre(s);
        let r = depth * self.radius(s, theta);
        [x, y + r * theta.cos(), z + r * theta.sin()]
    }
}
