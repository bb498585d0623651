//! The specimen along the capillary: eyes, width, ends, and the likelihoods that follow from them.
//!
//! ```text
//!        ___-----____                          width      head blunt, tail pointed: which end is which
//!      (O            -------________           eyes       near the head's end; two places: two larvae
//!        ---______----      neck ^             neck       narrow between two wide places: two larvae
//! ```

use super::found::{Head, Side};
use super::opacity::{BODY, Grid};
use super::pieces::{BLACK, Piece, Things};
use super::probability::{logistic, noisy_or};

/// Half the width from which a solid black place may be an eye. An eye seen edge on has at least 0.1; a bladder's rim and
/// pigment have at most 0.08.
const EYE_BORE: f64 = 0.09;
const LEAST_EYE_BORE: f64 = 0.07;
/// Black places closer than this along the capillary are the two eyes of one head.
const HEAD_BORE: f64 = 0.4;
/// Distance of the bladder behind the eyes.
const BLADDER_BORE: std::ops::Range<f64> = 0.6..1.6;
/// Distance behind an end at which its width is taken. A head has its full width there, a tail a quarter.
const END_BORE: f64 = 0.5;

/// The eyes of one head: their position along the capillary from the left end, and half the width of the larger one.
#[derive(Debug, Clone, Copy)]
struct Eyes {
    at_bore: f64,
    radius_bore: f64,
}

#[derive(Debug)]
pub(in crate::profile) struct Body {
    /// Extent along the capillary.
    length_bore: f64,
    /// The eyes of the head with the largest eye.
    eyes: Option<Eyes>,
    /// Likelihood that any other black place is the eyes of another head.
    second_head: f64,
    /// Width near the left and the right end, share of the greatest. `None` where that end is not visible.
    ends: [Option<f64>; 2],
    /// Depth of the deepest neck: 1 - its width over the smaller one of the widths on both sides of it.
    neck: f64,
    /// The smaller width beside that neck.
    beside_neck_bore: f64,
    /// Opacity that 95 % of its inner parts exceed.
    least_opacity: f64,
    /// Likelihood that another piece is a larva.
    others: f64,
}

/// Measures bodies. The memory is reused from frame to frame.
#[derive(Debug, Default)]
pub(in crate::profile) struct BodyFinder {
    /// For each label, whether the piece belongs to the specimen.
    owned: Vec<bool>,
    /// Along the capillary: cells of the body, its width, and the greatest width from there on to the right.
    count: Vec<f64>,
    width: Vec<f64>,
    right: Vec<f64>,
    depth: Vec<f32>,
    groups: Vec<Group>,
}

/// A group of black places: first and last column, and the depth of the deepest, in cells.
#[derive(Debug, Clone, Copy)]
struct Group {
    from: usize,
    to: usize,
    radius: f32,
}

impl Group {
    fn eyes(&self, per_bore: f64, first: usize) -> Eyes {
        Eyes {
            at_bore: (self.from + self.to) as f64 / 2.0 / per_bore - first as f64 / per_bore,
            radius_bore: f64::from(self.radius) / per_bore,
        }
    }
}

impl BodyFinder {
    /// The specimen's body; `None` where there is none.
    pub fn find(&mut self, grid: &Grid, things: &Things) -> Option<Body> {
        let (labels, pieces) = (&things.labels, &things.pieces);
        // A larva that the segmentation missed is there nevertheless.
        let largest = pieces.iter().find(|p| p.in_mask).or_else(|| pieces.first().filter(|p| p.looks().larva > 0.5))?;
        // All other pieces do not belong to the specimen, except for a tail behind a transparent stretch, which is in the mask
        // and lies behind the body.
        let own = |p: &&Piece| p.label == largest.label || p.in_mask && !p.beside(largest);
        let owned = &mut self.owned;
        owned.clear();
        owned.resize(usize::from(u16::MAX) + 1, false);
        pieces.iter().filter(own).for_each(|p| owned[usize::from(p.label)] = true);
        // A leak of the mask into clear water has no width.
        let body = |at: usize| owned[usize::from(labels[at])] && grid.opacity[at] > BODY;
        let column = |u: usize| (0..grid.height).map(move |v| v * grid.width + u);
        let raw = &mut self.count;
        raw.clear();
        raw.extend((0..grid.width).map(|u| column(u).filter(|&at| body(at)).count() as f64 / grid.per_bore));
        let reach = (0.1 * grid.per_bore) as usize;
        let width = &mut self.width;
        width.clear();
        width.extend((0..raw.len()).map(|u| {
            let near = &raw[u.saturating_sub(reach)..(u + reach + 1).min(raw.len())];
            near.iter().sum::<f64>() / near.len() as f64
        }));
        // Pigment apart from the body is narrower than this.
        let seen = |w: &f64| *w > 0.06;
        let (first, last) = (width.iter().position(seen)?, width.iter().rposition(seen)?);
        let width = &width[first..=last];
        let greatest = width.iter().copied().fold(0.0, f64::max);
        let behind = ((END_BORE * grid.per_bore) as usize).min(width.len() - 1);
        let left = (first > reach).then(|| width[behind] / greatest);
        let right = (last + reach < grid.width - 1).then(|| width[width.len() - 1 - behind] / greatest);
        let (neck, beside_neck_bore) = neck(width, &mut self.right);
        heads(grid, &body, &mut self.depth, &mut self.groups);
        let length_bore = width.len() as f64 / grid.per_bore;
        let mut heads = self.groups.iter().map(|group| group.eyes(grid.per_bore, first));
        let eyes = heads.next();
        let second_head = eyes.map_or(0.0, |eyes| second_head(eyes, heads, length_bore));
        let depth = &mut self.depth;
        grid.depth(body, depth);
        let deep = (0.08 * grid.per_bore) as f32;
        let mut histogram = [0usize; 64];
        for at in (0..labels.len()).filter(|&at| depth[at] > deep) {
            histogram[((grid.opacity[at] * 64.0).max(0.0) as usize).min(63)] += 1;
        }
        let total: usize = histogram.iter().sum();
        let mut below = 0;
        let brightest = histogram.iter().position(|n| {
            below += n;
            20 * below > total
        });
        Some(Body {
            length_bore,
            eyes,
            second_head,
            ends: [left, right],
            neck,
            beside_neck_bore,
            least_opacity: brightest.unwrap_or(0) as f64 / 64.0,
            others: noisy_or(pieces.iter().filter(|p| !own(p)).map(|p| p.looks().larva)),
        })
    }
}

