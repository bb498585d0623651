//! A profile column by column: where each column of the image enters and leaves it, to a fraction of a pixel.
//!
//! ```text
//!        upper[u]  ____----____        one column u of the image sees one slice of the specimen: its two edges are the
//!   u ->     _____/     |      \___    images of two tangents to that slice
//!            \_________ | ________/
//!        lower[u]      -+-             gap: px between the edges that the profile does not cover
//! ```

use crate::profile::{Mask, Polygon};

/// The edges of one column, px. v runs down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnEdges {
    /// Row in which the column enters the profile.
    pub upper: f64,
    /// Row in which the column leaves the profile.
    pub lower: f64,
    /// Length between the edges that is not covered: the slice is seen as hollow there, or as two bodies.
    pub gap: f64,
}

/// The edges of every column of a profile.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    edges: Vec<Option<ColumnEdges>>,
    height: usize,
}

impl Columns {
    /// The crossings of the outlines with the vertical through each column's centre. `width` and `height` are the image's, px.
    pub fn from_outlines(outlines: &[Polygon], width: usize, height: usize) -> Self {
        let mut crossings: Vec<Vec<(f64, i32)>> = vec![Vec::new(); width];
        let mut edges = vec![None; width];
        for polygon in outlines {
            let vertices = &polygon.vertices;
            crossings.iter_mut().for_each(Vec::clear);
            for (i, a) in vertices.iter().enumerate() {
                let b = vertices[(i + 1) % vertices.len()];
                let (from, to, way) = if a[0] <= b[0] { (*a, b, 1) } else { (b, *a, -1) };
                let mut u = from[0].ceil().max(0.0) as usize;
                // Half open: a vertex on a column belongs to the side right of it only.
                while (u as f64) < to[0] && u < width {
                    let part = (u as f64 - from[0]) / (to[0] - from[0]);
                    crossings[u].push((from[1] + part * (to[1] - from[1]), way));
                    u += 1;
                }
            }
            for (column, edge) in crossings.iter_mut().zip(&mut edges) {
                column.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                let mut winding = 0;
                for pair in column.windows(2) {
                    winding += pair[0].1;
                    if winding != 0 {
                        join(edge, pair[0].0, pair[1].0);
                    }
                }
            }
        }
        Self { edges, height }
    }

    /// The sides of a mask's pixels.
    pub fn from_mask(mask: &Mask) -> Self {
        Self::from_coverage(mask.width(), mask.height(), mask.data())
    }

    /// From anti-aliased coverage, row by row, 255 where a pixel is completely inside. A run of covered pixels is as long as
    /// the sum of its coverage.
    pub fn from_coverage(width: usize, height: usize, coverage: &[u8]) -> Self {
        let share = |u: usize, v: usize| f64::from(coverage[v * width + u]) / 255.0;
        let edges = (0..width)
            .map(|u| {
                let mut edge = None;
                let mut v = 0;
                while v < height {
                    if coverage[v * width + u] == 0 {
                        v += 1;
                        continue;
                    }
                    let first = v;
                    while v < height && coverage[v * width + u] > 0 {
                        v += 1;
                    }
                    if let Some((upper, lower)) = run(first, v, |v| share(u, v)) {
                        join(&mut edge, upper, lower);
                    }
                }
                edge
            })
            .collect();
        Self { edges, height }
    }

    /// The same with other edges, by column, and those of `missing` in the columns that have none.
    pub(crate) fn mapped(&self, missing: impl Fn(usize) -> Option<ColumnEdges>, edges: impl Fn(usize, ColumnEdges) -> ColumnEdges) -> Self {
        let of = |(u, own): (usize, &Option<ColumnEdges>)| own.map_or_else(|| missing(u), |own| Some(edges(u, own)));
        Self { edges: self.edges.iter().enumerate().map(of).collect(), height: self.height }
    }

    /// Columns of the image.
    pub fn width(&self) -> usize {
        self.edges.len()
    }

    /// Rows of the image.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The edges of column `u`. `None` where it shows nothing.
    pub fn get(&self, u: usize) -> Option<ColumnEdges> {
        self.edges.get(u).copied().flatten()
    }

    /// The edges between two columns, by linear interpolation. `None` where one of them shows nothing.
    pub fn at(&self, u: f64) -> Option<ColumnEdges> {
        let left = u.floor();
        if !(left >= 0.0 && left < self.edges.len() as f64) {
            return None;
        }
        let (a, part) = (self.get(left as usize)?, u - left);
        if part == 0.0 {
            return Some(a);
        }
        let b = self.get(left as usize + 1)?;
        let mix = |a: f64, b: f64| a + part * (b - a);
        Some(ColumnEdges { upper: mix(a.upper, b.upper), lower: mix(a.lower, b.lower), gap: a.gap.max(b.gap) })
    }

    /// First and last column that have edges. `None` where no column has.
    pub fn extent(&self) -> Option<(usize, usize)> {
        Some((self.edges.iter().position(Option::is_some)?, self.edges.iter().rposition(Option::is_some)?))
    }

    /// Intersection over union of the areas between the edges. 1 for two that show nothing.
    pub(crate) fn iou(&self, other: &Self) -> f64 {
        let (mut both, mut any) = (0.0, 0.0);
        for u in 0..self.width().max(other.width()) {
            let length = |e: Option<ColumnEdges>| e.map_or(0.0, |e| e.lower - e.upper);
            let (a, b) = (self.get(u), other.get(u));
            let shared = a.zip(b).map_or(0.0, |(a, b)| (a.lower.min(b.lower) - a.upper.max(b.upper)).max(0.0));
            both += shared;
            any += length(a) + length(b) - shared;
        }
        if any > 0.0 { both / any } else { 1.0 }
    }

