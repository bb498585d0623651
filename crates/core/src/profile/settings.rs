//! The settings of a profile, with their ranges.
//!
//! The ranges exclude what no frame can need and what would take too long.

use crate::range::{OutOfRange, Range, Ranged, outside_in};
use crate::ranges;
use serde::{Deserialize, Serialize};

/// How walls are found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct WallSettings {
    /// Largest tilt of the capillary in the picture. Steeper lines are not taken for walls.
    pub max_tilt_deg: f64,
    /// Largest bend of a wall: depth of its ends against its middle, share of the frame's width. With 0 walls must be straight.
    pub max_sag_share: f64,
    /// Least share of the frame's width along which a wall must be visible. A smaller share finds walls in poorer pictures, and more false
    /// ones.
    pub min_support: f64,
    /// Least darkness of a wall against both its sides, grey values. A smaller value finds fainter walls, and more false ones.
    pub min_depth: f32,
    /// Reach of the search for a wall's bright sides, share of the frame's height.
    pub line_reach_share: f64,
    /// Least height of the bore, share of the frame's height.
    pub min_bore_share: f64,
    /// Greatest thickness of one wall, share of the capillary's outer diameter.
    pub max_wall_share: f64,
}

impl Default for WallSettings {
    fn default() -> Self {
        Self {
            max_tilt_deg: 2.5,
            max_sag_share: 0.005,
            min_support: 0.35,
            min_depth: 8.0,
            line_reach_share: 1.0 / 64.0,
            min_bore_share: 0.05,
            max_wall_share: 0.25,
        }
    }
}

/// How the edge is placed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct EdgeSettings {
    /// Blur of the rig's frames (optics, sensor and demosaicing) as the standard deviation of a Gaussian, px. The search for a
    /// frame's own blur starts here, and this value is used where the edges do not determine one.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "operator")))]
    pub blur_px: f64,
    /// How far outside the coarse outline the edge is searched, px.
    pub search_outside_px: f64,
    /// How far inside the coarse outline the edge is searched, px. The coarse outline errs outwards.
    pub search_inside_px: f64,
    /// Averaging along the outline before the fit, standard deviation in px. More of it lessens noise and blurs detail.
    pub along_px: f64,
    /// Smoothing of the coarse outline, which gives the normals, standard deviation in px. More of it gives smoother normals.
    pub outline_smoothing_px: f64,
    /// Smoothing of the found shifts along the outline, standard deviation in px. More of it lessens noise and blurs detail.
    pub shift_smoothing_px: f64,
    /// Cost of a kink in the edge, per squared px of difference between neighbouring shifts. A larger cost gives a smoother edge.
    pub stiffness: f64,
}

impl Default for EdgeSettings {
    fn default() -> Self {
        Self {
            blur_px: 1.1,
            search_outside_px: 3.5,
            search_inside_px: 6.5,
            along_px: 1.5,
            outline_smoothing_px: 2.0,
            shift_smoothing_px: 1.0,
            stiffness: 1.0,
        }
    }
}

/// How the specimen is separated from the empty bore, before its edge is placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(rename = "SegmentMethod"))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The level set, and what is faint around it: for measurements.
    #[default]
    Hybrid,
    /// Level set alone: compact and sharp, leaks where the larva is transparent.
    LevelSet,
}

/// The level set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct LevelSetSettings {
    /// The level between background and body, as a share of the body's typical contrast. A smaller share gives a larger outline.
    pub level_share: f64,
    /// Least level between background and body, standard deviations of a block's noise. High contrast counts by its logarithm.
    pub least_sigma: f64,
    /// Weight of the region term, which moves the front to the level between background and body.
    pub region: f64,
    /// Weight of the edge term, which pulls the front to the nearest edge.
    pub edge: f64,
    /// Greatest number of steps of the front. It stops earlier where it rests. With more steps it moves further and takes longer.
    pub steps: usize,
}

impl Default for LevelSetSettings {
    fn default() -> Self {
        Self { level_share: 0.4, least_sigma: 3.0, region: 1.0, edge: 0.6, steps: 40 }
    }
}

