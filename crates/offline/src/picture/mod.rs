//! One picture of a specimen in its capillary: what its outline says, and reasons to doubt it.

mod blocks;
mod mosaic;

pub use blocks::too_blocky;
pub use mosaic::{UnevenGreens, step_grey, uneven_greens};

use carved_core::profile::{Detection, Polygon, Profile, ProfileQuality, SegmentSettings, Walls};
use carved_core::range::Ranged;
use serde::Serialize;

/// The numbers of a profile, as `carved segment` writes them.
#[derive(Debug, Clone, Serialize)]
pub struct ProfileReport {
    area_px: usize,
    /// Area enclosed by the sub-pixel outlines. Adding 0 turns the -0 of an empty sum into 0.
    area_px2: f64,
    /// What was detected in the picture.
    pub detection: Detection,
    quality: ProfileQuality,
    walls: Walls,
}

impl ProfileReport {
    /// The numbers of this profile.
    pub fn of(profile: &Profile) -> Self {
        Self {
            area_px: profile.mask.area_px(),
            area_px2: profile.edge.iter().map(Polygon::area_px2).sum::<f64>() + 0.0,
            detection: profile.detection,
            quality: profile.quality,
            walls: profile.walls,
        }
    }

    /// Pixels inside the mask.
    pub fn area_px(&self) -> usize {
        self.area_px
    }
}

/// The settings of a single picture. `states_faint_sure`: the user has stated this key.
pub fn of_single_picture(settings: SegmentSettings, states_faint_sure: bool) -> SegmentSettings {
    let faint_sure = if states_faint_sure { settings.faint_sure } else { SegmentSettings::of_single_picture().faint_sure };
    SegmentSettings { faint_sure, ..settings }
}

/// What is wrong with settings of the segmentation: values out of their ranges, and keys that have no effect any more.
pub fn breaches(settings: &SegmentSettings) -> Vec<String> {
    let retired = settings.retired_keys().map(|key| format!("{key} is no longer a setting and has no effect; remove it"));
    settings.outside().iter().map(ToString::to_string).chain(retired).collect()
}
