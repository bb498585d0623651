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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::gate::GateSettings;
    use serde::de::DeserializeOwned;

    const SHIPPED: &str = include_str!("../../config/simulated.toml");

    /// What stands commented out below a table's name.
    fn shipped<T: DeserializeOwned>(table: &str) -> T {
        let (_, block) = SHIPPED.split_once(&format!("# [methods.standard.{table}]")).unwrap();
        let keys: String = block.lines().skip(1).take_while(|l| !l.starts_with("# [")).map(|l| format!("{}\n", &l[2..])).collect();
        toml::from_str(&keys).unwrap()
    }

    #[test]
    fn the_defaults_are_those_that_the_shipped_file_names() {
        assert_eq!(shipped::<QualitySettings>("quality"), QualitySettings::default());
        assert_eq!(shipped::<GateSettings>("quality.gate"), GateSettings::default());
        assert_eq!(shipped::<EarlyStopSettings>("early_stop"), EarlyStopSettings::default());
        let breaches = [QualitySettings::default().check(), GateSettings::default().check(), EarlyStopSettings::default().check()];
        assert!(breaches.iter().all(Vec::is_empty), "{breaches:?}");
    }

    #[test]
    fn a_version_is_a_word_or_a_number_and_is_recorded() {
        let method = |line: &str| -> Result<Method, toml::de::Error> {
            toml::from_str(&format!("{line}\nasd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 10.0\n"))
        };
        let version = |line: &str| method(line).unwrap().version;
        assert_eq!((version("version = 3"), version("version = \"b-2\""), version("")), (Some("3".into()), Some("b-2".into()), None));
        assert!(method("version = [1]").is_err());
        let recorded = serde_json::to_string(&method("version = 3").unwrap()).unwrap();
        assert!(recorded.contains("\"version\":\"3\""), "{recorded}");
        assert_eq!(serde_json::from_str::<Method>(&recorded).unwrap().version.as_deref(), Some("3"));
    }

    #[test]
    fn a_sequential_turn_does_not_end_early_and_limits_have_ranges() {
        let config = |change: &str| {
            let text = SHIPPED.replacen("[methods.standard]\n", &format!("[methods.standard]\n{change}\n"), 1);
            crate::config::Config::parse(&text, std::path::Path::new("x.toml")).map(|_| ()).map_err(|e| e.to_string())
        };
        assert_eq!(config("quality = { residual_px = 2.0 }"), Ok(()));
        let refused = config("early_stop = { enabled = true, min_views = 2 }").unwrap_err();
        assert!(
            refused.contains("early_stop.enabled = true, with order = \"sequential\"") && refused.contains("min_views = 2"),
            "{refused}"
        );
        let refused = config("quality = { closure_turn_deg = -1.0, gate = { beads_least = 2 } }").unwrap_err();
        assert!(refused.contains("quality.closure_turn_deg = -1") && refused.contains("quality.gate.beads_least = 2"), "{refused}");
    }
}