impl Body {
    /// Likelihood that it is more than one larva.
    pub fn two(&self) -> f64 {
        // In opaque tissue every place may be as black as an eye.
        let heads = self.second_head * (1.0 - self.dead());
        let neck = logistic(self.neck, 0.45, 0.12) * logistic(self.beside_neck_bore, 0.25, 0.06);
        // The longest larva in the narrowest bore in use has a ratio of 7.
        let long = logistic(self.length_bore, 7.5, 0.3);
        noisy_or([heads, neck, long, self.others])
    }

    /// The side of the head, from the logarithms of the odds that its eyes, its ends and its girth give.
    pub fn head(&self) -> Head {
        let [left, right] = self.ends;
        // An end that is not visible is further away than the border.
        let eyes = self.eyes.map_or(0.0, |eyes| {
            let to_left = eyes.at_bore + if left.is_some() { 0.0 } else { 1.0 };
            let to_right = self.length_bore - eyes.at_bore + if right.is_some() { 0.0 } else { 1.0 };
            3.0 * (to_right / to_left.max(0.1)).ln().clamp(-1.0, 1.0)
        });
        let bluntness = |end: Option<f64>| end.map_or(0.0, |w| 6.0 * (w - 0.5));
        let odds = eyes + bluntness(left) - bluntness(right);
        let right_side = 1.0 / (1.0 + odds.exp());
        if (right_side - 0.5).abs() < 0.1 {
            return Head { side: None, confidence: 0.0 };
        }
        let (side, confidence) = if odds > 0.0 { (Side::Left, 1.0 - right_side) } else { (Side::Right, right_side) };
        Head { side: Some(side), confidence }
    }

    /// Opacity that 95 % of its inner parts exceed.
    pub fn opacity(&self) -> f64 {
        self.least_opacity
    }

    /// Likelihood that it is dead: no bright regions are left. A living larva transmits half of the light somewhere.
    pub fn dead(&self) -> f64 {
        logistic(self.least_opacity, 0.445, 0.05)
    }
}

/// Likelihood that any of the other black places is the eyes of another head.
fn second_head(first: Eyes, others: impl Iterator<Item = Eyes>, length_bore: f64) -> f64 {
    noisy_or(others.map(|eyes| {
        let eye = logistic(eyes.radius_bore, EYE_BORE, 0.015);
        let apart = (eyes.at_bore - first.at_bore).abs();
        // Near the bladder, pigment over its dark rim may look like an eye. It is not one where the larger eye is near an end,
        // as the eyes of one larva are.
        let nearest = first.at_bore.min(length_bore - first.at_bore);
        if BLADDER_BORE.contains(&apart) { eye * logistic(nearest, 1.1, 0.2) } else { eye }
    }))
}

/// Finds the heads by their eyes: groups of solid black places, the one with the largest eye first. `depth` is memory.
fn heads(grid: &Grid, body: &impl Fn(usize) -> bool, depth: &mut Vec<f32>, groups: &mut Vec<Group>) {
    grid.depth(|at| body(at) && grid.opacity[at] > BLACK, depth);
    let gap = HEAD_BORE * grid.per_bore;
    groups.clear();
    for u in 0..grid.width {
        let deepest = (0..grid.height).map(|v| depth[v * grid.width + u]).fold(0.0, f32::max);
        if f64::from(deepest) < LEAST_EYE_BORE * grid.per_bore {
            continue;
        }
        match groups.last_mut() {
            Some(group) if (u - group.to) as f64 <= gap => (group.to, group.radius) = (u, group.radius.max(deepest)),
            _ => groups.push(Group { from: u, to: u, radius: deepest }),
        }
    }
    // Of two equally large groups the left one stays first.
    groups.sort_unstable_by(|a, b| b.radius.total_cmp(&a.radius).then(a.from.cmp(&b.from)));
}

/// The deepest place between two wider ones: its depth relative to the smaller of them, and the width of that one. `right` is
/// memory.
fn neck(width: &[f64], right: &mut Vec<f64>) -> (f64, f64) {
    right.clear();
    right.extend_from_slice(width);
    for u in (0..right.len().saturating_sub(1)).rev() {
        right[u] = right[u].max(right[u + 1]);
    }
    let mut left = 0.0f64;
    width.iter().zip(&*right).fold((0.0, 0.0), |best: (f64, f64), (&w, &right)| {
        left = left.max(w);
        let beside = left.min(right);
        let depth = 1.0 - w / beside.max(1e-9);
        // A deep neck between narrow places belongs to a tail.
        if depth * beside > best.0 * best.1 { (depth, beside) } else { best }
    })
}
