//! One frame to its profile.

use super::arrays::{Memory, Picture, Pixels, rows, view};
use super::errors::{input, of_profile, report, settings};
use super::task;
use carved_core::profile::{EmptyCapillary, Picture as Colours, Profile, ProfileError, SegmentSettings, Segmenter};
use carved_offline::picture::{ProfileReport, breaches, of_single_picture, step_grey, too_blocky};
use numpy::{PyArray1, PyArray2, PyArrayDyn};
use pyo3::prelude::*;

/// A profile in arrays.
#[pyclass(frozen, get_all)]
pub struct NativeProfile {
    mask: Py<PyArrayDyn<u8>>,
    outlines: Vec<Py<PyArray2<f64>>>,
    body: Vec<Py<PyArray2<f64>>>,
    contrast: Vec<Py<PyArray1<f64>>>,
    error_px: Vec<Py<PyArray1<f64>>>,
    bounded: Vec<Py<PyArray1<bool>>>,
    json: String,
    /// Ratio of the steps between the blocks of a lossy compression to those inside them, if it is too large.
    blocks: Option<f64>,
    /// Grey values by which the pixels of a mosaic differ, if the picture looks like one.
    mosaic: Option<f64>,
}

/// The settings of the segmentation, checked.
fn checked(json: &str) -> PyResult<SegmentSettings> {
    let found: SegmentSettings = serde_json::from_str(json).map_err(settings("settings"))?;
    let keys: serde_json::Map<String, serde_json::Value> = serde_json::from_str(json).map_err(settings("settings"))?;
    let found = of_single_picture(found, keys.contains_key("faint_sure"));
    let wrong = breaches(&found);
    if wrong.is_empty() { Ok(found) } else { Err(input(format!("settings: {}", wrong.join("; ")))) }
}

#[pyfunction]
#[pyo3(signature = (image, bayer, settings, empty))]
pub fn segment(
    py: Python<'_>,
    image: Pixels<'_>,
    bayer: Option<&str>,
    settings: &str,
    empty: Option<Pixels<'_>>,
) -> PyResult<NativeProfile> {
    let settings = checked(settings)?;
    let picture = Picture::of(&image, bayer)?;
    let empty = empty.as_ref().map(|pixels| Picture::of(pixels, bayer)).transpose()?;
    let work = |_: &task::Steps| -> Result<(Profile, Option<f64>, Option<f64>), Wrong> {
        let mosaic = picture.grey().and_then(|(pixels, width)| step_grey(pixels, width));
        let colours = Colours::from_frame(&picture.frame()?);
        let empty = match empty {
            Some(picture) => Some(EmptyCapillary::new(Colours::from_frame(&picture.frame()?), &settings.walls)?),
            None => None,
        };
        let profile = Segmenter::default().segment(&colours, &settings, empty.as_ref())?;
        Ok((profile, too_blocky(&colours.planes()[1], colours.width()), mosaic))
    };
    let (profile, blocks, mosaic) = task::run(py, None, 0, work)?.map_err(|wrong| match wrong {
        Wrong::Size(error) => input(error),
        Wrong::Profile(error) => of_profile(error),
    })?;
    let json = serde_json::to_string_pretty(&ProfileReport::of(&profile)).map_err(report)?;
    let Profile { mask, edge, body, edge_points, .. } = profile;
    let mut arrays = NativeProfile {
        mask: view(py, Memory::Mask(mask))?,
        outlines: edge.into_iter().map(|polygon| rows(py, polygon.vertices)).collect::<PyResult<_>>()?,
        body: body.into_iter().map(|polygon| rows(py, polygon.vertices)).collect::<PyResult<_>>()?,
        contrast: Vec::new(),
        error_px: Vec::new(),
        bounded: Vec::new(),
        json,
        blocks,
        mosaic,
    };
    for points in edge_points {
        arrays.contrast.push(PyArray1::from_iter(py, points.iter().map(|p| p.contrast)).unbind());
        arrays.error_px.push(PyArray1::from_iter(py, points.iter().map(|p| p.error_px)).unbind());
        arrays.bounded.push(PyArray1::from_iter(py, points.iter().map(|p| p.bounded)).unbind());
    }
    Ok(arrays)
}

/// Why there is no profile.
enum Wrong {
    Size(carved_core::frame::WrongFrameSize),
    Profile(ProfileError),
}

impl From<carved_core::frame::WrongFrameSize> for Wrong {
    fn from(error: carved_core::frame::WrongFrameSize) -> Self {
        Self::Size(error)
    }
}

impl From<ProfileError> for Wrong {
    fn from(error: ProfileError) -> Self {
        Self::Profile(error)
    }
}
