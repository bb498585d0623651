//! Disturbances between a phantom and its views: an error of the camera, an axis that slips, a specimen that shakes, uneven edges, and
//! wrong views. All are drawn from one seed.
//!
//! ```text
//!   omega_i = rho plan_i + jitter_i (the first is exact)       v = v(uy + offset, gamma, alpha) + dy_i + noise along the edge
//! ```

use super::phantom::{Phantom, Pose};
use crate::scene::Camera;
use crate::scene::seeded::{Seeded, mixed};
use serde::{Deserialize, Serialize};

/// A wrong view. Views are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fault {
    /// No outline was found in this view.
    Blank { view: usize },
    /// A blob joins the upper side of the profile to the wall of the bore. Middle and full width of its foot along u, px.
    Leak { view: usize, at_u_px: f64, width_px: f64, bore_radius_um: f64 },
    /// The whole view is shifted, px.
    Jump { view: usize, u_px: f64, v_px: f64 },
    /// From this view on the specimen has another pose: rolled about the axis of the capillary, then moved.
    Moved { from: usize, by: Pose },
    /// The tail (the +x end) of the specimen extends this far beyond the right border of the sensor.
    Clipped { beyond_um: f64 },
}

/// All deviations from the nominal rig. The default has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Disturbance {
    pub seed: u64,
    /// Added to the nominal camera.
    pub uy_px: f64,
    pub gamma_rad: f64,
    pub alpha_rad: f64,
    /// Standard deviation of the angle of each view, rad. The first angle is exact.
    pub omega_jitter_rad: f64,
    /// True angle over planned angle: 1 without slip.
    pub rho: f64,
    /// Standard deviation of the shift of each view along v, px.
    pub dy_px: f64,
    /// Standard deviation of the edge along its normal, px, and its correlation length along the edge, px. The correlation is
    /// exp(-1/2) at this distance. It is at least half a pixel. Views are independent.
    pub edge_noise_px: f64,
    pub edge_correlation_px: f64,
    pub faults: Vec<Fault>,
}

impl Default for Disturbance {
    fn default() -> Self {
        Self {
            seed: 0,
            uy_px: 0.0,
            gamma_rad: 0.0,
            alpha_rad: 0.0,
            omega_jitter_rad: 0.0,
            rho: 1.0,
            dy_px: 0.0,
            edge_noise_px: 0.0,
            edge_correlation_px: 4.0,
            faults: Vec::new(),
        }
    }
}

/// Independent streams of one seed.
#[derive(Clone, Copy)]
pub(super) enum Stream {
    Drift,
    Omega,
    Shift,
    Edge,
}

impl Disturbance {
    /// The drift of one day that a calibration must solve: uy within 20 px, gamma within 1 deg, alpha within 0.3 deg. Standard
    /// deviations: angles 0.5 deg, views 0.4 px, edges 0.3 px.
    pub fn drift(seed: u64) -> Self {
        let mut s = stream(seed, Stream::Drift, 0);
        Self {
            seed,
            uy_px: s.between(-20.0, 20.0),
            gamma_rad: s.between(-1.0, 1.0).to_radians(),
            alpha_rad: s.between(-0.3, 0.3).to_radians(),
            omega_jitter_rad: 0.5f64.to_radians(),
            dy_px: 0.4,
            edge_noise_px: 0.3,
            ..Self::default()
        }
    }

    /// The true camera.
    pub fn camera(&self, nominal: &Camera) -> Camera {
        Camera {
            uy_px: nominal.uy_px + self.uy_px,
            gamma_rad: nominal.gamma_rad + self.gamma_rad,
            alpha_rad: nominal.alpha_rad + self.alpha_rad,
            ..nominal.clone()
        }
    }

    pub(super) fn omega_rad(&self, view: usize, planned_rad: f64) -> f64 {
        let jitter = if view == 0 { 0.0 } else { self.stream(Stream::Omega, view).normal(self.omega_jitter_rad) };
        self.rho * planned_rad + jitter
    }

    pub(super) fn shift_px(&self, view: usize) -> f64 {
        // Adding 0 turns -0 into 0 if there is no shift.
        self.stream(Stream::Shift, view).normal(self.dy_px) + 0.0
    }

    /// The pose of the specimen in a view.
    pub(super) fn pose(&self, view: usize, phantom: &Phantom, camera: &Camera) -> Pose {
        let mut pose = phantom.pose();
        for fault in &self.faults {
            match fault {
                Fault::Moved { from, by } if view >= *from => pose = pose.moved(by),
                Fault::Clipped { beyond_um } => {
                    let rim_um = (f64::from(camera.width) - 0.5 - camera.ux_px) / camera.kx_px_per_um;
                    pose.x_um += rim_um + beyond_um - phantom.ends_um()[1];
                }
                _ => {}
            }
        }
        pose
    }

    pub(super) fn stream(&self, of: Stream, view: usize) -> Seeded {
        stream(self.seed, of, view)
    }
}

fn stream(seed: u64, of: Stream, view: usize) -> Seeded {
    Seeded::new(mixed(mixed(seed ^ 0xD157) ^ ((of as u64) << 32) ^ view as u64))
}
