//! Features of a camera that change the picture: set to neutral values when it is opened, and read back at every arm and after
//! every turn; some of them after every frame.

use super::{AravisSettings, refused};
use crate::DeviceError;
use aravis::GcFeatureNode;
use aravis::glib::prelude::Cast;
use aravis::prelude::*;
use std::collections::BTreeMap;

/// Values of features, by their names.
pub(super) type Values = BTreeMap<String, String>;

/// Features that another program may have left, with the value at which they do not change the picture. A value in the configuration's
/// `features` comes first.
const NEUTRAL: [(&str, &str); 15] = [
    ("ExposureAuto", "Off"),
    ("GainAuto", "Off"),
    ("BlackLevelAuto", "Off"),
    ("BalanceWhiteAuto", "Off"),
    ("TestPattern", "Off"),
    ("TestImageSelector", "Off"),
    ("ReverseX", "false"),
    ("ReverseY", "false"),
    ("LUTEnable", "false"),
    ("GammaEnable", "false"),
    ("Gamma", "1"),
    ("BinningHorizontal", "1"),
    ("BinningVertical", "1"),
    ("DecimationHorizontal", "1"),
    ("DecimationVertical", "1"),
];

/// Further features that are recorded and read back.
const OTHERS: [&str; 14] = [
    "PixelFormat",
    "Width",
    "Height",
    "OffsetX",
    "OffsetY",
    "ExposureTime",
    "ExposureTimeAbs",
    "ExposureTimeRaw",
    "Gain",
    "GainRaw",
    "BlackLevel",
    "BlackLevelRaw",
    "BalanceRatioAbs",
    "BalanceRatio",
];

/// Beginnings of the names that are read after every frame.
const OF_EVERY_FRAME: [&str; 4] = ["Exposure", "Gain", "BlackLevel", "Reverse"];

/// Which features are read.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    All,
    OfEveryFrame,
}

/// A feature. `None` if the camera does not have it now.
fn feature(camera: &aravis::Camera, name: &str) -> Result<Option<GcFeatureNode>, DeviceError> {
    if !camera.is_feature_available(name).map_err(|e| refused(name, &e))? {
        return Ok(None);
    }
    Ok(camera.device().and_then(|device| device.feature(name)).and_then(|node| node.downcast().ok()))
}

fn value(camera: &aravis::Camera, name: &str) -> Result<Option<String>, DeviceError> {
    let read = |node: GcFeatureNode| node.value_as_string().map(Into::into).map_err(|e| refused(name, &e));
    feature(camera, name)?.map(read).transpose()
}

/// Sets the features to neutral that the configuration does not name.
pub(super) fn set_neutral(camera: &aravis::Camera, settings: &AravisSettings) -> Result<(), DeviceError> {
    for (name, neutral) in NEUTRAL {
        if settings.features.iter().any(|(configured, _)| configured == name) {
            continue;
        }
        let Some(found) = value(camera, name)?.filter(|found| !is_same(found, neutral)) else { continue };
        tracing::warn!(name, found, neutral, "another program left a feature of the camera; it is set");
        let set = feature(camera, name)?.map(|node| node.set_value_from_string(neutral));
        let after = value(camera, name)?;
        if after.as_ref().is_some_and(|after| !is_same(after, neutral)) {
            let why = match set {
                Some(Err(error)) => error.message().to_owned(),
                _ => "it keeps its value".to_owned(),
            };
            let rule = format!(
                "the camera does not take {neutral} ({why}); set it by the camera maker's program, or name the value in `features`"
            );
            return Err(DeviceError::Camera { what: format!("{name} = {found}"), why: rule });
        }
    }
    Ok(())
}

/// The values of all features that change the picture.
pub(super) fn values(camera: &aravis::Camera, settings: &AravisSettings) -> Result<Values, DeviceError> {
    let configured = settings.features.iter().map(|(name, _)| name.as_str());
    let mut values = Values::new();
    for name in NEUTRAL.iter().map(|(name, _)| *name).chain(OTHERS).chain(configured) {
        if let Some(value) = value(camera, name)? {
            values.insert(name.to_owned(), value);
        }
    }
    Ok(values)
}

/// Compares the camera with the values that it had when it was opened. Features that differ are set back.
///
/// # Errors
/// [`DeviceError::CameraChanged`] with the first difference.
pub(super) fn hold(camera: &aravis::Camera, expected: &Values, which: Which) -> Result<(), DeviceError> {
    let mut changed = None;
    for (name, value_before) in expected {
        if which == Which::OfEveryFrame && !OF_EVERY_FRAME.iter().any(|start| name.starts_with(start)) {
            continue;
        }
        let found = value(camera, name)?.unwrap_or_else(|| "not available".into());
        if is_same(&found, value_before) {
            continue;
        }
        if let Some(Err(error)) = feature(camera, name)?.map(|node| node.set_value_from_string(value_before)) {
            tracing::warn!(name, %error, "a feature of the camera was changed and could not be set back");
        }
        changed.get_or_insert_with(|| DeviceError::CameraChanged { name: name.clone(), expected: value_before.clone(), found });
    }
    changed.map_or(Ok(()), Err)
}

/// Whether two texts are the same value. Numbers may be written in several ways.
fn is_same(a: &str, b: &str) -> bool {
    match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= 1e-6 * a.abs().max(b.abs()),
        _ => a.eq_ignore_ascii_case(b),
    }
}
