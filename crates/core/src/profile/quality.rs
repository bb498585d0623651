//! How far a profile can be trusted, in figures measured on it.

use super::Polygon;
use super::bore::Bore;
use super::edge::finder::EdgePoint;
use serde::{Deserialize, Serialize};

/// Figures of one profile. Those of the edge are over the vertices where the specimen's own edge can be seen.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ProfileQuality {
    /// Median height of the step at the edge, in standard deviations of a pixel's noise.
    pub edge_contrast_sigma: f64,
    /// Root mean square of the edge's standard error, px. 0 without an edge.
    pub edge_error_px: f64,
    /// Share of the outline whose position is uncertain by more than half a pixel.
    pub uncertain_share: f64,
    /// Share of the outline that lies on a wall.
    pub wall_contact_share: f64,
    /// Share of the outline that lies on the picture's left or right border: the specimen extends beyond it.
    #[serde(default)]
    pub border_share: f64,
    /// Pieces of foreground larger than a speck, whether or not they belong to the specimen.
    pub components: usize,
    /// Share of saturated pixels in the bore: where the light saturates, faint tissue is lost.
    pub saturated_share: f64,
    /// Noise of a pixel, grey values, mean of the colours.
    pub noise_grey: f64,
    /// Blur at the specimen's edge, px, comparable to the configured `edge.blur_px`. `None` where the edge does not determine
    /// it.
    #[serde(default)]
    pub blur_px: Option<f64>,
}

const UNCERTAIN_PX: f64 = 0.5;

/// Measures the edge figures of `edge`, whose vertices `points` describes one by one; `contrasts` is memory.
pub(super) fn of_edge(edge: &[Polygon], points: &[Vec<EdgePoint>], bore: &Bore, contrasts: &mut Vec<f64>) -> ProfileQuality {
    contrasts.clear();
    let (mut total, mut uncertain, mut touching, mut cut, mut squares) = (0usize, 0usize, 0usize, 0usize, 0.0);
    let last_u = (bore.width - 1) as f64;
    for (polygon, record) in edge.iter().zip(points) {
        for (&[u, v], point) in polygon.vertices.iter().zip(record) {
            total += 1;
            if point.bounded {
                let walls = &bore.walls;
                cut += usize::from(u < 0.5 || u > last_u - 0.5);
                touching += usize::from(v - walls.upper.inner.at(u) < 1.0 || walls.lower.inner.at(u) - v < 1.0);
                continue;
            }
            contrasts.push(point.contrast);
            let error = point.error_px;
            uncertain += usize::from(error > UNCERTAIN_PX);
            // An edge that cannot be placed at all is not known to be further off than the search reaches.
            squares += error.min(4.0).powi(2);
        }
    }
    if total == 0 {
        return ProfileQuality::default();
    }
    contrasts.sort_unstable_by(f64::total_cmp);
    let seen = contrasts.len();
    ProfileQuality {
        // The upper median, within the buffer: a warm segmenter allocates nothing.
        edge_contrast_sigma: contrasts.get(seen / 2).copied().unwrap_or(0.0),
        edge_error_px: if seen > 0 { (squares / seen as f64).sqrt() } else { 0.0 },
        uncertain_share: uncertain as f64 / total as f64,
        wall_contact_share: touching as f64 / total as f64,
        border_share: cut as f64 / total as f64,
        ..ProfileQuality::default()
    }
}
