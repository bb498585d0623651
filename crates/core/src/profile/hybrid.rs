//! Which blocks of the bore belong to the specimen.
//!
//! ```text
//!   level set -> pieces as large as a body -> the body --+--> closing -> holes -> opening -> pieces -> the specimen
//!                                  |                     |
//!                                  +-> specks beside it -+-> means of what is left: what is faint and connected to the body
//! ```
//! The level set is compact and sharp. Dust does not disturb it, but it loses what is transparent. Means over many blocks show
//! what is transparent, but a speck has as much contrast as a fin. So the specks beside the body are found first and not
//! averaged. Whatever is fainter still has only its border, which [`super::fringe`] follows.

use super::background::Bore;
use super::bubble::{Bubbles, Disc};
use super::coarse::{Coarse, bent};
use super::faint::Faint;
use super::level_set::LevelSet;
use super::plane::Plane;
use super::region::{Pieces, Region, Scratch};
use super::settings::{Method, SegmentSettings};
use super::specks::Specks;

/// Smallest piece of the level set that counts as body, share of the squared bore. Smaller ones are dust and debris.
const BODY_BORE2: f64 = 0.015;

/// The contrast of a faint piece falls at its border by at least this share of the contrast at which foreground is continued.
const OWN_EDGE: f32 = 0.6;

/// Blur of a body's edge, blocks. It would connect all faint pieces around the body.
const RIM_BLOCKS: usize = 2;

/// Finds the blocks of the specimen. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Hybrid {
    level_set: LevelSet,
    specks: Specks,
    faint: Faint,
    /// The specimen with its holes filled. Empty where nothing is large enough.
    pub specimen: Region,
    /// All foreground that is larger than a speck: the pieces of the specimen and others.
    pub pieces: Pieces,
    bubbles: Bubbles,
    near: Region,
    /// Sum and number of the steps around each piece.
    steps: Vec<(f32, u32)>,
    scratch: Scratch,
}

impl Hybrid {
    pub fn find(&mut self, coarse: &Coarse, bore: &Bore, settings: &SegmentSettings) {
        self.level_set.run(coarse, &settings.level_set);
        let phi = &self.level_set.phi;
        self.specimen.take(coarse.width, coarse.within.iter().zip(phi).map(|(within, phi)| *within && *phi > 0.0));
        if settings.method == Method::Hybrid {
            self.keep_bodies(coarse, bore);
            self.specks.find(coarse, bore, &self.specimen, &mut self.scratch);
            self.near.copy(&self.specimen);
            let (body, specks) = (&self.specks.body.set, &self.specks.blocks.set);
            self.faint.find(coarse, |i| coarse.within[i] && !body[i] && !specks[i]);
            let (faint, least) = (&self.faint.contrast, bent(settings.faint_sigma as f32));
            self.specimen.grow(|i| coarse.within[i] && faint[i] >= least, &mut self.scratch);
            self.drop_shades(coarse, least);
        }
        self.tidy(coarse, settings);
        self.keep_specimen(coarse, bore, settings);
        self.bubbles.discs.clear();
        if settings.method == Method::Hybrid {
            self.bubbles.find(coarse, &mut self.scratch);
            let least = settings.min_area_bore2 * (bore.mean_px / coarse.step as f64).powi(2);
            self.bubbles.cut(&mut self.specimen, least, &mut self.scratch);
        }
    }

    /// Removes what is too small for a body.
    fn keep_bodies(&mut self, coarse: &Coarse, bore: &Bore) {
        let least = BODY_BORE2 * (bore.mean_px / coarse.step as f64).powi(2);
        self.pieces.find(&self.specimen, &mut self.scratch);
        // The pieces are sorted by size, and their labels are not.
        let bodies = self.pieces.sizes.partition_point(|(_, size)| *size as f64 >= least);
        let bodies = &self.pieces.sizes[..bodies];
        for (set, label) in self.specimen.set.iter_mut().zip(&self.pieces.labels) {
            *set &= bodies.iter().any(|(body, _)| body == label);
        }
    }

    /// Removes the specks that were found from the pixels of the bore's window.
    pub fn remove_specks(&mut self, plane: &mut Plane, coarse: &Coarse) {
        self.specks.remove_from(plane, coarse, &mut self.scratch);
    }

