//! Air bubbles: round, black, with a small bright middle. They are cut off the specimen that they touch.
//!
//! ```text
//!   opacity of the blocks -> black, filled -> deepest places -> discs that stand free, with a bright middle = bubbles
//!   specimen less the discs -> what the discs hid is bridged by the straight way across
//! ```
//! An eye is as black and as round, but has no bright middle. The bright middle of a bead is most of it.

use super::coarse::Coarse;
use crate::profile::raster::region::{Region, Scratch};

/// A bubble, in blocks of the coarse map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::profile) struct Disc {
    pub u: f64,
    pub v: f64,
    pub radius: f64,
}

impl Disc {
    pub fn holds(&self, u: f64, v: f64) -> bool {
        (u - self.u).hypot(v - self.v) <= self.radius + RIM
    }

    /// Whether a place of the picture is in a bubble or its blur. For discs in px.
    pub fn near(&self, at: [f64; 2]) -> bool {
        (at[0] - self.u).hypot(at[1] - self.v) <= self.radius + BLUR_PX
    }
}

/// Opacity from which on a block is black.
const BLACK: f32 = 0.6;
/// Opacity of a bubble's ring: 0.92. Dead tissue and plugs have up to 0.87.
const RING: f32 = 0.88;
/// Upper limit of the opacity around a bubble. Every body has more, so that a swim bladder does not count.
const CLEAR: f32 = 0.12;
/// Smallest radius of a disc that shows its middle, blocks.
const LEAST_RADIUS: f64 = 4.0;
/// Width of the blur around a bubble, blocks.
const RIM: f64 = 1.2;
/// The same in px of the picture.
const BLUR_PX: f64 = 5.0;
/// Share of the circle around a bubble that must be clear. The rest may touch the specimen.
const FREE_SHARE: f64 = 0.5;
/// The middle transmits more light than the ring by at least this share of the ring's opacity.
const BRIGHT_MIDDLE: f32 = 0.4;
/// A middle that is larger than this share of the disc is that of a bead.
const MIDDLE_SHARE: f64 = 0.15;

#[derive(Debug, Default)]
pub(in crate::profile) struct Bubbles {
    pub discs: Vec<Disc>,
    tried: Vec<Disc>,
    black: Region,
    depth: Vec<f32>,
    order: Vec<usize>,
    rest: Region,
    bridged: Region,
}

impl Bubbles {
    /// Finds the bubbles in the bore.
    pub fn find(&mut self, coarse: &Coarse, scratch: &mut Scratch) {
        let w = coarse.width;
        self.discs.clear();
        self.tried.clear();
        self.black.take(w, coarse.opacity.iter().zip(&coarse.within).map(|(o, within)| *within && *o > BLACK));
        self.black.fill_holes(&coarse.within, scratch);
        self.black.depth(&mut self.depth);
        self.order.clear();
        self.order.extend((0..self.depth.len()).filter(|&i| f64::from(self.depth[i]) >= LEAST_RADIUS));
        self.order.sort_unstable_by(|&a, &b| self.depth[b].total_cmp(&self.depth[a]).then(a.cmp(&b)));
        for &at in &self.order {
            let disc = Disc { u: (at % w) as f64, v: (at / w) as f64, radius: f64::from(self.depth[at]) };
            // The deepest place of each black thing decides about all of it.
            if self.tried.iter().any(|d| d.holds(disc.u, disc.v)) {
                continue;
            }
            self.tried.push(disc);
            if is_bubble(coarse, disc) {
                self.discs.push(disc);
            }
        }
    }

    /// Cuts the bubbles off a specimen that is more than bubbles.
    pub fn cut(&mut self, specimen: &mut Region, least: f64, scratch: &mut Scratch) {
        if self.discs.is_empty() {
            return;
        }
        let w = specimen.width;
        let hidden = |i: usize| self.discs.iter().any(|d| d.holds((i % w) as f64, (i / w) as f64));
        self.rest.take(w, specimen.set.iter().enumerate().map(|(i, set)| *set && !hidden(i)));
        self.rest.open(1, scratch);
        if (self.rest.set.iter().filter(|set| **set).count() as f64) < least {
            return;
        }
        let widest = self.discs.iter().map(|d| d.radius).fold(0.0, f64::max);
        self.bridged.copy(&self.rest);
        self.bridged.close(widest.ceil() as usize + 1, scratch);
        for (i, set) in specimen.set.iter_mut().enumerate() {
            *set = self.rest.set[i] || (*set && hidden(i) && self.bridged.set[i]);
        }
    }
}

fn is_bubble(coarse: &Coarse, disc: Disc) -> bool {
    const TURNS: usize = 32;
    let (w, h) = (coarse.width as f64, (coarse.opacity.len() / coarse.width) as f64);
    let opacity = |u: f64, v: f64| {
        let (u, v) = (u.round(), v.round());
        (u >= 0.0 && v >= 0.0 && u < w && v < h).then(|| coarse.opacity[v as usize * coarse.width + u as usize])
    };
    let around = |radius: f64| {
        (0..TURNS).map(move |k| {
            let (sin, cos) = (k as f64 / TURNS as f64 * std::f64::consts::TAU).sin_cos();
            (disc.u + radius * cos, disc.v + radius * sin)
        })
    };
    let free = around(disc.radius + 2.5).filter(|&(u, v)| opacity(u, v).is_none_or(|o| o < CLEAR)).count();
    let (sum, seen) = around(0.6 * disc.radius).filter_map(|(u, v)| opacity(u, v)).fold((0.0, 0), |(sum, n), o| (sum + o, n + 1));
    let ring = sum / seen.max(1) as f32;
    let reach = disc.radius as i64;
    let (mut all, mut bright, mut least) = (0usize, 0usize, f32::INFINITY);
    for dv in -reach..=reach {
        for du in -reach..=reach {
            let off = (du as f64).hypot(dv as f64);
            let Some(o) = (off <= 0.9 * disc.radius).then(|| opacity(disc.u + du as f64, disc.v + dv as f64)).flatten() else { continue };
            all += 1;
            bright += usize::from(o < BLACK);
            if off <= 0.35 * disc.radius + 1.0 {
                least = least.min(o);
            }
        }
    }
    free as f64 >= FREE_SHARE * TURNS as f64
        && ring > RING
        && least < (1.0 - BRIGHT_MIDDLE) * ring
        && (bright as f64) < MIDDLE_SHARE * all as f64
}
