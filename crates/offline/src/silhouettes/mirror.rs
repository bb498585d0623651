//! Matrices of a mirrored world: the specimen is behind every camera unless one axis is reversed.
//!
//! ```text
//!   P, depth < 0 in every view ── x -> -x ── -P, depth > 0 ── reconstructed ── mesh and positions: x -> -x again, triangles reversed
//! ```
//! The sign of a camera matrix is known only together with the handedness of its world: [`Projection`] takes right-handed worlds. Matrices
//! of a left-handed world, or of mirrored images, have a negative determinant where depths are positive. Volumes, areas and lengths are
//! those of the mirror image.

use super::measured::Measured;
use carved_core::geometry::{BoxUm, Projection, ProjectionError};
use serde_json::{Value, json};

/// Some cameras have the specimen in front of them and others behind.
#[derive(Debug, thiserror::Error)]
#[error(
    "the specimen lies {few} the camera(s) of view {views} (counted from 0) and {rest} all others: the matrices are not of one world. Check the \
     sign of the determinant of their left 3 x 3 parts, and the box"
)]
pub struct MixedWorlds {
    few: &'static str,
    rest: &'static str,
    views: String,
}

/// Whether the world is mirrored. `at` is a point of the specimen.
pub(super) fn is_mirrored(projections: &[Projection], at: [f64; 3]) -> Result<bool, MixedWorlds> {
    let behind: Vec<usize> = (0..projections.len()).filter(|&i| projections[i].depth(at) < 0.0).collect();
    if behind.is_empty() || behind.len() == projections.len() {
        return Ok(!behind.is_empty());
    }
    let (few, rest) = if 2 * behind.len() > projections.len() { ("before", "behind") } else { ("behind", "before") };
    let odd: Vec<usize> = if few == "behind" { behind } else { (0..projections.len()).filter(|i| !behind.contains(i)).collect() };
    Err(MixedWorlds { few, rest, views: odd.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ") })
}

/// The matrices for the mirrored world.
pub(super) fn projections(of: &[Projection]) -> Result<Vec<Projection>, ProjectionError> {
    let mirrored = |p: &Projection| Projection::from_matrix(p.rows().map(|[x, y, z, t]| [-x, y, z, t]));
    of.iter().map(mirrored).collect()
}

pub(super) fn bounds(of: BoxUm) -> BoxUm {
    let ([x0, y0, z0], [x1, y1, z1]) = (of.min, of.max);
    BoxUm { min: [-x1, y0, z0], max: [-x0, y1, z1] }
}

/// Converts the mesh back to the world of the matrices, with its triangles facing outwards.
pub(super) fn mesh(measured: &mut Measured) {
    let Some(mesh) = &mut measured.mesh else { return };
    mesh.vertices.iter_mut().for_each(|[x, ..]| *x = -*x);
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
}

/// Converts the positions in the report back to the world of the matrices. `along_axis`: the grid is aligned with the axis of the turn, not
/// with the world.
pub(super) fn report(mut report: Value, along_axis: bool) -> Value {
    let negated = |value: &Value| value.as_f64().map_or(Value::Null, |x| json!(-x));
    let places = ["/centroid_um", "/sphere/centre_um", "/turntable/origin", "/turntable/axes/0", "/turntable/axes/1", "/turntable/axes/2"];
    for place in places {
        if let Some(x) = report.pointer_mut(place).and_then(|at| at.get_mut(0)) {
            *x = negated(x);
        }
    }
    for fin in report["fins"].as_array_mut().into_iter().flatten() {
        for point in fin.get_mut("points_um").and_then(Value::as_array_mut).into_iter().flatten() {
            point[0] = negated(&point[0]);
        }
    }
    if !along_axis {
        let [low, high] = ["min_um", "max_um"].map(|key| negated(&report["grid"][key][0]));
        (report["grid"]["min_um"][0], report["grid"]["max_um"][0]) = (high, low);
    }
    report
}

pub(super) const SAID: &str = "the matrices are those of a mirrored world (or of mirrored images): it was mirrored at x = 0 to reconstruct it; mesh and \
                               places are in the matrices' own world, volumes and areas are the same in both";
