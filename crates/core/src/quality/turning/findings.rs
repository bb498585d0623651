//! What may be wrong with a turn, in words.

use crate::flag::Flag;
use serde::{Deserialize, Serialize};

/// Why the views do not show one specimen that turns at the angles of the ledger.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "finding", rename_all = "snake_case")]
pub enum TurnFinding {
    /// The specimen does not turn while the angles do.
    #[error(
        "the specimen does not turn: from view {first} to view {last} the ledger turns by {ledger_deg:.0} deg, and most edges move by at most {moved_px:.1} px. \
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
    /// Two views fit the others if they are exchanged.
    #[error(
        "views {view} and {other} are exchanged: each fits the others at the angle of the other one, {apart_deg:.0} deg away ({exchanged_px:.1} px instead of \
         {own_px:.1} px). Check the order of the pictures"
    )]
    Exchanged {
        /// The view.
        view: u32,
        /// The other view.
        other: u32,
        /// Difference of their angles, deg.
        apart_deg: f64,
        /// Distance of the edges of the worse one from the other views' model at its own angle, px.
        own_px: f64,
        /// The same where they are exchanged, px.
        exchanged_px: f64,
    },
    /// The views fit the camera better if the capillary turned in the other sense.
    #[error(
        "the views fit a turn in the other sense: their edges lie {reversed_px:.2} px from it, and {found_px:.2} px from the turn as it is recorded. The model is \
         a mirror image. Check the order of the pictures and the sense of the rig, and measure the pictures again"
    )]
    Reversed {
        /// Standard deviation of the edges from the model of the turn as recorded, px.
        found_px: f64,
        /// The same with all angles in the other sense, px.
        reversed_px: f64,
    },
    /// Several views fit the turn at no angle.
    #[error(
        "{views} of {of} views, the first of them {view}, fit the others at no angle: they show another specimen, the specimen moved, or the pictures are bad. Look at them"
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
    /// Its flag.
    pub fn flag(&self) -> Flag {
        match self {
            Self::Still { .. } => Flag::RotationSuspect,
            Self::Repeated { .. } => Flag::RepeatedViews,
            Self::Mirrored { .. } => Flag::MirroredViews,
            Self::Ends { .. } => Flag::SpecimenEndsDiffer,
            Self::Elsewhere { .. } | Self::Exchanged { .. } | Self::Foreign { .. } => Flag::ViewsDisagree,
            Self::Reversed { .. } => Flag::WrongSense,
            Self::OffBore { .. } => Flag::AxisOffBore,
        }
    }
}
