//! A method: what is done to a specimen and how it is measured. It is recorded whole with every specimen.

use super::Policy;
use crate::acquisition::ViewOrder;
use crate::geometry::{BoxUm, Camera, GridError, VoxelGrid};
use crate::pipeline::PipelineSettings;
use crate::profile::SegmentSettings;
use crate::quality::{EarlyStopSettings, QualitySettings};
use crate::reconstruction::{CalibrationSettings, ReconstructionSettings, SurfaceSettings};
use serde::{Deserialize, Deserializer, Serialize};

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

fn papers_box() -> BoxUm {
    BoxUm::PAPER
}

impl Method {
    /// What the numbers depend on, with the rig's camera and a sphere fitted or not.
    pub fn pipeline(&self, camera: &Camera, sphere: bool) -> Result<PipelineSettings, GridError> {
        Ok(PipelineSettings {
            camera: camera.clone(),
            grid: VoxelGrid::new(self.box_um, self.voxel_um)?,
            planned_views: self.asd,
            segment: self.segment.clone(),
            reference: None,
            reconstruction: ReconstructionSettings { epsilon: self.epsilon, surface: self.surface, calibration: self.calibration },
            quality: self.quality,
            sphere,
        })
    }
}
