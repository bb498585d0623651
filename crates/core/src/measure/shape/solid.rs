//! Numbers of the whole solid, which need no axis.

use super::{Refusal, Vector};
use crate::measure::{area, centroid, volume};
use crate::parallel::prelude::*;
use crate::surface::Mesh;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Sums over tetrahedra between the triangles and the centroid; exact for the mesh but for rounding (1e-12 of the value).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Solid {
    /// Enclosed by the mesh.
    pub volume_um3: f64,
    /// Area of its triangles, by Heron's formula.
    pub area_um2: f64,
    /// Centre of mass.
    pub centroid_um: [f64; 3],
    /// Moments of inertia about the principal axes through the centroid at density 1, um^5, the smallest first. That of an
    /// elongated body about its long axis is the first.
    pub principal_moments_um5: [f64; 3],
    /// The axes of these moments: unit vectors, right-handed. The sign of each is that of its largest component.
    pub principal_axes: [[f64; 3]; 3],
    /// Wadell's sphericity: area of the ball of the same volume over the area, `(36 pi V^2)^(1/3) / A`. 1 for a ball.
    pub sphericity: f64,
    /// Area over volume, 1/um.
    pub surface_per_volume_per_um: f64,
}

/// Triangles per partial sum: fixed, so that the sum does not depend on the number of threads.
const CHUNK: usize = 8192;

/// A closed mesh's area vectors cancel; rounding leaves some 1e-13 of the area, one missing triangle of 250 000 some 1e-6.
const OPEN: f64 = 1e-9;

impl Solid {
    pub(super) fn of(mesh: &Mesh) -> Result<Self, Refusal> {
        let (area_um2, volume_um3) = (area(mesh), volume(mesh));
        let open_um2 = sum(mesh, |[a, b, c]| (b - a).cross(&(c - a)) / 2.0).norm();
        if open_um2 > OPEN * area_um2 {
            return Err(Refusal::Open { open_um2 });
        }
        let found = centroid(mesh).filter(|_| volume_um3.is_finite() && volume_um3 > 0.0);
        let centroid_um = found.ok_or(Refusal::NoVolume { triangles: mesh.triangles.len(), volume_um3 })?;
        let middle = Vector::from(centroid_um);
        // Int x x^T over a tetrahedron with a corner at the origin: det / 120 (s s^T + a a^T + b b^T + c c^T), s = a + b + c.
        let moment: Matrix3<f64> = sum(mesh, |corners| {
            let [a, b, c] = corners.map(|p| p - middle);
            let s = a + b + c;
            (s * s.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (a.dot(&b.cross(&c)) / 120.0)
        });
        let eigen = moment.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let axis = |i: usize| {
            let v: Vector = eigen.eigenvectors.column(order[i]).into_owned();
            v * v[v.iamax()].signum()
        };
        let (long, second) = (axis(0), axis(1));
        let principal_axes = [long, second, long.cross(&second)].map(Into::into);
        let trace = moment.trace();
        let principal_moments_um5 = order.map(|i| trace - eigen.eigenvalues[i]);
        let sphericity = libm::cbrt(36.0 * PI * volume_um3 * volume_um3) / area_um2;
        let surface_per_volume_per_um = area_um2 / volume_um3;
        Ok(Self { volume_um3, area_um2, centroid_um, principal_moments_um5, principal_axes, sphericity, surface_per_volume_per_um })
    }
}

/// Sum over the triangles, chunk by chunk in their order.
fn sum<T: Send + Default + std::ops::Add<Output = T>>(mesh: &Mesh, term: impl Fn([Vector; 3]) -> T + Sync) -> T {
    let of_chunk = |chunk: &[[u32; 3]]| chunk.iter().fold(T::default(), |sum, &t| sum + term(mesh.corners(t).map(Vector::from)));
    let chunks: Vec<T> = mesh.triangles.par_chunks(CHUNK).map(of_chunk).collect();
    chunks.into_iter().fold(T::default(), |sum, part| sum + part)
}
