//! The JSON object that `carved reconstruct` prints.

use super::measured::Measured;
use super::{Cameras, Unit, View};
use carved_core::geometry::VoxelGrid;
use carved_core::statistics::mean;
use serde_json::{Map, Value, json};
use std::path::Path;

const OVERLAP_RULE: &str = "intersection over union of the view's mask (inside = 128 or more) and the image of the hull's \
    surface before fairing; a pixel of that image is inside where its centre lies in the projection of a triangle";

pub(super) fn report(
    measured: &Measured,
    views: &[View],
    cameras: &Cameras,
    grid: &VoxelGrid,
    mesh: Option<&Path>,
    timing_ms: Map<String, Value>,
) -> Result<Value, serde_json::Error> {
    let counts = grid.counts();
    let mut report = match &measured.measurement {
        Some(measurement) => serde_json::from_value(serde_json::to_value(measurement)?)?,
        None => nothing(),
    };
    // The list of views shows their number.
    report.remove("views");
    let lo: [f64; 3] = std::array::from_fn(|a| grid.centre(a, 0) - grid.size() / 2.0);
    let hi: [f64; 3] = std::array::from_fn(|a| grid.centre(a, counts[a] - 1) + grid.size() / 2.0);
    report.insert("grid".into(), json!({"counts": counts, "min_um": lo, "max_um": hi, "voxel_size_um": grid.size()}));
    report.insert("miss_budget".into(), json!(measured.budget));
    report.insert("touches_box".into(), json!(measured.touches_box));
    let listed: Vec<Value> = views
        .iter()
        .zip(&measured.views)
        .enumerate()
        .map(|(index, (view, judged))| {
            json!({"index": index, "name": view.name, "used": judged.used, "reason": judged.reason, "dy_px": judged.dy_px,
                   "residual_px": judged.residual_px, "overlap": judged.overlap})
        })
        .collect();
    report.insert("fins".into(), json!(measured.fins));
    report.insert("views".into(), json!(listed));
    let overlaps: Vec<f64> = measured.views.iter().filter(|v| v.used).filter_map(|v| v.overlap).collect();
    report.insert("overlap_mean".into(), json!((!overlaps.is_empty()).then(|| mean(&overlaps))));
    report.insert("overlap_rule".into(), json!(OVERLAP_RULE));
    if let Some((camera, omega)) = &measured.psi {
        let mut psi = serde_json::to_value(camera)?;
        psi["omega"] = json!(omega);
        report.insert("psi".into(), psi);
        let sd = measured.calibration.as_ref();
        report.insert(
            "psi_sd".into(),
            json!({"uy": sd.map(|c| c.sd.uy_px), "gamma": sd.map(|c| c.sd.gamma_rad), "alpha": sd.map(|c| c.sd.alpha_rad)}),
        );
        report.insert("rho".into(), json!(sd.map(|c| c.rho)));
        report.insert("rho_sd".into(), json!(sd.map(|c| c.sd.rho)));
        report.insert("passes".into(), json!(sd.map(|c| c.passes)));
        report.insert("residual_sd_um".into(), json!(sd.map(|c| c.residual_sd_um)));
        report.insert("vrv".into(), json!(measured.vrv));
        report.insert("moved".into(), json!(sd.and_then(|c| c.moved)));
    }
    report.insert("cameras".into(), json!(cameras.count().1));
    report.insert("flags".into(), json!(measured.flags));
    let warnings: Vec<&str> = measured.doubts.iter().map(|doubt| doubt.strip_prefix("warning: ").unwrap_or(doubt)).collect();
    report.insert("warnings".into(), json!(warnings));
    report.insert("turn_findings".into(), json!(measured.turn_findings));
    if !measured.turn_findings.is_empty() {
        // What was computed stays in `estimators`.
        for key in ["volume_um3", "volume_sd_um3", "area_um2", "area_sd_um2"] {
            report.insert(key.into(), Value::Null);
        }
    }
    report.insert("mesh".into(), json!(mesh));
    report.insert("timing_ms".into(), Value::Object(timing_ms));
    Ok(Value::Object(report))
}

/// The report with the name of the world's unit. Without a unit the keys have none either.
pub(super) fn in_unit(mut report: Value, unit: Unit) -> Value {
    report["unit"] = json!(unit.name());
    if unit == Unit::None { without_unit(report) } else { report }
}

/// The numbers of an empty capillary.
fn nothing() -> Map<String, Value> {
    let zero = ["voxels", "volume_um3", "volume_sd_um3", "area_um2", "area_sd_um2"].map(|key| (key.to_owned(), json!(0)));
    let mut map: Map<String, Value> = zero.into_iter().collect();
    map.insert("estimator".into(), json!("voxel"));
    map.insert("estimators".into(), json!({"voxel": {"volume_um3": 0, "area_um2": 0}, "support": null}));
    map
}

/// Removes the unit from every key: `area_um2` becomes `area`.
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
