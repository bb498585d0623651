//! How far a profile is from an annotation: the outline that a person drew, or the true one of a simulation.
//!
//! ```text
//!            +-hump-+              false: in the profile, more than 2 px outside the annotated outline
//!      ------+      +-----.        hump:  a connected piece of false pixels
//!     (  profile           )       edge:  from points of the profile's outline to the nearest point of the annotated one,
//!      ----.      .-------'               positive outside
//!           `----'  missed         missed: not in the profile, more than 2 px inside the annotated outline
//! ```
//! An annotation is a mask, an outline at sub-pixel position, or both of one frame. The outline of a mask runs through the middles of the
//! sides between pixels inside and outside (marching squares). It also follows holes.

use super::Mask;
use super::raster::outline::{Crossings, Polygon, rasterise};
use super::raster::region::{Pieces, Region, Scratch};

/// Pixels nearer than this to the annotated outline are neither false nor missed, px. A person places an outline to about 1 px, and the
/// edge error has the rest.
pub const TOLERANCE_PX: f64 = 2.0;
/// Longest distance between two samples of an outline, px.
const STEP_PX: f64 = 0.5;
/// Side of the cells by which sides of the annotated outline are found, px.
const CELL_PX: f64 = 8.0;

/// An outline of a frame that profiles are compared with.
#[derive(Debug, Clone)]
pub struct Annotation {
    mask: Mask,
    sides: Sides,
}

/// The masks are of pictures of different sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what} is {}, the picture is {}", size(*.found), size(*.expected))]
pub struct SizesDiffer {
    /// The mask that differs.
    pub what: &'static str,
    /// Its width and height, px.
    pub found: [usize; 2],
    /// Width and height of the picture, px.
    pub expected: [usize; 2],
}

fn size([width, height]: [usize; 2]) -> String {
    format!("{width} x {height} px")
}

/// How a profile differs from an annotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Intersection over union of the masks; 1 if both are empty.
    pub iou: f64,
    /// Pixels of the profile.
    pub area_px: usize,
    /// Pixels of the annotation.
    pub annotation_area_px: usize,
    /// Distances between the outlines. `None` if one of them is missing or runs along the border of the picture only.
    pub edge: Option<EdgeError>,
    /// Pixels of the profile more than [`TOLERANCE_PX`] outside the annotated outline.
    pub false_px: usize,
    /// Pixels that the profile lacks, more than [`TOLERANCE_PX`] inside the annotated outline.
    pub missed_px: usize,
    /// Connected pieces of the false pixels; pixels that share a corner are connected.
    pub humps: usize,
    /// Pixels of the largest hump; 0 if there is none.
    pub largest_hump_px: usize,
}

/// Distances from the profile's outline to the nearest point of the annotated one, weighted by length. Points within 1 px of the border of
/// the picture do not count, because a specimen that leaves the picture has no edge there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeError {
    /// Mean, px; positive if the profile is too large.
    pub mean_px: f64,
    /// Mean of the absolute values, px.
    pub mean_abs_px: f64,
    /// 95th percentile of the absolute values, px.
    pub p95_abs_px: f64,
}

impl Annotation {
    /// The annotation by a mask.
    pub fn from_mask(mask: Mask) -> Self {
        let sides = Sides::new(marching_squares(&mask), &mask);
        Self { mask, sides }
    }

    /// The annotation by closed outlines that do not overlap, in pixel coordinates (pixel centres at integers) of a picture of that size. A
    /// pixel is inside if an outline encloses its centre.
    pub fn from_polygons(width: usize, height: usize, polygons: &[Polygon]) -> Self {
        let mut mask = Mask::empty(width, height);
        rasterise(polygons, &mut mask, &mut Crossings::default());
        let sides = Sides::new(polygons.iter().flat_map(clockwise_sides).collect(), &mask);
        Self { mask, sides }
    }

