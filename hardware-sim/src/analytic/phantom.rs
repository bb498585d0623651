//! A specimen that is given by formulas: its solids, its pose, its true values and its outlines.

use super::contour::contour;
use super::larva::{Body, Plate};
use super::loft::{Loft, Solid};
use super::truth::{hull_volume_and_area, volume_and_area};
use super::union::Lines;
use crate::scene::camera::View as Sight;
use crate::scene::phantom::LarvaError;
use crate::scene::seeded::{Seeded, mixed};
use crate::scene::{Camera, Outline, Truth};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The pose of a phantom: rolled about its own x axis, then moved. It turns with the capillary. um and rad.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Pose {
    pub x_um: f64,
    pub y_um: f64,
    pub z_um: f64,
    pub roll_rad: f64,
}

impl Pose {
    /// A random pose: up to 100 um along and 40 um across the capillary, rolled by any angle.
    pub fn seeded(seed: u64) -> Self {
        let mut s = Seeded::new(mixed(seed ^ 0x905E));
        Self { x_um: s.between(-100.0, 100.0), y_um: s.between(-40.0, 40.0), z_um: s.between(-40.0, 40.0), roll_rad: s.between(0.0, TAU) }
    }

    pub fn place(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.roll_rad.sin_cos();
        [x + self.x_um, y * cos - z * sin + self.y_um, y * sin + z * cos + self.z_um]
    }

    /// The inverse of [`Pose::place`].
    fn own(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.roll_rad.sin_cos();
        let (y, z) = (y - self.y_um, z - self.z_um);
        [x - self.x_um, y * cos + z * sin, z * cos - y * sin]
    }

    /// This pose, then rolled about the axis of the capillary and moved.
    #[must_use]
    pub fn moved(&self, by: &Self) -> Self {
        let [x_um, y_um, z_um] = by.place([self.x_um, self.y_um, self.z_um]);
        Self { x_um, y_um, z_um, roll_rad: self.roll_rad + by.roll_rad }
    }
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SizeError {
    #[error("{name} is {found} um; it must be a finite number above {above} um")]
    TooSmall { name: &'static str, found: f64, above: f64 },
}

/// A specimen with true values and outlines.
#[derive(Debug, Clone)]
pub struct Phantom {
    /// The body first, then the other solids that contribute to the outline.
    lofts: Vec<Loft>,
    pose: Pose,
    diameter_um: Option<f64>,
}

impl Phantom {
    /// # Errors
    /// The diameter is not a positive length.
    pub fn sphere(diameter_um: f64) -> Result<Self, SizeError> {
        let radius_um = above("sphere's diameter", diameter_um, 0.0)? / 2.0;
        Ok(Self { diameter_um: Some(diameter_um), ..Self::ellipsoid([radius_um; 3])? })
    }

    /// An ellipsoid with these half axes along x, y and z, um.
    ///
    /// # Errors
    /// A half axis is not a positive length.
    pub fn ellipsoid(half_axes_um: [f64; 3]) -> Result<Self, SizeError> {
        for a in half_axes_um {
            above("ellipsoid's half axis", a, 0.0)?;
        }
        Ok(Self::of(vec![Solid::Ellipsoid { half_axes_um }]))
    }

    /// A cylinder along x between two half spheres.
    ///
    /// # Errors
    /// The diameter is not a positive length, or the length is not larger than the diameter.
    pub fn capsule(length_um: f64, diameter_um: f64) -> Result<Self, SizeError> {
        let radius_um = above("capsule's diameter", diameter_um, 0.0)? / 2.0;
        let half_cylinder_um = above("capsule's length", length_um, diameter_um)? / 2.0 - radius_um;
        Ok(Self::of(vec![Solid::Capsule { radius_um, half_cylinder_um }]))
    }

    /// A larva-like body of 3, 4 or 5 dpf without fins.
    ///
    /// # Errors
    /// The age is not 3, 4 or 5 dpf.
    pub fn larva(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        Ok(Self::of(vec![Solid::Body(Body::new(dpf, seed)?)]))
    }

    /// The body of [`Self::larva`] with its fin fold.
    ///
    /// # Errors
    /// The age is not 3, 4 or 5 dpf.
    pub fn finned(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        let body = Body::new(dpf, seed)?;
        let plate = Plate::new(&body, seed);
        Ok(Self::of(vec![Solid::Body(body), Solid::Plate(plate)]))
    }

    fn of(solids: Vec<Solid>) -> Self {
        Self { lofts: solids.into_iter().map(Loft::new).collect(), pose: Pose::default(), diameter_um: None }
    }

    #[must_use]
    pub fn placed(mut self, pose: Pose) -> Self {
        self.pose = pose;
        self
    }

    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// First and last x of the whole specimen in its pose, um.
    pub fn ends_um(&self) -> [f64; 2] {
        let ends = |loft: &Loft| [loft.solid.slice(0.0).x, loft.solid.slice(loft.solid.span()).x];
        let [from, to] = self.lofts.iter().map(ends).fold([f64::INFINITY, f64::NEG_INFINITY], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        [from + self.pose.x_um, to + self.pose.x_um]
    }

    /// Least and greatest x, y and z of the whole specimen in its pose, um.
    pub fn bounds_um(&self) -> [[f64; 3]; 2] {
        let slices = || self.lofts.iter().flat_map(|loft| &loft.slices);
        let reach = |t: f64| slices().map(|slice| slice.support(t - self.pose.roll_rad).h).fold(f64::NEG_INFINITY, f64::max);
        let [from, to] = self.ends_um();
        let Pose { y_um, z_um, .. } = self.pose;
        [[from, y_um - reach(PI), z_um - reach(1.5 * PI)], [to, y_um + reach(0.0), z_um + reach(FRAC_PI_2)]]
    }

    /// Volume and area of the body and of the ideal hull of body and fin fold, by integration. The relative error is below 1e-5.
    pub fn truth(&self) -> Truth {
        let body = &self.lofts[0].solid;
        let [volume_um3, area_um2] = volume_and_area(body);
        let [hull_volume_um3, hull_area_um2] = match (body, self.lofts.get(1).map(|loft| &loft.solid)) {
            (Solid::Body(body), Some(Solid::Plate(plate))) => hull_volume_and_area(body, plate),
            _ => [volume_um3, area_um2],
        };
        let length_um = body.slice(body.span()).x - body.slice(0.0).x;
        Truth { volume_um3, area_um2, hull_volume_um3, hull_area_um2, length_um, diameter_um: self.diameter_um }
    }

    /// The outline that the camera sees when the axis is turned by `omega_rad`, px: closed, clockwise on the screen, not clipped at the
    /// border of the sensor.
    pub fn outline(&self, camera: &Camera, omega_rad: f64) -> Outline {
        self.outline_at(&self.pose, &camera.view(omega_rad))
    }

    pub(super) fn outline_at(&self, pose: &Pose, sight: &Sight) -> Outline {
        let eye = pose.own(sight.centre());
        let seen = |loft: &Loft| {
            let image = |point: [f64; 3]| {
                let p = sight.project(pose.place(point));
                [p.u_px, p.v_px]
            };
            let outline: Vec<[f64; 2]> = contour(loft, eye).into_iter().map(image).collect();
            Lines::of(&outline)
        };
        self.lofts.iter().map(seen).reduce(|all, other| all.with(&other)).map(Lines::outline).unwrap_or_default()
    }
}

fn above(name: &'static str, found: f64, above: f64) -> Result<f64, SizeError> {
    if found.is_finite() && found > above { Ok(found) } else { Err(SizeError::TooSmall { name, found, above }) }
}

#[cfg(test)]
mod tests;
