//! Recovers psi and its angles from the matrices of views of one camera in front of a turntable.
//!
//! ```text
//!   P_i = K [R_i | t_i]      one K: their mean      R_0^T R_i: turns about one direction a       t_i = d - R_i c: about one line, through c
//!        ── psi's frame: origin on the line beside the projection centre, x along a ── psi, omega_i ── seen again: off by how much?
//! ```
//! psi looks straight at the axis (`phi` is a quarter turn). A camera that looks past the axis differs only by a turn about its
//! own x axis, which changes the angles, and by a small effect on the perspective. The images of the box's corners show whether
//! the result fits.

use super::{Camera, Projection};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Rotation3, Vector3, Vector6};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A turn that was recovered from matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct Turntable {
    /// The camera, in psi's unit.
    pub camera: Camera,
    /// Angle of each view, rad. The first is 0.
    pub omega: Vec<f64>,
    /// Where psi's world lies in that of the matrices.
    pub frame: AxisFrame,
    /// Largest distance between the images of a corner of the box by psi and by the matrices, px.
    pub off_px: f64,
    /// Largest angle between the axis of a view and the common axis, deg.
    pub axis_off_deg: f64,
}

/// Position of psi's world in that of the matrices: `world = origin + scale axes x`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisFrame {
    /// The origin of psi's world, in the world of the matrices.
    pub origin: [f64; 3],
    /// Directions of psi's x (along the axis), y and z, as columns.
    pub axes: Matrix3<f64>,
    /// Units of the matrices' world in one unit of psi's.
    pub scale: f64,
}

impl AxisFrame {
    /// A point of psi's world in the world of the matrices.
    pub fn to_world(&self, x: [f64; 3]) -> [f64; 3] {
        (Vector3::from(self.origin) + self.scale * self.axes * Vector3::from(x)).into()
    }

    /// A point of the matrices' world in psi's world.
    pub fn from_world(&self, x: [f64; 3]) -> [f64; 3] {
        (self.axes.transpose() * (Vector3::from(x) - Vector3::from(self.origin)) / self.scale).into()
    }
}

/// Why matrices are not those of a turntable.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoTurn {
    /// Too few matrices.
    #[error("{found} matrices; {needed} or more tell an axis")]
    FewViews {
        /// Matrices given.
        found: usize,
        /// Matrices needed.
        needed: usize,
    },
    /// The views hardly turn.
    #[error("the views turn by {found_deg:.2} deg at most, {least_deg:.0} or more tell an axis")]
    Still {
        /// Largest turn, deg.
        found_deg: f64,
        /// Least turn needed, deg.
        least_deg: f64,
    },
    /// No camera in front of one axis reproduces the images.
    #[error(
        "no one camera before one axis sees what they see: the best is {off_px:.1} px off, {most_px:.1} at most, and the views' own axes lie up to {axis_off_deg:.2} \
         deg from a common one"
    )]
    Apart {
        /// Largest error of the best one, px.
        off_px: f64,
        /// Largest error allowed, px.
        most_px: f64,
        /// Largest angle of a view's axis from the common one, deg.
        axis_off_deg: f64,
    },
    /// The axis does not lie along the image's rows.
    #[error(
        "the axis is seen {found_deg:.0} deg from the image's rows, {most_deg:.0} at most are calibrated: turn images and cameras so that it lies along them"
    )]
    Upright {
        /// Angle from the rows, deg.
        found_deg: f64,
        /// Largest angle allowed, deg.
        most_deg: f64,
    },
    /// A matrix has no inverse.
    #[error("a matrix has no inverse; a camera's has one")]
    Singular,
}

const VIEWS_LEAST: usize = 4;
/// A smaller turn is noise.
const TURN_LEAST_DEG: f64 = 20.0;
/// Largest error, px, with which a calibration is useful. Good turntables are known to half a pixel.
const OFF_MOST_PX: f64 = 1.0;
/// Views in the order of the turn go around once, and a little further where there is a closure view.
const MOST_TURN: f64 = 1.1 * TAU;
/// Largest angle of the axis from the rows: slices of the axis are read along the columns of the image.
const UPRIGHT_MOST_DEG: f64 = 20.0;

/// A matrix taken apart: `K [R | t]`.
struct Apart {
    k: Matrix3<f64>,
    r: Rotation3<f64>,
    t: Vector3<f64>,
}

