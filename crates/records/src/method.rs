//! A method: how a specimen is taken through its turn and how it is measured. The whole method is recorded with every specimen.

use crate::{Policy, Versioned};
use carved_core::geometry::{BoxUm, Camera, GridError, VoxelGrid};
use carved_core::pipeline::PipelineSettings;
use carved_core::profile::SegmentSettings;
use carved_core::quality::{EarlyStopSettings, QualitySettings};
use carved_core::range::{OutOfRange, Range, Ranged, outside_in};
use carved_core::ranges;
use carved_core::reconstruction::{CalibrationSettings, ReconstructionSettings, SurfaceSettings};
use serde::{Deserialize, Deserializer, Serialize};

/// The order in which the views of a revolution are taken. The result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ViewOrder {
    /// Once around, the shortest way.
    #[default]
    Sequential,
    /// Halves, then quarters, then eighths of the turn, and so on. The live model shows its shape after a few views, but the axis turns
    /// further.
    CoarseToFine,
    /// In one sweep: the axis turns at a constant speed while the camera runs freely (docs/sweep.md).
    Sweep,
}

impl std::fmt::Display for ViewOrder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Sequential => "sequential",
            Self::CoarseToFine => "coarse_to_fine",
            Self::Sweep => "sweep",
        })
    }
}

/// The speed of a sweep (`order = "sweep"`). One of `frame_rate_hz` and `turn_s` may be given; without both there are 30 frames/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct SweepSettings {
    /// Frames per second. A turn takes `asd` frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// Time of a turn, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn_s: Option<f64>,
    /// Longest way of the wall of the capillary during an exposure, px of the picture. An outline moves less, and its middle stays where it
    /// is: only its blur grows.
    pub blur_px: f64,
}

impl Default for SweepSettings {
    fn default() -> Self {
        Self { frame_rate_hz: None, turn_s: None, blur_px: 1.0 }
    }
}

impl Ranged for SweepSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        frame_rate_hz: 1.0, 1000.0, "frames/s";
        turn_s: 0.1, 600.0, "s";
        blur_px: 0.01, 5.0, "px";
    ];
}

impl SweepSettings {
    /// Frames per second of a camera without other wishes.
    pub const USUAL_HZ: f64 = 30.0;

    /// Frames per second for a turn of `asd` views.
    pub fn rate_hz(&self, asd: u32) -> f64 {
        self.frame_rate_hz.or_else(|| self.turn_s.map(|turn_s| f64::from(asd) / turn_s)).unwrap_or(Self::USUAL_HZ)
    }
}

/// What is done to a specimen and how it is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// What the lab calls this state of the method: a word or a number. It is recorded with the method and its numbers.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Version>"))]
    #[serde(default, deserialize_with = "word_or_number", skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// Axial views in one revolution (ASD). More views give a better model and take longer.
    pub asd: u32,
    /// The order in which the views are taken. The result does not depend on it.
    pub order: ViewOrder,
    /// Share of the views that may miss a voxel that still counts (paper: 0.05). A larger share forgives more views with errors and makes the
    /// model larger.
    pub epsilon: f64,
    /// Edge of a voxel (SD). A smaller voxel takes more memory and time.
    pub voxel_um: f64,
    /// The reconstructed box around the axis of the capillary: x along it, y and z across it. The specimen must fit into it.
    #[serde(default = "papers_box")]
    pub box_um: BoxUm,
    /// The speed of a sweep.
    #[serde(default, skip_serializing_if = "is_usual_sweep")]
    pub sweep: SweepSettings,
    /// How the outline of the specimen is found in a frame.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    #[serde(default)]
    pub segment: SegmentSettings,
    /// How the surface is made from the voxels.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    #[serde(default)]
    pub surface: SurfaceSettings,
    /// How a turn calibrates its own camera.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    #[serde(default)]
    pub calibration: CalibrationSettings,
    /// How long a phase may take, what is tried again and how an interrupted run continues.
    #[serde(default)]
    pub policy: Policy,
    /// A specimen beyond one of these limits is flagged, never dropped (docs/quality.md).
    #[serde(default)]
    pub quality: QualitySettings,
    /// When a turn may end before its last view. It needs `order = "coarse_to_fine"`.
    #[serde(default)]
    pub early_stop: EarlyStopSettings,
}

