//! The numbers of a model that are stored for a specimen.
//!
//! ```text
//!  Carver ── voxels x SD^3 ───────────────────────────── volume_um3                          the paper's
//!  Mesh of the voxels, faired
//!                ├─ signed tetrahedra ────────────────── mesh_volume_um3, centroid_um
//!                ├─ Heron's formula over its triangles ─ area_um2                            the paper's
//!                ├─ extents ──────────────────────────── length_um along the capillary
//!                └─ least-squares sphere ─────────────── sphere (beads)
//!  Mesh of the field, as it is ───────────────────────── field_volume_um3, field_area_um2    of the outlines
//!  Support functions of the slices ────────────────────── estimators.support                 of the outlines, no voxels
//! ```
//! `volume_um3` and `area_um2` are those of the estimator that is trusted, which `estimator` names. All estimators stand side
//! by side in `estimators`. The area depends by up to a tenth on how the mesh was smoothed, so [`Measurement`] states operator,
//! weight and number of iterations.

pub mod facing;
mod fallback;
pub mod fluorescence;
pub mod references;
pub mod shape;
mod solid;
mod sphere;
pub mod support;

pub use fallback::Fallback;
pub use solid::{Extents, area, centroid, extents, volume};
pub use sphere::{SphereError, SphereFit, fit_sphere};
use support::SupportEstimate;

use serde::{Deserialize, Serialize};

/// The numbers of one model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// Estimator of `volume_um3` and `area_um2`.
    pub estimator: Estimator,
    /// Why the estimator is not that of the support functions, in words. `None` where it is.
    pub fallback: Option<String>,
    /// Volume by the trusted estimator.
    pub volume_um3: f64,
    /// Standard deviation of `volume_um3`; `spread` has its parts. `None` where there are no slices, or where the part of the
    /// calibration is not known.
    pub volume_sd_um3: Option<f64>,
    /// Volume that the faired mesh encloses.
    pub mesh_volume_um3: f64,
    /// Share of the unfaired mesh's volume that fairing took away.
    pub fairing_volume_loss: f64,
    /// Area by the trusted estimator.
    pub area_um2: f64,
    /// Standard deviation of `area_um2`. `None` as for the volume.
    pub area_sd_um2: Option<f64>,
    /// The parts of the standard deviations. `None` if the standard deviations are `None`.
    pub spread: Option<Spread>,
    /// Each estimator's numbers.
    pub estimators: Estimators,
    /// Area of the mesh before fairing.
    pub unfaired_area_um2: f64,
    /// How the surface of the voxels was faired before its area was taken.
    pub area_method: AreaMethod,
    /// Volume that the field's mesh encloses: the hull with tolerance, from the outlines at their sub-pixel positions.
    pub field_volume_um3: f64,
    /// Area of the field's mesh by Heron's formula, without fairing.
    pub field_area_um2: f64,
    /// Centre of mass of the faired mesh.
    pub centroid_um: [f64; 3],
    /// Extent of the faired mesh along each axis.
    pub extent_um: [f64; 3],
    /// Extent along the capillary. Of a turn of a larva that did not move it is that of the silhouettes: an end is where one view in 21 shows
    /// it, at least two of four or more. Otherwise it is that of the faired mesh.
    pub length_um: f64,
    /// The sphere nearest to the vertices of the faired mesh. `None` where none was requested.
    pub sphere: Option<SphereFit>,
    /// Diameter of the sphere nearest to the surface of the trusted estimator. `None` where none was requested.
    pub diameter_um: Option<f64>,
    /// Root mean square distance of that surface from the sphere. `None` where none was requested.
    pub sphere_rms_um: Option<f64>,
    /// Extent of a bead along the capillary over its extent across. 1 where `kx` and `ky` are right. `None` where no sphere was
    /// requested.
    pub aspect_ratio: Option<f64>,
}

impl Measurement {
    /// Whether the specimen may have fins that the views together do not show.
    pub fn misses_fins(&self) -> bool {
        self.spread.is_some_and(|spread| spread.volume_fins_unseen_um3 > 0.0)
    }
}

/// A way from views to volume and area.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// The paper's: voxels are counted, and Heron's formula is applied to the faired surface.
    Voxel,
    /// Support functions of the slices.
    Support,
    /// The field of the hull with tolerance, with its surface at the sub-pixel outlines. The mesh and the shape are its own; `volume_um3` and
    /// `area_um2` never are.
    Field,
}

impl Estimator {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Voxel => "voxel",
            Self::Support => "support",
            Self::Field => "field",
        }
    }
}