impl Turntable {
    /// Recovers the turn. `sensor` is the size of the images, px. `corners` are points around the specimen, in the world of the
    /// matrices. `kx` (px/um) makes um of a world without a unit; with `None` the unit of the matrices is kept.
    ///
    /// # Errors
    /// [`NoTurn`], with how far off the matrices are and how far off they may be.
    pub fn of(projections: &[Projection], sensor: [u32; 2], corners: &[[f64; 3]], kx: Option<f64>) -> Result<Self, NoTurn> {
        if projections.len() < VIEWS_LEAST {
            return Err(NoTurn::FewViews { found: projections.len(), needed: VIEWS_LEAST });
        }
        let mut views = projections.iter().map(|p| apart(p).ok_or(NoTurn::Singular)).collect::<Result<Vec<_>, _>>()?;
        let n = views.len() as f64;
        let k = views.iter().map(|v| v.k).sum::<Matrix3<f64>>() / n;
        let widest = views.iter().map(|v| v.r.angle_to(&views[0].r)).fold(0.0, f64::max).to_degrees();
        if widest < TURN_LEAST_DEG {
            return Err(NoTurn::Still { found_deg: widest, least_deg: TURN_LEAST_DEG });
        }
        let mut along = axis(&views);
        let mut seen = views.iter().map(|v| v.r * along).sum::<Vector3<f64>>().normalize();
        if seen.x < 0.0 {
            (along, seen) = (-along, -seen);
        }
        let found_deg = seen.x.clamp(-1.0, 1.0).acos().to_degrees();
        if found_deg > UPRIGHT_MOST_DEG {
            return Err(NoTurn::Upright { found_deg, most_deg: UPRIGHT_MOST_DEG });
        }
        let (c, d) = line(&views, &along).ok_or(NoTurn::Singular)?;
        // The origin is moved along the axis to where psi's origin is seen.
        let slide = -d.x / seen.x;
        let (origin, d) = (c + slide * along, d + slide * seen);
        // The camera is turned about its own x axis until it looks at the axis, so that psi's phi is a quarter turn.
        let past = FRAC_PI_2 - d.z.atan2(d.y);
        let [fx, fy] = [k[(0, 0)], k[(1, 1)]];
        let [kx_world, ky_world] = [fx / d.z, fy / d.z / past.cos()];
        let [ux, uy] = [k[(0, 2)] + k[(0, 1)] * d.y / d.z, k[(1, 2)] + fy * d.y / d.z];
        let straight = Rotation3::from_axis_angle(&Vector3::x_axis(), past);
        for v in &mut views {
            v.r = straight * v.r;
        }
        let (seen, f_world) = (straight * seen, (straight * d).z);
        let axis_off_deg = views.iter().map(|v| (v.r * along).angle(&seen)).fold(0.0, f64::max).to_degrees();
        let (alpha, gamma) = ((-seen.z).atan2(seen.x), seen.y.asin());
        let pose = Rotation3::from_axis_angle(&Vector3::y_axis(), alpha) * Rotation3::from_axis_angle(&Vector3::z_axis(), gamma);
        let axes = views[0].r.inverse() * pose;
        let omega = one_turn(views.iter().map(|v| turn_about_x(&(pose.inverse() * v.r * axes))));
        let scale = kx.map_or(1.0, |kx| kx / kx_world);
        let camera = Camera {
            f: f_world / scale,
            kx: kx_world * scale,
            ky: ky_world * scale,
            ux,
            uy,
            s: k[(0, 1)],
            alpha,
            gamma,
            phi: FRAC_PI_2,
            width: sensor[0],
            height: sensor[1],
            glass: None,
        };
        let frame = AxisFrame { origin: origin.into(), axes: *axes.matrix(), scale };
        let mut table = Self { camera, omega, frame, off_px: 0.0, axis_off_deg };
        table.off_px = table.off(projections, corners);
        if table.camera.check().is_err() || table.off_px.is_nan() || table.off_px > OFF_MOST_PX {
            return Err(NoTurn::Apart { off_px: table.off_px, most_px: OFF_MOST_PX, axis_off_deg });
        }
        Ok(table)
    }

