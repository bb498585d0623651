//! Which blocks of the bore belong to the specimen.
//!
//! ```text
//!   level set -> pieces as large as a body -> the body --+--> closing -> holes -> opening -> pieces -> the specimen
//!                                  |                     |
//!                                  +-> specks beside it -+-> means of what is left: what is faint and connected to the body
//! ```
//! The level set is compact and sharp. Dust does not disturb it, but it loses what is transparent. Means over many blocks show
//! what is transparent, but a speck has as much contrast as a fin. So the specks beside the body are found first and not
//! averaged. What is faint is added to the body only with evidence that it is a part of it: each block is dark itself, and both
//! sides show. Whatever is fainter still has only its border, which [`super::fringe`] follows.

use super::bubble::{Bubbles, Disc};
use super::coarse::{Coarse, bent};
use super::faint::Faint;
use super::level_set::LevelSet;
use super::specks::Specks;
use crate::profile::bore::Bore;
use crate::profile::raster::plane::Plane;
use crate::profile::raster::region::{Pieces, Region, Scratch};
use crate::profile::settings::{Method, SegmentSettings};

/// Smallest piece of the level set that counts as body, share of the squared bore. Smaller ones are dust and debris.
const BODY_BORE2: f64 = 0.015;

/// Share of the contrast that is asked of a mean that a block must have itself. A mean reaches beyond the end of something dark, where a
/// block shows water. Smoothed as it is, a block's noise is a quarter of that share.
const OWN: f32 = 0.7;

/// Finds the blocks of the specimen. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct Hybrid {
    level_set: LevelSet,
    specks: Specks,
    faint: Faint,
    /// The specimen with its holes filled. Empty where nothing is large enough.
    pub specimen: Region,
    /// All foreground that is larger than a speck: the pieces of the specimen and others.
    pub pieces: Pieces,
    bubbles: Bubbles,
    near: Region,
    added: Region,
    sure: Region,
    /// For each column of pixels, the blocks on both sides and its place between their middles.
    columns: Vec<(usize, usize, f32)>,
    /// One row of blocks, interpolated between two rows.
    across: Vec<f32>,
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
            let (body, specks) = (&self.specks.body.set, &self.specks.blocks.set);
            self.faint.find(coarse, |i| coarse.within[i] && !body[i] && !specks[i]);
            let [least, sure] = [settings.faint_sigma, settings.faint_sure * settings.faint_sigma].map(|sigma| bent(sigma as f32));
            self.add_faint(coarse, least, sure);
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

    /// Adds what is faint and connected to the body: where the mean around a block and the block itself differ from water, as far as both
    /// sides show. What reaches a wall shows one side only, and the wall's shade or dirt on the glass would look the same. A piece is added
    /// only if its mean is `sure` somewhere: dust that is too fine for a speck raises many means to `least`. In a turn both are equal.
    fn add_faint(&mut self, coarse: &Coarse, least: f32, sure: f32) {
        let (w, within, mean, own) = (coarse.width, &coarse.within, &self.faint.contrast, &coarse.smooth[0]);
        self.added.take(w, within.iter().zip(mean).zip(own).map(|((within, mean), own)| *within && *mean >= least && *own >= OWN * least));
        let (added, body) = (&mut self.added.set, &self.specimen.set);
        added.iter_mut().zip(body).for_each(|(added, body)| *added &= !body);
        leave_walls(added, within, w);
        self.sure.take(w, added.iter().zip(mean).map(|(added, mean)| *added && *mean >= sure));
        self.sure.grow(|i| added[i], &mut self.scratch);
        let sure = &self.sure.set;
        self.specimen.grow(|i| sure[i], &mut self.scratch);
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
    pub fn mark_pixels(&mut self, coarse: &Coarse, bore: &Bore, inside: &mut Vec<bool>) {
        let (w, h, step) = (coarse.width, coarse.height, coarse.step);
        let middle = (step - 1) as f32 / 2.0;
        // Between the middles of blocks, a pixel is inside by bilinear interpolation of the four around it.
        let place = |at: usize, last: usize| {
            let x = ((at as f32 - middle) / step as f32).clamp(0.0, (last - 1) as f32);
            (x as usize, (x as usize + 1).min(last - 1), x - (x as usize) as f32)
        };
        let columns = &mut self.columns;
        columns.clear();
        columns.extend((0..bore.width).map(|u| place(u, w)));
        inside.clear();
        for v in 0..bore.height() {
            let (v0, v1, fv) = place(v, h);
            let (upper, lower) = (&self.specimen.set[v0 * w..][..w], &self.specimen.set[v1 * w..][..w]);
            let between = |(upper, lower): (&bool, &bool)| f32::from(*upper) + fv * (f32::from(*lower) - f32::from(*upper));
            self.across.clear();
            self.across.extend(upper.iter().zip(lower).map(between));
            let across = &self.across[..w];
            inside.extend(columns.iter().map(|&(u0, u1, fu)| across[u0] + fu * (across[u1] - across[u0]) > 0.5 - 1e-3));
        }
    }
}

