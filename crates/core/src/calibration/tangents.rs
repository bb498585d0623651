//! The edges of a column as tangents of a slice of the specimen.
//!
//! ```text
//!   edge (u, v) ── plane through the projection centre ── cut with the slice x = const ── tangent line (theta, offset)
//!
//!   m = (v - dy - uy) / (f ky)             normal in the camera's frame: (cos g - m sin g sin a, -m cos a)
//!   offset = m (f' - x cos g sin a) - x sin g - y'      over the normal's length; theta = its angle - omega - eps(offset)
//! ```
//! `eps` is the angle by which the glass turns a ray at this distance from the axis, see [`GlassTube`](crate::geometry::GlassTube).
//! The column that shows a slice's tangent depends on where the tangent touches, since rays spread and the capillary is rolled.
//! The slice's own support function, from the pass before, gives that place.

use super::support::Support;
use crate::geometry::Camera;
use crate::profile::{ColumnEdges, Columns};
use std::f64::consts::PI;

/// A view with the pose that is known of it.
#[derive(Debug, Clone, Copy)]
pub struct TurnView<'a> {
    /// Edges of its profile, column by column.
    pub columns: &'a Columns,
    /// Angle of the capillary, rad.
    pub omega: f64,
    /// The profile's shift down the image against the camera's, px.
    pub dy_px: f64,
}

/// Which edge of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Upper,
    Lower,
}

impl Side {
    pub const BOTH: [Self; 2] = [Self::Upper, Self::Lower];

    /// Sign of the outward normal along v.
    pub fn sign(self) -> f64 {
        match self {
            Self::Upper => -1.0,
            Self::Lower => 1.0,
        }
    }

    /// This edge of a column.
    pub fn of(self, edges: ColumnEdges) -> f64 {
        match self {
            Self::Upper => edges.upper,
            Self::Lower => edges.lower,
        }
    }
}

/// A tangent of a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tangent {
    /// Direction of the outward normal in the specimen's frame, rad.
    pub theta: f64,
    /// Distance from the capillary's axis, um.
    pub offset_um: f64,
    /// Tangent of the ray's angle with the optical axis, across the capillary.
    pub ray: f64,
    /// Angle by which the glass turns the ray for each um that it lies further down, rad/um.
    pub turns: f64,
    /// Slope of the edge, px of v per px of u.
    pub edge_slope: f64,
    /// Where the tangent touches, in the camera's frame: across, and in depth from the axis, um. Through glass, where it seems to.
    pub touch_um: [f64; 2],
    /// Length of the slice's column that the profile does not cover, px.
    pub gap_px: f64,
}

/// The line of an edge in a slice, before the capillary is turned back: across and in depth. The normal points down the image.
pub(super) struct Line {
    ray: f64,
    normal: [f64; 2],
    /// Distance from the axis times the normal's length. The length is 1 up to some 1e-5, since rays lean by less than a
    /// hundredth.
    pub offset: f64,
}

impl Line {
    /// Unit normal and distance from the axis, um.
    fn unit(&self) -> ([f64; 2], f64) {
        let per_length = 1.0 / (self.normal[0] * self.normal[0] + self.normal[1] * self.normal[1]).sqrt();
        (self.normal.map(|n| n * per_length), self.offset * per_length)
    }
}

/// Columns to either side over which the slope of an edge is taken.
const SLOPE_REACH_PX: f64 = 4.0;

/// The pose of a camera, with its sines and cosines.
#[derive(Debug, Clone)]
pub struct Pose {
    camera: Camera,
    cos_alpha: f64,
    sin_alpha: f64,
    cos_gamma: f64,
    sin_gamma: f64,
    /// Place of the axis in front of the camera.
    across_um: f64,
    depth_um: f64,
}

impl Pose {
    /// The pose of this camera.
    pub fn new(camera: &Camera) -> Self {
        let (sin_alpha, cos_alpha) = camera.alpha.sin_cos();
        let (sin_gamma, cos_gamma) = camera.gamma.sin_cos();
        let (across_um, depth_um) = (camera.f * camera.phi.cos(), camera.f * camera.phi.sin());
        Self { camera: camera.clone(), cos_alpha, sin_alpha, cos_gamma, sin_gamma, across_um, depth_um }
    }

