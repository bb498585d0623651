//! The sense of rotation, and whether the picture is mirrored, from a dot of ink on the outside of the glass.
//!
//! ```text
//!  dark spots of each view ── track ── v = axis + b cos omega + c sin omega, as wide as the glass ── judge ── sense, mirror
//!                                                                                                      ▲
//!  where the operator's eye saw the dot at the first view, from where the camera stands ───────────────┘
//!      near or far, top or bottom, left or right
//! ```
//! The sinusoid alone is the same for a near dot that goes down and a far dot that goes up. So the sense follows from the
//! direction in which the dot goes and from the operator's sighting of near or far. The perspective checks the sighting: a dot
//! beside the picture's middle is seen further from it in the near half of the turn.

mod judge;
mod track;

pub use judge::{Depth, Edge, End, MarkSighting, Verdict, judge};
pub use track::{MarkTrack, MarkView, track};

/// Why a turn does not give the sense of rotation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MarkError {
    /// Too few views.
    #[error("{found} views; {needed} or more are needed")]
    FewViews {
        /// Views given.
        found: usize,
        /// Views needed.
        needed: usize,
    },
    /// No spot goes around with the glass in enough views.
    #[error(
        "no mark was found: the darkest spot that goes around with the glass is in {seen} of {views} views, {needed} or more are needed. A spot that \
         stands still is on a window; make the mark larger and blacker, about 100 um, on the outside of the glass"
    )]
    NotFound {
        /// Views that show the best spot.
        seen: usize,
        /// Views given.
        views: usize,
        /// Views needed.
        needed: usize,
    },
    /// Too wide an arc of the turn does not show the mark.
    #[error(
        "the mark is seen in no view over {found_deg:.0} deg of the turn, {most_deg:.0} deg at most are passed over: take views all around"
    )]
    Gap {
        /// Widest arc without the mark, deg.
        found_deg: f64,
        /// Widest arc allowed, deg.
        most_deg: f64,
    },
    /// Another spot goes around with the glass.
    #[error(
        "two spots go around with the glass: the darker at column {u_px:.0}, another at column {rival_u_px:.0} with {share:.2} of its ink, {most:.2} at \
         most: clean the glass, or make the mark blacker"
    )]
    Rival {
        /// Column of the darker spot, px.
        u_px: f64,
        /// Column of the other spot, px.
        rival_u_px: f64,
        /// Ink of the other spot over that of the darker one.
        share: f64,
        /// Largest share allowed.
        most: f64,
    },
    /// The spot is not on the outside of the glass.
    #[error(
        "the spot goes {found_px:.1} px up and down, the glass' outer wall is {wall_px:.1} px from the axis: more than {most_percent:.0} % off, it is no mark on \
         its outside"
    )]
    Radius {
        /// Amplitude of the spot, px.
        found_px: f64,
        /// Distance of the outer wall from the axis, px.
        wall_px: f64,
        /// Largest difference allowed, %.
        most_percent: f64,
    },
    /// The places of the spot are not those of a circle at these angles.
    #[error("the spot's places are {found_px:.2} px off a circle's in the mean, {most_px:.2} at most: are these the views' angles?")]
    Residual {
        /// Root mean square distance, px.
        found_px: f64,
        /// Largest distance allowed, px.
        most_px: f64,
    },
    /// The mark does not come back to its first place.
    #[error(
        "the mark comes back {found_px:.1} px beside where it was at the first view, {most_px:.1} at most: the steps per revolution are wrong, or it slips"
    )]
    Closure {
        /// Distance after one turn, px.
        found_px: f64,
        /// Largest distance allowed, px.
        most_px: f64,
    },
    /// At the first view the mark is too near to the border of two quarters.
    #[error(
        "at the first view the mark is {found_deg:.0} deg from where {between} meet, {least_deg:.0} or more are needed for an eye to be sure: turn the capillary \
         until the mark stands between, half way, and record again"
    )]
    Between {
        /// The two halves that meet there.
        between: &'static str,
        /// Angle from that border, deg.
        found_deg: f64,
        /// Least angle, deg.
        least_deg: f64,
    },
    /// The mark is too near to the picture's middle column.
    #[error(
        "the mark is seen {found_px:.0} px from the picture's middle, {least_px:.0} or more are needed to tell left from right: mark it nearer to an end"
    )]
    Middle {
        /// Distance from the middle, px.
        found_px: f64,
        /// Least distance, px.
        least_px: f64,
    },
    /// The perspective contradicts the sighting.
    #[error(
        "the mark was said to be {said} at the first view, but where that makes it near it is seen {found_px:+.2} px further out, {expected_px:+.2} px are \
         expected of the perspective: look again from where the camera stands"
    )]
    Contradiction {
        /// `near` or `far`.
        said: &'static str,
        /// How much further out the mark is seen where the sighting makes it near, px.
        found_px: f64,
        /// What the perspective makes expected, px.
        expected_px: f64,
    },
}