/// Removes the blocks that reach a wall along their column.
fn leave_walls(set: &mut [bool], within: &[bool], width: usize) {
    let end = set.len();
    let is_at_wall = |i: usize| i < width || i + width >= end || !within[i - width] || !within[i + width];
    for i in 0..end {
        if !set[i] || !is_at_wall(i) {
            continue;
        }
        for on in [usize::checked_add, usize::checked_sub] {
            let mut next = Some(i);
            while let Some(at) = next.filter(|&at| at == i || at < end && set[at]) {
                set[at] = false;
                next = on(at, width);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::synthetic::bore;

    /// Between two blocks a mask rounds corners and moves no edge by more than half a pixel.
    #[test]
    fn blocks_become_the_pixels_that_they_cover() {
        let mut coarse = Coarse::of_lightness(10, vec![0.0; 100]);
        coarse.step = 3;
        let mut hybrid = Hybrid::default();
        hybrid.specimen.take(10, (0..100).map(|i| (3..7).contains(&(i % 10)) && (2..6).contains(&(i / 10))));
        let mut inside = Vec::new();
        hybrid.mark_pixels(&coarse, &bore(30, 30), &mut inside);
        let pixels = inside.iter().filter(|i| **i).count();
        assert!((4 * 4 * 9 - 8..=4 * 4 * 9 + 28).contains(&pixels), "{pixels}");
        assert!(inside[10 * 30 + 14] && !inside[10 * 30 + 7] && !inside[3 * 30 + 14]);
    }

    const WIDTH: usize = 120;
    const HEIGHT: usize = 60;

    /// The blocks that are added to a body in columns 10 .. 40 and rows 20 .. 40, where `extra` is the contrast of what is beside it. The
    /// walls hide 4 rows on each side.
    fn added(extra: impl Fn(usize, usize) -> f32) -> Vec<(usize, usize)> {
        let in_body = |u: usize, v: usize| (10..40).contains(&u) && (20..40).contains(&v);
        let mut noise = crate::profile::synthetic::Noise::new(21);
        let map = (0..WIDTH * HEIGHT).map(|i| {
            let (u, v) = (i % WIDTH, i / WIDTH);
            (if in_body(u, v) { 20.0 } else { extra(u, v) }) + noise.next() as f32
        });
        let mut coarse = Coarse::of_lightness(WIDTH, map.collect());
        coarse.step = 1;
        coarse.within = (0..WIDTH * HEIGHT).map(|i| (4..HEIGHT - 4).contains(&(i / WIDTH))).collect();
        let bore = bore(WIDTH, HEIGHT);
        let mut hybrid = Hybrid::default();
        hybrid.specimen.take(WIDTH, (0..WIDTH * HEIGHT).map(|i| in_body(i % WIDTH, i / WIDTH)));
        hybrid.specks.find(&coarse, &bore, &hybrid.specimen, &mut hybrid.scratch);
        let (body, specks) = (&hybrid.specks.body.set, &hybrid.specks.blocks.set);
        hybrid.faint.find(&coarse, |i| coarse.within[i] && !body[i] && !specks[i]);
        hybrid.add_faint(&coarse, 2.0, 4.0);
        let set = hybrid.specimen.set;
        (0..WIDTH * HEIGHT).map(|i| (i % WIDTH, i / WIDTH)).filter(|&(u, v)| set[v * WIDTH + u] && !in_body(u, v)).collect()
    }

    /// This contrast in these columns and rows.
    fn patch(contrast: f32, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> impl Fn(usize, usize) -> f32 {
        move |u, v| if columns.contains(&u) && rows.contains(&v) { contrast } else { 0.0 }
    }

    /// Of a fin of 400 blocks the border may be lost, and the mean over 9 blocks may not widen it.
    #[test]
    fn a_faint_fin_is_added_and_water_around_it_is_not() {
        let found = added(patch(4.0, 15..55, 10..20));
        let (within, beside) = found.iter().partition::<Vec<(usize, usize)>, _>(|(u, v)| (15..55).contains(u) && (10..20).contains(v));
        assert!(within.len() > 300, "{} of 400", within.len());
        let far = beside.iter().filter(|(u, v)| *v < 8 || *u < 13 || *u > 56 || *v > 41).count();
        assert!(far == 0 && beside.len() < 100, "{} beside, {far} of them far", beside.len());
    }

    /// Fine dust raises means to the least contrast, and nowhere to that of a fin.
    #[test]
    fn what_is_nowhere_dark_enough_is_not_added() {
        let found = added(patch(2.6, 15..55, 10..20));
        assert!(found.is_empty(), "{} blocks", found.len());
    }

    /// A shade that lies all along the wall shows no border on that side, whatever it is.
    #[test]
    fn what_reaches_a_wall_is_not_added() {
        for rows in [4..20, 40..56] {
            let found = added(patch(4.0, 15..55, rows.clone()));
            let at = found.iter().filter(|(u, v)| (15..38).contains(u) && rows.contains(v)).count();
            assert!(at < 30, "{at} of 368 blocks at rows {rows:?}");
        }
    }

    #[test]
    fn runs_leave_the_walls() {
        let rows = ["........", "#.##....", "#.#..#..", "..##.#..", "..#.....", "###...##", "........"];
        let mut set: Vec<bool> = rows.iter().flat_map(|row| row.chars().map(|c| c == '#')).collect();
        let within: Vec<bool> = (0..set.len()).map(|i| (1..6).contains(&(i / 8))).collect();
        leave_walls(&mut set, &within, 8);
        let left: Vec<usize> = (0..set.len()).filter(|&i| set[i]).collect();
        assert_eq!(left, [2 * 8 + 5, 3 * 8 + 3, 3 * 8 + 5]);
    }
}
