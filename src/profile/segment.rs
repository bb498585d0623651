//! One frame to one profile: the order of the steps, their settings and their refusals.

use super::background::{self, Bore};
use super::edge::{self, Limits, Polygon};
use super::foreground;
use super::plane::Plane;
use super::{Detection, Mask, Picture, ProfileQuality, Walls, quality, walls};
use serde::{Deserialize, Serialize};

/// How walls are found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WallSettings {
    /// Largest tilt of the capillary, degrees.
    pub max_tilt_deg: f64,
    /// Least share of the frame's width along which a wall must be visible.
    pub min_support: f64,
    /// Least darkness of a wall against both its sides, grey values.
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
#[serde(default, deny_unknown_fields)]
pub struct EdgeSettings {
    /// Blur of the frame (optics, sensor and demosaicing) as a Gaussian's standard deviation, px.
    pub blur_px: f64,
    /// How far outside the coarse outline the edge is searched, px.
    pub search_outside_px: f64,
    /// How far inside the coarse outline the edge is searched, px: the coarse outline errs outwards.
    pub search_inside_px: f64,
    /// Reach of the fit outside the edge, px.
    pub outside_px: f64,
    /// Reach of the fit inside the edge, px.
    pub inside_px: f64,
    /// Averaging along the outline before the fit, standard deviation in px.
    pub along_px: f64,
    /// Smoothing of the coarse outline, which gives the normals, standard deviation in px.
    pub outline_smoothing_px: f64,
    /// Smoothing of the found shifts along the outline, standard deviation in px.
    pub shift_smoothing_px: f64,
    /// Cost of a kink in the edge: per squared px of difference between neighbouring shifts.
    pub stiffness: f64,
}

impl Default for EdgeSettings {
    fn default() -> Self {
        Self {
            blur_px: 1.0,
            search_outside_px: 3.5,
            search_inside_px: 6.5,
            outside_px: 3.0,
            inside_px: 2.5,
            along_px: 1.5,
            outline_smoothing_px: 2.0,
            shift_smoothing_px: 1.0,
            stiffness: 1.0,
        }
    }
}

/// How a frame is segmented. Lengths "per bore" are shares of the bore's height, so that they hold at any magnification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SegmentSettings {
    pub walls: WallSettings,
    pub edge: EdgeSettings,
    /// Smoothing of the fine scale, standard deviation in px.
    pub fine_px: f64,
    /// Smoothing of the coarse scale, standard deviation in px.
    pub coarse_px: f64,
    /// Contrast beyond this counts as this before smoothing, standard deviations of a pixel's noise.
    pub clip_sigma: f64,
    /// Contrast that starts foreground, standard deviations of the smoothed noise.
    pub high_sigma: f64,
    /// Contrast that continues foreground, standard deviations of the smoothed noise.
    pub low_sigma: f64,
    /// Gaps narrower than twice this are bridged, px.
    pub closing_px: usize,
    /// Whiskers narrower than twice this are removed, px.
    pub opening_px: usize,
    /// Width of the stripe along each wall in which foreground is not looked for, px.
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
}

impl Default for SegmentSettings {
    fn default() -> Self {
        Self {
            walls: WallSettings::default(),
            edge: EdgeSettings::default(),
            fine_px: 1.0,
            coarse_px: 2.5,
            clip_sigma: 4.0,
            high_sigma: 7.0,
            low_sigma: 3.5,
            closing_px: 3,
            opening_px: 2,
            wall_margin_px: 2.5,
            speck_bore2: 0.002,
            min_area_bore2: 0.03,
            join_gap_bore: 0.06,
            black_below: 30,
            max_saturated_share: 0.8,
        }
    }
}

/// The outline of the specimen in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Pixels whose centres the edge encloses.
    pub mask: Mask,
    /// Closed outlines at sub-pixel position; none in an empty capillary.
    pub edge: Vec<Polygon>,
    pub walls: Walls,
    pub quality: ProfileQuality,
    pub detection: Detection,
}