    /// Area covered, px^2.
    pub fn area_px(&self) -> f64 {
        self.edges.iter().flatten().map(|e| e.lower - e.upper - e.gap).sum()
    }
}

/// Ends of a run of covered pixels `first..end`. `None` where no pixel of it counts as inside.
fn run(first: usize, end: usize, share: impl Fn(usize) -> f64) -> Option<(f64, f64)> {
    let inside = |v: usize| share(v) >= 128.0 / 255.0;
    if !(first..end).any(inside) {
        return None;
    }
    // From a pixel that is wholly inside, each end is as far as the coverage on its side reaches.
    if let Some(whole) = (first..end).find(|&v| share(v) >= 1.0) {
        let above: f64 = (first..whole).map(&share).sum();
        let below: f64 = (whole..end).map(&share).sum();
        return Some((whole as f64 - 0.5 - above, whole as f64 - 0.5 + below));
    }
    let (length, moment) = (first..end).fold((0.0, 0.0), |(s, m), v| (s + share(v), m + share(v) * v as f64));
    let middle = moment / length;
    Some((middle - length / 2.0, middle + length / 2.0))
}

/// Adds a run to a column.
fn join(edge: &mut Option<ColumnEdges>, upper: f64, lower: f64) {
    *edge = Some(match *edge {
        None => ColumnEdges { upper, lower, gap: 0.0 },
        Some(e) => {
            let covered = (e.lower - e.upper - e.gap) + (lower - upper);
            let (top, bottom) = (e.upper.min(upper), e.lower.max(lower));
            ColumnEdges { upper: top, lower: bottom, gap: (bottom - top - covered).max(0.0) }
        }
    });
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests {
    use super::*;

    /// Coverage of a tilted bar between two lines, by 32 x 32 samples per pixel.
    fn bar(upper: impl Fn(f64) -> f64, lower: impl Fn(f64) -> f64) -> Vec<u8> {
        let mut data = vec![0; 40 * 30];
        for v in 0..30 {
            for u in 0..40 {
                let hits = (0..1024)
                    .filter(|n| {
                        let x = u as f64 - 0.5 + (f64::from(n % 32) + 0.5) / 32.0;
                        let y = v as f64 - 0.5 + (f64::from(n / 32) + 0.5) / 32.0;
                        (upper(x)..lower(x)).contains(&y)
                    })
                    .count();
                data[v * 40 + u] = (hits as f64 / 1024.0 * 255.0).round() as u8;
            }
        }
        data
    }

    #[test]
    fn edges_lie_between_pixels_where_the_coverage_says() {
        let (upper, lower) = (|u: f64| 5.3 + 0.1 * u, |u: f64| 19.8 - 0.05 * u);
        let columns = Columns::from_coverage(40, 30, &bar(upper, lower));
        for u in 0..40 {
            let e = columns.get(u).unwrap();
            // 8 bits and 32 samples a pixel.
            assert!((e.upper - upper(u as f64)).abs() < 0.02 && (e.lower - lower(u as f64)).abs() < 0.02, "column {u}: {e:?}");
        }
        let half = columns.at(7.5).unwrap();
        assert!((half.upper - upper(7.5)).abs() < 0.02, "{half:?}");
        assert_eq!((columns.at(39.5), columns.at(-0.5), columns.extent()), (None, None, Some((0, 39))));
        // A sliver that fills no pixel has its place from its middle.
        let thin = Columns::from_coverage(40, 30, &bar(|_| 9.7, |_| 10.5)).get(3).unwrap();
        assert!((thin.upper - 9.7).abs() < 0.12 && (thin.lower - 10.5).abs() < 0.12, "{thin:?}");
    }

    #[test]
    fn outlines_are_cut_at_the_columns_centres() {
        let square = |u: f64, v: f64, a: f64| Polygon { vertices: vec![[u, v], [u + a, v], [u + a, v + a], [u, v + a]] };
        let columns = Columns::from_outlines(&[square(3.5, 4.25, 6.0), square(5.0, 20.0, 2.5)], 20, 30);
        assert_eq!(columns.get(4), Some(ColumnEdges { upper: 4.25, lower: 10.25, gap: 0.0 }));
        assert_eq!(columns.get(6), Some(ColumnEdges { upper: 4.25, lower: 22.5, gap: 9.75 }));
        assert_eq!(columns.extent(), Some((4, 9)));
        assert_eq!(columns.area_px(), 6.0 * 6.0 + 3.0 * 2.5);
    }

    #[test]
    fn two_squares_that_share_half_their_height_overlap_by_a_third() {
        let square =
            |v: f64| Columns::from_outlines(&[Polygon { vertices: vec![[2.5, v], [12.5, v], [12.5, v + 8.0], [2.5, v + 8.0]] }], 20, 30);
        assert!((square(4.0).iou(&square(8.0)) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!((square(4.0).iou(&square(4.0)), square(4.0).iou(&square(20.0))), (1.0, 0.0));
        assert_eq!(Columns::from_outlines(&[], 20, 30).iou(&Columns::from_outlines(&[], 20, 30)), 1.0);
    }

    #[test]
    fn a_mask_has_its_pixels_sides() {
        let mut mask = Mask::empty(4, 9);
        (2..5).for_each(|v| mask.set(1, v, true));
        let columns = Columns::from_mask(&mask);
        assert_eq!(columns.get(1), Some(ColumnEdges { upper: 1.5, lower: 4.5, gap: 0.0 }));
        assert_eq!(columns.get(0), None);
    }
}
