//! Frames and silhouettes of a turn to numbers.

use super::arrays::{Picture, Pixels, rows};
use super::errors::{camera, input, of_pipeline, of_silhouettes, report, settings};
use super::task::{self, Steps};
use carved_core::frame::{RawFrame, WrongFrameSize};
use carved_core::geometry::{BoxUm, Projection};
use carved_core::pipeline::{Finished, PipelineError};
use carved_core::reconstruction::{HullModel, SurfaceSettings};
use carved_core::surface::Mesh;
use carved_offline::silhouettes::{self, Cameras, Psi, Settings, SilhouettesError, Step, Unit, View as Silhouette};
use carved_offline::{Stopped, frames::View};
use carved_records::Method;
use carved_store::durable;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Numbers with the model that they come from.
#[pyclass(frozen)]
pub struct Numbers {
    /// The numbers as the commands write them.
    #[pyo3(get)]
    json: String,
    /// Reasons to doubt them, in plain words.
    #[pyo3(get)]
    doubts: Vec<String>,
    #[pyo3(get)]
    vertices: Py<PyArray2<f64>>,
    #[pyo3(get)]
    triangles: Py<PyArray2<u32>>,
    hull: Option<HullModel>,
    /// Whether the voxels are of the mirror image at x = 0.
    #[pyo3(get)]
    mirrored: bool,
}

/// Dense voxels `[z, y, x]`, the centre of the first one `(x, y, z)`, and their edge.
type Voxels = (Py<PyArray3<u8>>, [f64; 3], f64);

#[pymethods]
impl Numbers {
    /// The voxels that were counted. `None` where there is none.
    fn voxels(&self, py: Python<'_>) -> PyResult<Option<Voxels>> {
        let Some(found) = self.hull.as_ref().and_then(|hull| py.detach(|| hull.carver().voxels())) else { return Ok(None) };
        let [x, y, z] = found.counts;
        Ok(Some((PyArray1::from_vec(py, found.inside).reshape([z, y, x])?.unbind(), found.origin, found.size)))
    }
}

impl Numbers {
    pub fn new(py: Python<'_>, json: String, mesh: Mesh, hull: Option<HullModel>) -> PyResult<Self> {
        let (vertices, triangles) = (rows(py, mesh.vertices)?, rows(py, mesh.triangles)?);
        Ok(Self { json, doubts: Vec::new(), vertices, triangles, hull, mirrored: false })
    }
}

/// The text of a result as carved's files hold it.
pub fn file_text(value: &impl Serialize) -> PyResult<String> {
    let bytes = durable::json_text(Path::new("measurement.json"), value).map_err(super::errors::of_store)?;
    String::from_utf8(bytes).map_err(input)
}

/// Why frames give no numbers.
enum Wrong {
    Pipeline(PipelineError),
    Frame(WrongFrameSize),
    Stopped(Stopped),
}

impl From<PipelineError> for Wrong {
    fn from(error: PipelineError) -> Self {
        Self::Pipeline(error)
    }
}

#[pyfunction]
#[pyo3(signature = (frames, bayer, angles, closure, empty, camera_json, method, bead, progress))]
#[allow(clippy::too_many_arguments, reason = "as the Python side calls it")]
pub fn measure_frames(
    py: Python<'_>,
    frames: Vec<Pixels<'_>>,
    bayer: Option<&str>,
    angles: Vec<f64>,
    closure: Option<Pixels<'_>>,
    empty: Option<Pixels<'_>>,
    camera_json: &str,
    method: &str,
    bead: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Numbers> {
    let camera = camera(camera_json)?;
    let method: Method = serde_json::from_str(method).map_err(settings("method"))?;
    let wrong = method.check();
    if !wrong.is_empty() {
        return Err(input(wrong.join("; ")));
    }
    method.clears(&camera).map_err(input)?;
    let of_turn = frames.iter().chain(&closure);
    let pictures = of_turn.map(|pixels| Picture::of(pixels, bayer)).collect::<PyResult<Vec<_>>>()?;
    let empty = empty.as_ref().map(|pixels| Picture::of(pixels, bayer)).transpose()?;
    let mut views: Vec<View> = (0..).zip(angles).map(|(number, omega)| View { number, omega, closure: false }).collect();
    if views.len() != frames.len() {
        return Err(input(format!("{} frames and {} angles; one angle per frame is expected", frames.len(), views.len())));
    }
    views.extend(closure.is_some().then_some(View { number: views.len() as u32, omega: std::f64::consts::TAU, closure: true }));
    let work = |steps: &Steps| -> Result<Finished, Wrong> {
        let empty = empty.map(|picture| picture.frame()).transpose().map_err(Wrong::Frame)?;
        let settings = method.pipeline(&camera, bead).map_err(PipelineError::from)?.compared_with(empty.as_ref())?;
        let frame = |at: usize| -> Result<RawFrame, Wrong> { pictures[at].frame().map_err(Wrong::Frame) };
        let finished = carved_offline::frames::measure(settings, &views, false, frame, |_, _| steps.step().map_err(Wrong::Stopped))?;
        steps.step().map_err(Wrong::Stopped)?;
        Ok(finished)
    };
    let Finished { mesh, record, hull, .. } = task::run(py, progress.as_ref(), views.len() + 1, work)?.map_err(|wrong| match wrong {
        Wrong::Pipeline(error) => of_pipeline(error),
        Wrong::Frame(error) => input(error),
        Wrong::Stopped(error) => of_silhouettes(error.into()),
    })?;
    Numbers::new(py, file_text(&record)?, mesh, Some(hull))
}

/// How silhouettes are measured, as the Python side gives it.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Options {
    bounds: Option<BoxUm>,
    voxel: Option<f64>,
    /// `um` or `none`.
    unit: String,
    sphere: bool,
    calibrate: bool,
    epsilon: f64,
    surface: SurfaceSettings,
}

