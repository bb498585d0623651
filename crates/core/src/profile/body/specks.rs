//! Specks: dust in the water, on the glass and on the window.
//!
//! ```text
//!   dark blocks beside the body -> connected pieces -> small, compact, in clear water = specks -> no longer in the maps
//! ```
//! Real frames have about 80 visible specks per 1000 px of bore, most of them 2 to 6 px wide and half of them within reach of the
//! fins. A speck that touches the body stays: a single view cannot tell it from a part of the body.

use super::coarse::{Coarse, bent};
use crate::profile::bore::Bore;
use crate::profile::raster::plane::{Plane, quantile};
use crate::profile::raster::region::{Pieces, Region, Scratch};

/// Darkness of a speck, standard deviations of a block's noise.
const DARK_SIGMA: f32 = 3.0;
/// Width of the body's blur, blocks. Nothing in it is a speck.
const BODY_RIM: usize = 1;
/// Largest area, share of the squared bore, and largest extent, share of the bore.
const MOST_BORE2: f64 = 0.02;
const MOST_BORE: f64 = 0.2;
/// A piece fills at least this share of the square of its extent. A piece of a fin's border is longer than wide.
const COMPACT: f64 = 0.4;
/// Pieces of this extent are compact in any case, blocks.
const SMALL: usize = 3;
/// Width of the ring that shows what surrounds a piece, blocks, and fewest blocks in it.
const RING: usize = 4;
const LEAST_RING: usize = 40;
/// Largest median contrast of that ring. A dark place inside something faint is not a speck.
const CLEAR_SIGMA: f32 = 1.0;
/// Width of a speck's own blur, blocks.
const SPECK_RIM: usize = 1;
/// Fewest pixels around a speck that tell what it hides.
const LEAST_PIXELS: usize = 8;

/// Finds specks. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct Specks {
    /// Blocks of the specks and of their blur.
    pub blocks: Region,
    /// The body and its blur.
    pub body: Region,
    pieces: Pieces,
    bounds: Vec<Bounds>,
    is_speck: Vec<bool>,
    around: Vec<f32>,
}

/// The blocks `left ..= right`, `top ..= bottom` around a piece.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

impl Bounds {
    const NONE: Self = Self { left: usize::MAX, right: 0, top: usize::MAX, bottom: 0 };

    fn add(&mut self, u: usize, v: usize) {
        (self.left, self.right) = (self.left.min(u), self.right.max(u));
        (self.top, self.bottom) = (self.top.min(v), self.bottom.max(v));
    }

    fn extent(&self) -> usize {
        (self.right - self.left).max(self.bottom - self.top) + 1
    }

    /// The rows and columns from `reach` before to `reach` beyond the bounds, in a map of that size.
    fn wider(&self, reach: usize, width: usize, height: usize) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let span = |from: usize, to: usize, end: usize| from.saturating_sub(reach)..(to + reach + 1).min(end);
        (span(self.top, self.bottom, height), span(self.left, self.right, width))
    }
}

impl Specks {
    /// Finds the specks outside of `body`.
    pub fn find(&mut self, coarse: &Coarse, bore: &Bore, body: &Region, scratch: &mut Scratch) {
        let (w, h) = (coarse.width, coarse.height);
        let bore_blocks = bore.mean_px / coarse.step as f64;
        self.body.copy(body);
        self.body.dilate(BODY_RIM, scratch);
        let beside = &self.body.set;
        let contrast = |i: usize| coarse.smooth[0][i].max(coarse.smooth[1][i].abs());
        let dark = bent(DARK_SIGMA);
        self.blocks.take(w, (0..w * h).map(|i| coarse.within[i] && !beside[i] && contrast(i) >= dark));
        self.pieces.find(&self.blocks, scratch);
        bounds(&self.pieces, w, &mut self.bounds);
        self.is_speck.clear();
        self.is_speck.resize(self.bounds.len(), false);
        let labels = &self.pieces.labels;
        for &(label, size) in &self.pieces.sizes {
            let own = self.bounds[label as usize];
            let (extent, area) = (own.extent() as f64, size as f64);
            let compact = own.extent() <= SMALL || area >= COMPACT * extent * extent;
            if area > MOST_BORE2 * bore_blocks * bore_blocks || extent > MOST_BORE * bore_blocks || !compact {
                continue;
            }
            let (rows, columns) = own.wider(RING, w, h);
            let inside = |u: usize, v: usize| (own.left..=own.right).contains(&u) && (own.top..=own.bottom).contains(&v);
            self.around.clear();
            for v in rows {
                let ring = columns.clone().filter(|&u| !inside(u, v)).map(|u| v * w + u);
                self.around.extend(ring.filter(|&i| coarse.within[i] && !beside[i]).map(contrast));
            }
            self.is_speck[label as usize] = self.around.len() >= LEAST_RING && quantile(&mut self.around, 0.5) <= CLEAR_SIGMA;
        }
        self.blocks.take(w, labels.iter().map(|&label| self.is_speck[label as usize]));
        self.blocks.dilate(SPECK_RIM, scratch);
        for (set, body) in self.blocks.set.iter_mut().zip(beside) {
            *set &= !body;
        }
    }

