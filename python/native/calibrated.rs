//! Silhouettes of a turn to psi.

use super::arrays::Pixels;
use super::errors::{camera, input, of_calibrate, report};
use super::{measured, task};
use carved_core::calibration::Ask;
use carved_core::geometry::{BoxUm, VoxelGrid};
use carved_offline::calibrate::{CalibratedTurn, Objective, Search, Turn, least_squares};
use carved_offline::silhouettes::Psi;
use pyo3::prelude::*;

/// Report, camera, angles, shifts, doubts.
type Calibrated = (String, String, Vec<f64>, Vec<f64>, Vec<String>);

#[pyfunction]
#[pyo3(signature = (silhouettes, names, angles, camera_json, objective, free, epsilon, voxel_um, evaluations))]
#[allow(clippy::too_many_arguments, reason = "as the Python side calls it")]
pub fn calibrate(
    py: Python<'_>,
    silhouettes: Vec<Pixels<'_>>,
    names: Vec<String>,
    angles: Vec<f64>,
    camera_json: &str,
    objective: &str,
    free: Vec<String>,
    epsilon: f64,
    voxel_um: f64,
    evaluations: usize,
) -> PyResult<Calibrated> {
    let psi = Psi { camera: camera(camera_json)?, omega: angles };
    let free = free.iter().map(|name| name.parse::<Ask>().map_err(input)).collect::<PyResult<Vec<_>>>()?;
    let objective = match objective {
        "vrv" => Some(Objective::Vrv { grid: VoxelGrid::new(BoxUm::PAPER, voxel_um).map_err(input)?, epsilon }),
        "coherence" => Some(Objective::Coherence),
        _ => None,
    };
    let search = objective.map(|objective| Search::new(&free, objective, evaluations)).transpose().map_err(of_calibrate)?;
    let views = measured::views(py, &silhouettes, &names)?;
    let work = |_: &task::Steps| {
        let turn = Turn::new(psi, views)?;
        match &search {
            Some(search) => search.run(&turn),
            None => least_squares(&turn),
        }
    };
    let CalibratedTurn { psi, report: found, doubts } = task::run(py, None, 0, work)?.map_err(of_calibrate)?;
    let json = serde_json::to_string_pretty(&found).map_err(report)?;
    let camera = serde_json::to_string(&psi.camera).map_err(report)?;
    Ok((json, camera, psi.omega, psi.dy_px, doubts))
}
