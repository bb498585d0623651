//! The glass tube around the specimen, and what it does to rays across it.
//!
//! ```text
//!   outside   glass   bore         A ray that would pass the axis at distance h outside passes it inside at distance b = h n_outside / n_inside,
//!   ───────(\───(─.__              so that the image is as wide as ky says. It is also turned about the axis, by eps:
//!     h    R   r  b  `'──
//!                                  eps(b) = asin(b / r) - asin(n_i b / (n_g r)) + asin(n_i b / (n_g R)) - asin(h / R)
//! ```
//! At each face the angle to the normal changes by Snell's law, and the sum of the changes of two faces is `eps`. A point is thus seen where it
//! would be seen without glass if the capillary had turned by `eps` more. `eps` has the sign of `b`; in water it is positive.

use serde::{Deserialize, Serialize};

/// A round tube about the axis of the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GlassTube {
    /// Radius of the inner face, um.
    pub bore_radius_um: f64,
    /// Radius of the outer face, um.
    pub outer_radius_um: f64,
    /// Refractive index of the medium in the bore.
    pub inside: f64,
    /// Refractive index of the glass.
    pub glass: f64,
    /// Refractive index of the medium around the tube.
    pub outside: f64,
}

/// Share of the bore beyond which `eps` no longer grows. A ray at the wall itself has no direction.
const REACH: f64 = 0.998;

impl GlassTube {
    /// The vendor's capillary of borosilicate glass in water, with the wall that most pictures show: the lines of the wall lie as those of 20 to
    /// 35 um do.
    pub const THIN: Self = Self { bore_radius_um: 300.0, outer_radius_um: 325.0, inside: 1.333, glass: 1.474, outside: 1.333 };

    /// Largest distance from the axis of a ray in the bore, um.
    fn reach_um(&self) -> f64 {
        REACH * self.bore_radius_um.min(self.outer_radius_um * self.outside / self.inside)
    }

    /// The angle (rad) by which the ray that passes the axis at distance `b_um` in the bore is turned, and its derivative (rad/um). Beyond the
    /// bore it is that at the wall.
    pub fn turn(&self, b_um: f64) -> [f64; 2] {
        let reach = self.reach_um();
        let b = b_um.max(-reach).min(reach);
        let sine = |index: f64, radius: f64| {
            let per_um = self.inside / (index * radius);
            let sine = b * per_um;
            (sine, (1.0 - sine * sine).sqrt(), per_um)
        };
        let (bore, bore_glass) = (sine(self.inside, self.bore_radius_um), sine(self.glass, self.bore_radius_um));
        let (outer_glass, outer) = (sine(self.glass, self.outer_radius_um), sine(self.outside, self.outer_radius_um));
        // asin x - asin y
        let difference = |x: (f64, f64, f64), y: (f64, f64, f64)| (x.0 * y.1 - y.0 * x.1).asin();
        let slope = |x: (f64, f64, f64)| x.2 / x.1;
        let per_um = slope(bore) - slope(bore_glass) + slope(outer_glass) - slope(outer);
        [difference(bore, bore_glass) + difference(outer_glass, outer), if b_um.abs() < reach { per_um } else { 0.0 }]
    }

    /// The derivative of [`Self::turn`] by the ratio of the radii, bore over outer face, rad. `eps` is nearly straight in this ratio.
    pub fn turn_by_ratio(&self, b_um: f64) -> f64 {
        let reach = self.reach_um();
        let b = b_um.max(-reach).min(reach) * self.inside;
        let slope = |index: f64| {
            let sine = b / (index * self.outer_radius_um);
            b / (index * self.bore_radius_um) / (1.0 - sine * sine).sqrt()
        };
        slope(self.glass) - slope(self.outside)
    }

    /// Whether it turns no ray: by less than a millionth of a radian near the wall.
    pub fn is_clear(&self) -> bool {
        self.turn(0.9 * self.reach_um())[0].abs() < 1e-6
    }
}

/// A tube in a view, as seen from the projection centre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Through {
    pub tube: GlassTube,
    /// Cosine and sine of the angle of the capillary.
    pub turned: [f64; 2],
    /// The axis in front of the projection centre: across and in depth, um.
    pub axis_um: [f64; 2],
}

/// Steps until a ray is found. Three do, except at the wall.
const STEPS: usize = 40;
/// Distance to which a ray is found, um.
const NEAR_UM: f64 = 1e-7;