/// The numbers of every estimator, from the same views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Estimators {
    /// The paper's estimator.
    pub voxel: VoxelEstimate,
    /// Support functions. `None` where the views have no stretch of slices in common.
    pub support: Option<SupportEstimate>,
}

/// The paper's numbers: volume = voxels x SD^3, area = Heron's formula over the faired mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VoxelEstimate {
    /// Volume.
    pub volume_um3: f64,
    /// Area.
    pub area_um2: f64,
}

/// Standard deviations by cause. Bias is not among them: what is known of it is stated with the estimators.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Spread {
    /// Volume: what another turn of the same specimen would change: a jackknife over the views, the error of the method, and the scatter of the
    /// correction for their shifts.
    pub volume_views_um3: f64,
    /// Area: the same.
    pub area_views_um2: f64,
    /// Volume: axis, roll, tilt and angles are known only to their covariance, and without a calibration only to the rig's priors.
    pub volume_calibration_um3: f64,
    /// Area: the same.
    pub area_calibration_um2: f64,
    /// Volume: the corners of fins, which too few views cannot resolve. They reduce the volume by an unknown
    /// amount.
    #[serde(default)]
    pub volume_corners_um3: f64,
    /// Area: the corners of fins, which the views do not tell from the mean radius or show less steep than they are.
    #[serde(default)]
    pub area_corners_um2: f64,
    /// Volume: all fins half a pixel too far out or in.
    #[serde(default)]
    pub volume_fins_um3: f64,
    /// Area: the same, and what fins that few views show, or none, may do to it.
    #[serde(default)]
    pub area_fins_um2: f64,
    /// Volume: what fins that no view shows may add to it. It is one-sided and no part of the standard deviation. 0 where the
    /// fins that were found are half as long as the specimen or more, and for a specimen that is too short for a larva.
    #[serde(default)]
    pub volume_fins_unseen_um3: f64,
    /// Volume: the rig's scale, three times its relative standard deviation.
    pub volume_scale_um3: f64,
    /// Area: the rig's scale, twice its relative standard deviation.
    pub area_scale_um2: f64,
    /// Volume: all edges too far out or in by the same amount.
    pub volume_edge_um3: f64,
    /// Area: the same.
    pub area_edge_um2: f64,
}

impl Spread {
    /// Standard deviation of the volume.
    pub fn volume_um3(&self) -> f64 {
        root_of_squares([self.volume_of_turn_um3(), self.volume_scale_um3, self.volume_edge_um3])
    }

    /// Standard deviation of the volume without the causes that are the same in every turn on the rig: its scale and edges.
    pub fn volume_of_turn_um3(&self) -> f64 {
        root_of_squares([self.volume_views_um3, self.volume_calibration_um3, self.volume_corners_um3, self.volume_fins_um3])
    }

    /// Standard deviation of the area.
    pub fn area_um2(&self) -> f64 {
        root_of_squares([
            self.area_views_um2,
            self.area_calibration_um2,
            self.area_corners_um2,
            self.area_fins_um2,
            self.area_scale_um2,
            self.area_edge_um2,
        ])
    }
}

fn root_of_squares<const N: usize>(parts: [f64; N]) -> f64 {
    parts.iter().map(|p| p * p).sum::<f64>().sqrt()
}

/// How a mesh was faired before its area was taken.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AreaMethod {
    /// Operator of the implicit fairing.
    pub operator: String,
    /// Weight of the operator.
    pub lambda: f64,
    /// Number of iterations.
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
            estimator: Estimator::Voxel,
            fallback: Some("few".into()),
            volume_um3: 998.4,
            volume_sd_um3: Some(9.8),
            mesh_volume_um3: 990.1,
            fairing_volume_loss: 0.01,
            area_um2: 812.0,
            area_sd_um2: None,
            spread: None,
            estimators: Estimators { voxel: VoxelEstimate { volume_um3: 998.4, area_um2: 812.0 }, support: None },
            unfaired_area_um2: 880.0,
            area_method: AreaMethod { operator: "umbrella".into(), lambda: 0.8, iterations: 10 },
            field_volume_um3: 995.2,
            field_area_um2: 815.0,
            centroid_um: [1.0, 2.0, 3.0],
            extent_um: [4.0, 5.0, 6.0],
            length_um: 4.0,
            sphere: Some(SphereFit { diameter_um: 500.0, rms_um: 0.7, centre_um: [0.0; 3] }),
            diameter_um: Some(500.0),
            sphere_rms_um: Some(0.7),
            aspect_ratio: Some(1.0),
        };
        let text = serde_json::to_string(&m).unwrap();
        assert_eq!(serde_json::from_str::<Measurement>(&text).unwrap(), m);
        assert!(text.contains("\"sphere\":{\"diameter_um\":500.0"));
    }
}
