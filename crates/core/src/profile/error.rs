//! Why a frame has no profile.

use super::Damage;

/// Why a frame has no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// The frame is too small.
    #[error("the frame is {width} x {height} px; at least {least} x {least} are needed: check the camera's region of interest")]
    TooSmall {
        /// Width of the frame, px.
        width: usize,
        /// Height of the frame, px.
        height: usize,
        /// Least width and height, px.
        least: usize,
    },
    /// Frame and picture of the empty capillary differ in size.
    #[error(
        "the frame is {width} x {height} px, the picture of the empty capillary {wide} x {high} px: take it again with this region of interest"
    )]
    EmptyCapillarySize {
        /// Width of the frame, px.
        width: usize,
        /// Height of the frame, px.
        height: usize,
        /// Width of the picture, px.
        wide: usize,
        /// Height of the picture, px.
        high: usize,
    },
    /// The frame is black.
    #[error(
        "the frame is black: its brightest percent starts at {brightest}, at least {needed} is needed; check lamp, shutter and exposure"
    )]
    Black {
        /// Grey value from which on the brightest percent lies.
        brightest: u8,
        /// Least value.
        needed: u8,
    },
    /// The frame is over-exposed.
    #[error("the frame is over-exposed: {share:.3} of its pixels are saturated, at most {limit:.3} may be; shorten the exposure")]
    OverExposed {
        /// Share of saturated pixels.
        share: f64,
        /// Largest share.
        limit: f64,
    },
    /// A part of the frame was not taken by the camera.
    #[error(
        "the picture is damaged: rows {} to {}, columns {} to {} (counted from 0) {damage}; take it or copy it again. If all pictures have this, \
         the camera has dead pixels there, or a program fills them: leave them out of the region of interest, or let the camera correct them",
        rows[0], rows[1], columns[0], columns[1]
    )]
    Damaged {
        /// First and last row.
        rows: [usize; 2],
        /// First and last column.
        columns: [usize; 2],
        /// What its pixels are.
        damage: Damage,
    },
    /// No two lines can be the walls.
    #[error(
        "no capillary: of the straight dark lines that cross at least {needed_support:.2} of the frame ({lines} found) no two are its walls; \
         check that the capillary is in view and in focus"
    )]
    NoWalls {
        /// Straight dark lines found.
        lines: usize,
        /// Share of the frame's width that a line must cross.
        needed_support: f64,
    },
    /// The capillary runs from top to bottom.
    #[error(
        "no capillary from left to right: it seems to run from top to bottom; turn the picture by 90 degrees, or the camera on its mount"
    )]
    OnItsSide,
    /// The lines that could be the walls are not straight.
    #[error(
        "no capillary: the two dark lines that could be its walls are straight along {straight_share:.2} of the picture, at least \
         {needed_share} is expected; they may be the specimen's own edges: take the picture so that both walls are in view"
    )]
    CrookedWalls {
        /// Share of the picture's width along which they are.
        straight_share: f64,
        /// Least share.
        needed_share: f64,
    },
    /// The picture shows too little beside the capillary.
    #[error(
        "the picture shows {beyond_px:.0} px of what is beyond the capillary's walls, at least {needed_px} px are needed above or below it to \
         tell the light from the specimen: leave more of it in the picture, or compare with a picture of the empty capillary"
    )]
    TooTight {
        /// Rows shown beyond a wall, px.
        beyond_px: f64,
        /// Least rows, px.
        needed_px: usize,
    },
}