/// The transparent fringe around the body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct FringeSettings {
    /// How far from the body the border of a fin is searched, share of the bore's height.
    pub reach_bore: f64,
    /// Averaging along the outline, standard deviation in px. More of it shows fainter borders and blurs detail.
    pub along_px: f64,
    /// Strength of the border that a place further out than the body must show, in standard deviations of chance. A larger value believes
    /// fewer fins.
    pub bar: f64,
    /// Largest strength that one place counts with, in standard deviations of chance, so that one strong place does not make a fin.
    pub most: f64,
    /// Length over which the mean border of a fringe must reach `least`, px.
    pub run_px: f64,
    /// Least mean border of a fringe that is believed, in standard deviations of chance.
    pub least: f64,
    /// Darkness that cannot lie between the body and its fringe, standard deviations of a pixel's noise. A fringe behind a darker place is
    /// not part of the specimen.
    pub opaque_sigma: f64,
    /// Cost of a kink in the fringe, per squared px of difference between neighbouring steps. A larger cost gives a smoother fringe.
    pub kink: f64,
}

impl Default for FringeSettings {
    fn default() -> Self {
        Self { reach_bore: 0.35, along_px: 6.0, bar: 2.0, most: 4.0, run_px: 60.0, least: 2.3, opaque_sigma: 12.0, kink: 0.8 }
    }
}

/// How a frame is segmented. Lengths in bores are shares of the bore's height, so that they hold at any magnification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = crate::range::in_schema::<Self>))]
#[serde(default, deny_unknown_fields)]
pub struct SegmentSettings {
    /// Method of segmentation.
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "method")))]
    pub method: Method,
    /// How walls are found.
    pub walls: WallSettings,
    /// The level set.
    pub level_set: LevelSetSettings,
    /// The transparent fringe.
    pub fringe: FringeSettings,
    /// How the edge is placed.
    pub edge: EdgeSettings,
    /// Mean contrast of many blocks that belongs to the specimen if it is connected to its body, standard deviations of one block's noise. A
    /// larger value gives a smaller outline.
    pub faint_sigma: f64,
    /// Contrast that the mean of a faint piece must reach somewhere, as a multiple of `faint_sigma`. With 1 all faint pieces are taken, and the
    /// other views of a turn decide which of them are fins. With more, faint fins are lost, and less dust is taken for one. Where
    /// it is not stated, `carved segment` and `carved.segment` of Python take 2, because a
    /// single picture has no other views.
    pub faint_sure: f64,
    /// Gaps narrower than twice this are bridged, px. With 0 none is.
    pub closing_px: usize,
    /// Whiskers narrower than twice this are removed, px. With 0 none is.
    pub opening_px: usize,
    /// Width of the stripe along each wall in which foreground is not searched, px.
    pub wall_margin_px: f64,
    /// Pieces smaller than this are noise: share of the squared bore.
    pub speck_bore2: f64,
    /// A specimen is at least this large: share of the squared bore (a bead of a quarter of the bore has 0.05).
    pub min_area_bore2: f64,
    /// Pieces this near to the specimen belong to it: share of the bore.
    pub join_gap_bore: f64,
    /// A frame whose brightest percent is darker than this is black, grey values.
    pub black_below: u8,
    /// A frame with more saturated pixels than this share is over-exposed.
    pub max_saturated_share: f64,
    /// A key of earlier versions.
    #[serde(skip_serializing)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub mean_shift: Retired,
    /// A key of earlier versions.
    #[serde(skip_serializing)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub high_sigma: Retired,
    /// A key of earlier versions.
    #[serde(skip_serializing)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub low_sigma: Retired,
}

/// A key that earlier versions had. Stored methods still have it. It is read, whatever its value, and has no effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retired {
    found: bool,
}

impl<'de> Deserialize<'de> for Retired {
    fn deserialize<D: serde::Deserializer<'de>>(value: D) -> Result<Self, D::Error> {
        serde::de::IgnoredAny::deserialize(value).map(|_| Self { found: true })
    }
}

impl SegmentSettings {
    /// Those of a single picture: no other view tells a faint fin from dust. On a frame of a VAST, means over fine dust beside a tail reach more than
    /// 1.5 times `faint_sigma`.
    pub fn of_single_picture() -> Self {
        Self { faint_sure: 2.0, ..Self::default() }
    }

    /// Keys that were given although they have no effect any more. In a file that somebody writes they are a mistake.
    pub fn retired_keys(&self) -> impl Iterator<Item = &'static str> {
        [("mean_shift", self.mean_shift), ("high_sigma", self.high_sigma), ("low_sigma", self.low_sigma)]
            .into_iter()
            .filter_map(|(key, retired)| retired.found.then_some(key))
    }
}

