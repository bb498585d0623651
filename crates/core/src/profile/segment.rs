//! From one frame to one profile: the order of the steps, and their errors.

use super::body::bubble::Disc;
use super::body::coarse::Coarse;
use super::body::hybrid::Hybrid;
use super::bore::background::Background;
use super::bore::walls::WallFinder;
use super::bore::{Bore, MARGIN_PX};
use super::detection::Detector;
use super::edge::finder::{EdgeFinder, EdgePoint, Limits, Refined, STEP_PX};
use super::fins::borders::FinBorders;
use super::fins::fringe::{self, Fringe};
use super::raster::damage::Inspector;
use super::raster::outline::{self, Crossings, Outlines, Polygon, Smoother};
use super::settings::{Method, SegmentSettings};
use super::{Detection, EmptyCapillary, Mask, Picture, ProfileError, ProfileQuality, Walls, quality};

/// The outline of the specimen in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Pixels whose centres the edge encloses.
    pub mask: Mask,
    /// Closed outlines at sub-pixel positions. Empty in an empty capillary.
    pub edge: Vec<Polygon>,
    /// The outlines without the fins that only their border shows: the same as `edge` where none was found.
    pub body: Vec<Polygon>,
    /// The certainty of each vertex of each outline.
    pub edge_points: Vec<Vec<EdgePoint>>,
    /// The walls of the capillary.
    pub walls: Walls,
    /// Figures of the profile.
    pub quality: ProfileQuality,
    /// What was detected in the frame.
    pub detection: Detection,
}

/// Frames smaller than this in either direction cannot hold a capillary and its surroundings.
const LEAST_PX: usize = 48;
/// Largest share of the rows, above or below, that a program fills. Where more is filled, this is why no walls are found.
const MOST_FILLED_SHARE: f64 = 0.4;
/// Pieces with a shorter outline are left out.
const LEAST_CRACKS: usize = 12;
/// Grey value from which on a pixel counts as saturated.
const SATURATED: u8 = 254;

/// Segments frames. It keeps its memory from frame to frame, so that a warm one allocates only what it returns: the mask, and
/// the outlines with their points. It keeps no findings: the same frame always gives the same profile.
#[derive(Default)]
pub struct Segmenter {
    walls: WallFinder,
    background: Background,
    coarse: Coarse,
    hybrid: Hybrid,
    inside: Vec<bool>,
    bubbles: Vec<Disc>,
    body: Vec<bool>,
    used: Vec<bool>,
    cracks: Outlines,
    smoother: Smoother,
    outlines: Outlines,
    fringe: Fringe,
    edge: EdgeFinder,
    crossings: Crossings,
    contrasts: Vec<f64>,
    detector: Detector,
    inspector: Inspector,
}

/// Separates the specimen from the capillary in one frame.
///
/// # Errors
/// See [`Segmenter::segment`].
pub fn segment(picture: &Picture, settings: &SegmentSettings) -> Result<Profile, ProfileError> {
    Segmenter::default().segment(picture, settings, None)
}

impl Segmenter {
    /// Separates the specimen from the capillary. `empty` is the picture of the empty capillary, if there is one.
    ///
    /// # Errors
    /// [`ProfileError`] for a frame that shows no capillary, with the figures that say why.
    pub fn segment(
        &mut self,
        picture: &Picture,
        settings: &SegmentSettings,
        empty: Option<&EmptyCapillary>,
    ) -> Result<Profile, ProfileError> {
        let (width, height) = (picture.width(), picture.height());
        if width < LEAST_PX || height < LEAST_PX {
            return Err(ProfileError::TooSmall { width, height, least: LEAST_PX });
        }
        if let Some((wide, high)) = empty.map(EmptyCapillary::size).filter(|size| *size != (width, height)) {
            return Err(ProfileError::EmptyCapillarySize { width, height, wide, high });
        }
        check_exposure(picture, settings)?;
        let found = self.walls.find(picture, &settings.walls);
        // What is damaged may be why no walls are found.
        let rows = found.as_ref().map_or(0..height, |walls| walls.rows(width, height));
        if let Some(part) = self.inspector.find(picture, &rows) {
            // A program may fill the rows above and below what it has stored.
            let is_at_end = part.rows.start == 0 || part.rows.end == height;
            if found.is_ok() || !is_at_end || part.rows.len() as f64 > MOST_FILLED_SHARE * height as f64 {
                return Err(part.error());
            }
        }
        let walls = found?;
        let bore = Bore::of(picture, walls);
        if empty.is_none() {
            check_surroundings(&bore)?;
        }
        self.background.take_away(&bore, picture, empty);
        self.coarse.fill(&bore, &self.background.contrast, settings.wall_margin_px);
        self.hybrid.find(&self.coarse, &bore, settings);
        self.hybrid.mark_pixels(&self.coarse, &bore, &mut self.inside);

        if settings.method == Method::Hybrid {
            self.hybrid.remove_specks(&mut self.background.contrast.lightness, &self.coarse);
        }
        let contrast = &self.background.contrast;
        let rows = |u: f64| (walls.upper.inner.at(u), walls.lower.inner.at(u));
        self.bubbles.clear();
        self.bubbles.extend(self.hybrid.bubbles(&self.coarse, &bore));
        self.body.clear();
        self.body.extend_from_slice(&self.inside);
        if settings.method == Method::Hybrid {
            // Once more from what was found: around the body's tip, normals spread too far to follow a fin.
            for _ in 0..fringe::ROUNDS {
                outline::trace(&self.inside, width, bore.top, LEAST_CRACKS, &mut self.used, &mut self.cracks);
                outline::smoothed(&self.cracks, fringe::OUTLINE_SMOOTHING_PX, fringe::STEP_PX, &mut self.smoother, &mut self.outlines);
                if self.outlines.each().all(fringe::is_disc) {
                    break;
                }
                self.fringe.add(&self.outlines, contrast, &bore, &settings.fringe, &mut self.inside);
            }
        }
        outline::trace(&self.inside, width, bore.top, LEAST_CRACKS, &mut self.used, &mut self.cracks);
        outline::smoothed(&self.cracks, settings.edge.outline_smoothing_px, STEP_PX, &mut self.smoother, &mut self.outlines);
        let limits = Limits { inside: &self.inside, body: &self.body, bubbles: &self.bubbles, rows: &rows };
        let Refined { edge, points, blur_px } = self.edge.refine(&self.outlines, &contrast.darkness, &limits, &settings.edge);
        let body = if self.body == self.inside {
            edge.clone()
        } else {
            outline::trace(&self.body, width, bore.top, LEAST_CRACKS, &mut self.used, &mut self.cracks);
            outline::smoothed(&self.cracks, settings.edge.outline_smoothing_px, STEP_PX, &mut self.smoother, &mut self.outlines);
            let limits = Limits { inside: &self.body, ..limits };
            self.edge.refine_again(&self.outlines, &contrast.darkness, &limits, &settings.edge)
        };
        let mut mask = Mask::empty(width, height);
        outline::rasterise(&edge, &mut mask, &mut self.crossings);
        let quality = ProfileQuality {
            components: self.hybrid.pieces.sizes.len(),
            saturated_share: saturated_share(picture, bore.top, bore.bottom),
            noise_grey: contrast.noise_grey,
            blur_px,
            ..quality::of_edge(&edge, &points, &bore, &mut self.contrasts)
        };
        let detection = self.detector.detect(&mask, &bore, &contrast.darkness, contrast.all_light, &self.bubbles);
        Ok(Profile { mask, edge, body, edge_points: points, walls, quality, detection })
    }

