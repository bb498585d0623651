//! Whether the views show one specimen that turns at the angles of the ledger in this camera.
//!
//! ```text
//!  a view's outline and the grey of its bore ─┬─ nothing changes while the ledger turns ────────────── still
//!                                             ├─ another angle, the same exposure ──────────────────── repeated
//!                                             ├─ a neighbour fits only with left and right exchanged ── mirrored
//!                                             └─ the ends of the specimen differ from view to view ─── ends
//!  the calibration of the turn ───────────────┬─ a view fits the others elsewhere, or nowhere ──────── elsewhere, foreign
//!                                             ├─ two views fit the others at each other's angle ────── exchanged
//!                                             ├─ rays spread, or turn in the glass, the other way ──── reversed
//!                                             └─ its axis is not in the middle of the bore ─────────── off the bore
//! ```
//! The calibration alone cannot answer this. Views of a specimen that stands still fit a body of revolution, and mirrored views fit the part that
//! both pictures have in common. So the views are compared with each other, before any model is made of them.
//!
//! What no picture of a specimen tells: a whole turn that is mirrored, and, where rays are parallel and no glass turns them, a turn in the other
//! sense. Both show the mirror image of the specimen, with the same volume and area (`calibration::mark` finds both on the rig). A sphere looks alike
//! from all sides and is not judged.

mod findings;
mod outlines;
mod pixels;
mod placing;

use crate::parallel::prelude::*;
use crate::profile::{Columns, Picture, Profile};
use crate::quality::CoarseOutline;
use crate::statistics::upper_median;
pub use findings::TurnFinding;
use outlines::{Mirror, SHARE, distance_px, shape_distance_px};
use pixels::{BorePicture, Difference, Sampling, difference};
pub(crate) use placing::{OFF_BORE_PX, Places, of_calibration};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Least views of a stretch that stands still.
const STILL_VIEWS: usize = 3;
/// Least angle of a stretch whose outlines are unchanged and whose pixels surely are, deg. Neighbours of 84 views are 4.3 deg apart, so that three
/// views tell.
const STILL_SURE_DEG: f64 = 8.0;
/// The same where the pixels may be unchanged, deg. A larva that is nearly round shows little of so small a turn.
const STILL_DEG: f64 = 12.0;
/// Least angle of a stretch of which only the outlines are known to be unchanged, deg. Over a quarter of a turn a larva shows side and back.
const STILL_OUTLINES_DEG: f64 = 84.0;
/// Largest change of the pixels of a specimen that stands still.
const STILL_CHANGE: f64 = 1.3;
/// The same where the specimen surely stands still. On 11 larvae of two renderers, frames of one pose had 0.45 to 0.62. One of 9 good turns of 84
/// views had 1.05 over 8.6 deg between outlines that did not differ.
const STILL_SURE_CHANGE: f64 = 0.85;
/// Largest distance of outlines of a specimen that stands still, px per deg of the ledger, within limits: the segmentation's noise, and less than a
/// larva changes.
const STILL_PX_PER_DEG: f64 = 0.03;
const STILL_LEAST_PX: f64 = 0.35;
const STILL_MOST_PX: f64 = 1.5;
/// Share of the columns of which the outlines lie within that distance where the pixels surely are unchanged: single views find or miss fins that are
/// along most of a larva.
const STILL_SURE_SHARE: f64 = 0.5;
/// A specimen as long as this multiple of its width or longer is no sphere.
const LONG: f64 = 1.4;
/// Least difference of the angles of two views that may not be the same picture, deg.
const REPEATED_DEG: f64 = 2.0;
/// Largest distance of the outlines of one exposure that was stored twice, px: coding and another gain move an edge by less.
const REPEATED_PX: f64 = 1.0;
/// One exposure stored twice differs by at most this share of what two exposures differ by, inside and beside the specimen. Coding can
/// at most remove the noise of one of the two, which leaves half of the variance. Other exposures of one camera have 1.
const REPEATED_SHARE: f64 = 0.65;
/// Least variance of two exposures, grey levels^2. Less is not the sensor's noise but rounding, which differs from view to view.
const REPEATED_LEAST: f64 = 0.5;
/// Views next to a view by angle that show what two exposures differ by.
const REFERENCES: usize = 2;
/// A mirrored neighbour's outline must be nearer than this share of the distance as it is, and by so many px.
const MIRRORED_SHARE: f64 = 0.6;
const MIRRORED_PX: f64 = 5.0;
/// Widest step between views that are compared with mirrored ones, deg. Side and back of a larva differ as much as head and tail.
const NEIGHBOURS_DEG: f64 = 46.0;
/// A part of the capillary is common to the views if this share of them shows the specimen there.
const COMMON: f64 = 0.75;
/// Largest share of the profiles' area outside the common part, %.
const ENDS_PERCENT: f64 = 6.0;