/// Why a frame has no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProfileError {
    #[error("the frame is {width} x {height} px; at least {least} x {least} are needed: check the camera's region of interest")]
    TooSmall { width: usize, height: usize, least: usize },
    #[error(
        "the frame is black: its brightest percent starts at {brightest}, at least {needed} is needed; check lamp, shutter and exposure"
    )]
    Black { brightest: u8, needed: u8 },
    #[error("the frame is over-exposed: {share:.3} of its pixels are saturated, at most {limit:.3} may be; shorten the exposure")]
    OverExposed { share: f64, limit: f64 },
    #[error(
        "no capillary: {lines} straight dark lines cross at least {needed_support:.2} of the frame, two walls are needed; \
         check that the capillary is in view and in focus"
    )]
    NoWalls { lines: usize, needed_support: f64 },
}

/// Frames smaller than this in either direction cannot hold a capillary and its surroundings.
const LEAST_PX: usize = 48;
/// From here on a pixel counts as saturated.
const SATURATED: u8 = 254;

/// Separates the specimen from the capillary.
///
/// # Errors
/// Refuses frames that show no capillary, with the figures that say why.
pub fn segment(picture: &Picture, settings: &SegmentSettings) -> Result<Profile, ProfileError> {
    let (width, height) = (picture.width(), picture.height());
    if width < LEAST_PX || height < LEAST_PX {
        return Err(ProfileError::TooSmall { width, height, least: LEAST_PX });
    }
    check_exposure(picture, settings)?;
    let walls = walls::find(picture, &settings.walls)?;
    let bore = Bore::of(picture, walls);
    let seen: Vec<Plane> = (0..picture.colours()).map(|c| Plane::from_picture(picture, c, bore.top, bore.bottom)).collect();
    let backgrounds: Vec<_> = seen.iter().enumerate().map(|(c, plane)| background::estimate(&bore, picture, c, plane)).collect();
    let darkness = foreground::darkness(&seen, &backgrounds);
    let found = foreground::find(&bore, &seen, &backgrounds, settings);

    let rows = |u: f64| (walls.upper.inner.at(u), walls.lower.inner.at(u));
    let limits = Limits { inside: &found.inside, rows: &rows };
    let (edge, points): (Vec<_>, Vec<_>) = edge::trace(&found.inside, width, bore.top)
        .iter()
        .filter(|outline| outline.len() >= 12)
        .map(|outline| edge::refine(outline, &darkness, &limits, &settings.edge))
        .unzip();
    let mut mask = Mask::empty(width, height);
    edge::rasterise(&edge, &mut mask);
    let quality = ProfileQuality {
        components: found.components.len(),
        saturated_share: saturated_share(picture, bore.top, bore.bottom),
        noise_grey: backgrounds.iter().map(|b| f64::from(b.noise)).sum::<f64>() / backgrounds.len() as f64,
        ..quality::of_edge(&edge, &points, &bore)
    };
    let detection = Detection::decide(&mask, found.components.first(), settings.min_area_bore2 * bore.mean_px * bore.mean_px);
    Ok(Profile { mask, edge, walls, quality, detection })
}

fn check_exposure(picture: &Picture, settings: &SegmentSettings) -> Result<(), ProfileError> {
    let mut counts = [0usize; 256];
    for &grey in &picture.planes()[1] {
        counts[usize::from(grey)] += 1;
    }
    let total: usize = counts.iter().sum();
    let mut above = 0;
    let brightest = (0..=255u8).rev().find(|&grey| {
        above += counts[usize::from(grey)];
        above * 100 >= total
    });
    let brightest = brightest.unwrap_or(0);
    if brightest < settings.black_below {
        return Err(ProfileError::Black { brightest, needed: settings.black_below });
    }
    let share = saturated_share(picture, 0, picture.height());
    if share > settings.max_saturated_share {
        return Err(ProfileError::OverExposed { share, limit: settings.max_saturated_share });
    }
    Ok(())
}

/// Share of the pixels of rows `top .. bottom` that are saturated in every colour.
fn saturated_share(picture: &Picture, top: usize, bottom: usize) -> f64 {
    let [red, green, blue] = picture.planes();
    let span = top * picture.width()..bottom * picture.width();
    let n = span.len().max(1);
    let saturated = span.filter(|&i| red[i].min(green[i]).min(blue[i]) >= SATURATED).count();
    saturated as f64 / n as f64
}
