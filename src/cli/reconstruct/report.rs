//! The JSON object that `carved reconstruct` prints.

use super::Unit;
use super::views::View;
use crate::geometry::Projection;
use crate::measure::Measurement;
use crate::reconstruction::HullModel;
use crate::surface;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::path::Path;

const OVERLAP_RULE: &str = "intersection over union of the view's mask (inside = 128 or more) and the image of the hull's \
    surface before fairing; a pixel of that image is inside where its centre lies in the projection of a triangle";

/// Overlap of each view's mask with the hull seen through its own projection.
pub(super) fn overlaps(hull: &HullModel, views: &[View], projections: &[Projection]) -> Vec<f64> {
    let mesh = hull.unfaired_mesh();
    views
        .par_iter()
        .zip(projections)
        .map(|(view, projection)| view.mask.iou(&surface::silhouette(&mesh, projection, view.mask.width(), view.mask.height())))
        .collect()
}

/// Mean overlap below which views do not show one body: profiles of a good recording reach 0.94 to 0.97.
const OVERLAP_LEAST: f64 = 0.9;

/// What makes the numbers doubtful, in plain words.
pub(super) fn doubts(hull: &HullModel, overlaps: &[f64]) -> Vec<String> {
    let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
    let low = (mean < OVERLAP_LEAST).then(|| {
        format!(
            "warning: the hull's images overlap the masks by {mean:.2} in the mean, {OVERLAP_LEAST} and more is usual. Masks (inside = 255), angles (rad), \
             cameras or the order of the files do not fit each other"
        )
    });
    let cut = hull.touches_box().then(|| "warning: the hull reaches the end of the box, and may go on outside: widen --box".to_owned());
    low.into_iter().chain(cut).collect()
}

pub(super) fn report(
    hull: &HullModel,
    measurement: &Measurement,
    views: &[View],
    overlaps: &[f64],
    unit: Unit,
    mesh: &Path,
) -> anyhow::Result<Value> {
    let grid = hull.carver().grid();
    let counts = grid.counts();
    let mut report = match serde_json::to_value(measurement)? {
        Value::Object(map) => map,
        other => anyhow::bail!("a measurement is an object, found {other}"),
    };
    // The list of views has their number.
    report.remove("views");
    report.insert("unit".into(), json!(unit.name()));
    let lo: [f64; 3] = std::array::from_fn(|a| grid.centre(a, 0) - grid.size() / 2.0);
    let hi: [f64; 3] = std::array::from_fn(|a| grid.centre(a, counts[a] - 1) + grid.size() / 2.0);
    report.insert("grid".into(), json!({"counts": counts, "min_um": lo, "max_um": hi, "voxel_size_um": grid.size()}));
    report.insert("miss_budget".into(), json!(hull.carver().budget()));
    report.insert("touches_box".into(), json!(hull.touches_box()));
    let listed: Vec<Value> = views.iter().zip(overlaps).map(|(view, overlap)| json!({"name": view.name(), "overlap": overlap})).collect();
    report.insert("views".into(), json!(listed));
    report.insert("overlap_mean".into(), json!(overlaps.iter().sum::<f64>() / overlaps.len() as f64));
    report.insert("overlap_rule".into(), json!(OVERLAP_RULE));
    report.insert("mesh".into(), json!(mesh));
    let report = Value::Object(report);
    Ok(if unit == Unit::None { without_unit(report) } else { report })
}

/// Takes the unit from every key: `area_um2` becomes `area`.
fn without_unit(value: Value) -> Value {
    let bare = |key: String| ["_um3", "_um2", "_um"].iter().find_map(|s| key.strip_suffix(s).map(String::from)).unwrap_or(key);
    match value {
        Value::Object(map) => Value::Object(map.into_iter().map(|(k, v)| (bare(k), without_unit(v))).collect::<Map<_, _>>()),
        Value::Array(list) => Value::Array(list.into_iter().map(without_unit).collect()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_lose_their_unit_at_every_depth_and_nothing_else() {
        let with = json!({"area_um2": 1, "grid": {"min_um": [1, {"volume_um3": 2}]}, "voxels": 3, "unfaired_area_um2": 4});
        assert_eq!(without_unit(with), json!({"area": 1, "grid": {"min": [1, {"volume": 2}]}, "voxels": 3, "unfaired_area": 4}));
    }
}