/// A view of the turn.
#[derive(Debug, Clone)]
struct SeenView {
    index: u32,
    omega: f64,
    /// The outline without fins that only their border shows: single views find or miss these.
    body: Columns,
    /// Row of the middle of the bore, px.
    middle_v: Option<f64>,
    bore: Option<BorePicture>,
}

/// The views of a turn, and what their comparison shows.
#[derive(Debug, Clone, Default)]
pub struct Turning {
    views: Vec<SeenView>,
    /// What two views differ by in which nothing has changed, by their numbers.
    unchanged: BTreeMap<(u32, u32), Option<Unchanged>>,
}

/// What two views differ by in which nothing has changed.
#[derive(Debug, Clone, Copy, Default)]
struct Unchanged {
    /// Distance of the outlines, px.
    moved_px: f64,
    /// Least share of the columns that lie within this distance.
    share: f64,
    /// Change of the pixels, as [`Difference::change`]. 0 where they need not be compared.
    change: f64,
    /// Whether the pixels tell, or need not.
    is_told_by_pixels: bool,
}

impl Turning {
    /// Takes a view, or a newer take of it. `u` is the column in which the bore is read.
    pub fn observe(&mut self, index: u32, omega: f64, picture: &Picture, profile: &Profile, u: f64) {
        self.forget(index);
        if profile.mask.area_px() == 0 {
            return;
        }
        let body = Columns::from_outlines(&profile.body, picture.width(), picture.height());
        let bore = Some(BorePicture::of(picture, &profile.walls));
        let at = self.views.partition_point(|v| v.index < index);
        self.views.insert(at, SeenView { index, omega, body, middle_v: Some(profile.walls.middle_v(u)), bore });
    }

    /// The outline of a view in stripes. `None` for a view without a profile, and for a round specimen.
    pub(crate) fn coarse_outline(&self, index: u32) -> Option<CoarseOutline> {
        self.views.iter().find(|v| v.index == index).and_then(|v| CoarseOutline::of(&v.body))
    }

    /// Takes a silhouette. The views come in the order of their numbers.
    pub fn observe_outline(&mut self, index: u32, omega: f64, outline: Columns) {
        self.views.push(SeenView { index, omega, body: outline, middle_v: None, bore: None });
    }

    /// Forgets a view.
    pub fn forget(&mut self, index: u32) {
        self.views.retain(|v| v.index != index);
        self.unchanged.retain(|(a, b), _| *a != index && *b != index);
    }

    /// Median row of the middle of the bore over the views, px.
    pub fn middle_v(&self) -> Option<f64> {
        let rows: Vec<f64> = self.views.iter().filter_map(|v| v.middle_v).collect();
        (!rows.is_empty()).then(|| upper_median(rows))
    }

    /// What the comparison of the views shows, the cause before its consequences. A bead is not judged by its shape.
    pub fn findings(&mut self) -> Vec<TurnFinding> {
        let found = [self.still(), self.repeated(), self.mirrored(), self.ends()];
        found.into_iter().flatten().collect()
    }