    /// The same for a view of a turn, with the borders of fins that are too faint for one view. There are none for a disc, and where fins
    /// are not searched.
    ///
    /// # Errors
    /// As [`Self::segment`].
    pub fn segment_view(
        &mut self,
        picture: &Picture,
        settings: &SegmentSettings,
        empty: Option<&EmptyCapillary>,
    ) -> Result<(Profile, Option<FinBorders>), ProfileError> {
        let profile = self.segment(picture, settings, empty)?;
        let is_searched = settings.method == Method::Hybrid && settings.fringe.reach_bore > 0.0;
        let may_have_fins = is_searched && !profile.body.iter().all(|outline| fringe::is_disc(&outline.vertices));
        let Profile { body, walls, quality, .. } = &profile;
        let borders = may_have_fins.then(|| FinBorders::of(&self.background.contrast, body, walls, quality.blur_px, picture.height()));
        Ok((profile, borders))
    }
}

/// Asks for a row of pixels along the capillary that the glass and its blur leave alone: the light's course is read there.
fn check_surroundings(bore: &Bore) -> Result<(), ProfileError> {
    let (walls, last_u) = (&bore.walls, (bore.width - 1) as f64);
    let (first_v, last_v) = (bore.lit.start as f64, bore.lit.end as f64 - 1.0);
    let least = |of: &dyn Fn(f64) -> f64| [0.0, last_u / 2.0, last_u].into_iter().map(of).fold(f64::INFINITY, f64::min);
    let beyond_px = least(&|u| walls.upper.outer.at(u) - first_v).max(least(&|u| last_v - walls.lower.outer.at(u))).max(0.0);
    if beyond_px.round() < MARGIN_PX as f64 {
        return Err(ProfileError::TooTight { beyond_px, needed_px: MARGIN_PX });
    }
    Ok(())
}

fn check_exposure(picture: &Picture, settings: &SegmentSettings) -> Result<(), ProfileError> {
    let green = &picture.planes()[1];
    // The brightest percent starts above that value. Only a frame that is refused needs to know where.
    if 100 * count(green.chunks(LANES).map(|chunk| chunk.iter().map(|&grey| u8::from(grey >= settings.black_below)).sum())) < green.len() {
        let bright = |least: u8| 100 * green.iter().filter(|&&grey| grey >= least).count() >= green.len();
        let brightest = (0..settings.black_below).rev().find(|&least| bright(least)).unwrap_or(0);
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
    let span = top * picture.width()..bottom * picture.width();
    let [red, green, blue] = picture.planes().each_ref().map(|plane| plane[span.clone()].chunks(LANES));
    let saturated = red.zip(green).zip(blue).map(|((red, green), blue)| {
        let colours = red.iter().zip(green).zip(blue);
        colours.map(|((r, g), b)| u8::from((*r).min(*g).min(*b) >= SATURATED)).sum()
    });
    count(saturated) as f64 / span.len().max(1) as f64
}

/// Pixels that are counted in a byte, so that many are counted at once.
const LANES: usize = 240;

fn count(chunks: impl Iterator<Item = u8>) -> usize {
    chunks.map(usize::from).sum()
}
