//! Whether the views show one specimen that turns at the angles of the ledger in this camera.
//!
//! ```text
//!  a view's outline and the grey of its bore ─┬─ nothing changes while the ledger turns ────────────── still
//!                                             ├─ another angle, the same picture ───────────────────── repeated
//!                                             ├─ a neighbour fits only with left and right exchanged ── mirrored
//!                                             └─ the ends of the specimen differ from view to view ─── ends
//!  the calibration of the turn ───────────────┬─ a view fits the others elsewhere, or nowhere ──────── elsewhere, foreign
//!                                             └─ its axis is not in the middle of the bore ─────────── off the bore
//! ```
//! The calibration alone cannot answer this. Views of a specimen that stands still fit a body of revolution, and mirrored views fit the part that
//! both pictures have in common. So the views are compared with each other, before any model is made of them.
//!
//! What no picture of a specimen tells: a whole turn that is mirrored, or that is recorded in the other sense. Both show the mirror image of the
//! specimen, with the same volume and area (`calibration::mark` finds both on the rig). A sphere looks alike from all sides and is not judged.

mod outlines;
mod pixels;

use crate::calibration::Placed;
use crate::flag::Flag;
use crate::profile::{Columns, Picture, Profile};
use crate::statistics::median;
use outlines::{Mirror, distance_px, shape_distance_px};
use pixels::{BorePicture, change};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Why the views do not show one specimen that turns at the angles of the ledger.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "finding", rename_all = "snake_case")]
pub enum TurnFinding {
    /// The specimen does not turn while the angles do.
    #[error(
        "the specimen does not turn: from view {first} to view {last} the ledger turns by {ledger_deg:.0} deg, and no edge moves by more than {moved_px:.1} px. \
         Check the motor's supply, the coupling and the belt, and whether the specimen turns with the glass"
    )]
    Still {
        /// First view of the stretch.
        first: u32,
        /// Last view of the stretch.
        last: u32,
        /// Angle between them by the ledger, deg.
        ledger_deg: f64,
        /// Largest distance of two outlines of the stretch, px.
        moved_px: f64,
    },
    /// Views of different angles are the same picture.
    #[error("views {view} and {other} are the same picture, and their angles differ by {apart_deg:.0} deg. Give each view its own picture")]
    Repeated {
        /// The view.
        view: u32,
        /// The other view.
        other: u32,
        /// Difference of their angles, deg.
        apart_deg: f64,
    },
    /// Some views are mirrored against others.
    #[error(
        "some views have left and right exchanged: view {view} fits view {before} only mirrored (outlines {mirrored_px:.1} px apart instead of {found_px:.1} px). \
         Switch the reversing of the camera and of the program that stores the pictures off, and take the views again"
    )]
    Mirrored {
        /// The view before the first exchange.
        before: u32,
        /// The view after it.
        view: u32,
        /// Distance of their outlines as they are, px.
        found_px: f64,
        /// The same with one of them mirrored, px.
        mirrored_px: f64,
    },
    /// The ends of the specimen are not at the same places in all views.
    #[error(
        "{share_percent:.0} % of the specimen is outside the part of the capillary that the views have in common; {most_percent:.0} % are allowed. The views show \
         different specimens, some are mirrored, or the specimen slid along the capillary: look at the pictures, and take the turn again"
    )]
    Ends {
        /// Share of the profiles' area, %.
        share_percent: f64,
        /// Largest share allowed, %.
        most_percent: f64,
    },
    /// A view fits the others at another angle, or upside down.
    #[error(
        "view {view} fits the others {off_deg:+.0} deg from its angle ({best_px:.1} px instead of {own_px:.1} px), and so do {others} more views. Near 180 deg the \
         picture is upside down. Otherwise pictures were exchanged, or the angles are not those of the pictures: check their order, their number and the steps \
         per revolution"
    )]
    Elsewhere {
        /// The view that fits worst at its own angle.
        view: u32,
        /// Angle at which it fits, minus its own, deg.
        off_deg: f64,
        /// Distance of its edges from the other views' model at its own angle, px.
        own_px: f64,
        /// The same where it fits, px.
        best_px: f64,
        /// Number of other views of which the same is true.
        others: usize,
    },
    /// Several views fit the turn at no angle.
    #[error(
        "{views} of {of} views, the first of them {view}, fit the others at no angle: they show another specimen, or are no good pictures. Look at them"
    )]
    Foreign {
        /// The first of them.
        view: u32,
        /// Number of these views.
        views: usize,
        /// Number of all views.
        of: usize,
    },
    /// The axis that fits the views is not where the glass turns.
    #[error(
        "the axis that fits the views lies {found_px:.1} px from the middle of the bore; {most_px:.0} px are allowed. The glass does not turn as the ledger says, \
         or the specimen does not turn with it: check the coupling and how the glass is held, and take the turn again"
    )]
    OffBore {
        /// Distance of the axis from the middle of the bore, px, at the specimen.
        found_px: f64,
        /// Largest distance allowed, px.
        most_px: f64,
    },
}