#[pyfunction]
#[pyo3(signature = (silhouettes, names, angles, camera_json, matrices, options, progress))]
#[allow(clippy::too_many_arguments, reason = "as the Python side calls it")]
pub fn measure_silhouettes(
    py: Python<'_>,
    silhouettes: Vec<Pixels<'_>>,
    names: Vec<String>,
    angles: Vec<f64>,
    camera_json: Option<&str>,
    matrices: Option<PyReadonlyArray3<'_, f64>>,
    options: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Numbers> {
    let Options { bounds, voxel, unit, sphere, calibrate, epsilon, surface } =
        serde_json::from_str(options).map_err(settings("settings"))?;
    let unit = if unit == "none" { Unit::None } else { Unit::Um };
    let (cameras, turntable) = match (camera_json, matrices) {
        (Some(json), _) => (Cameras::Psi(Psi { camera: camera(json)?, omega: angles }), false),
        (None, Some(matrices)) => {
            let rows = matrices.as_array();
            let matrix = |at: usize| Projection::from_matrix(std::array::from_fn(|r| std::array::from_fn(|c| rows[[at, r, c]])));
            let projections = (0..rows.shape()[0]).map(|at| matrix(at).map_err(|e| input(format!("matrix {at} (counted from 0): {e}"))));
            (Cameras::Matrices { projections: projections.collect::<PyResult<_>>()?, names: None }, calibrate)
        }
        (None, None) => return Err(input("found no camera, expected one with angles, or a matrix per view")),
    };
    let reconstruction = silhouettes::settings(epsilon, calibrate, surface);
    let settings = Settings { bounds, voxel, unit, sphere, turntable, reconstruction };
    settings.check().map_err(input)?;
    let views = views(py, &silhouettes, &names)?;
    // The views, the calibration and the numbers.
    let total = views.len() + 2;
    let work = |steps: &Steps| -> Result<_, SilhouettesError> {
        silhouettes::reconstruct(cameras, &views, &settings, &mut |step| match step {
            Step::View | Step::Calibrated | Step::Measured => steps.step(),
            Step::Checked | Step::Carved => Ok(()),
        })
    };
    let solved = task::run(py, progress.as_ref(), total, work)?.map_err(of_silhouettes)?;
    let mut json = solved.report(&views, None, serde_json::Map::new()).map_err(report)?;
    // A command has written a file and has taken time; here is neither.
    if let Some(report) = json.as_object_mut() {
        report.remove("mesh");
        report.remove("timing_ms");
    }
    let json = serde_json::to_string_pretty(&json).map_err(report)?;
    let mirrored = solved.is_mirrored();
    let measured = solved.into_measured();
    let numbers = Numbers::new(py, json, measured.mesh.unwrap_or_default(), measured.hull)?;
    Ok(Numbers { doubts: measured.doubts, mirrored, ..numbers })
}

/// Silhouettes with their names.
pub fn views(py: Python<'_>, silhouettes: &[Pixels<'_>], names: &[String]) -> PyResult<Vec<Silhouette>> {
    if names.len() != silhouettes.len() {
        return Err(input(format!("{} silhouettes and {} names; one name per silhouette is expected", silhouettes.len(), names.len())));
    }
    let pictures = silhouettes.iter().map(|pixels| Picture::of(pixels, None)).collect::<PyResult<Vec<_>>>()?;
    py.detach(|| pictures.iter().zip(names).map(|(picture, name)| picture.view(name)).collect::<Result<_, _>>()).map_err(input)
}

/// The 3 x 4 projections of a camera at these angles.
#[pyfunction]
pub fn projections<'py>(py: Python<'py>, camera_json: &str, angles: Vec<f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let camera = camera(camera_json)?;
    let rows: Vec<f64> = angles.iter().flat_map(|omega| camera.projection(*omega).rows().as_flattened().to_vec()).collect();
    PyArray1::from_vec(py, rows).reshape([angles.len(), 3, 4])
}