    /// Replaces the specks' pixels by the median of the pixels around them.
    pub fn remove_from(&mut self, plane: &mut Plane, coarse: &Coarse, scratch: &mut Scratch) {
        let (w, h, step) = (coarse.width, coarse.height, coarse.step);
        self.pieces.find(&self.blocks, scratch);
        bounds(&self.pieces, w, &mut self.bounds);
        let labels = &self.pieces.labels;
        let pixels = |block: usize, end: usize| block * step..((block + 1) * step).min(end);
        for &(label, _) in &self.pieces.sizes {
            let own = self.bounds[label as usize];
            self.around.clear();
            let (rows, columns) = own.wider(RING - SPECK_RIM, w, h);
            for t in rows {
                for k in columns.clone().filter(|k| labels[t * w + k] == 0 && coarse.within[t * w + k] && !self.body.set[t * w + k]) {
                    for v in pixels(t, plane.height) {
                        self.around.extend_from_slice(&plane.row(v)[pixels(k, plane.width)]);
                    }
                }
            }
            let level = if self.around.len() < LEAST_PIXELS { 0.0 } else { quantile(&mut self.around, 0.5) };
            for t in own.top..=own.bottom {
                for k in (own.left..=own.right).filter(|k| labels[t * w + k] == label) {
                    for v in pixels(t, plane.height) {
                        let columns = pixels(k, plane.width);
                        plane.data[v * plane.width..][columns].fill(level);
                    }
                }
            }
        }
    }
}

/// The bounds of each piece, by its label. Label 0 has none.
fn bounds(pieces: &Pieces, width: usize, bounds: &mut Vec<Bounds>) {
    bounds.clear();
    bounds.resize(pieces.sizes.len() + 1, Bounds::NONE);
    for (i, &label) in pieces.labels.iter().enumerate().filter(|(_, label)| **label > 0) {
        bounds[label as usize].add(i % width, i / width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::synthetic::{Noise, bore};

    const WIDTH: usize = 80;
    const HEIGHT: usize = 60;

    /// The blocks that are taken for specks beside a body in columns 10 .. 20, where `extra` is the contrast of everything else.
    fn specks(extra: impl Fn(usize, usize) -> f32) -> (Specks, Coarse) {
        let mut noise = Noise::new(9);
        let in_body = |u: usize| (10..20).contains(&u);
        let map = (0..WIDTH * HEIGHT).map(|i| {
            let (u, v) = (i % WIDTH, i / WIDTH);
            (if in_body(u) { 20.0 } else { extra(u, v) }) + 0.3 * noise.next() as f32
        });
        let coarse = Coarse::of_lightness(WIDTH, map.collect());
        let mut body = Region::default();
        body.take(WIDTH, (0..WIDTH * HEIGHT).map(|i| in_body(i % WIDTH)));
        let mut specks = Specks::default();
        specks.find(&coarse, &bore(WIDTH, HEIGHT), &body, &mut Scratch::default());
        (specks, coarse)
    }

    /// Contrast 9 in the blocks up to `reach` around (50, 30).
    fn dot(reach: [usize; 2]) -> impl Fn(usize, usize) -> f32 {
        move |u, v| if u.abs_diff(50) <= reach[0] && v.abs_diff(30) <= reach[1] { 9.0 } else { 0.0 }
    }

    fn is_speck(specks: &Specks) -> bool {
        specks.blocks.set[30 * WIDTH + 50]
    }

    #[test]
    fn what_is_small_compact_and_alone_is_a_speck() {
        assert!(is_speck(&specks(dot([1, 1])).0));
        assert!(!is_speck(&specks(dot([12, 12])).0), "a thing of 40 % of the bore");
        assert!(!is_speck(&specks(dot([6, 0])).0), "a piece of a fin's border");
        assert!(!is_speck(&specks(|u, v| dot([1, 1])(u, v).max(2.0)).0), "pigment on something faint");
        assert!(specks(|_, _| 0.0).0.blocks.set.iter().all(|set| !set), "nothing but noise");
    }

    #[test]
    fn what_touches_the_body_is_not_a_speck() {
        let (specks, _) = specks(|u, v| if u < 22 && v.abs_diff(30) <= 1 { 9.0 } else { 0.0 });
        let beside = |u: usize| specks.blocks.set[30 * WIDTH + u];
        assert!((8..=20).all(|u| !beside(u)), "the body and its rim");
    }

    #[test]
    fn a_speck_becomes_as_what_surrounds_it() {
        let (mut specks, coarse) = specks(|u, v| dot([1, 1])(u, v) + 0.5);
        let mut plane = Plane { width: WIDTH, height: HEIGHT, top: 0, data: coarse.lightness.clone() };
        specks.remove_from(&mut plane, &coarse, &mut Scratch::default());
        let at = |u: usize, v: usize| plane.data[v * WIDTH + u];
        assert!((at(50, 30) - 0.5).abs() < 0.15, "{}", at(50, 30));
        let changed = (0..WIDTH * HEIGHT).filter(|&i| plane.data[i].to_bits() != coarse.lightness[i].to_bits());
        assert!(
            changed.clone().all(|i| (i % WIDTH).abs_diff(50) <= 4 && (i / WIDTH).abs_diff(30) <= 4),
            "{:?}",
            changed.collect::<Vec<_>>()
        );
    }
}