impl TurnFinding {
    /// The same with other numbers of its views.
    #[must_use]
    pub fn numbered(self, number: impl Fn(u32) -> u32) -> Self {
        match self {
            Self::Elsewhere { view, off_deg, own_px, best_px, others } => {
                Self::Elsewhere { view: number(view), off_deg, own_px, best_px, others }
            }
            Self::Foreign { view, views, of } => Self::Foreign { view: number(view), views, of },
            other => other,
        }
    }

    /// Its flag.
    pub fn flag(&self) -> Flag {
        match self {
            Self::Still { .. } => Flag::RotationSuspect,
            Self::Repeated { .. } => Flag::RepeatedViews,
            Self::Mirrored { .. } => Flag::MirroredViews,
            Self::Ends { .. } => Flag::SpecimenEndsDiffer,
            Self::Elsewhere { .. } | Self::Foreign { .. } => Flag::ViewsDisagree,
            Self::OffBore { .. } => Flag::AxisOffBore,
        }
    }
}

/// Least views of a stretch that stands still.
const STILL_VIEWS: usize = 3;
/// Least angle of a stretch whose pixels and outlines are unchanged, deg. Neighbours of 84 views are 4.3 deg apart, so that three views tell.
const STILL_DEG: f64 = 8.0;
/// Least angle of a stretch of which only the outlines are known to be unchanged, deg. Over a quarter of a turn a larva shows side and back.
const STILL_OUTLINES_DEG: f64 = 84.0;
/// Largest change of the pixels of a specimen that stands still. On 12 larvae of the second renderer, frames of one pose had 0.3 to 0.7, larvae that
/// turned by 8.6 deg 2.2 and more, both with a smaller floor of the variances (1/6) than now.
const STILL_CHANGE: f64 = 1.3;
/// Largest distance of outlines of a specimen that stands still, px per deg of the ledger, within limits: the segmentation's noise, and less than a
/// larva changes.
const STILL_PX_PER_DEG: f64 = 0.03;
const STILL_LEAST_PX: f64 = 0.35;
const STILL_MOST_PX: f64 = 1.5;
/// A specimen as long as this multiple of its width or longer is no sphere.
const LONG: f64 = 1.4;
/// Least difference of the angles of two views that may not be the same picture, deg.
const REPEATED_DEG: f64 = 2.0;
/// A mirrored neighbour's outline must be nearer than this share of the distance as it is, and by so many px.
const MIRRORED_SHARE: f64 = 0.6;
const MIRRORED_PX: f64 = 5.0;
/// Widest step between views that are compared with mirrored ones, deg. Side and back of a larva differ as much as head and tail.
const NEIGHBOURS_DEG: f64 = 46.0;
/// A part of the capillary is common to the views if this share of them shows the specimen there.
const COMMON: f64 = 0.75;
/// Largest share of the profiles' area outside the common part, %.
const ENDS_PERCENT: f64 = 6.0;

/// A view belongs elsewhere if its distance from the other views' model falls below this share at another angle, was more than this, px, and that
/// angle is further off than this, deg. In good turns of three larvae of the second renderer no view fell below 0.6.
const ELSEWHERE_SHARE: f64 = 0.55;
const ELSEWHERE_PX: f64 = 1.0;
const ELSEWHERE_DEG: f64 = 12.0;
/// A single view belongs elsewhere only from this distance on, px: on frames with the look of a VAST, one view of a good turn was at 1.4 px.
const ELSEWHERE_ALONE_PX: f64 = 3.0;
/// Least number and least share of the views that fit at no angle, for more than single bad pictures.
const FOREIGN_LEAST: usize = 2;
const FOREIGN_SHARE: f64 = 0.1;
/// Largest distance of the axis from the middle of the bore, px: glass that is not round, and chucks that hold it off their axis.
pub(crate) const OFF_BORE_PX: f64 = 12.0;