    /// Bubbles in the way of the specimen's edge, px of the picture.
    pub fn bubbles(&self, coarse: &Coarse, bore: &Bore) -> impl Iterator<Item = Disc> {
        let (step, middle, top) = (coarse.step as f64, (coarse.step - 1) as f64 / 2.0, bore.top as f64);
        let discs: &[Disc] = &self.bubbles.discs;
        discs.iter().map(move |d| Disc { u: d.u * step + middle, v: d.v * step + middle + top, radius: d.radius * step })
    }

    /// Removes what was added to the certain part, `near`, and has no edge of its own. Where the background's model has an
    /// error, contrast fades slowly into the bore; where a fin ends, it falls in a step.
    fn drop_shades(&mut self, coarse: &Coarse, low: f32) {
        let (w, len) = (coarse.width, coarse.within.len());
        self.near.dilate(RIM_BLOCKS, &mut self.scratch);
        for (certain, set) in self.near.set.iter_mut().zip(&self.specimen.set) {
            *certain = *set && !*certain;
        }
        self.pieces.find(&self.near, &mut self.scratch);
        self.steps.clear();
        self.steps.resize(self.pieces.sizes.len() + 1, (0.0, 0));
        let score = |i: usize| coarse.smooth[0][i].abs().max(coarse.smooth[1][i].abs());
        let (w, h) = (w as isize, (len / w) as isize);
        for v in 0..h {
            for u in 0..w {
                let at = (v * w + u) as usize;
                let label = self.pieces.labels[at] as usize;
                if label == 0 {
                    continue;
                }
                for (du, dv) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                    // Two blocks outside against one inside. The blur of the blocks lies in between.
                    let (one, two, back) = ((u + du, v + dv), (u + 2 * du, v + 2 * dv), (u - du, v - dv));
                    let index = |(u, v): (isize, isize)| {
                        ((0..w).contains(&u) && (0..h).contains(&v)).then_some((v * w + u) as usize).filter(|&i| coarse.within[i])
                    };
                    if let (Some(one), Some(two), Some(back)) = (index(one), index(two), index(back))
                        && !self.specimen.set[one]
                        && !self.specimen.set[two]
                    {
                        self.steps[label].0 += score(back) - score(two);
                        self.steps[label].1 += 1;
                    }
                }
            }
        }
        for (set, &label) in self.specimen.set.iter_mut().zip(&self.pieces.labels) {
            let (sum, n) = self.steps[label as usize];
            if label != 0 && sum < OWN_EDGE * low * n.max(1) as f32 {
                *set = false;
            }
        }
    }

    fn tidy(&mut self, coarse: &Coarse, settings: &SegmentSettings) {
        let radius = |px: usize| (px as f64 / coarse.step as f64).round() as usize;
        let (region, scratch) = (&mut self.specimen, &mut self.scratch);
        region.close(radius(settings.closing_px), scratch);
        for (set, within) in region.set.iter_mut().zip(&coarse.within) {
            *set &= within;
        }
        region.fill_holes(&coarse.within, scratch);
        region.open(radius(settings.opening_px), scratch);
    }

    /// Keeps the largest piece, and larger pieces that nearly touch what is kept, such as a tail beyond a transparent stretch.
    fn keep_specimen(&mut self, coarse: &Coarse, bore: &Bore, settings: &SegmentSettings) {
        let bore2 = (bore.mean_px / coarse.step as f64).powi(2);
        let (speck, least) = (settings.speck_bore2 * bore2, settings.min_area_bore2 * bore2);
        self.pieces.find(&self.specimen, &mut self.scratch);
        self.pieces.sizes.retain(|(_, size)| *size as f64 >= speck);
        let Some(&(largest, size)) = self.pieces.sizes.first() else {
            self.specimen.set.fill(false);
            return;
        };
        let labels = &self.pieces.labels;
        self.specimen.take(coarse.width, labels.iter().map(|&l| l == largest && size as f64 >= least));
        if size as f64 >= least {
            let reach = (settings.join_gap_bore * bore.mean_px / coarse.step as f64).round() as usize;
            for &(label, _) in &self.pieces.sizes[1..] {
                self.near.copy(&self.specimen);
                self.near.dilate(reach, &mut self.scratch);
                if labels.iter().zip(&self.near.set).any(|(l, near)| *l == label && *near) {
                    for (set, _) in self.specimen.set.iter_mut().zip(labels).filter(|(_, l)| **l == label) {
                        *set = true;
                    }
                }
            }
        }
    }

    /// Marks the pixels of the bore's window that the specimen's blocks cover, with rounded corners.
    pub fn to_pixels(&self, coarse: &Coarse, bore: &Bore, inside: &mut Vec<bool>) {
        let (w, h, step) = (coarse.width, coarse.height, coarse.step);
        let middle = (step - 1) as f32 / 2.0;
        // Between the middles of blocks, a pixel is inside by bilinear interpolation of the four around it.
        let place = |at: usize, last: usize| {
            let x = ((at as f32 - middle) / step as f32).clamp(0.0, (last - 1) as f32);
            (x as usize, (x as usize + 1).min(last - 1), x.fract())
        };
        inside.clear();
        for v in 0..bore.height() {
            let (v0, v1, fv) = place(v, h);
            for u in 0..bore.width {
                let (u0, u1, fu) = place(u, w);
                let is = |u: usize, v: usize| f32::from(self.specimen.set[v * w + u]);
                let (upper, lower) = (is(u0, v0) + fu * (is(u1, v0) - is(u0, v0)), is(u0, v1) + fu * (is(u1, v1) - is(u0, v1)));
                inside.push(upper + fv * (lower - upper) > 0.5 - 1e-3);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::bore;
    use super::*;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 40;

    /// A body in columns 10..20 from wall to wall; to its right, as far as `beside` is above 1, something faint that was grown on to it. Gives
    /// the number of its columns that are kept.
    fn kept(beside: impl Fn(f32) -> f32) -> usize {
        let contrast = |u: usize| {
            if (10..20).contains(&u) {
                30.0
            } else if u >= 20 {
                beside(u as f32 - 19.5)
            } else {
                0.0
            }
        };
        let map = (0..WIDTH * HEIGHT).map(|i| contrast(i % WIDTH)).collect();
        let coarse = Coarse::of_lightness(WIDTH, map);
        let mut hybrid = Hybrid::default();
        let set = |least: f32| (0..WIDTH * HEIGHT).map(move |i| (i, least));
        hybrid.near.take(WIDTH, set(20.0).map(|(i, least)| coarse.lightness[i] > least));
        hybrid.specimen.take(WIDTH, set(1.0).map(|(i, least)| coarse.lightness[i] > least));
        hybrid.drop_shades(&coarse, 1.3);
        (20 + RIM_BLOCKS..WIDTH).filter(|u| hybrid.specimen.set[20 * WIDTH + u]).count()
    }

    #[test]
    fn a_shade_that_fades_is_dropped_and_what_ends_in_a_step_is_kept() {
        assert_eq!(kept(|out| 3.0 - 0.1 * out), 0, "a ramp has no edge of its own");
        assert_eq!(kept(|out| if out < 15.0 { 2.0 } else { 0.0 }), 15 - RIM_BLOCKS, "a fin of 2 sigma has");
    }

    /// Between two blocks a mask rounds corners and moves no edge by more than half a pixel.
    #[test]
    fn blocks_become_the_pixels_that_they_cover() {
        let mut coarse = Coarse::of_lightness(10, vec![0.0; 100]);
        coarse.step = 3;
        let mut hybrid = Hybrid::default();
        hybrid.specimen.take(10, (0..100).map(|i| (3..7).contains(&(i % 10)) && (2..6).contains(&(i / 10))));
        let mut inside = Vec::new();
        hybrid.to_pixels(&coarse, &bore(30, 30), &mut inside);
        let pixels = inside.iter().filter(|i| **i).count();
        assert!((4 * 4 * 9 - 8..=4 * 4 * 9 + 28).contains(&pixels), "{pixels}");
        assert!(inside[10 * 30 + 14] && !inside[10 * 30 + 7] && !inside[3 * 30 + 14]);
    }
}
