//! Which pixels of the bore differ from the empty bore.
//!
//! ```text
//! (background - seen) / sigma, per colour -> lightness and colour contrast -> two scales -> hysteresis
//!      -> closing -> holes filled -> components -> the specimen
//! ```
//! A fine scale keeps thin things, a coarse one finds what is fainter than the noise of a pixel: a fin of 2 grey values is
//! 5 standard deviations of a smoothed frame. What is coarse here does not blur the edge, which is placed later.

use super::background::{Background, Bore};
use super::plane::{Plane, quantile};
use super::settings::SegmentSettings;

/// The foreground of the window.
pub(super) struct Foreground {
    /// One flag per pixel of the window: the specimen, holes filled; all false where nothing is large enough.
    pub inside: Vec<bool>,
    /// How many pieces there are, specks left out.
    pub components: usize,
}

/// Light taken away, in standard deviations of one pixel's noise: the mean of the colours. Near the walls the doubt about
/// their place counts as noise.
pub(super) fn contrast(seen: &[Plane], backgrounds: &[Background]) -> Plane {
    mean_of(seen, backgrounds, |background, at, grey| (background.level.data[at] - grey) / background.sigma.data[at])
}

/// The share of light taken away, in units in which it equals [`contrast`] in mid-bore. A specimen before the dark line of a
/// wall takes the same share as beside it, so its edge goes on there.
pub(super) fn darkness(seen: &[Plane], backgrounds: &[Background]) -> Plane {
    mean_of(seen, backgrounds, |background, at, grey| {
        let level = background.level.data[at].max(1.0);
        (level - grey) / level * background.mid_level / background.noise
    })
}

fn mean_of(seen: &[Plane], backgrounds: &[Background], of: impl Fn(&Background, usize, f32) -> f32) -> Plane {
    let mut mean = Plane::filled(seen[0].width, seen[0].height, seen[0].top, 0.0);
    let share = 1.0 / seen.len() as f32;
    for (plane, background) in seen.iter().zip(backgrounds) {
        for (at, (out, &grey)) in mean.data.iter_mut().zip(&plane.data).enumerate() {
            *out += share * of(background, at, grey);
        }
    }
    mean
}

/// Blue against red, in standard deviations: yellowish tissue that is hardly darker than the light.
fn colour(seen: &[Plane], backgrounds: &[Background]) -> Option<Plane> {
    let (first, last) = (seen.first()?, seen.last()?);
    if seen.len() < 3 {
        return None;
    }
    let mut difference = Plane::filled(first.width, first.height, first.top, 0.0);
    let (a, b) = (&backgrounds[0], &backgrounds[seen.len() - 1]);
    for (i, out) in difference.data.iter_mut().enumerate() {
        *out = (b.level.data[i] - last.data[i]) / b.sigma.data[i] - (a.level.data[i] - first.data[i]) / a.sigma.data[i];
    }
    Some(difference)
}

fn clip(map: &Plane, sigma: f64) -> Plane {
    let limit = sigma as f32;
    Plane { data: map.data.iter().map(|m| m.clamp(-limit, limit)).collect(), ..*map }
}

/// Scales a map so that its noise is 1, measured over the pixels in `empty`.
fn normalise(map: &mut Plane, empty: &[bool]) {
    let mut sizes: Vec<f32> = map.data.iter().zip(empty).filter(|(_, e)| **e).map(|(m, _)| m.abs()).collect();
    let sigma = (quantile(&mut sizes, 0.5) / 0.6745).max(1e-3);
    for m in &mut map.data {
        *m /= sigma;
    }
}

pub(super) fn find(bore: &Bore, seen: &[Plane], backgrounds: &[Background], settings: &SegmentSettings) -> Foreground {
    let within = within_walls(bore, settings.wall_margin_px);
    // Clipped, a body and a fin have nearly the same contrast, and smoothing spreads neither far: unclipped, a black eye's
    // smoothed rim would pass any threshold that finds a fin at 9 px from the eye.
    let clipped = clip(&contrast(seen, backgrounds), settings.clip_sigma);
    let mut maps = vec![clipped.smoothed(settings.fine_px), clipped.smoothed(settings.coarse_px)];
    maps.extend(colour(seen, backgrounds).map(|c| clip(&c, settings.clip_sigma).smoothed(settings.coarse_px)));
    let free = &backgrounds[backgrounds.len() / 2].free;
    let empty: Vec<bool> = within.iter().enumerate().map(|(at, w)| *w && free[at % bore.width]).collect();
    for map in &mut maps {
        normalise(map, &empty);
    }
    let score: Vec<f32> =
        (0..within.len()).map(|i| if within[i] { maps.iter().map(|m| m.data[i].abs()).fold(0.0, f32::max) } else { 0.0 }).collect();
    let (w, h) = (bore.width, bore.height());
    let mut inside = hysteresis(&score, w, settings.low_sigma as f32, settings.high_sigma as f32);
    inside = close(&inside, w, h, settings.closing_px);
    for (flag, &w) in inside.iter_mut().zip(&within) {
        *flag &= w;
    }
    fill_holes(&mut inside, &within, w);
    inside = open(&inside, w, h, settings.opening_px);
    keep_specimen(&inside, w, bore, settings)
}

/// Pixels whose centre lies at least `margin_px` inside both inner wall lines.
fn within_walls(bore: &Bore, margin_px: f64) -> Vec<bool> {
    let mut within = vec![false; bore.width * bore.height()];
    for u in 0..bore.width {
        let (from, to) = (bore.walls.upper.inner.at(u as f64) + margin_px, bore.walls.lower.inner.at(u as f64) - margin_px);
        for v in 0..bore.height() {
            let row = (bore.top + v) as f64;
            within[v * bore.width + u] = row >= from && row <= to;
        }
    }
    within
}