    /// The first stretch of views in which nothing changes while the ledger turns.
    pub fn still(&mut self) -> Option<TurnFinding> {
        if !self.is_long() {
            return None;
        }
        let mut first = 0;
        let mut most = Unchanged::default();
        for last in 1..self.views.len() {
            // The longest stretch that ends here.
            while first < last {
                let unchanged = (first..last).map(|at| self.unchanged(at, last)).collect::<Option<Vec<Unchanged>>>();
                if let Some(unchanged) = unchanged {
                    let max = |of: fn(&Unchanged) -> f64| unchanged.iter().map(of).fold(0.0, f64::max);
                    let is_told_by_pixels = unchanged.iter().all(|u| u.is_told_by_pixels);
                    let share = unchanged.iter().map(|u| u.share).fold(SHARE, f64::min);
                    most = Unchanged { moved_px: max(|u| u.moved_px), share, change: max(|u| u.change), is_told_by_pixels };
                    break;
                }
                first += 1;
            }
            let ledger_deg = self.apart_deg(first, last);
            let stretch = &self.views[first..=last];
            let needed_deg = match most.is_told_by_pixels {
                false => STILL_OUTLINES_DEG,
                true if most.change <= STILL_SURE_CHANGE && most.share == SHARE => STILL_SURE_DEG,
                true => STILL_DEG,
            };
            if stretch.len() >= STILL_VIEWS && ledger_deg >= needed_deg {
                let (first, last) = (stretch[0].index, self.views[last].index);
                return Some(TurnFinding::Still { first, last, ledger_deg, moved_px: most.moved_px });
            }
        }
        None
    }

    /// What two views differ by in which nothing has changed. `None` where something has.
    fn unchanged(&mut self, at: usize, other: usize) -> Option<Unchanged> {
        let key = (self.views[at].index, self.views[other].index);
        if let Some(known) = self.unchanged.get(&key) {
            return *known;
        }
        let found = self.compared(at, other);
        self.unchanged.insert(key, found);
        found
    }

    fn compared(&self, at: usize, other: usize) -> Option<Unchanged> {
        let (a, b) = (&self.views[at], &self.views[other]);
        let apart_deg = self.apart_deg(at, other);
        let down_px = b.middle_v.zip(a.middle_v).map_or(0.0, |(b, a)| b - a);
        // The bore is where the walls are found. A wall that the specimen hides may be found wrongly.
        let moved_px = |share: f64| {
            let distances = [0.0, down_px].map(|down_px| distance_px(&a.body, &b.body, down_px, share));
            Some(distances[0]?.min(distances[1]?))
        };
        let allowed_px = (STILL_PX_PER_DEG * apart_deg).clamp(STILL_LEAST_PX, STILL_MOST_PX);
        let bores = a.bore.as_ref().zip(b.bore.as_ref());
        let compared = bores.filter(|_| apart_deg < STILL_OUTLINES_DEG);
        let (share, most_change) = if moved_px(SHARE)? <= allowed_px {
            (SHARE, STILL_CHANGE)
        } else if compared.is_some() && moved_px(STILL_SURE_SHARE)? <= allowed_px {
            (STILL_SURE_SHARE, STILL_SURE_CHANGE)
        } else {
            return None;
        };
        // Too few pixels tell as little as none.
        let found = compared.and_then(|(x, y)| difference((x, &a.body), (y, &b.body), Sampling::All));
        let change = found.as_ref().map_or(0.0, Difference::change);
        let is_told_by_pixels = bores.is_some() && found.is_some() == compared.is_some();
        let is_told = change <= most_change && (share == SHARE || is_told_by_pixels);
        is_told.then_some(Unchanged { moved_px: moved_px(share)?, share, change, is_told_by_pixels })
    }

