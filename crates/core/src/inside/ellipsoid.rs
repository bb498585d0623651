//! Ellipsoids, and how views show them.

use crate::geometry::Projection;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};
use std::f64::consts::PI;

/// An ellipsoid: all x with (x - centre) S^-1 (x - centre) <= 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ellipsoid {
    /// Centre, um.
    pub centre: Vector3<f64>,
    /// S, um^2: its eigenvalues are the squared half axes.
    pub spread: Matrix3<f64>,
}

/// Length of the steps by which a projection is made linear, um.
const STEP_UM: f64 = 1.0;

impl Ellipsoid {
    /// Volume, um^3.
    pub fn volume_um3(&self) -> f64 {
        4.0 / 3.0 * PI * self.spread.determinant().max(0.0).sqrt()
    }

    /// Half axes, um, the longest first.
    pub fn half_axes_um(&self) -> [f64; 3] {
        let mut found: [f64; 3] = self.spread.symmetric_eigenvalues().map(|e| e.max(0.0).sqrt()).into();
        found.sort_by(|a, b| b.total_cmp(a));
        found
    }

    /// S as xx, yy, zz, xy, xz, yz.
    pub fn spread_um2(&self) -> [f64; 6] {
        let s = &self.spread;
        [s[(0, 0)], s[(1, 1)], s[(2, 2)], s[(0, 1)], s[(0, 2)], s[(1, 2)]]
    }

    /// How far it reaches from its centre in a direction of length 1, um.
    pub fn reach_um(&self, direction: Vector3<f64>) -> f64 {
        direction.dot(&(self.spread * direction)).max(0.0).sqrt()
    }

    /// Its image. `None` where it is not in front of the camera.
    pub(super) fn seen(&self, view: &Linear) -> Ellipse {
        Ellipse { centre: view.at + view.along * (self.centre - view.about), spread: view.along * self.spread * view.along.transpose() }
    }
}

/// A projection near a point, made linear.
#[derive(Debug, Clone, Copy)]
pub(super) struct Linear {
    about: Vector3<f64>,
    at: Vector2<f64>,
    along: Matrix2x3<f64>,
}

impl Linear {
    pub fn of(projection: &Projection, about: Vector3<f64>) -> Option<Self> {
        let at = |x: Vector3<f64>| projection.project(x.into()).map(|(u, v)| Vector2::new(u, v));
        let mut along = Matrix2x3::zeros();
        for axis in 0..3 {
            let step = STEP_UM * Vector3::ith(axis, 1.0);
            along.set_column(axis, &((at(about + step)? - at(about - step)?) / (2.0 * STEP_UM)));
        }
        Some(Self { about, at: at(about)?, along })
    }

    /// Scale, px/um.
    pub fn scale(&self) -> f64 {
        self.along.norm() / 2f64.sqrt()
    }
}

/// The image of an ellipsoid, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ellipse {
    pub centre: Vector2<f64>,
    pub spread: Matrix2<f64>,
}

impl Ellipse {
    /// Distance of the outline from the centre in a direction, px.
    pub fn reach(&self, direction: Vector2<f64>) -> f64 {
        self.form(direction).map_or(0.0, |q| 1.0 / q.sqrt())
    }

    /// How far a point lies outside along the ray from the centre, px. Negative inside.
    pub fn beyond(&self, point: Vector2<f64>) -> f64 {
        let d = point - self.centre;
        let length = d.norm();
        if length == 0.0 { -self.reach(Vector2::x()) } else { length - self.reach(d / length) }
    }

    fn form(&self, d: Vector2<f64>) -> Option<f64> {
        let q = d.dot(&(self.spread.try_inverse()? * d));
        (q > 0.0).then_some(q)
    }
}