/// The neighbours of pixel `at` in a window `width` wide: 4 of them, or 8 with the diagonals.
fn neighbours(at: usize, width: usize, len: usize, diagonals: bool) -> impl Iterator<Item = usize> {
    const STEPS: [(isize, isize); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    let (u, v) = ((at % width) as isize, (at / width) as isize);
    let (w, h) = (width as isize, (len / width) as isize);
    STEPS[..if diagonals { 8 } else { 4 }].iter().filter_map(move |(du, dv)| {
        let (u, v) = (u + du, v + dv);
        ((0..w).contains(&u) && (0..h).contains(&v)).then_some((v * w + u) as usize)
    })
}

/// Pixels of at least `low` that hang together with one of at least `high`.
fn hysteresis(score: &[f32], width: usize, low: f32, high: f32) -> Vec<bool> {
    let mut inside: Vec<bool> = score.iter().map(|&s| s >= high).collect();
    let mut stack: Vec<usize> = (0..score.len()).filter(|&i| inside[i]).collect();
    while let Some(at) = stack.pop() {
        for next in neighbours(at, width, score.len(), true) {
            if !inside[next] && score[next] >= low {
                inside[next] = true;
                stack.push(next);
            }
        }
    }
    inside
}

/// Grows the set by a disc.
fn dilate(set: &[bool], w: usize, h: usize, radius: usize) -> Vec<bool> {
    let mut grown = vec![false; set.len()];
    let r = radius as isize;
    for v in 0..h {
        let row = &set[v * w..(v + 1) * w];
        if !row.contains(&true) {
            continue;
        }
        for dv in -r..=r {
            let to = v as isize + dv;
            if !(0..h as isize).contains(&to) {
                continue;
            }
            // A radius of r + 1/2 makes rounder small discs than r.
            let half = ((radius as f64 + 0.5).powi(2) - (dv * dv) as f64).sqrt() as usize;
            let out = &mut grown[to as usize * w..(to as usize + 1) * w];
            let mut u = 0;
            while u < w {
                if !row[u] {
                    u += 1;
                    continue;
                }
                let from = u;
                while u < w && row[u] {
                    u += 1;
                }
                out[from.saturating_sub(half)..(u + half).min(w)].fill(true);
            }
        }
    }
    grown
}

fn erode(set: &[bool], w: usize, h: usize, radius: usize) -> Vec<bool> {
    let outside: Vec<bool> = set.iter().map(|s| !s).collect();
    dilate(&outside, w, h, radius).iter().map(|s| !s).collect()
}

/// Bridges gaps narrower than twice the radius. The border counts as a continuation of what is there.
fn close(set: &[bool], w: usize, h: usize, radius: usize) -> Vec<bool> {
    erode(&dilate(set, w, h, radius), w, h, radius)
}

/// Removes whiskers narrower than twice the radius.
fn open(set: &[bool], w: usize, h: usize, radius: usize) -> Vec<bool> {
    dilate(&erode(set, w, h, radius), w, h, radius)
}

/// Visits each connected piece of `of`: calls back with its pixels.
fn pieces(of: &[bool], width: usize, diagonals: bool, mut each: impl FnMut(&[usize])) {
    let mut seen = vec![false; of.len()];
    let mut piece = Vec::new();
    for start in 0..of.len() {
        if !of[start] || seen[start] {
            continue;
        }
        piece.clear();
        piece.push(start);
        seen[start] = true;
        let mut next = 0;
        while next < piece.len() {
            for n in neighbours(piece[next], width, of.len(), diagonals) {
                if of[n] && !seen[n] {
                    seen[n] = true;
                    piece.push(n);
                }
            }
            next += 1;
        }
        each(&piece);
    }
}

/// Fills background that is shut in by the specimen alone: the bright swim bladder, a bead's clear centre. What reaches a
/// wall is open water, also where the specimen touches the wall on both sides of it.
fn fill_holes(inside: &mut [bool], within: &[bool], width: usize) {
    let free: Vec<bool> = inside.iter().zip(within).map(|(i, w)| *w && !i).collect();
    let mut holes = Vec::new();
    pieces(&free, width, false, |piece| {
        if !piece.iter().any(|&at| neighbours(at, width, within.len(), false).any(|n| !within[n])) {
            holes.extend_from_slice(piece);
        }
    });
    for at in holes {
        inside[at] = true;
    }
}

/// Keeps the largest piece, and pieces of some size that nearly touch what is kept: a tail beyond a transparent stretch.
fn keep_specimen(inside: &[bool], width: usize, bore: &Bore, settings: &SegmentSettings) -> Foreground {
    let bore_area = bore.mean_px * bore.mean_px;
    let (speck, least) = (settings.speck_bore2 * bore_area, settings.min_area_bore2 * bore_area);
    let mut found: Vec<Vec<usize>> = Vec::new();
    pieces(inside, width, true, |piece| {
        if piece.len() as f64 >= speck {
            found.push(piece.to_vec());
        }
    });
    found.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    let mut kept = vec![false; inside.len()];
    if found.first().is_some_and(|largest| largest.len() as f64 >= least) {
        let reach = (settings.join_gap_bore * bore.mean_px).round() as usize;
        let mut near: Option<Vec<bool>> = None;
        for piece in &found {
            if near.as_ref().is_none_or(|near| piece.iter().any(|&at| near[at])) {
                for &at in piece {
                    kept[at] = true;
                }
                near = Some(dilate(&kept, width, bore.height(), reach));
            }
        }
    }
    Foreground { inside: kept, components: found.len() }
}
