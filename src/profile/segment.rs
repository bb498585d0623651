//! One frame to one profile: the order of the steps and their refusals.

use super::background::{self, Bore};
use super::edge::{self, EdgePoint, Limits, Polygon, Refined};
use super::foreground;
use super::plane::Plane;
use super::settings::SegmentSettings;
use super::{Detection, Mask, Picture, ProfileQuality, Walls, detection, quality, walls};

/// The outline of the specimen in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Pixels whose centres the edge encloses.
    pub mask: Mask,
    /// Closed outlines at sub-pixel position; none in an empty capillary.
    pub edge: Vec<Polygon>,
    /// How sure each vertex of each outline is.
    pub edge_points: Vec<Vec<EdgePoint>>,
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
    let outlines: Vec<_> = edge::trace(&found.inside, width, bore.top).into_iter().filter(|outline| outline.len() >= 12).collect();
    let Refined { edge, points, blur_px } = edge::refine(&outlines, &darkness, &limits, &settings.edge);
    let mut mask = Mask::empty(width, height);
    edge::rasterise(&edge, &mut mask);
    let quality = ProfileQuality {
        components: found.components,
        saturated_share: saturated_share(picture, bore.top, bore.bottom),
        noise_grey: backgrounds.iter().map(|b| f64::from(b.noise)).sum::<f64>() / backgrounds.len() as f64,
        blur_px,
        ..quality::of_edge(&edge, &points, &bore)
    };
    let middle = seen.len() / 2;
    let detection = detection::detect(&mask, &bore, &seen[middle], &backgrounds[middle].level, backgrounds[middle].noise);
    Ok(Profile { mask, edge, edge_points: points, walls, quality, detection })
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