/// What the calibration of a turn shows. `bad` are the views that it left out; `axis_off_px` is the axis minus the middle of the bore.
pub(crate) fn of_calibration(placed: &[Option<Placed>], bad: &[usize], axis_off_px: Option<f64>) -> Vec<TurnFinding> {
    let belongs_elsewhere =
        |p: &Placed| p.own_px > ELSEWHERE_PX && p.best_px < ELSEWHERE_SHARE * p.own_px && p.off_rad.to_degrees().abs() >= ELSEWHERE_DEG;
    let mut elsewhere: Vec<(usize, Placed)> =
        placed.iter().enumerate().filter_map(|(i, p)| Some((i, (*p).filter(belongs_elsewhere)?))).collect();
    if let [(_, alone)] = elsewhere[..]
        && alone.own_px < ELSEWHERE_ALONE_PX
    {
        elsewhere.clear();
    }
    let worst = elsewhere.iter().max_by(|a, b| a.1.own_px.total_cmp(&b.1.own_px)).map(|(i, p)| TurnFinding::Elsewhere {
        view: *i as u32,
        off_deg: p.off_rad.to_degrees(),
        own_px: p.own_px,
        best_px: p.best_px,
        others: elsewhere.len() - 1,
    });
    let is_foreign = bad.len() >= FOREIGN_LEAST && bad.len() as f64 >= FOREIGN_SHARE * placed.len() as f64;
    let foreign = (worst.is_none() && is_foreign).then(|| TurnFinding::Foreign { view: bad[0] as u32, views: bad.len(), of: placed.len() });
    let off_bore =
        axis_off_px.filter(|px| px.abs() > OFF_BORE_PX).map(|px| TurnFinding::OffBore { found_px: px.abs(), most_px: OFF_BORE_PX });
    [worst, foreign, off_bore].into_iter().flatten().collect()
}

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
    /// Distance of the outlines of two views in which nothing has changed, by their numbers.
    unchanged_px: BTreeMap<(u32, u32), Option<f64>>,
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

    /// Takes a silhouette. The views come in the order of their numbers.
    pub fn observe_outline(&mut self, index: u32, omega: f64, outline: Columns) {
        self.views.push(SeenView { index, omega, body: outline, middle_v: None, bore: None });
    }

    /// Forgets a view.
    pub fn forget(&mut self, index: u32) {
        self.views.retain(|v| v.index != index);
        self.unchanged_px.retain(|(a, b), _| *a != index && *b != index);
    }

    /// Median row of the middle of the bore over the views, px.
    pub fn middle_v(&self) -> Option<f64> {
        let rows: Vec<f64> = self.views.iter().filter_map(|v| v.middle_v).collect();
        (!rows.is_empty()).then(|| median(rows))
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
        let mut moved_px: f64 = 0.0;
        for last in 1..self.views.len() {
            // The longest stretch that ends here.
            while first < last {
                let distances = (first..last).map(|at| self.unchanged_px(at, last)).collect::<Option<Vec<f64>>>();
                if let Some(distances) = distances {
                    moved_px = distances.into_iter().fold(0.0, f64::max);
                    break;
                }
                first += 1;
            }
            let ledger_deg = self.apart_deg(first, last);
            let stretch = &self.views[first..=last];
            let by_pixels = stretch.iter().all(|v| v.bore.is_some());
            let needed_deg = if by_pixels { STILL_DEG } else { STILL_OUTLINES_DEG };
            if stretch.len() >= STILL_VIEWS && ledger_deg >= needed_deg {
                return Some(TurnFinding::Still { first: stretch[0].index, last: self.views[last].index, ledger_deg, moved_px });
            }
        }
        None
    }

    /// Distance of the outlines of two views in which nothing has changed, px. `None` where something has.
    fn unchanged_px(&mut self, at: usize, other: usize) -> Option<f64> {
        let key = (self.views[at].index, self.views[other].index);
        if let Some(known) = self.unchanged_px.get(&key) {
            return *known;
        }
        let found = self.compared_px(at, other);
        self.unchanged_px.insert(key, found);
        found
    }

    fn compared_px(&self, at: usize, other: usize) -> Option<f64> {
        let (a, b) = (&self.views[at], &self.views[other]);
        let apart_deg = self.apart_deg(at, other);
        let down_px = b.middle_v.zip(a.middle_v).map_or(0.0, |(b, a)| b - a);
        // The bore is where the walls are found. A wall that the specimen hides may be found wrongly.
        let distances = [distance_px(&a.body, &b.body, 0.0)?, distance_px(&a.body, &b.body, down_px)?];
        let moved_px = distances[0].min(distances[1]);
        let allowed = (STILL_PX_PER_DEG * apart_deg).clamp(STILL_LEAST_PX, STILL_MOST_PX);
        let pixels = || a.bore.as_ref().zip(b.bore.as_ref()).and_then(|(x, y)| change((x, &a.body), (y, &b.body)));
        let is_same = moved_px <= allowed && (apart_deg >= STILL_OUTLINES_DEG || pixels().is_none_or(|change| change <= STILL_CHANGE));
        is_same.then_some(moved_px)
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
        median(shapes.collect()) >= LONG
    }

    /// Two views of different angles that are one picture, grey value by grey value.
    fn repeated(&self) -> Option<TurnFinding> {
        let pairs = (0..self.views.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let same = |&(a, b): &(usize, usize)| {
            let (first, second) = (&self.views[a], &self.views[b]);
            let turns = (second.omega - first.omega) / TAU;
            let apart_deg = 360.0 * (turns - turns.round()).abs();
            apart_deg >= REPEATED_DEG && first.bore.is_some() && first.bore == second.bore
        };
        pairs.into_iter().find(same).map(|(a, b)| TurnFinding::Repeated {
            view: self.views[a].index,
            other: self.views[b].index,
            apart_deg: self.apart_deg(a, b),
        })
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
        let share_percent = median(shares.collect());
        (share_percent > ENDS_PERCENT).then_some(TurnFinding::Ends { share_percent, most_percent: ENDS_PERCENT })
    }
}
