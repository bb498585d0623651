//! A method: what is done to a specimen and how it is measured. It is recorded whole with every specimen.

use crate::{Policy, Versioned};
use carved_core::geometry::{BoxUm, Camera, GridError, VoxelGrid};
use carved_core::pipeline::PipelineSettings;
use carved_core::profile::SegmentSettings;
use carved_core::quality::{EarlyStopSettings, QualitySettings};
use carved_core::reconstruction::{CalibrationSettings, ReconstructionSettings, SurfaceSettings};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt::Display;

/// The order in which the views of a revolution are taken. The result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewOrder {
    /// Once around, the shortest way.
    #[default]
    Sequential,
    /// Halves, then quarters, then eighths of the turn, and so on. The live model shows its shape after a few views, but the axis turns
    /// further.
    CoarseToFine,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// What the lab calls this state of the method: a word or a number. It is recorded with the method and its numbers.
    #[serde(default, deserialize_with = "word_or_number", skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// ASD: axial views in one revolution.
    pub asd: u32,
    /// In which order the stops are visited.
    pub order: ViewOrder,
    /// Share of the views that may miss a voxel that still counts (paper: 0.05).
    pub epsilon: f64,
    /// SD: edge of a voxel, um.
    pub voxel_um: f64,
    /// The reconstructed box, um.
    #[serde(default = "papers_box")]
    pub box_um: BoxUm,
    #[serde(default)]
    pub segment: SegmentSettings,
    #[serde(default)]
    pub surface: SurfaceSettings,
    #[serde(default)]
    pub calibration: CalibrationSettings,
    /// How long a phase may take, what is tried again and how an interrupted run goes on.
    #[serde(default)]
    pub policy: Policy,
    /// What is over one of these limits is flagged.
    #[serde(default)]
    pub quality: QualitySettings,
    #[serde(default)]
    pub early_stop: EarlyStopSettings,
}

/// The breaches of a table below the method's.
fn below(table: &str, breaches: Vec<impl Display>) -> impl Iterator<Item = String> {
    breaches.into_iter().map(move |breach| format!("{table}.{breach}"))
}

fn word_or_number<'de, D: Deserializer<'de>>(found: D) -> Result<Option<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Version {
        Word(String),
        Number(u64),
    }
    Ok(Option::<Version>::deserialize(found)?.map(|version| match version {
        Version::Word(word) => word,
        Version::Number(number) => number.to_string(),
    }))
}

/// A camera that the reconstructed box reaches while it turns.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "distance_um = {distance_um}; expected more than {needed_um:.0} um: the method's box_um reaches so far towards the camera, which must lie outside of it. \
     Correct the distance, or make the box smaller{}", in_mm(*distance_um, *needed_um)
)]
pub struct CameraTooNear {
    pub distance_um: f64,
    pub needed_um: f64,
}

/// Says what the number would be if it was meant in mm, where that is a lens' working distance.
fn in_mm(distance_um: f64, needed_um: f64) -> String {
    let is_plausible = (5.0..=2000.0).contains(&distance_um) && 1e3 * distance_um > needed_um;
    if is_plausible { format!(". If {distance_um} mm were meant, write {:.1}", 1e3 * distance_um) } else { String::new() }
}

fn papers_box() -> BoxUm {
    BoxUm::PAPER
}

impl Method {
    /// Whether a camera lies outside of the box however that is turned.
    ///
    /// # Errors
    /// Says how far away the camera is and how far it must be. A box that makes no grid is refused by [`Self::pipeline`].
    pub fn clears(&self, camera: &Camera) -> Result<(), CameraTooNear> {
        let Ok(grid) = VoxelGrid::new(self.box_um, self.voxel_um) else { return Ok(()) };
        // The box ends half a voxel beyond the outermost centres, at most a voxel's length along the line of sight.
        let lacking_um = grid.size() - camera.nearest_um(&grid);
        if lacking_um < 0.0 { Ok(()) } else { Err(CameraTooNear { distance_um: camera.f, needed_um: camera.f + lacking_um }) }
    }

    /// Every value that cannot be used, as `key = value; expected ...` below the method's table. Whether the axis can make `asd` stops is
    /// the rig's to say.
    pub fn check(&self) -> Vec<String> {
        let mut breaches = Vec::new();
        if !(0.0..0.5).contains(&self.epsilon) {
            breaches.push(format!("epsilon = {}; expected 0 up to, not including, 0.5", self.epsilon));
        }
        if let Err(e) = VoxelGrid::new(self.box_um, self.voxel_um) {
            let key = if matches!(e, GridError::Box { .. }) { "box_um".into() } else { format!("voxel_um = {}", self.voxel_um) };
            breaches.push(format!("{key}: {e}"));
        }
        breaches.extend(below("segment", self.segment.check()));
        breaches.extend(below("surface", self.surface.check()));
        breaches.extend(below("calibration", self.calibration.check()));
        breaches.extend(below("quality", self.quality.check()));
        breaches.extend(below("quality.gate", self.quality.gate.check()));
        breaches.extend(below("early_stop", self.early_stop.check()));
        breaches.extend(below("policy", self.policy.check()));
        if self.early_stop.enabled && self.order == ViewOrder::Sequential {
            breaches.push(
                "early_stop.enabled = true, with order = \"sequential\"; expected order = \"coarse_to_fine\": views one after the other leave the \
                 rest of the turn unseen"
                    .into(),
            );
        }
        breaches
    }

    /// What the numbers depend on, with the rig's camera and a sphere fitted or not.
    pub fn pipeline(&self, camera: &Camera, sphere: bool) -> Result<PipelineSettings, GridError> {
        Ok(PipelineSettings {
            camera: camera.clone(),
            grid: VoxelGrid::new(self.box_um, self.voxel_um)?,
            planned_views: self.asd,
            segment: self.segment.clone(),
            empty_capillary: None,
            reconstruction: ReconstructionSettings { epsilon: self.epsilon, surface: self.surface, calibration: self.calibration },
            quality: self.quality,
            sphere,
        })
    }
}

impl Versioned for Method {
    fn version(&self) -> Option<&str> {
        self.version.as_deref()
    }
}
