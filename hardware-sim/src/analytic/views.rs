//! The views of a phantom under a disturbance.
//!
//! ```text
//!   pose ─► outline ─► leak ─► uneven edge ─► shift and jump ─► clip at the border of the sensor
//! ```

use super::disturbance::{Disturbance, Fault, Stream};
use super::phantom::Phantom;
use super::union::Lines;
use crate::scene::seeded::Seeded;
use crate::scene::{Camera, Outline};

/// One view with its true values.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// No outline or one, px: closed, clockwise on the screen, within the sensor.
    pub outline: Vec<Outline>,
    pub true_omega_rad: f64,
    /// The shift of this view along v, px.
    pub dy_px: f64,
}

impl Phantom {
    /// The views at the planned angles. `camera` is the nominal camera.
    pub fn views(&self, camera: &Camera, omegas_plan_rad: &[f64], disturbance: &Disturbance) -> Vec<View> {
        let looking = disturbance.camera(camera);
        omegas_plan_rad.iter().enumerate().map(|(view, &planned_rad)| self.view(&looking, view, planned_rad, disturbance)).collect()
    }

    fn view(&self, camera: &Camera, view: usize, planned_rad: f64, disturbance: &Disturbance) -> View {
        let true_omega_rad = disturbance.omega_rad(view, planned_rad);
        let dy_px = disturbance.shift_px(view);
        if disturbance.faults.contains(&Fault::Blank { view }) {
            return View { outline: Vec::new(), true_omega_rad, dy_px };
        }
        let mut outline = self.outline_at(&disturbance.pose(view, self, camera), &camera.view(true_omega_rad));
        for fault in &disturbance.faults {
            if let Fault::Leak { view: at, at_u_px, width_px, bore_radius_um } = fault
                && *at == view
            {
                let wall_v_px = camera.uy_px - camera.ky_px_per_um * bore_radius_um;
                outline = leaked(&outline, *at_u_px, *width_px, wall_v_px);
            }
        }
        if disturbance.edge_noise_px > 0.0 {
            let mut seeded = disturbance.stream(Stream::Edge, view);
            outline = uneven(&outline, disturbance.edge_noise_px, disturbance.edge_correlation_px.max(0.5), &mut seeded);
        }
        let (mut du, mut dv) = (0.0, dy_px);
        for fault in &disturbance.faults {
            if let Fault::Jump { view: at, u_px, v_px } = fault
                && *at == view
            {
                (du, dv) = (du + u_px, dv + v_px);
            }
        }
        for p in &mut outline {
            *p = [p[0] + du, p[1] + dv];
        }
        let outline = within(outline, camera.width, camera.height);
        View { outline: if outline.len() < 3 { Vec::new() } else { vec![outline] }, true_omega_rad, dy_px }
    }
}

/// Raises the upper line to the wall: completely in the middle half of the width, with a slope on both sides.
fn leaked(outline: &[[f64; 2]], at_u_px: f64, width_px: f64, wall_v_px: f64) -> Outline {
    let mut lines = Lines::of(outline);
    for [u, v] in &mut lines.upper {
        let off = (*u - at_u_px).abs() / (width_px / 2.0);
        let share = (2.0 - 2.0 * off).clamp(0.0, 1.0);
        let smooth = share * share * (3.0 - 2.0 * share);
        *v += smooth * (wall_v_px - *v).min(0.0);
    }
    lines.outline()
}

/// Moves an outline along its normals by a random function of the way round: white numbers every half `correlation_px`, blurred
/// by exp(-(d / correlation)^2), which leaves a correlation of exp(-d^2 / (2 correlation^2)).
fn uneven(outline: &[[f64; 2]], sd_px: f64, correlation_px: f64, seeded: &mut Seeded) -> Outline {
    let n = outline.len();
    let next = |i: usize| outline[(i + 1) % n];
    let mut along: Vec<f64> = vec![0.0];
    for (i, p) in outline.iter().enumerate() {
        along.push(along[i] + (next(i)[0] - p[0]).hypot(next(i)[1] - p[1]));
    }
    let way = along[n];
    let knots = ((way / correlation_px * 2.0).ceil() as usize).max(1);
    let white: Vec<f64> = (0..knots).map(|_| seeded.normal(sd_px)).collect();
    let spacing = way / knots as f64;
    // exp(-2.5^2) = 0.002: the rest is negligible.
    let reach = (2.5 * correlation_px / spacing).ceil() as i64;
    (0..n)
        .map(|i| {
            let at = along[i] / spacing;
            let (mut sum, mut squares) = (0.0, 0.0);
            for k in at.floor() as i64 - reach..=at.floor() as i64 + 1 + reach {
                let weight = (-((at - k as f64) * spacing / correlation_px).powi(2)).exp();
                sum += weight * white[k.rem_euclid(knots as i64) as usize];
                squares += weight * weight;
            }
            let by = sum / squares.sqrt();
            let (p, before, after) = (outline[i], outline[(i + n - 1) % n], next(i));
            let (du, dv) = (after[0] - before[0], after[1] - before[1]);
            let length = du.hypot(dv).max(1e-12);
            // The outside of a clockwise outline lies to the left.
            [p[0] + by * dv / length, p[1] - by * du / length]
        })
        .collect()
}

/// Clips an outline at the border of the sensor and closes it there, one side after the other.
pub(super) fn within(outline: Outline, width: u32, height: u32) -> Outline {
    let rims = [(0, 1.0, -0.5), (0, -1.0, f64::from(width) - 0.5), (1, 1.0, -0.5), (1, -1.0, f64::from(height) - 0.5)];
    rims.into_iter().fold(outline, |outline, (axis, sign, rim)| {
        let room = |p: &[f64; 2]| sign * (p[axis] - rim);
        if outline.iter().all(|p| room(p) >= 0.0) {
            return outline;
        }
        let mut kept = Vec::with_capacity(outline.len());
        for (i, p) in outline.iter().enumerate() {
            let q = &outline[(i + 1) % outline.len()];
            let (a, b) = (room(p), room(q));
            if a >= 0.0 {
                kept.push(*p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                let share = a / (a - b);
                let mut crossing = [p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])];
                crossing[axis] = rim;
                kept.push(crossing);
            }
        }
        kept
    })
}

#[cfg(test)]
mod tests;
