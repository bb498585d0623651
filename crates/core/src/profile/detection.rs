//! Detects what a frame shows: nothing, one larva or two, a bead, air, debris; how it lies, and whether it is completely in
//! view.
//!
//! ```text
//!   opacity on a grid of 1/48 bore -> pieces -> what each piece looks like ---------> empty, larva, two, bubble, debris, bead
//!                                       │
//!                                       └─ the body: eyes, width along it, ends ----> two, head, dead, clipped
//! ```
//! Each question is a soft threshold on one measured figure, so that an answer near its threshold has a low confidence. The
//! answers are combined as if they were independent. The six kinds sum to 1. Lengths are in bores, so that they hold at any
//! magnification.

use super::Mask;
use super::background::Bore;
use super::body::{Body, BodyFinder};
use super::bubble::Disc;
use super::opacity::Grid;
use super::pieces::{Piece, Things};
use super::plane::Plane;
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
}

/// From here on yes is more likely than no.
const LIKELY: f64 = 0.5;
/// Least confidence with which a specimen is given up.
const SURE: f64 = 0.8;

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

/// A soft threshold: 0.5 at `mid`, 0.9 at `width` above it, 0.1 at `width` below.
pub(super) fn above(x: f64, mid: f64, width: f64) -> f64 {
    1.0 / (1.0 + (-(x - mid) / width * 9f64.ln()).exp())
}

/// Whether any of some independent things is so.
pub(super) fn any(of: impl IntoIterator<Item = f64>) -> f64 {
    1.0 - of.into_iter().map(|p| 1.0 - p).product::<f64>()
}

/// Detects; keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Detector {
    grid: Grid,
    things: Things,
    body: BodyFinder,
}

impl Detector {
    /// Decides by the darkness of the bore, in which the loss of all light counts `all_light`; `bubbles` are those found in it.
    pub fn detect(&mut self, mask: &Mask, bore: &Bore, darkness: &Plane, all_light: f32, bubbles: &[Disc]) -> Detection {
        self.grid.fill(mask, bore, darkness, all_light, bubbles);
        self.things.find(&self.grid);
        decide(&self.things.pieces, self.body.find(&self.grid, &self.things).as_ref(), self.grid.clipped())
    }
}

fn decide(pieces: &[Piece], body: Option<&Body>, [clipped_left, clipped_right]: [f64; 2]) -> Detection {
    let looks = || pieces.iter().map(|p| (p, p.looks()));
    // What reaches out of the picture is more than is seen of it: a tail by itself has no body's look.
    let cut = |p: &Piece| if p.in_mask { clipped_left.max(clipped_right) } else { 0.0 };
    let larva = any(looks().map(|(p, l)| l.larva + cut(p) * l.debris));
    // Something round that the segmentation did not take for a specimen is too small for one.
    let bead = any(looks().map(|(p, l)| if p.in_mask { l.bead } else { 0.0 }));
    let bubble = any(looks().map(|(_, l)| l.bubble));
    let debris = any(looks().map(|(p, l)| (1.0 - cut(p)) * l.debris + if p.in_mask { 0.0 } else { l.bead }));
    let two = body.map_or(0.0, Body::two);
    // What there is goes by what matters most: debris beside a larva is a larva's picture.
    let mut left = 1.0;
    let [larva, bead, bubble, debris] = [larva, bead, bubble, debris].map(|p| {
        let share = left * p;
        left -= share;
        share
    });
    // Each piece is one of the four: what they leave over is nobody's but where there may be nothing at all.
    let something = any(looks().map(|(_, l)| l.larva + l.bead + l.bubble + l.debris));
    let scale = if left < 1.0 { something / (1.0 - left) } else { 0.0 };
    let likelihoods = Likelihoods {
        empty: 1.0 - something,
        larva: scale * larva * (1.0 - two),
        two: scale * larva * two,
        bubble: scale * bubble,
        debris: scale * debris,
        bead: scale * bead,
    };
    let l = &likelihoods;
    let kinds = [
        (Kind::Empty, l.empty),
        (Kind::Larva, l.larva),
        (Kind::Two, l.two),
        (Kind::Bubble, l.bubble),
        (Kind::Debris, l.debris),
        (Kind::Bead, l.bead),
    ];
    let (kind, confidence) = kinds.into_iter().fold((Kind::Empty, 0.0), |best, next| if next.1 > best.1 { next } else { best });
    let head = match (body, kind) {
        (Some(body), Kind::Larva) => body.head(),
        _ => Head { side: None, confidence: 0.0 },
    };
    let dead = body.map_or(0.0, |b| larva * b.dead());
    Detection { kind, confidence, likelihoods, clipped_left, clipped_right, head, dead }
}