impl Ranged for Method {
    const RANGES: &'static [Range<Self>] = ranges![
        // The number of stops is also limited by the rig's steps.
        asd: Self::LEAST_ASD as f64, 100_000.0, "views";
        epsilon: 0.0, 0.499, "of the views";
        voxel_um: 0.1, 1000.0, "um";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outside_in("box_um", &self.box_um)
            .chain(outside_in("sweep", &self.sweep))
            .chain(outside_in("segment", &self.segment))
            .chain(outside_in("surface", &self.surface))
            .chain(outside_in("calibration", &self.calibration))
            .chain(outside_in("policy", &self.policy))
            .chain(outside_in("quality", &self.quality))
            .chain(outside_in("early_stop", &self.early_stop))
            .collect()
    }
}

/// Methods without a sweep keep their files.
fn is_usual_sweep(sweep: &SweepSettings) -> bool {
    *sweep == SweepSettings::default()
}

/// What a lab calls a state of its method.
#[derive(Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
enum Version {
    Word(String),
    Number(u64),
}

fn word_or_number<'de, D: Deserializer<'de>>(found: D) -> Result<Option<String>, D::Error> {
    Ok(Option::<Version>::deserialize(found)?.map(|version| match version {
        Version::Word(word) => word,
        Version::Number(number) => number.to_string(),
    }))
}

/// The reconstructed box reaches the camera while it turns.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "distance_um = {distance_um}; expected more than {needed_um:.0} um: the method's box_um reaches so far towards the camera, which must lie outside of it. \
     Correct the distance, or make the box smaller{}", in_mm(*distance_um, *needed_um)
)]
pub struct CameraTooNear {
    pub distance_um: f64,
    pub needed_um: f64,
}

/// A hint for a distance that may be meant in mm. Empty if it is not a plausible working distance of a lens.
fn in_mm(distance_um: f64, needed_um: f64) -> String {
    let is_plausible = (5.0..=2000.0).contains(&distance_um) && 1e3 * distance_um > needed_um;
    if is_plausible { format!(". If {distance_um} mm were meant, write {:.1}", 1e3 * distance_um) } else { String::new() }
}

fn papers_box() -> BoxUm {
    BoxUm::PAPER
}

impl Method {
    /// The least number of views that enclose a volume. Views half a turn apart show the same silhouette, so two are not enough.
    pub const LEAST_ASD: u32 = 3;

    /// Checks that a camera is outside of the box at any angle of the turn.
    ///
    /// # Errors
    /// Contains the distance of the camera and the required distance. A box without a valid grid is refused by [`Self::pipeline`].
    pub fn clears(&self, camera: &Camera) -> Result<(), CameraTooNear> {
        let Ok(grid) = VoxelGrid::new(self.box_um, self.voxel_um) else { return Ok(()) };
        // The box ends half a voxel beyond the outermost centres. Along the line of sight that is at most the length of a voxel.
        let lacking_um = grid.size() - camera.nearest_um(&grid);
        if lacking_um < 0.0 { Ok(()) } else { Err(CameraTooNear { distance_um: camera.f, needed_um: camera.f + lacking_um }) }
    }

    /// All values that cannot be used, as `key = value; expected ...`. The keys are relative to the method's table. Whether the axis can
    /// make `asd` stops depends on the rig.
    pub fn check(&self) -> Vec<String> {
        let outside = self.outside();
        let mut breaches: Vec<String> = outside.iter().map(ToString::to_string).collect();
        let is_grid = !outside.iter().any(|breach| breach.key == "voxel_um" || breach.key.starts_with("box_um."));
        if is_grid && let Err(e) = VoxelGrid::new(self.box_um, self.voxel_um) {
            let key = if matches!(e, GridError::Box { .. }) { "box_um".into() } else { format!("voxel_um = {}", self.voxel_um) };
            breaches.push(format!("{key}: {e}"));
        }
        if self.early_stop.enabled && self.order != ViewOrder::CoarseToFine {
            breaches.push(format!(
                "early_stop.enabled = true, with order = \"{}\"; expected order = \"coarse_to_fine\": views one after the other leave the \
                 rest of the turn unseen",
                self.order
            ));
        }
        if let SweepSettings { frame_rate_hz: Some(rate), turn_s: Some(turn), .. } = self.sweep {
            breaches.push(format!("sweep.frame_rate_hz = {rate} and sweep.turn_s = {turn}; expected one of them: each sets the speed"));
        }
        let rate = self.sweep.rate_hz(self.asd);
        if self.order == ViewOrder::Sweep && !(1.0..=1000.0).contains(&rate) {
            breaches.push(format!("sweep.turn_s: {} views in this time are {rate:.2} frames/s; expected 1 to 1000 frames/s", self.asd));
        }
        breaches
    }

    /// The settings of the pipeline for this method and a camera. `sphere`: fit a sphere, for beads.
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