    fn apart_deg(&self, at: usize, other: usize) -> f64 {
        (self.views[other].omega - self.views[at].omega).to_degrees().abs()
    }

    /// Whether the specimen is longer than wide, so that its outline changes as it turns.
    fn is_long(&self) -> bool {
        let shapes = self.views.iter().filter_map(|v| {
            let (from, to) = v.body.extent()?;
            let widest = (from..=to).filter_map(|u| v.body.get(u)).map(|e| e.lower - e.upper).fold(0.0, f64::max);
            Some((to - from + 1) as f64 / widest)
        });
        upper_median(shapes.collect()) >= LONG
    }

    /// Two views of different angles that are one exposure: they differ by less than the noise of the sensor makes two exposures differ,
    /// which the neighbours of both show.
    fn repeated(&self) -> Option<TurnFinding> {
        let n = self.views.len();
        let bore = |at: usize| self.views[at].bore.as_ref();
        let pairs: Vec<(usize, usize)> = (0..n)
            .flat_map(|b| (0..b).map(move |a| (a, b)))
            .filter(|&(a, b)| self.apart_around_deg(a, b) >= REPEATED_DEG && bore(a).is_some() && bore(b).is_some())
            .filter(|&(a, b)| {
                distance_px(&self.views[a].body, &self.views[b].body, 0.0, SHARE).map_or_else(|| bore(a) == bore(b), |px| px <= REPEATED_PX)
            })
            .collect();
        let references: Vec<[Vec<(usize, usize)>; 2]> =
            pairs.iter().map(|&(a, b)| [(a, b), (b, a)].map(|(of, not)| self.references(of, not))).collect();
        let compared: BTreeSet<(usize, usize)> = references.iter().flatten().flatten().chain(&pairs).copied().collect();
        let compared: Vec<(usize, usize)> = compared.into_iter().collect();
        let differences: Vec<((usize, usize), Option<Difference>)> =
            compared.into_par_iter().map(|pair| (pair, self.difference(pair))).collect();
        let differences: BTreeMap<(usize, usize), Difference> =
            differences.into_iter().filter_map(|(pair, difference)| Some((pair, difference?))).collect();
        let is_one = |pair: &(usize, usize), references: &[Vec<(usize, usize)>; 2]| {
            let Some(own) = differences.get(pair) else { return bore(pair.0) == bore(pair.1) };
            let of_view = |pairs: &Vec<(usize, usize)>, part: fn(&Difference) -> f64| {
                pairs.iter().filter_map(|pair| differences.get(pair)).map(part).min_by(f64::total_cmp).unwrap_or(0.0)
            };
            // The stored copy of a picture may have lost its noise, so that the view with more noise tells what is usual.
            let usual = |part: fn(&Difference) -> f64| references.iter().map(|pairs| of_view(pairs, part)).fold(0.0, f64::max);
            let is_less = |part: fn(&Difference) -> f64| usual(part) > REPEATED_LEAST && part(own) < REPEATED_SHARE * usual(part);
            bore(pair.0) == bore(pair.1) || is_less(|d| d.inside) && is_less(|d| d.beside)
        };
        let found = pairs.iter().zip(&references).find(|(pair, references)| is_one(pair, references)).map(|(pair, _)| *pair);
        let (a, b) = found.or_else(|| self.repeated_outlines())?;
        Some(TurnFinding::Repeated { view: self.views[a].index, other: self.views[b].index, apart_deg: self.apart_deg(a, b) })
    }

    /// Two silhouettes of different angles that are equal to the last pixel. A symmetric body shows most of its silhouettes twice, and is none.
    fn repeated_outlines(&self) -> Option<(usize, usize)> {
        let n = self.views.len();
        let is_pair = |a: usize, b: usize| {
            let (first, second) = (&self.views[a], &self.views[b]);
            first.bore.is_none() && second.bore.is_none() && self.apart_around_deg(a, b) >= REPEATED_DEG && first.body == second.body
        };
        let pairs: Vec<(usize, usize)> = (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).filter(|&(a, b)| is_pair(a, b)).collect();
        let twice: BTreeSet<usize> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
        (2 * twice.len() <= n).then(|| pairs.first().copied()).flatten()
    }