impl Through {
    /// Where a point (y, z) of the capillary would lie if it were seen there without glass.
    pub fn apparent(&self, [y, z]: [f64; 2], turn: impl Fn(f64) -> [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.turned;
        let [across, depth] = [y * cos - z * sin, y * sin + z * cos];
        let radius = across.hypot(depth);
        // In the glass there is nothing to be seen. Points there and beyond are turned as those at the bore.
        let within = (self.tube.reach_um() / radius).min(1.0);
        let mut b = across * within;
        let (mut low, mut high) = (-radius * within, radius * within);
        for _ in 0..STEPS {
            let [eps, per_um] = turn(b);
            let (sin, cos) = eps.sin_cos();
            let [seen, beyond] = [within * (across * cos - depth * sin), within * (across * sin + depth * cos)];
            let off = self.passes(seen, beyond) - b;
            if off.abs() < NEAR_UM {
                break;
            }
            if off > 0.0 {
                low = b;
            } else {
                high = b;
            }
            let next = b + off / (1.0 + beyond * per_um);
            b = if next > low && next < high { next } else { f64::midpoint(low, high) };
        }
        let (sin_eps, cos_eps) = turn(b)[0].sin_cos();
        [y * cos_eps - z * sin_eps, y * sin_eps + z * cos_eps]
    }

    /// Distance from the axis of the ray through a point, um. Rays lean where the projection centre is near.
    fn passes(&self, across: f64, depth: f64) -> f64 {
        let [from, far] = self.axis_um;
        let [right, away] = [across + from, depth + far];
        (across * away - depth * right) / right.hypot(away)
    }
}

/// `eps` at even steps, for many points of one view.
#[derive(Debug, Clone)]
pub(super) struct TurnTable {
    reach_um: f64,
    steps_per_um: f64,
    turns: Vec<f64>,
}

/// Steps of the table. Between two, `eps` is off by less than 2e-5 rad, which is 0.005 um at the wall.
const TABLE_STEPS: usize = 2048;

impl TurnTable {
    pub fn of(tube: &GlassTube) -> Self {
        let reach_um = tube.reach_um();
        let steps_per_um = TABLE_STEPS as f64 / (2.0 * reach_um);
        let turns = (0..=TABLE_STEPS + 1).map(|step| tube.turn(step as f64 / steps_per_um - reach_um)[0]).collect();
        Self { reach_um, steps_per_um, turns }
    }

    pub fn turn(&self, b_um: f64) -> [f64; 2] {
        let at = (b_um.clamp(-self.reach_um, self.reach_um) + self.reach_um) * self.steps_per_um;
        let step = (at as usize).min(TABLE_STEPS);
        let rise = self.turns[step + 1] - self.turns[step];
        [self.turns[step] + (at - step as f64) * rise, rise * self.steps_per_um]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;
    use std::f64::consts::TAU;

    fn through(outer_radius_um: f64, outside: f64) -> Camera {
        let glass = Some(GlassTube { bore_radius_um: 300.0, outer_radius_um, inside: 1.333, glass: 1.474, outside });
        let k = 0.2;
        Camera { f: 1e8, kx: k, ky: k * 1.333 / outside, glass, ..Camera::published(1024, 400) }
    }

    /// Heights of the rays that pass through points, traced face by face by Snell's law.
    #[test]
    fn a_point_is_seen_where_its_traced_ray_comes_from() {
        let camera = through(425.0, 1.333);
        for (y, z, omega, height) in
            [(-150.0, 230.0, 0.7, -256.590_841), (200.0, -180.0, 0.4, 260.255_096), (250.0, 20.0, 0.0, 248.285_694)]
        {
            let projection = camera.projection(omega);
            for (_, v) in [projection.project([100.0, y, z]).unwrap(), projection.lookup().project([100.0, y, z]).unwrap()] {
                assert!(((v - camera.uy) / camera.ky - height).abs() < 0.005, "{y} {z} {omega}: {v}");
            }
        }
    }

    #[test]
    fn the_table_and_its_slope_are_those_of_the_formula() {
        for (outer, outside) in [(320.0, 1.333), (425.0, 1.333), (425.0, 1.0)] {
            let tube = through(outer, outside).glass.unwrap();
            let table = TurnTable::of(&tube);
            for step in -58..=58 {
                let b = 5.0 * f64::from(step);
                let [eps, per_um] = tube.turn(b);
                assert!((table.turn(b)[0] - eps).abs() < 2e-5, "{outer} {outside} {b}: {:?} {eps}", table.turn(b));
                let slope = (tube.turn(b + 0.01)[0] - tube.turn(b - 0.01)[0]) / 0.02;
                assert!((slope - per_um).abs() < 1e-7, "{outer} {outside} {b}: {slope} {per_um}");
                let wider = GlassTube { outer_radius_um: outer * 1.0001, ..tube };
                let by_ratio = (wider.turn(b)[0] - eps) / (300.0 / wider.outer_radius_um - 300.0 / outer);
                assert!((by_ratio - tube.turn_by_ratio(b)).abs() < 2e-3, "{outer} {outside} {b}: {by_ratio} {}", tube.turn_by_ratio(b));
            }
        }
        assert!(GlassTube { outer_radius_um: 300.0, ..through(320.0, 1.333).glass.unwrap() }.is_clear());
    }

    /// Every point of the bore has a place, and points beside each other in the picture lie beside each other in the bore.
    #[test]
    fn every_point_in_and_around_the_bore_is_seen_once() {
        for (outer, outside) in [(320.0, 1.333), (425.0, 1.333), (425.0, 1.0)] {
            let camera = through(outer, outside);
            let projection = camera.projection(0.3);
            for radius in [0.0, 100.0, 250.0, 290.0, 320.0, 600.0] {
                let seen = (0..720).map(|i| {
                    let (sin, cos) = (TAU * f64::from(i) / 720.0).sin_cos();
                    (projection.project([0.0, radius * cos, radius * sin]).unwrap().1 - camera.uy) / camera.ky
                });
                let seen: Vec<f64> = seen.collect();
                assert!(seen.iter().all(|h| h.abs() <= radius + 1e-6));
                let steps = seen.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
                assert!(steps <= 0.03 * radius, "{outer} {outside} {radius}: {steps}");
                let turns = seen.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0).count();
                assert!(radius == 0.0 || turns == 2, "{outer} {outside} {radius}: {turns}");
            }
        }
    }
}
