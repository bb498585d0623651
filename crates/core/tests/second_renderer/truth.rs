//! The true silhouette of a frame: its pixels and its outline.

use crate::scene::Frame;
use carved_core::profile::{Mask, Polygon};
use std::collections::BTreeMap;

/// The pixels of which the specimen covers at least half; `covered` is one of the frame's coverages.
pub fn mask(frame: &Frame, covered: &[f32]) -> Mask {
    let mut mask = Mask::empty(frame.width, frame.height);
    for (i, _) in covered.iter().enumerate().filter(|(_, c)| **c >= 0.5) {
        mask.set(i % frame.width, i / frame.width, true);
    }
    mask
}

/// Where the coverage is one half, by marching squares: closed outlines at sub-pixel positions. The specimen must not touch the border.
pub fn outlines(frame: &Frame) -> Vec<Polygon> {
    type Pixel = (usize, usize);
    // Each square of four pixel centres joins the pair of pixels where its border leaves the silhouette, going clockwise, to the pair where it
    // enters again. Its neighbour goes through that pair in the other direction and leaves there.
    let mut next: BTreeMap<(Pixel, Pixel), (Pixel, Pixel)> = BTreeMap::new();
    let value = |(u, v): Pixel| f64::from(frame.covered[v * frame.width + u]) - 0.5;
    for (v, u) in (0..frame.height - 1).flat_map(|v| (0..frame.width - 1).map(move |u| (v, u))) {
        let corners = [(u, v), (u + 1, v), (u + 1, v + 1), (u, v + 1)];
        let is_inside = corners.map(|c| value(c) >= 0.0);
        for leaving in (0..4).filter(|&i| is_inside[i] && !is_inside[(i + 1) % 4]) {
            let entering = (leaving + 1..leaving + 4).map(|i| i % 4).find(|&i| !is_inside[i] && is_inside[(i + 1) % 4]).unwrap();
            next.insert((corners[leaving], corners[(leaving + 1) % 4]), (corners[(entering + 1) % 4], corners[entering]));
        }
    }
    let mut outlines = Vec::new();
    while let Some((first, mut to)) = next.pop_first() {
        let mut vertices = Vec::new();
        loop {
            let (inside, outside) = to;
            let part = value(inside) / (value(inside) - value(outside));
            let between = |a: usize, b: usize| a as f64 + part * (b as f64 - a as f64);
            vertices.push([between(inside.0, outside.0), between(inside.1, outside.1)]);
            if to == first {
                break;
            }
            to = next.remove(&to).unwrap();
        }
        outlines.push(Polygon { vertices });
    }
    outlines
}
