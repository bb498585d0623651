//! What was detected in a frame.

use serde::{Deserialize, Serialize};

/// The kinds of contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Nothing.
    Empty,
    /// One larva.
    Larva,
    /// Two larvae or more.
    Two,
    /// Air, and no specimen.
    Bubble,
    /// Something small and irregular, and no specimen.
    Debris,
    /// A bead.
    Bead,
}

impl Kind {
    /// The name in files and in the status.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Larva => "larva",
            Self::Two => "two",
            Self::Bubble => "bubble",
            Self::Debris => "debris",
            Self::Bead => "bead",
        }
    }
}

/// The likelihood of each kind; they sum to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Likelihoods {
    /// Nothing.
    pub empty: f64,
    /// One larva.
    pub larva: f64,
    /// Two larvae or more.
    pub two: f64,
    /// Air, and no specimen.
    pub bubble: f64,
    /// Something small and irregular, and no specimen.
    pub debris: f64,
    /// A bead.
    pub bead: f64,
}

/// A side of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The left side.
    Left,
    /// The right side.
    Right,
}

/// The side towards which the head lies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(rename = "HeadInPicture"))]
pub struct Head {
    /// `None` where the picture does not show it, or there is not one larva.
    pub side: Option<Side>,
    /// From 0.5 (either side) to 1 for the side that is named. 0 without one.
    pub confidence: f64,
}

/// What was detected in a frame, with confidences from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Detection {
    /// The likeliest kind.
    pub kind: Kind,
    /// Its likelihood.
    pub confidence: f64,
    /// The likelihood of every kind.
    pub likelihoods: Likelihoods,
    /// Likelihood that the specimen extends beyond the left border of the picture.
    pub clipped_left: f64,
    /// Likelihood that it extends beyond the right border.
    pub clipped_right: f64,
    /// The side of the head.
    pub head: Head,
    /// Likelihood that the larva is dead: opaque throughout.
    pub dead: f64,
    /// Opacity that 95 % of the inner parts of the body exceed: 0 is clear, 1 is black. `None` without a body, and in files of versions
    /// that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<f64>,
}

/// From here on yes is more likely than no.
pub(super) const LIKELY: f64 = 0.5;
/// Least confidence with which a specimen is given up.
pub(super) const SURE: f64 = 0.8;

impl Detection {
    /// Why this well is not worth a revolution. `None` where it is, and where the picture does not show it surely enough: then
    /// the revolution decides.
    pub fn skip_reason(&self) -> Option<&'static str> {
        let sure = match self.kind {
            Kind::Larva | Kind::Bead => return None,
            Kind::Empty => LIKELY,
            Kind::Two | Kind::Bubble | Kind::Debris => SURE,
        };
        (self.confidence >= sure).then(|| self.kind.name())
    }

    /// Whether the specimen extends beyond the left border.
    pub fn is_clipped_left(&self) -> bool {
        self.clipped_left > LIKELY
    }

    /// Whether the specimen extends beyond the right border.
    pub fn is_clipped_right(&self) -> bool {
        self.clipped_right > LIKELY
    }

    /// Whether the larva looks dead.
    pub fn looks_dead(&self) -> bool {
        self.dead > LIKELY
    }
}