    /// The pixels inside.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Compares a profile with this annotation: its mask, and its outline at sub-pixel position in pixel coordinates.
    ///
    /// # Errors
    /// The mask has another size than the annotation.
    pub fn compare(&self, found: &Mask, outline: &[Polygon]) -> Result<Comparison, SizesDiffer> {
        self.check(found, "the mask of the profile")?;
        let beyond = |in_one: &Mask, in_other: &Mask| -> Region {
            let width = in_one.width();
            let differs = |at: usize| in_one.data()[at] != 0 && in_other.data()[at] == 0;
            let far = |at: usize| self.sides.distance([(at % width) as f64, (at / width) as f64], TOLERANCE_PX) > TOLERANCE_PX;
            Region { width, set: (0..in_one.data().len()).map(|at| differs(at) && far(at)).collect() }
        };
        let mut pieces = Pieces::default();
        pieces.find(&beyond(found, &self.mask), &mut Scratch::default());
        let humps = pieces.sizes.iter().map(|(_, size)| *size);
        Ok(Comparison {
            iou: found.iou(&self.mask),
            area_px: found.area_px(),
            annotation_area_px: self.mask.area_px(),
            edge: self.edge_error(outline),
            false_px: humps.clone().sum(),
            missed_px: beyond(&self.mask, found).set.iter().filter(|far| **far).count(),
            humps: humps.len(),
            largest_hump_px: humps.max().unwrap_or(0),
        })
    }

    /// The share of the fins that a profile has, 0 to 1. Fins are the pixels of this annotation outside the mask of the body. `None` if there
    /// are none.
    ///
    /// # Errors
    /// A mask has another size than the annotation.
    pub fn fins_found(&self, body: &Mask, found: &Mask) -> Result<Option<f64>, SizesDiffer> {
        self.check(body, "the mask of the body")?;
        self.check(found, "the mask of the profile")?;
        let fins = || self.mask.data().iter().zip(body.data()).zip(found.data()).filter(|((all, body), _)| **all != 0 && **body == 0);
        let count = fins().count();
        Ok((count > 0).then(|| fins().filter(|(_, found)| **found != 0).count() as f64 / count as f64))
    }

    fn check(&self, mask: &Mask, what: &'static str) -> Result<(), SizesDiffer> {
        let (found, expected) = ([mask.width(), mask.height()], [self.mask.width(), self.mask.height()]);
        if found == expected { Ok(()) } else { Err(SizesDiffer { what, found, expected }) }
    }

    fn edge_error(&self, outline: &[Polygon]) -> Option<EdgeError> {
        if self.sides.list.is_empty() {
            return None;
        }
        let mut samples: Vec<(f64, f64)> = Vec::new();
        for side in outline.iter().flat_map(clockwise_sides) {
            let [from, to] = side;
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            let count = (length / STEP_PX).ceil().max(1.0) as usize;
            for k in 0..count {
                let part = (k as f64 + 0.5) / count as f64;
                let at = [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])];
                if self.is_off_the_border(at) && length > 0.0 {
                    let distance = self.sides.distance(at, f64::INFINITY);
                    samples.push((if self.sides.enclose(at) { -distance } else { distance }, length / count as f64));
                }
            }
        }
        if samples.is_empty() {
            return None;
        }
        samples.sort_unstable_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        let total: f64 = samples.iter().map(|(_, length)| length).sum();
        let mean = |of: fn(f64) -> f64| samples.iter().map(|(d, length)| of(*d) * length).sum::<f64>() / total;
        let mut before = 0.0;
        let p95 = samples.iter().find(|(_, length)| {
            before += length;
            before >= 0.95 * total
        });
        Some(EdgeError { mean_px: mean(|d| d), mean_abs_px: mean(f64::abs), p95_abs_px: p95.or(samples.last())?.0.abs() })
    }

    /// More than 1 px from the border, which is half a pixel outside the first and last centres.
    fn is_off_the_border(&self, [u, v]: [f64; 2]) -> bool {
        let within = |x: f64, length: usize| x > 0.5 && x < length as f64 - 1.5;
        within(u, self.mask.width()) && within(v, self.mask.height())
    }
}

type Side = [[f64; 2]; 2];

/// The sides of an outline, so that all outlines enclose in the same sense.
fn clockwise_sides(polygon: &Polygon) -> Vec<Side> {
    let vertices = &polygon.vertices;
    let sides = || vertices.iter().zip(vertices.iter().cycle().skip(1)).map(|(from, to)| [*from, *to]);
    let doubled: f64 = sides().map(|[a, b]| a[0] * b[1] - b[0] * a[1]).sum();
    if doubled < 0.0 { sides().map(|[from, to]| [to, from]).collect() } else { sides().collect() }
}

