//! Which way the capillary turns, and whether the picture is mirrored, from a dot of ink on the outside of the glass.
//!
//! ```text
//!  dark spots of each view ── track ── v = axis + b cos omega + c sin omega, as wide as the glass ── judge ── sense, mirror
//!                                                                                                      ▲
//!  where the operator's eye saw the dot at the first view, from where the camera stands ───────────────┘
//!      near or far, top or bottom, left or right
//! ```
//! The sinusoid alone is the same for a near dot that goes down and a far one that goes up: the sense is the operator's word on
//! near or far against the direction in which the dot goes. What can be held against that word is the perspective: of a dot beside
//! the picture's middle the near half of the turn is seen further from it than the far half.

mod judge;
mod track;

pub use judge::{Depth, Edge, End, MarkSighting, Verdict, judge};
pub use track::{MarkTrack, MarkView, track};

/// Why a turn does not tell.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MarkError {
    #[error("{found} views; {needed} or more are needed")]
    FewViews { found: usize, needed: usize },
    #[error(
        "no mark was found: the darkest spot that goes around with the glass is in {seen} of {views} views, {needed} or more are needed. A spot that \
         stands still is on a window; make the mark larger and blacker, about 100 um, on the outside of the glass"
    )]
    NotFound { seen: usize, views: usize, needed: usize },
    #[error(
        "the mark is seen in no view over {found_deg:.0} deg of the turn, {most_deg:.0} deg at most are passed over: take views all around"
    )]
    Gap { found_deg: f64, most_deg: f64 },
    #[error(
        "two spots go around with the glass: the darker at column {u_px:.0}, another at column {rival_u_px:.0} with {share:.2} of its ink, {most:.2} at \
         most: clean the glass, or make the mark blacker"
    )]
    Rival { u_px: f64, rival_u_px: f64, share: f64, most: f64 },
    #[error(
        "the spot goes {found_px:.1} px up and down, the glass' outer wall is {wall_px:.1} px from the axis: more than {most_percent:.0} % off, it is no mark on \
         its outside"
    )]
    Radius { found_px: f64, wall_px: f64, most_percent: f64 },
    #[error("the spot's places are {found_px:.2} px off a circle's in the mean, {most_px:.2} at most: are these the views' angles?")]
    Residual { found_px: f64, most_px: f64 },
    #[error(
        "the mark comes back {found_px:.1} px beside where it was at the first view, {most_px:.1} at most: the steps per revolution are wrong, or it slips"
    )]
    Closure { found_px: f64, most_px: f64 },
    #[error(
        "at the first view the mark is {found_deg:.0} deg from where {between} meet, {least_deg:.0} or more are needed for an eye to be sure: turn the capillary \
         until the mark stands between, half way, and record again"
    )]
    Between { between: &'static str, found_deg: f64, least_deg: f64 },
    #[error(
        "the mark is seen {found_px:.0} px from the picture's middle, {least_px:.0} or more are needed to tell left from right: mark it nearer to an end"
    )]
    Middle { found_px: f64, least_px: f64 },
    #[error(
        "the mark was said to be {said} at the first view, but where that makes it near it is seen {found_px:+.2} px further out, {expected_px:+.2} px are \
         expected of the perspective: look again from where the camera stands"
    )]
    Contradiction { said: &'static str, found_px: f64, expected_px: f64 },
}
