//! Combines what the pieces and the body look like into one answer for the frame.

use super::fish::{Body, BodyFinder};
use super::found::{Detection, Head, Kind, Likelihoods};
use super::opacity::Grid;
use super::pieces::{Piece, Things};
use super::probability::noisy_or;
use crate::profile::Mask;
use crate::profile::body::bubble::Disc;
use crate::profile::bore::Bore;
use crate::profile::raster::plane::Plane;

/// Detects; keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct Detector {
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
    let larva = noisy_or(looks().map(|(p, l)| l.larva + cut(p) * l.debris));
    // Something round that the segmentation did not take for a specimen is too small for one.
    let bead = noisy_or(looks().map(|(p, l)| if p.in_mask { l.bead } else { 0.0 }));
    let bubble = noisy_or(looks().map(|(_, l)| l.bubble));
    let debris = noisy_or(looks().map(|(p, l)| (1.0 - cut(p)) * l.debris + if p.in_mask { 0.0 } else { l.bead }));
    let two = body.map_or(0.0, Body::two);
    // What there is goes by what matters most: debris beside a larva is a larva's picture.
    let mut left = 1.0;
    let [larva, bead, bubble, debris] = [larva, bead, bubble, debris].map(|p| {
        let share = left * p;
        left -= share;
        share
    });
    // Each piece is one of the four: what they leave over is nobody's but where there may be nothing at all.
    let something = noisy_or(looks().map(|(_, l)| l.larva + l.bead + l.bubble + l.debris));
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
    Detection { kind, confidence, likelihoods, clipped_left, clipped_right, head, dead, opacity: body.map(Body::opacity) }
}
