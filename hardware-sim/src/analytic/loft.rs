//! Solids that are given slice by slice, and the spacing of slices that makes outlines smooth.
//!
//! ```text
//!   ellipsoid   ( | | | | )     x = -a cos s, half axes times sin s
//!   capsule     (|:::::::|)     two half spheres and a cylinder, s the arc along its profile over the radius
//!   body        (||  |  |  |>   a larva's body, see `larva`
//!   plate         (--|--|-)     its fin fold: a thin ellipse in every slice
//! ```

use super::larva::{Body, Plate};
use super::slice::{Section, Slice};
use std::f64::consts::{FRAC_PI_2, PI};

/// One solid whose slices are all convex.
#[derive(Debug, Clone)]
pub enum Solid {
    Ellipsoid { half_axes_um: [f64; 3] },
    Capsule { radius_um: f64, half_cylinder_um: f64 },
    Body(Body),
    Plate(Plate),
}

impl Solid {
    /// The largest s. The smallest is 0.
    pub fn span(&self) -> f64 {
        match self {
            Self::Capsule { radius_um, half_cylinder_um } => PI + 2.0 * half_cylinder_um / radius_um,
            Self::Ellipsoid { .. } | Self::Body(_) | Self::Plate(_) => PI,
        }
    }

    pub fn slice(&self, s: f64) -> Slice {
        match self {
            Self::Ellipsoid { half_axes_um: [a, b, c] } => {
                let (sin, cos) = s.sin_cos();
                on_axis(s, [-a * cos, a * sin], [b * sin, c * sin], [b * cos, c * cos])
            }
            Self::Capsule { radius_um: r, half_cylinder_um: m } => {
                let after = s - FRAC_PI_2 - 2.0 * m / r;
                if s < FRAC_PI_2 {
                    on_axis(s, [-m - r * s.cos(), r * s.sin()], [r * s.sin(); 2], [r * s.cos(); 2])
                } else if after < 0.0 {
                    on_axis(s, [r * (s - FRAC_PI_2) - m, *r], [*r; 2], [0.0; 2])
                } else {
                    on_axis(s, [m + r * after.sin(), r * after.cos()], [r * after.cos(); 2], [-r * after.sin(); 2])
                }
            }
            Self::Body(body) => body.slice(s),
            Self::Plate(plate) => plate.slice(s),
        }
    }
}

fn on_axis(s: f64, [x, x_s]: [f64; 2], half: [f64; 2], half_s: [f64; 2]) -> Slice {
    Slice { s, x, x_s, centre: [0.0; 2], centre_s: [0.0; 2], section: Section::Ellipse { half, half_s } }
}

/// A solid with its computed slices.
#[derive(Debug, Clone)]
pub struct Loft {
    pub solid: Solid,
    /// In the order of s, without the two poles.
    pub slices: Vec<Slice>,
}

/// A vertex of an outline every so often: 0.8 px at 5.5 um per pixel. Turning by no more than this between two, a chord leaves
/// its arc by 0.8 px * 0.06 / 8 = 0.006 px at most.
const STEP_UM: f64 = 4.4;
const TURN_RAD: f64 = 0.06;
/// Places that are tried on the way; a slice is taken once the steps between them have added up.
const TRIED: u32 = 6000;

impl Loft {
    pub fn new(solid: Solid) -> Self {
        let span = solid.span();
        let mut slices = Vec::new();
        let mut before: Option<(f64, f64)> = None;
        let mut due = 0.0;
        for i in 1..TRIED {
            let slice = solid.slice(span * f64::from(i) / f64::from(TRIED));
            // Along the profile with the mean radius; the steepest direction of a slice climbs somewhat more.
            let climb = match slice.section {
                Section::Ellipse { half_s: [b, c], .. } => {
                    if b.abs() > c.abs() {
                        b
                    } else {
                        c
                    }
                }
                Section::Fourier { mean_s, .. } => mean_s,
            };
            let (speed, heading) = (slice.x_s.hypot(1.3 * climb), climb.atan2(slice.x_s));
            if let Some((last_speed, last_heading)) = before {
                let path = f64::midpoint(speed, last_speed) * span / f64::from(TRIED);
                due += path / STEP_UM + (heading - last_heading).abs() / TURN_RAD;
            }
            before = Some((speed, heading));
            if due >= 1.0 || slices.is_empty() {
                slices.push(slice);
                due = 0.0;
            }
        }
        Self { solid, slices }
    }
}