    /// Largest distance between the images of a corner. A corner behind both cameras counts 0.
    fn off(&self, projections: &[Projection], corners: &[[f64; 3]]) -> f64 {
        let of_view = |(p, &omega): (&Projection, &f64)| {
            let psi = self.camera.projection(omega);
            let off = |corner: &[f64; 3]| match (p.project(*corner), psi.project(self.frame.from_world(*corner))) {
                (Some(a), Some(b)) => (a.0 - b.0).hypot(a.1 - b.1),
                (None, None) => 0.0,
                _ => f64::INFINITY,
            };
            corners.iter().map(off).fold(0.0, larger)
        };
        projections.iter().zip(&self.omega).map(of_view).fold(0.0, larger)
    }
}

/// As `f64::max`, but keeps a value that is no number.
fn larger(a: f64, b: f64) -> f64 {
    if b.is_nan() || b > a { b } else { a }
}

/// `K [R | t]` with a positive diagonal of K whose last entry is 1.
fn apart(projection: &Projection) -> Option<Apart> {
    let rows = projection.rows();
    let m = Matrix3::from_fn(|i, j| rows[i][j]);
    // M = K R, so that M^-1 = R^T K^-1: orthogonal times upper triangular.
    let (q, upper) = m.try_inverse()?.qr().unpack();
    let signs = Matrix3::from_diagonal(&upper.diagonal().map(f64::signum));
    let k = (signs * upper).try_inverse()?;
    let r = Rotation3::from_matrix_unchecked((q * signs).transpose());
    let t = k.try_inverse()? * Vector3::from_fn(|i, _| rows[i][3]);
    Some(Apart { k: k / k[(2, 2)], r, t: t * k[(2, 2)] })
}

/// The direction in the world that no turn from the first view changes.
fn axis(views: &[Apart]) -> Vector3<f64> {
    let moved = views.iter().map(|v| (views[0].r.inverse() * v.r).matrix() - Matrix3::identity());
    let sum: Matrix3<f64> = moved.map(|m| m.transpose() * m).sum();
    let eigen = sum.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into()
}

/// A point of the axis and its place in the frame of all views, `t_i = d - R_i c`. It is the point of the axis nearest to the
/// world's origin.
fn line(views: &[Apart], along: &Vector3<f64>) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    let mut add = |rows: Matrix3x6<f64>, values: Vector3<f64>| {
        normal += rows.transpose() * rows;
        right += rows.transpose() * values;
    };
    for v in views {
        let rows = Matrix3x6::from_fn(|i, j| if j < 3 { -v.r[(i, j)] } else { f64::from(u8::from(j - 3 == i)) });
        add(rows, v.t);
    }
    add(Matrix3x6::from_fn(|i, j| if i == 0 && j < 3 { along[j] } else { 0.0 }), Vector3::zeros());
    let found = normal.cholesky()?.solve(&right);
    Some((found.fixed_rows::<3>(0).into(), found.fixed_rows::<3>(3).into()))
}

/// Angles that change by less than half a turn from view to view. Where they go further than once around, they are reduced to
/// one turn.
fn one_turn(angles: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut turned: Vec<f64> = Vec::new();
    for angle in angles {
        let from = turned.last().copied().unwrap_or(0.0);
        turned.push(angle - TAU * ((angle - from) / TAU).round());
    }
    let span = |side: fn(f64, f64) -> f64| turned.iter().copied().fold(0.0, side);
    if span(f64::max) - span(f64::min) > MOST_TURN { turned.into_iter().map(|a| a.rem_euclid(TAU)).collect() } else { turned }
}