impl Default for SegmentSettings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            walls: WallSettings::default(),
            level_set: LevelSetSettings::default(),
            fringe: FringeSettings::default(),
            edge: EdgeSettings::default(),
            faint_sigma: 2.0,
            faint_sure: 1.0,
            closing_px: 2,
            opening_px: 2,
            wall_margin_px: 2.5,
            speck_bore2: 0.002,
            min_area_bore2: 0.03,
            join_gap_bore: 0.06,
            black_below: 30,
            max_saturated_share: 0.8,
            mean_shift: Retired::default(),
            high_sigma: Retired::default(),
            low_sigma: Retired::default(),
        }
    }
}

const FRAME: &str = "of the frame's height";
const WIDTH: &str = "of the frame's width";
const BORE: &str = "of the bore's height";
const BORE2: &str = "of the squared bore";
const NOISE: &str = "standard deviations of the noise";
const CHANCE: &str = "standard deviations of chance";
/// Samples along a normal of the coarse outline reach this far to either side, px.
pub(super) const REACH_PX: usize = 9;
/// The edge is fitted in a window of this reach to either side of the coarse outline, px.
const EDGE_REACH_PX: f64 = REACH_PX as f64 - 2.0;

impl Ranged for WallSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        max_sag_share: 0.0, 0.05, WIDTH;
        max_tilt_deg: 0.0, 10.0, "deg";
        min_support: 0.05, 1.0, WIDTH;
        min_depth: 0.5, 100.0, "grey values";
        line_reach_share: 0.001, 0.2, FRAME;
        min_bore_share: 0.01, 0.95, FRAME;
        max_wall_share: 0.01, 0.45, "of the capillary's outer diameter";
    ];
}

impl Ranged for EdgeSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        blur_px: 0.3, 4.0, "px";
        search_outside_px: 0.5, EDGE_REACH_PX, "px";
        search_inside_px: 0.5, EDGE_REACH_PX, "px";
        along_px: 0.3, 10.0, "px";
        outline_smoothing_px: 0.3, 10.0, "px";
        shift_smoothing_px: 0.3, 10.0, "px";
        stiffness: 0.0, 1000.0, "per squared px";
    ];
}

impl Ranged for LevelSetSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        level_share: 0.01, 1.0, "of the body's contrast";
        least_sigma: 0.1, 100.0, NOISE;
        region: 0.0, 2.0, "per step";
        edge: 0.0, 2.0, "per step";
        steps: 0.0, 1000.0, "steps";
    ];
}

impl Ranged for FringeSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        reach_bore: 0.0, 1.0, BORE;
        along_px: 0.3, 30.0, "px";
        bar: 0.0, 100.0, CHANCE;
        most: 0.0, 100.0, CHANCE;
        run_px: 2.0, 1000.0, "px";
        least: 0.0, 100.0, CHANCE;
        opaque_sigma: 0.0, 1000.0, NOISE;
        kink: 0.0, 100.0, "per squared px";
    ];
}

impl Ranged for SegmentSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        faint_sigma: 0.1, 100.0, NOISE;
        faint_sure: 1.0, 100.0, "of faint_sigma";
        closing_px: 0.0, 30.0, "px";
        opening_px: 0.0, 30.0, "px";
        wall_margin_px: 0.0, 20.0, "px";
        speck_bore2: 0.0, 1.0, BORE2;
        min_area_bore2: 1e-4, 1.0, BORE2;
        join_gap_bore: 0.0, 1.0, BORE;
        black_below: 0.0, 254.0, "grey values";
        max_saturated_share: 0.0, 1.0, "of the pixels";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outside_in("walls", &self.walls)
            .chain(outside_in("level_set", &self.level_set))
            .chain(outside_in("fringe", &self.fringe))
            .chain(outside_in("edge", &self.edge))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A method that an earlier version stored is read. It is not written with its old keys again.
    #[test]
    fn keys_of_earlier_versions_are_read_and_named() {
        let stored = r#"{"method": "hybrid", "mean_shift": {"range_sigma": 3.5}, "high_sigma": 8.0, "low_sigma": 1.3, "closing_px": 4}"#;
        let settings: SegmentSettings = serde_json::from_str(stored).unwrap();
        assert_eq!(settings.closing_px, 4);
        assert_eq!(settings.retired_keys().collect::<Vec<_>>(), ["mean_shift", "high_sigma", "low_sigma"]);
        let written = serde_json::to_string(&settings).unwrap();
        assert!(!written.contains("mean_shift") && !written.contains("low_sigma"), "{written}");
        let again: SegmentSettings = serde_json::from_str(&written).unwrap();
        assert_eq!(again.retired_keys().count(), 0);
    }
}
