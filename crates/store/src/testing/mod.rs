//! Test helpers of the store: a recording of a small specimen, and a disk whose operations can be traced and refused.

#![allow(clippy::unwrap_used, reason = "the values are constants")]

pub mod trace;

use crate::Recording;
use carved_records::{Mode, PlannedWell};

/// A method with three views.
pub fn method() -> carved_records::Method {
    serde_json::from_str(r#"{"asd": 3, "order": "sequential", "epsilon": 0.05, "voxel_um": 20.0}"#).unwrap()
}

/// The record of a specimen whose views are 16 x 16 px.
pub fn recording(run: &str, specimen: &PlannedWell) -> Recording {
    let rig = serde_json::json!({
        "name": "rig", "pixel_format": "Mono8", "steps_per_revolution": [500, 1], "sense": 1,
        "camera": {"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16},
        "rotation_identity": "axis", "camera_identity": "camera"
    });
    Recording::new(run, specimen.clone(), Mode::Simulated, serde_json::from_value(rig).unwrap(), "m", method())
}