/// The outline of a mask through the middles of the sides between pixels, clockwise around pixels inside. Beyond the picture nothing is
/// inside. Two pixels inside that share only a corner are separate.
fn marching_squares(mask: &Mask) -> Vec<Side> {
    let (width, height) = (mask.width() as isize, mask.height() as isize);
    let is = |u: isize, v: isize| u >= 0 && v >= 0 && u < width && v < height && mask.get(u as usize, v as usize);
    let mut sides = Vec::new();
    for v in -1..height {
        for u in -1..width {
            let (x, y) = (u as f64, v as f64);
            let (top, right, bottom, left) = ([x + 0.5, y], [x + 1.0, y + 0.5], [x + 0.5, y + 1.0], [x, y + 0.5]);
            // The pixels at the corners of this square, row by row.
            match [is(u, v), is(u + 1, v), is(u, v + 1), is(u + 1, v + 1)] {
                [false, false, false, false] | [true, true, true, true] => {}
                [true, false, false, false] => sides.push([top, left]),
                [false, true, false, false] => sides.push([right, top]),
                [false, false, false, true] => sides.push([bottom, right]),
                [false, false, true, false] => sides.push([left, bottom]),
                [true, true, false, false] => sides.push([right, left]),
                [false, true, false, true] => sides.push([bottom, top]),
                [false, false, true, true] => sides.push([left, right]),
                [true, false, true, false] => sides.push([top, bottom]),
                [false, true, true, true] => sides.push([left, top]),
                [true, false, true, true] => sides.push([top, right]),
                [true, true, true, false] => sides.push([right, bottom]),
                [true, true, false, true] => sides.push([bottom, left]),
                [true, false, false, true] => sides.extend([[top, left], [bottom, right]]),
                [false, true, true, false] => sides.extend([[right, top], [left, bottom]]),
            }
        }
    }
    sides
}

/// The sides of outlines, with a grid of cells over the picture: each cell has the sides that may pass through it. What is beyond the
/// picture belongs to the cells at its border; clamping moves no two points away from each other, so bounds by cells stay valid.
#[derive(Debug, Clone)]
struct Sides {
    list: Vec<Side>,
    cells: Vec<Vec<u32>>,
    columns: usize,
}

impl Sides {
    fn new(sides: Vec<Side>, of: &Mask) -> Self {
        let count = |length: usize| (length as f64 / CELL_PX).ceil().max(1.0) as usize;
        let (columns, rows) = (count(of.width()), count(of.height()));
        // Long sides are cut, so that each is in few cells.
        let short: Vec<Side> = sides.into_iter().flat_map(cut).collect();
        let mut all = Self { list: short, cells: vec![Vec::new(); columns * rows], columns };
        for (k, [from, to]) in all.list.iter().enumerate() {
            let ([c0, r0], [c1, r1]) = (cell_of(*from, columns, rows), cell_of(*to, columns, rows));
            for row in r0.min(r1)..=r0.max(r1) {
                for column in c0.min(c1)..=c0.max(c1) {
                    all.cells[row * columns + column].push(k as u32);
                }
            }
        }
        all
    }

    fn rows(&self) -> usize {
        self.cells.len() / self.columns
    }

    /// Distance to the nearest side, px. If no side is nearer than `limit`: any number from `limit` on, or infinity.
    fn distance(&self, at: [f64; 2], limit: f64) -> f64 {
        let (columns, rows) = (self.columns, self.rows());
        let [column, row] = cell_of(at, columns, rows);
        let mut nearest = f64::INFINITY;
        for ring in 0..columns.max(rows) {
            // Sides that are in no ring so far are at least this far away.
            if nearest.min(limit) <= (ring as f64 - 1.0) * CELL_PX {
                break;
            }
            for r in row.saturating_sub(ring)..=(row + ring).min(rows - 1) {
                let whole = r.abs_diff(row) == ring;
                for c in column.saturating_sub(ring)..=(column + ring).min(columns - 1) {
                    if whole || c.abs_diff(column) == ring {
                        let sides = self.cells[r * columns + c].iter().map(|&k| distance(&self.list[k as usize], at));
                        nearest = sides.fold(nearest, f64::min);
                    }
                }
            }
        }
        nearest
    }

