//! Matrices of a turn: it is measured like psi's turns and reported in the world of the matrices.
//!
//! ```text
//!  matrices, box ── Turntable ── psi, angles ── measured::turn ── mesh, positions: back into the world
//!                      │                                      └── lengths, areas, volumes: times scale, scale^2, scale^3
//!                      └── no turn: refused
//! ```

use super::measured::{self, Measured};
use super::{Psi, SilhouettesError, Step, Unit, View};
use crate::Stopped;
use carved_core::geometry::{BoxUm, NoTurn, Projection, Turntable, VoxelGrid};
use carved_core::reconstruction::ReconstructionSettings;
use serde_json::{Value, json};

/// The scale in psi's unit if the world has no unit: that of the published rig, for which the estimators are designed.
const PUBLISHED_PX_PER_UM: f64 = 1.0 / 5.5;
/// Calibration may move the axis by this distance from its place in the matrices, and the visible region grows by the same distance.
const MARGIN_PX: f64 = 20.0;

/// Finds the turn to which the matrices belong.
pub(super) fn find(projections: &[Projection], views: &[View], bounds: BoxUm, unit: Unit) -> Result<Turntable, NoTurn> {
    let sensor = views.first().map_or([0; 2], |v| [v.mask.width() as u32, v.mask.height() as u32]);
    let kx = (unit == Unit::None).then_some(PUBLISHED_PX_PER_UM);
    Turntable::of(projections, sensor, &corners(bounds), kx)
}

/// Measures the turn. Mesh and positions are in the world of the matrices.
pub(super) fn measure(
    table: &Turntable,
    views: &[View],
    bounds: BoxUm,
    voxel: f64,
    settings: ReconstructionSettings,
    sphere: bool,
    step: &mut dyn FnMut(Step) -> Result<(), Stopped>,
) -> Result<(Measured, VoxelGrid), SilhouettesError> {
    let grid = VoxelGrid::new(seen(table, views, bounds), voxel / table.frame.scale).map_err(SilhouettesError::GridAlongAxis)?;
    let psi = Psi { camera: table.camera.clone(), omega: table.omega.clone() };
    let mut measured = measured::turn(&psi, grid, views, settings, sphere, step)?;
    for vertex in measured.mesh.iter_mut().flat_map(|mesh| &mut mesh.vertices) {
        *vertex = table.frame.to_world(*vertex);
    }
    Ok((measured, grid))
}

fn corners(bounds: BoxUm) -> [[f64; 3]; 8] {
    std::array::from_fn(|i| std::array::from_fn(|a| if i >> a & 1 == 0 { bounds.min[a] } else { bounds.max[a] }))
}

/// The part of the box that can contain something: around the axis, as far as any view shows anything.
fn seen(table: &Turntable, views: &[View], bounds: BoxUm) -> BoxUm {
    let c = &table.camera;
    let around = corners(bounds).map(|corner| table.frame.from_world(corner));
    let extent = |a: usize, side: fn(f64, f64) -> f64| around.iter().map(|p| p[a]).reduce(side).unwrap_or(0.0);
    let (mut along, mut across) = ([f64::INFINITY, f64::NEG_INFINITY], 0.0_f64);
    for columns in views.iter().map(|v| &v.columns) {
        for (u, edges) in (0..columns.width()).filter_map(|u| Some((u as f64, columns.get(u)?))) {
            let x = (u - c.ux) / c.kx;
            along = [along[0].min(x), along[1].max(x)];
            let axis = c.uy + c.ky * x * c.gamma.tan();
            across = across.max((axis - edges.upper).max(edges.lower - axis) / c.ky);
        }
    }
    // A nearer body appears larger, and further from the middle.
    let wider = 1.0 + 2.0 * across / c.f;
    let radius = wider * across + MARGIN_PX / c.ky;
    let end = MARGIN_PX / c.kx;
    let limits = [[along[0] * wider - end, along[1] * wider + end], [-radius, radius], [-radius, radius]];
    BoxUm {
        min: std::array::from_fn(|a| extent(a, f64::min).max(limits[a][0].min(limits[a][1] - 2.0 * end))),
        max: std::array::from_fn(|a| extent(a, f64::max).min(limits[a][1])),
    }
}

/// The report of a turn, in the world and unit of the matrices.
pub(super) fn with_table(report: Value, table: &Turntable) -> Value {
    let frame = &table.frame;
    let mut report = scaled(report, frame.scale);
    // Positions need the offset, too. They were already scaled like lengths.
    let in_world = |value: &Value| json!(frame.to_world(std::array::from_fn(|a| value[a].as_f64().unwrap_or(f64::NAN) / frame.scale)));
    for place in ["/centroid_um", "/sphere/centre_um"] {
        if let Some(value) = report.pointer_mut(place).filter(|v| v.is_array()) {
            *value = in_world(value);
        }
    }
    for fin in report["fins"].as_array_mut().into_iter().flatten() {
        for point in fin.get_mut("points_um").and_then(Value::as_array_mut).into_iter().flatten() {
            *point = in_world(point);
        }
    }
    for (key, power) in [("f", 1), ("kx", -1), ("ky", -1)] {
        if let Some(number) = report["psi"][key].as_f64() {
            report["psi"][key] = json!(number * frame.scale.powi(power));
        }
    }
    let axes: [[f64; 3]; 3] = std::array::from_fn(|column| frame.axes.column(column).into_owned().into());
    report["turntable"] = json!({
        "origin": frame.origin, "axes": axes, "off_px": table.off_px, "axis_off_deg": table.axis_off_deg,
    });
    report
}

/// Converts every length, area and volume, recognised by its key, to the other unit.
fn scaled(value: Value, scale: f64) -> Value {
    let power = |key: &str| [("_um3", 3), ("_um2", 2), ("_um", 1)].iter().find_map(|(end, power)| key.ends_with(end).then_some(*power));
    match value {
        Value::Object(map) => map
            .into_iter()
            .map(|(k, v)| {
                let v = power(&k).map_or_else(|| scaled(v.clone(), scale), |p| times(&v, scale.powi(p)));
                (k, v)
            })
            .collect(),
        Value::Array(list) => list.into_iter().map(|v| scaled(v, scale)).collect(),
        other => other,
    }
}

fn times(value: &Value, factor: f64) -> Value {
    match value {
        Value::Number(n) => n.as_f64().map_or(Value::Null, |x| json!(x * factor)),
        Value::Array(list) => list.iter().map(|v| times(v, factor)).collect(),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_a_unit_is_scaled_by_its_power_and_nothing_else() {
        let report = json!({"a_um": 1.0, "b_um2": [1.0, null], "c": {"d_um3": 1.0, "n": 5}, "grid": [{"e_um": 2.0}]});
        assert_eq!(
            scaled(report, 0.5),
            json!({"a_um": 0.5, "b_um2": [0.25, null], "c": {"d_um3": 0.125, "n": 5}, "grid": [{"e_um": 1.0}]})
        );
    }
}
