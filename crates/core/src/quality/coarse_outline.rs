//! The outline of a long specimen in a few numbers, by which a picture is known again after it was stored in another format.
//!
//! ```text
//!  columns of the outline ── stripes of 16 px ── mean upper and lower edge of each ── CoarseOutline ──┐
//!  a view of another well ── the same ────────────────────────────────────────────────────────────────┴── the same picture?
//! ```
//! Coding and noise move the mean edges of a stripe by a fraction of a pixel. A larva that comes into the capillary again, or another one, lies
//! elsewhere and has another shape. A sphere has nothing but its place and its size, so it has no coarse outline.

use crate::profile::Columns;
use crate::statistics::lower_quantile;
use serde::{Deserialize, Serialize};

/// Columns of a stripe, px.
const STRIPE: usize = 16;
/// A specimen as long as this multiple of its largest width or longer is no sphere.
const LONG: f64 = 1.8;
/// Least stripes of an outline.
const STRIPES_LEAST: usize = 8;
/// Share of the stripes of either outline that both must have.
const COMMON: f64 = 0.85;
/// In this share of the stripes the edges of one picture lie within the distances below. Fins that one segmentation finds and another misses are in
/// the others.
const SHARE: f64 = 0.75;
/// Largest distance of the edges of one picture, px. Of 24 larvae of the second renderer, 351 of 360 views were nearer after JPEG of 90 and 75 %,
/// noise of 2 grey levels, rounding and another gain; fins were found in the others that were missed before, or the other way round. 2376
/// pairs of views of different larvae were at least 2.35 px apart.
const SAME_PX: f64 = 0.6;

/// The mean edges of an outline in stripes of 16 columns. The first stripe begins at the left border of the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CoarseOutline {
    /// Number of the first stripe that the specimen fills.
    pub first: usize,
    /// Upper and lower edge in each stripe from there on, px, to a hundredth.
    pub edges_px: Vec<[f64; 2]>,
}

impl CoarseOutline {
    /// `None` for a round specimen, and for one that fills fewer than 8 stripes.
    pub fn of(outline: &Columns) -> Option<Self> {
        let (from, to) = outline.extent()?;
        let first = from.div_ceil(STRIPE);
        let edges_px: Vec<[f64; 2]> = (first..(to + 1) / STRIPE)
            .map_while(|stripe| {
                let mut sum = [0.0; 2];
                for u in stripe * STRIPE..(stripe + 1) * STRIPE {
                    let edges = outline.get(u)?;
                    sum = [sum[0] + edges.upper, sum[1] + edges.lower];
                }
                Some(sum.map(|sum| (100.0 * sum / STRIPE as f64).round() / 100.0))
            })
            .collect();
        let widest = edges_px.iter().map(|[upper, lower]| lower - upper).fold(0.0, f64::max);
        let is_long = (to - from + 1) as f64 >= LONG * widest;
        (is_long && edges_px.len() >= STRIPES_LEAST).then_some(Self { first, edges_px })
    }

    /// Whether both are the outline of one picture.
    pub fn is_same(&self, other: &Self) -> bool {
        self.distance_px(other).is_some_and(|px| px <= SAME_PX)
    }

    /// Distance of the edges in three quarters of the stripes, px. `None` where the outlines have too few stripes in common.
    pub fn distance_px(&self, other: &Self) -> Option<f64> {
        let (from, to) = (self.first.max(other.first), self.end().min(other.end()));
        let longest = self.edges_px.len().max(other.edges_px.len());
        if to < from || ((to - from) as f64) < COMMON * longest as f64 {
            return None;
        }
        let of = |outline: &Self| outline.edges_px[from - outline.first..to - outline.first].to_vec();
        let apart = of(self).into_iter().zip(of(other)).map(|(a, b)| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()));
        lower_quantile(apart.collect(), SHARE)
    }

    fn end(&self) -> usize {
        self.first + self.edges_px.len()
    }
}
