//! Numbers of a model: what is written down for a specimen.
//!
//! ```text
//!  Carver ── voxels x SD^3 ───────────────────────────── volume_um3                          the paper's
//!  Mesh of the voxels, faired
//!                ├─ signed tetrahedra ────────────────── mesh_volume_um3, centroid_um
//!                ├─ Heron's formula over its triangles ─ area_um2                            the paper's
//!                ├─ extents ──────────────────────────── length_um along the capillary
//!                └─ least-squares sphere ─────────────── sphere (beads)
//!  Mesh of the field, as it is ───────────────────────── field_volume_um3, field_area_um2    of the outlines
//! ```
//! The area depends on how the mesh was smoothed by up to a tenth, so [`Measurement`] says which operator, weight and
//! number of iterations made it.

pub mod references;
pub mod shape;
mod solid;
mod sphere;
pub mod support;

pub use solid::{Extents, area, centroid, extents, volume};
pub use sphere::{SphereError, SphereFit, fit_sphere};

use serde::{Deserialize, Serialize};

/// The numbers of one model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// Live voxels.
    pub voxels: u64,
    /// Edge of a voxel (SD).
    pub voxel_size_um: f64,
    /// Views that carved the hull.
    pub views: usize,
    /// Views that the tolerance was set for.
    pub planned_views: usize,
    /// Share of views that may miss a voxel.
    pub epsilon: f64,
    /// Volume of the live voxels: the paper's volume.
    pub volume_um3: f64,
    /// Volume that the faired mesh encloses.
    pub mesh_volume_um3: f64,
    /// Part of the unfaired mesh's volume that fairing took away.
    pub fairing_volume_loss: f64,
    /// Area of the faired mesh by Heron's formula: the paper's area.
    pub area_um2: f64,
    /// Area of the mesh before fairing.
    pub unfaired_area_um2: f64,
    /// What made `area_um2` of the binary voxels.
    pub area_method: AreaMethod,
    /// Volume that the field's mesh encloses: the tolerant hull of the outlines at their sub-pixel positions.
    pub field_volume_um3: f64,
    /// Area of the field's mesh by Heron's formula, without fairing.
    pub field_area_um2: f64,
    /// Centre of mass of the faired mesh.
    pub centroid_um: [f64; 3],
    /// Extent of the faired mesh along each axis.
    pub extent_um: [f64; 3],
    /// Extent along the capillary.
    pub length_um: f64,
    /// The sphere nearest to the faired mesh's vertices, where one was asked for.
    pub sphere: Option<SphereFit>,
}

/// How a mesh was smoothed before its area was taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AreaMethod {
    /// Operator of the implicit fairing.
    pub operator: String,
    pub lambda: f64,
    pub iterations: usize,
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests {
    use super::*;
    use crate::surface::Mesh;

    /// A box with its corner at `at`, cut into twelve triangles that turn counter-clockwise seen from outside.
    fn cuboid(at: [f64; 3], sides: [f64; 3]) -> Mesh {
        let vertices = (0..8).map(|n| std::array::from_fn(|a| at[a] + sides[a] * f64::from(n >> a & 1))).collect();
        let faces: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh { vertices, triangles }
    }

    #[test]
    fn a_box_has_its_numbers_wherever_it_is() {
        for at in [[0.0; 3], [-700.0, 30.0, 1e4]] {
            let mesh = cuboid(at, [3800.0, 500.0, 400.0]);
            assert!((volume(&mesh) / 7.6e8 - 1.0).abs() < 1e-12);
            assert!((area(&mesh) / (2.0 * (3800.0 * 900.0 + 2e5)) - 1.0).abs() < 1e-12);
            let middle: [f64; 3] = std::array::from_fn(|a| at[a] + [1900.0, 250.0, 200.0][a]);
            let found = centroid(&mesh).unwrap();
            assert!((0..3).all(|a| (found[a] - middle[a]).abs() < 1e-6), "{found:?} is not {middle:?}");
            let e = extents(&mesh).unwrap();
            assert_eq!(e.min, at);
            assert_eq!(e.sides(), [3800.0, 500.0, 400.0]);
        }
        assert!(volume(&cuboid([0.0; 3], [-1.0, 1.0, 1.0])) < 0.0, "a mesh turned inside out has a negative volume");
        assert_eq!((centroid(&Mesh::default()), extents(&Mesh::default())), (None, None));
    }

    /// Kahan's needle: from the sides alone, the textbook's form of the formula loses half the digits.
    #[test]
    fn a_needle_has_the_area_of_a_needle() {
        let needle = |height: f64| Mesh { vertices: vec![[0.0; 3], [1e5, 0.0, 0.0], [5e4, height, 0.0]], triangles: vec![[0, 1, 2]] };
        // The sides are known to half an ulp of 5e4, 4e-12; the excess of two over the third is 2 h^2 / 1e5.
        for height in [10.0, 1.0, 0.1] {
            let excess = 2.0 * height * height / 1e5;
            let bound = 3.0 * 4e-12 / excess;
            let error = area(&needle(height)) / (5e4 * height) - 1.0;
            assert!(error.abs() < bound.max(1e-14), "height {height}: {error}, bound {bound}");
        }
        assert_eq!(area(&needle(0.0)), 0.0);
    }

    #[test]
    fn a_measurement_survives_being_written_down() {
        let m = Measurement {
            voxels: 3,
            voxel_size_um: 6.93,
            views: 21,
            planned_views: 21,
            epsilon: 0.05,
            volume_um3: 998.4,
            mesh_volume_um3: 990.1,
            fairing_volume_loss: 0.01,
            area_um2: 812.0,
            unfaired_area_um2: 880.0,
            area_method: AreaMethod { operator: "umbrella".into(), lambda: 0.8, iterations: 10 },
            field_volume_um3: 995.2,
            field_area_um2: 815.0,
            centroid_um: [1.0, 2.0, 3.0],
            extent_um: [4.0, 5.0, 6.0],
            length_um: 4.0,
            sphere: Some(SphereFit { diameter_um: 500.0, rms_um: 0.7, centre_um: [0.0; 3] }),
        };
        let text = serde_json::to_string(&m).unwrap();
        assert_eq!(serde_json::from_str::<Measurement>(&text).unwrap(), m);
        assert!(text.contains("\"sphere\":{\"diameter_um\":500.0"));
    }
}