    /// Whether the outlines wind around a point.
    fn enclose(&self, [u, v]: [f64; 2]) -> bool {
        let mut winding = 0;
        for [a, b] in &self.list {
            // Half open: a vertex on the row belongs to the side below it only.
            if (a[1] <= v) != (b[1] <= v) && a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) > u {
                winding += if a[1] <= v { 1 } else { -1 };
            }
        }
        winding != 0
    }
}

fn cut([from, to]: Side) -> impl Iterator<Item = Side> {
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let count = (length / CELL_PX).ceil().max(1.0) as usize;
    let at = move |k: usize| {
        let part = k as f64 / count as f64;
        // The ends stay as they are, so that outlines stay closed to the last bit.
        if k == count { to } else { [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])] }
    };
    (0..count).map(move |k| [at(k), at(k + 1)])
}

fn cell_of(at: [f64; 2], columns: usize, rows: usize) -> [usize; 2] {
    let cell = |x: f64, count: usize| ((x / CELL_PX).max(0.0) as usize).min(count - 1);
    [cell(at[0], columns), cell(at[1], rows)]
}

fn distance([a, b]: &Side, at: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [at[0] - a[0], at[1] - a[1]]);
    let squared = along[0] * along[0] + along[1] * along[1];
    let part = if squared > 0.0 { ((to[0] * along[0] + to[1] * along[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - part * along[0]).hypot(to[1] - part * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (120, 90);

    fn rectangle(u: [f64; 2], v: [f64; 2]) -> Polygon {
        Polygon { vertices: vec![[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]] }
    }

    fn circle([u, v]: [f64; 2], radius: f64) -> Polygon {
        let at = |k: usize| (k as f64 / 720.0 * std::f64::consts::TAU).sin_cos();
        Polygon { vertices: (0..720).map(at).map(|(sin, cos)| [u + radius * cos, v + radius * sin]).collect() }
    }

    fn annotation(polygons: &[Polygon]) -> Annotation {
        Annotation::from_polygons(SIZE.0, SIZE.1, polygons)
    }

    fn compared(annotated: &[Polygon], found: &[Polygon]) -> Comparison {
        annotation(annotated).compare(annotation(found).mask(), found).unwrap()
    }

    #[test]
    fn an_outline_equals_itself() {
        let polygon = rectangle([20.0, 80.0], [30.0, 50.0]);
        let same = compared(std::slice::from_ref(&polygon), std::slice::from_ref(&polygon));
        assert_eq!((same.iou, same.false_px, same.missed_px, same.humps, same.largest_hump_px), (1.0, 0, 0, 0, 0));
        let edge = same.edge.unwrap();
        assert!(edge.mean_abs_px < 1e-12 && edge.p95_abs_px < 1e-12, "{edge:?}");
        // The order of the vertices does not matter.
        let reversed = Polygon { vertices: polygon.vertices.iter().rev().copied().collect() };
        let larger = rectangle([19.0, 81.0], [29.0, 51.0]);
        for annotated in [polygon, reversed] {
            assert!(compared(&[annotated], std::slice::from_ref(&larger)).edge.unwrap().mean_px > 0.9);
        }
    }

    #[test]
    fn a_circle_that_is_too_large_or_too_small_by_a_known_amount() {
        let (middle, true_radius) = ([60.3, 44.6], 30.0);
        for off in [-3.0, -0.4, 0.25, 3.0] {
            let found = compared(&[circle(middle, true_radius)], &[circle(middle, true_radius + off)]);
            // A circle of 720 vertices lies up to 0.0003 px inside.
            let edge = found.edge.unwrap();
            for (value, expected) in [(edge.mean_px, off), (edge.mean_abs_px, off.abs()), (edge.p95_abs_px, off.abs())] {
                assert!((value - expected).abs() < 1e-3, "{off}: {edge:?}");
            }
            // A pixel counts if its centre is in the ring beyond 2 px: its area, to the pixels that the circles cut (about 1 in 10).
            let ring = std::f64::consts::PI * ((true_radius + off).powi(2) - (true_radius + off.signum() * 2.0).powi(2)).abs();
            let expected = if off.abs() > 2.0 { ring } else { 0.0 };
            let (beyond, none) = if off > 0.0 { (found.false_px, found.missed_px) } else { (found.missed_px, found.false_px) };
            assert!((beyond as f64 - expected).abs() <= 0.1 * expected, "{off}: {beyond} of {expected}");
            assert_eq!(none, 0);
            let areas = (true_radius / (true_radius + off)).powi(2);
            assert!((found.iou - areas.min(1.0 / areas)).abs() < 0.01, "{off}: {}", found.iou);
        }
    }

    /// Rows of pixels are 0.5, 1.5, 2.5, ... px beyond an outline that runs between pixels.
    #[test]
    fn humps_are_counted_and_measured_beyond_two_px() {
        let body = rectangle([19.5, 79.5], [29.5, 49.5]);
        // 10 px wide and 6 px high, of which 4 rows count; 5 x 3 px, of which 1 row counts; 4 x 2 px, of which none counts.
        let humps =
            [([29.5, 39.5], [23.5, 30.0]), ([59.5, 64.5], [49.0, 52.5]), ([44.5, 48.5], [27.5, 30.0])].map(|(u, v)| rectangle(u, v));
        let found: Vec<Polygon> = std::iter::once(body.clone()).chain(humps).collect();
        let with_humps = compared(std::slice::from_ref(&body), &found);
        assert_eq!((with_humps.false_px, with_humps.humps, with_humps.largest_hump_px, with_humps.missed_px), (45, 2, 40, 0));
        assert_eq!((with_humps.area_px, with_humps.annotation_area_px), (60 * 20 + 60 + 15 + 8, 60 * 20));
        assert!((with_humps.iou - 1200.0 / 1283.0).abs() < 1e-12);
        // The other way round the first hump is missed. From inside, its sides are near as well.
        let outline = [[19.5, 29.5], [29.5, 29.5], [29.5, 23.5], [39.5, 23.5], [39.5, 29.5], [79.5, 29.5], [79.5, 49.5], [19.5, 49.5]];
        let without = compared(&[Polygon { vertices: outline.to_vec() }], &[body]);
        assert_eq!((without.false_px, without.humps), (0, 0));
        // 10 x 6 px, open towards the body: 2 px less at the top and at both sides.
        assert_eq!(without.missed_px, 6 * 4);
    }

    /// The staircase of a mask is up to half a pixel off its outline. The middles of its sides are unbiased.
    #[test]
    fn the_outline_of_a_mask_is_that_of_its_shape() {
        for radius in [8.0, 21.3, 40.1] {
            let shape = circle([60.2, 44.9], radius);
            let by_mask = Annotation::from_mask(annotation(std::slice::from_ref(&shape)).mask().clone());
            let edge = by_mask.compare(by_mask.mask(), &[shape]).unwrap().edge.unwrap();
            assert!(edge.mean_px.abs() < 0.05 && edge.p95_abs_px < 0.5, "{radius}: {edge:?}");
        }
        let square = Annotation::from_mask(annotation(&[rectangle([19.5, 79.5], [29.5, 49.5])]).mask().clone());
        let edge = square.compare(square.mask(), &[rectangle([19.5, 79.5], [29.5, 49.5])]).unwrap().edge.unwrap();
        assert!(edge.p95_abs_px < 1e-9 && edge.mean_px.abs() < 0.02, "{edge:?}");
    }

    #[test]
    fn a_hole_of_a_mask_is_outside() {
        let mut mask = annotation(&[rectangle([9.5, 109.5], [9.5, 79.5])]).mask().clone();
        (40..60).for_each(|v| (50..70).for_each(|u| mask.set(u, v, false)));
        let annotation = Annotation::from_mask(mask);
        assert!(annotation.sides.enclose([45.0, 50.0]) && !annotation.sides.enclose([60.0, 50.0]));
        // A profile without the hole: all but the outermost 2 px of the hole are false.
        let whole = [rectangle([9.5, 109.5], [9.5, 79.5])];
        let mask = Annotation::from_polygons(SIZE.0, SIZE.1, &whole).mask().clone();
        let found = annotation.compare(&mask, &whole).unwrap();
        assert_eq!((found.false_px, found.humps, found.missed_px), (16 * 16, 1, 0));
    }

    #[test]
    fn the_border_of_the_picture_is_no_edge() {
        let (w, h) = (SIZE.0 as f64, SIZE.1 as f64);
        // The specimen leaves the picture on the right. The profile ends at the border, the annotation 1 px inside it.
        let annotated = rectangle([30.0, w - 1.0], [30.0, 60.0]);
        let edge = compared(&[annotated], &[rectangle([30.0, w - 0.5], [30.0, 60.0])]).edge.unwrap();
        assert!(edge.mean_abs_px < 1e-9, "{edge:?}");
        let whole = rectangle([-0.5, w - 0.5], [-0.5, h - 0.5]);
        assert_eq!(compared(std::slice::from_ref(&whole), std::slice::from_ref(&whole)).edge, None);
    }

    #[test]
    fn nothing_found_and_nothing_annotated() {
        let body = rectangle([19.5, 79.5], [29.5, 49.5]);
        let nothing = compared(&[], &[]);
        assert_eq!((nothing.iou, nothing.edge, nothing.false_px, nothing.missed_px), (1.0, None, 0, 0));
        let missed = compared(std::slice::from_ref(&body), &[]);
        assert_eq!((missed.iou, missed.edge, missed.false_px, missed.missed_px), (0.0, None, 0, 56 * 16));
        let invented = compared(&[], &[body]);
        assert_eq!((invented.iou, invented.edge, invented.false_px, invented.humps), (0.0, None, 60 * 20, 1));
    }

    #[test]
    fn the_share_of_the_fins_and_masks_of_other_sizes() {
        let (body, all) = (rectangle([19.5, 79.5], [29.5, 49.5]), rectangle([19.5, 79.5], [24.5, 49.5]));
        let annotated = annotation(&[all]);
        let (body, half) = (annotation(&[body]), annotation(&[rectangle([19.5, 49.5], [24.5, 49.5])]));
        assert_eq!(annotated.fins_found(body.mask(), half.mask()), Ok(Some(0.5)));
        assert_eq!(body.fins_found(body.mask(), half.mask()), Ok(None));
        let other = Mask::empty(119, 90);
        let differ = annotated.compare(&other, &[]).unwrap_err();
        assert_eq!(differ.to_string(), "the mask of the profile is 119 x 90 px, the picture is 120 x 90 px");
        assert!(annotated.fins_found(&other, body.mask()).unwrap_err().to_string().contains("the mask of the body is 119"));
    }

    /// The cells find the same distance as a search through all sides, also from points and to sides beyond the picture.
    #[test]
    fn the_nearest_side_is_the_nearest() {
        let mut state = 5u64;
        let mut any = |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * (state >> 40) as f64 / (1u64 << 24) as f64
        };
        for count in [1, 3, 12] {
            let sides: Vec<Side> = (0..count).map(|_| [[any(-9.0, 130.0), any(-9.0, 99.0)], [any(-9.0, 130.0), any(-9.0, 99.0)]]).collect();
            let index = Sides::new(sides.clone(), &Mask::empty(SIZE.0, SIZE.1));
            for _ in 0..400 {
                let at = [any(-30.0, 150.0), any(-30.0, 120.0)];
                let expected = sides.iter().map(|side| distance(side, at)).fold(f64::INFINITY, f64::min);
                let found = index.distance(at, f64::INFINITY);
                assert!((found - expected).abs() < 1e-9, "{at:?}: {found} for {expected}");
                let limited = index.distance(at, 5.0);
                assert!(
                    if expected < 5.0 { (limited - expected).abs() < 1e-9 } else { limited >= 5.0 },
                    "{at:?}: {limited} for {expected}"
                );
            }
        }
        assert!(Sides::new(Vec::new(), &Mask::empty(0, 0)).distance([3.0, 4.0], f64::INFINITY).is_infinite());
    }
}
