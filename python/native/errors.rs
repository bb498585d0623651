//! Errors as exceptions. The message is that of the typed error.

use carved_core::geometry::Camera;
use carved_core::pipeline::PipelineError;
use carved_core::profile::ProfileError;
use carved_core::reconstruction::ReconstructionError;
use carved_offline::calibrate::CalibrateError;
use carved_offline::recording::NumbersError;
use carved_offline::silhouettes::SilhouettesError;
use carved_store::StoreError;
use pyo3::{PyErr, PyResult, import_exception};
use serde_json::Error as JsonError;

import_exception!(carved._errors, InputError);
import_exception!(carved._errors, MeasureError);
import_exception!(carved._errors, RecordingError);
import_exception!(carved._errors, SegmentError);

/// An argument is wrong.
pub fn input(error: impl ToString) -> PyErr {
    InputError::new_err(error.to_string())
}

/// A setting has the wrong form.
pub fn settings(what: &str) -> impl Fn(JsonError) -> PyErr + '_ {
    move |error| input(format!("{what}: {error}"))
}

/// A report cannot be written as JSON.
pub fn report(error: JsonError) -> PyErr {
    MeasureError::new_err(error.to_string())
}

pub fn of_store(error: StoreError) -> PyErr {
    RecordingError::new_err(error.to_string())
}

pub fn of_profile(error: ProfileError) -> PyErr {
    SegmentError::new_err(error.to_string())
}

pub fn of_pipeline(error: PipelineError) -> PyErr {
    match error {
        PipelineError::Reconstruction(error) => of_reconstruction(error),
        error if error.is_of_setup() => input(error),
        error => MeasureError::new_err(error.to_string()),
    }
}

/// The views give no model, or an argument is wrong.
fn of_reconstruction(error: ReconstructionError) -> PyErr {
    match error {
        ReconstructionError::NoViews { .. }
        | ReconstructionError::EmptyHull { .. }
        | ReconstructionError::Contour(_)
        | ReconstructionError::Fairing(_)
        | ReconstructionError::Sphere(_) => MeasureError::new_err(error.to_string()),
        error => input(error),
    }
}

pub fn of_numbers(error: NumbersError) -> PyErr {
    match error {
        NumbersError::Store(error) => of_store(error),
        NumbersError::Pipeline(error) => of_pipeline(error),
        NumbersError::Subset(error) => input(error),
        NumbersError::Stopped(error) => MeasureError::new_err(error.to_string()),
    }
}

pub fn of_silhouettes(error: SilhouettesError) -> PyErr {
    match error {
        SilhouettesError::Refused(_) | SilhouettesError::Stopped(_) => MeasureError::new_err(error.to_string()),
        SilhouettesError::Reconstruction(error) => of_reconstruction(error),
        error => input(error),
    }
}

pub fn of_calibrate(error: CalibrateError) -> PyErr {
    match error {
        CalibrateError::Calibration(_) | CalibrateError::Nothing(_) | CalibrateError::Blank { .. } => {
            MeasureError::new_err(error.to_string())
        }
        error => input(error),
    }
}

/// The camera of `camera.json`, checked.
pub fn camera(json: &str) -> PyResult<Camera> {
    let camera: Camera = serde_json::from_str(json).map_err(settings("camera"))?;
    camera.check().map_err(input)?;
    Ok(camera)
}