/// The angle of the turn about x that is nearest.
fn turn_about_x(r: &Rotation3<f64>) -> f64 {
    (r[(2, 1)] - r[(1, 2)]).atan2(r[(1, 1)] + r[(2, 2)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let (k, f) = (0.18, 60_000.0);
        Camera {
            f,
            kx: k,
            ky: 1.1 * k,
            ux: 500.0,
            uy: 520.0,
            s: 3.0,
            alpha: 0.01,
            gamma: -0.02,
            phi: FRAC_PI_2,
            width: 1024,
            height: 1024,
            glass: None,
        }
    }

    const CORNERS: [[f64; 3]; 4] = [[2000.0, 300.0, 300.0], [-2000.0, 300.0, -300.0], [1500.0, -300.0, 300.0], [-1500.0, -300.0, -300.0]];

    /// The camera's views with each world point at `turned x + shift`, lengths `scale` as large.
    fn matrices(camera: &Camera, omega: &[f64], scale: f64) -> (Vec<Projection>, Vec<[f64; 3]>) {
        let turned = Rotation3::from_euler_angles(0.7, -0.4, 2.0);
        let shift = Vector3::new(3.0, -7.0, 11.0) * scale;
        let of = |&w: &f64| {
            let rows = camera.projection(w).rows().to_owned();
            let m = Matrix3::from_fn(|i, j| rows[i][j]) * turned.inverse().matrix() / scale;
            let p4 = Vector3::from_fn(|i, _| rows[i][3]) - m * shift;
            Projection::from_matrix(std::array::from_fn(|i| std::array::from_fn(|j| if j < 3 { m[(i, j)] } else { p4[i] }))).unwrap()
        };
        let world = CORNERS.map(|c| (turned * Vector3::from(c) * scale + shift).into());
        (omega.iter().map(of).collect(), world.to_vec())
    }

    #[test]
    fn a_turn_in_any_world_is_psi_again() {
        let omega: Vec<f64> = (0..9).map(|i| f64::from(i) * -0.7).collect();
        for (camera, scale, within_px) in
            [(camera(), 1.0, 1e-6), (camera(), 0.01, 1e-6), (Camera { phi: FRAC_PI_2 - 0.02, ..camera() }, 1.0, 0.2)]
        {
            let (projections, corners) = matrices(&camera, &omega, scale);
            let table = Turntable::of(&projections, [1024, 1024], &corners, Some(camera.kx)).unwrap();
            assert!(table.off_px < within_px && table.axis_off_deg < 1e-5, "{table:?}");
            for (found, expected) in table.omega.iter().zip(&omega) {
                assert!((found - expected).sin().abs() < 1e-3, "{found} is not {expected}");
            }
            assert!((table.frame.scale / scale - 1.0).abs() < 1e-3, "{table:?}");
            let c = &table.camera;
            assert!((c.gamma - camera.gamma).abs() < 1e-3 && (c.alpha - camera.alpha).abs() < 1e-3, "{c:?}");
            assert!((c.ky / camera.ky - 1.0).abs() < 1e-3 && (c.f / camera.f - 1.0).abs() < 1e-3, "{c:?}");
            for corner in corners {
                let back = table.frame.to_world(table.frame.from_world(corner));
                assert!((0..3).all(|i| (back[i] - corner[i]).abs() < 1e-8), "{back:?} {corner:?}");
            }
        }
    }

    #[test]
    fn what_is_no_turn_is_refused_with_both_numbers() {
        let omega: Vec<f64> = (0..8).map(|i| f64::from(i) * 0.7).collect();
        let (good, corners) = matrices(&camera(), &omega, 1.0);
        let of = |p: &[Projection]| Turntable::of(p, [1024, 1024], &corners, None).unwrap_err();
        // One view rolled by 3 deg: no turn about the axis does that.
        let (rolled, _) = matrices(&Camera { gamma: 0.03, ..camera() }, &omega[3..4], 1.0);
        let mut views = good.clone();
        views[3] = rolled[0];
        let NoTurn::Apart { off_px, most_px, axis_off_deg } = of(&views) else { panic!("{:?}", of(&views)) };
        assert!(off_px > 5.0 && most_px <= 1.0 && (1.0..3.0).contains(&axis_off_deg), "{off_px} {axis_off_deg}");
        // One view of another focal length.
        let (nearer, _) = matrices(&Camera { kx: 0.19, ..camera() }, &omega[3..4], 1.0);
        views[3] = nearer[0];
        assert!(matches!(of(&views), NoTurn::Apart { .. }));
        assert!(matches!(of(&good[..3]), NoTurn::FewViews { found: 3, .. }));
        let (still, _) = matrices(&camera(), &[0.0, 0.01, 0.02, 0.03, 0.04], 1.0);
        assert!(matches!(of(&still), NoTurn::Still { .. }));
        let (upright, _) = matrices(&Camera { gamma: 1.5, ..camera() }, &omega, 1.0);
        assert!(matches!(of(&upright), NoTurn::Upright { found_deg, .. } if (found_deg - 85.9).abs() < 0.2));
    }
}