    /// The camera of the pose.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Column that shows a point of slice `x_um` at `touch_um` from the axis (across and in depth, um).
    pub(crate) fn column(&self, x_um: f64, touch_um: [f64; 2]) -> f64 {
        let [across, depth] = touch_um;
        let (along, down) = (x_um * self.cos_gamma - across * self.sin_gamma, x_um * self.sin_gamma + across * self.cos_gamma);
        let right = along * self.cos_alpha + depth * self.sin_alpha;
        let away = depth * self.cos_alpha - along * self.sin_alpha + self.depth_um;
        let c = &self.camera;
        c.ux + (c.f * c.kx * right + c.s * (down + self.across_um)) / away
    }

    /// Place of the slice that column `u` shows on the axis, um along the capillary.
    pub fn slice(&self, u: f64) -> f64 {
        let c = &self.camera;
        // The relation is straight except for the tilt, whose part of x is 1e-4 of it: two steps are exact to rounding at every
        // tilt that is allowed.
        let mut x_um = (u - c.ux) / c.kx;
        for _ in 0..3 {
            x_um += (u - self.column(x_um, [0.0; 2])) / c.kx;
        }
        x_um
    }

    /// The line in which the plane through the projection centre and an edge at height `v` cuts slice `x_um`.
    pub(super) fn line(&self, x_um: f64, v: f64) -> Line {
        let c = &self.camera;
        let ray = (v - c.uy) / (c.f * c.ky);
        let normal = [self.cos_gamma - ray * self.sin_gamma * self.sin_alpha, -ray * self.cos_alpha];
        let offset = ray * (self.depth_um - x_um * self.cos_gamma * self.sin_alpha) - x_um * self.sin_gamma - self.across_um;
        Line { ray, normal, offset }
    }

    /// Angle by which the glass turns a ray at a distance from the axis, and its derivative: rad and rad/um.
    fn turn(&self, b_um: f64) -> [f64; 2] {
        self.camera.glass.map_or([0.0; 2], |tube| tube.turn(b_um))
    }

    /// Unit normal in the bore of a line, and its distance from the axis, um.
    pub(super) fn in_bore(&self, line: &Line) -> ([f64; 2], f64) {
        let ([y, z], offset_um) = line.unit();
        if self.camera.glass.is_none() {
            return ([y, z], offset_um);
        }
        let (sin, cos) = self.turn(offset_um)[0].sin_cos();
        ([y * cos + z * sin, z * cos - y * sin], offset_um)
    }

    /// The tangent that one edge of a view gives of slice `x_um`. The support function says which column to read. `None` where
    /// the profile has no edge there.
    pub(crate) fn tangent(&self, x_um: f64, view: &TurnView, side: Side, support: Option<&Support>) -> Option<Tangent> {
        let sign = side.sign();
        let towards = if side == Side::Upper { PI } else { 0.0 };
        // Rays lean by less than a hundredth, so the tangent touches where a parallel ray would. How far it is turned depends on where
        // it touches: a second look finds it to a tenth of a degree, which moves the column by less than a hundredth of a px.
        let [h, slope] = support.map_or([0.0; 2], |s| {
            let at = |turned: f64| s.at(towards - view.omega - turned);
            if self.camera.glass.is_none() {
                return at(0.0);
            }
            let near = self.turn(sign * at(0.0)[0])[0];
            at(self.turn(sign * at(near)[0])[0])
        });
        let touch_um = [sign * h, sign * slope];
        let u = self.column(x_um, touch_um);
        let edges = view.columns.at(u)?;
        let v = side.of(edges) - view.dy_px;
        let edge_slope = match (view.columns.at(u - SLOPE_REACH_PX), view.columns.at(u + SLOPE_REACH_PX)) {
            (Some(a), Some(b)) => (side.of(b) - side.of(a)) / (2.0 * SLOPE_REACH_PX),
            _ => 0.0,
        };
        let Line { ray, normal, offset } = self.line(x_um, v);
        let length = normal[0].hypot(normal[1]);
        let [turned, turns] = self.turn(offset / length);
        let theta = normal[1].atan2(normal[0]) + towards - view.omega - turned;
        Some(Tangent { theta, offset_um: sign * offset / length, ray, turns, edge_slope, touch_um, gap_px: edges.gap })
    }
}