    fn difference(&self, (at, other): (usize, usize)) -> Option<Difference> {
        let (a, b) = (&self.views[at], &self.views[other]);
        difference((a.bore.as_ref()?, &a.body), (b.bore.as_ref()?, &b.body), Sampling::Third)
    }

    /// The views nearest to one by angle, without another, as pairs with it.
    fn references(&self, of: usize, not: usize) -> Vec<(usize, usize)> {
        let mut others: Vec<usize> = (0..self.views.len()).filter(|at| *at != of && *at != not).collect();
        others.sort_by(|a, b| self.apart_around_deg(of, *a).total_cmp(&self.apart_around_deg(of, *b)));
        others.into_iter().take(REFERENCES).map(|at| (at.min(of), at.max(of))).collect()
    }

    /// Angle between two views, deg, whole turns left out.
    fn apart_around_deg(&self, at: usize, other: usize) -> f64 {
        let turns = (self.views[other].omega - self.views[at].omega) / TAU;
        360.0 * (turns - turns.round()).abs()
    }

    /// The first neighbour that fits only mirrored.
    fn mirrored(&self) -> Option<TurnFinding> {
        let n = self.views.len();
        let mut by_angle: Vec<&SeenView> = self.views.iter().collect();
        by_angle.sort_by(|a, b| a.omega.total_cmp(&b.omega));
        let link = |at: usize| {
            let (a, b) = (by_angle[at], by_angle[(at + 1) % n]);
            let apart_deg = (b.omega - a.omega).rem_euclid(TAU).to_degrees();
            if apart_deg > NEIGHBOURS_DEG {
                return None;
            }
            let found_px = shape_distance_px(&a.body, &b.body, Mirror::None)?;
            let mirrored = [Mirror::LeftRight, Mirror::HalfTurn].map(|mirror| shape_distance_px(&a.body, &b.body, mirror));
            let mirrored_px = mirrored.into_iter().flatten().fold(f64::INFINITY, f64::min);
            let fits_mirrored = mirrored_px < MIRRORED_SHARE * found_px && found_px - mirrored_px > MIRRORED_PX;
            fits_mirrored.then_some(TurnFinding::Mirrored { before: a.index, view: b.index, found_px, mirrored_px })
        };
        if n < 2 {
            return None;
        }
        let links: Vec<TurnFinding> = (0..n).filter_map(link).collect();
        // Around a whole turn the sides are exchanged back again.
        let closes = (by_angle[0].omega - by_angle[n - 1].omega).rem_euclid(TAU).to_degrees() <= NEIGHBOURS_DEG;
        (links.len() >= if closes { 2 } else { 1 }).then(|| links.into_iter().next()).flatten()
    }

    /// The share of the specimen outside the part that most views show.
    fn ends(&self) -> Option<TurnFinding> {
        let width = self.views.iter().map(|v| v.body.width()).max()?;
        let needed = (COMMON * self.views.len() as f64).ceil() as usize;
        let is_common: Vec<bool> = (0..width).map(|u| self.views.iter().filter(|v| v.body.get(u).is_some()).count() >= needed).collect();
        let shares = self.views.iter().filter(|v| v.body.area_px() > 0.0).map(|v| {
            let outside: f64 = (0..width).filter(|u| !is_common[*u]).filter_map(|u| v.body.get(u)).map(|e| e.lower - e.upper - e.gap).sum();
            100.0 * outside / v.body.area_px()
        });
        let share_percent = upper_median(shares.collect());
        (share_percent > ENDS_PERCENT).then_some(TurnFinding::Ends { share_percent, most_percent: ENDS_PERCENT })
    }
}
