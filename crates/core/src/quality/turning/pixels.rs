//! Two pictures of the bore, compared pixel by pixel.
//!
//! ```text
//!   grey of the bore ── difference ── less light, shift and vibration (least squares on 1, g, dg/du, dg/dv) ── squares of 8 x 8 px
//!                                     ├─ inside both outlines:  median of the mean squares ─┐
//!                                     └─ beside both outlines:  median of the mean squares ─┴─ ratio: 1 where only noise changed
//! ```

use crate::profile::{Columns, Picture, Walls};
use nalgebra::{Matrix4, Vector4};

/// The grey values of the rows between the walls.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BorePicture {
    width: usize,
    /// First row of the picture that is kept.
    first_row: usize,
    grey: Vec<u8>,
}

/// Distance from an outline or a wall within which pixels are not compared, px: the width of a blurred edge.
const MARGIN_PX: f64 = 4.0;
/// Side of a square, px.
const SIDE: usize = 8;
/// Least squares of pixels that are compared, inside and beside the outlines.
const SQUARES_LEAST: usize = 12;
/// Variance that is added on both sides, grey levels^2: a picture without noise, or compressed until none was left, differs by its rounding only.
const FLOOR: f64 = 1.0;

impl BorePicture {
    pub fn of(picture: &Picture, walls: &Walls) -> Self {
        let (width, height) = (picture.width(), picture.height());
        let ends = [0.0, width as f64 / 2.0, width as f64 - 1.0];
        let upper = ends.map(|u| walls.upper.inner.at(u)).into_iter().fold(f64::INFINITY, f64::min);
        let lower = ends.map(|u| walls.lower.inner.at(u)).into_iter().fold(f64::NEG_INFINITY, f64::max);
        let first_row = (upper.max(0.0) as usize).min(height);
        let end = (lower.max(0.0).ceil() as usize + 1).clamp(first_row, height);
        let [red, green, blue] = picture.planes();
        let rows = first_row * width..end * width;
        let colours = red[rows.clone()].iter().zip(&green[rows.clone()]).zip(&blue[rows]);
        let grey = colours.map(|((&r, &g), &b)| ((u16::from(r) + 2 * u16::from(g) + u16::from(b)) / 4) as u8).collect();
        Self { width, first_row, grey }
    }

    fn end_row(&self) -> usize {
        self.first_row + self.grey.len() / self.width.max(1)
    }

    fn at(&self, u: usize, v: usize) -> f64 {
        f64::from(self.grey[(v - self.first_row) * self.width + u])
    }
}

/// What is left of the difference of two pictures, grey levels^2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Difference {
    /// Inside both outlines.
    pub inside: f64,
    /// Beside them.
    pub beside: f64,
}

impl Difference {
    /// How much more the pixels inside differ than those beside: 1 for two pictures of a specimen that stands still.
    pub fn change(&self) -> f64 {
        (self.inside + FLOOR) / (self.beside + FLOOR)
    }
}

/// Which squares are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sampling {
    All,
    /// Those of every third column of squares, for many pairs of pictures.
    Third,
}

/// What two pictures differ by apart from light, shift and vibration. `None` where too few pixels can be compared.
pub(super) fn difference(a: (&BorePicture, &Columns), b: (&BorePicture, &Columns), sampling: Sampling) -> Option<Difference> {
    let ((first, first_edges), (second, second_edges)) = (a, b);
    if first.width != second.width {
        return None;
    }
    let rows = [first.first_row.max(second.first_row) + 1, first.end_row().min(second.end_row()).saturating_sub(1)];
    let mut inside = Squares::default();
    let mut beside = Squares::default();
    let mut v = rows[0];
    while v + SIDE <= rows[1] {
        for at in (0..first.width.saturating_sub(2) / SIDE).step_by(if sampling == Sampling::Third { 3 } else { 1 }) {
            let u = 1 + at * SIDE;
            let place = place([first_edges, second_edges], [u, v], rows);
            let squares = match place {
                Some(Place::Inside) => &mut inside,
                Some(Place::Beside) => &mut beside,
                None => continue,
            };
            squares.add(first, second, [u, v]);
        }
        v += SIDE;
    }
    Some(Difference { inside: inside.variance()?, beside: beside.variance()? })
}

/// Where a square of pixels lies.
enum Place {
    Inside,
    Beside,
}

/// `None` for a square that an outline crosses or touches, or that lies at a wall.
fn place(edges: [&Columns; 2], [u, v]: [usize; 2], rows: [usize; 2]) -> Option<Place> {
    let (top, bottom) = (v as f64, (v + SIDE - 1) as f64);
    let covers = |columns: &Columns| {
        let of = |u: usize| columns.get(u);
        (u..u + SIDE).all(|u| of(u).is_some_and(|e| e.gap == 0.0 && e.upper + MARGIN_PX <= top && bottom + MARGIN_PX <= e.lower))
    };
    let avoids = |columns: &Columns| {
        let reach = MARGIN_PX as usize;
        (u.saturating_sub(reach)..u + SIDE + reach)
            .all(|u| columns.get(u).is_none_or(|e| bottom + MARGIN_PX <= e.upper || e.lower + MARGIN_PX <= top))
    };
    if edges.iter().all(|columns| covers(columns)) {
        return Some(Place::Inside);
    }
    let from_walls = top - rows[0] as f64 >= MARGIN_PX && rows[1] as f64 - bottom >= MARGIN_PX;
    (from_walls && edges.iter().all(|columns| avoids(columns))).then_some(Place::Beside)
}

/// The pixels of squares, as equations: `difference = a + b g + c dg/du + d dg/dv`.
#[derive(Default)]
struct Squares {
    /// The equations of all squares, one square after the other.
    rows: Vec<(Vector4<f64>, f64)>,
}

impl Squares {
    fn add(&mut self, first: &BorePicture, second: &BorePicture, [u0, v0]: [usize; 2]) {
        for (u, v) in (0..SIDE * SIDE).map(|i| (u0 + i % SIDE, v0 + i / SIDE)) {
            // The mean of both pictures, so that the noise of one does not look like its slope.
            let mean = |u: usize, v: usize| f64::midpoint(first.at(u, v), second.at(u, v));
            let along = (mean(u + 1, v) - mean(u - 1, v)) / 2.0;
            let across = (mean(u, v + 1) - mean(u, v - 1)) / 2.0;
            self.rows.push((Vector4::new(1.0, mean(u, v) / 100.0, along, across), second.at(u, v) - first.at(u, v)));
        }
    }

    /// The median over the squares of what is left of the differences, grey levels^2.
    fn variance(&self) -> Option<f64> {
        let pixels = SIDE * SIDE;
        if self.rows.len() < SQUARES_LEAST * pixels {
            return None;
        }
        // Weak ridge: a part without slopes does not determine a shift.
        let mut normal = Matrix4::identity();
        let mut right = Vector4::zeros();
        for (row, difference) in &self.rows {
            normal += row * row.transpose();
            right += row * *difference;
        }
        let fit = normal.cholesky()?.solve(&right);
        let squares = self
            .rows
            .chunks_exact(pixels)
            .map(|square| square.iter().map(|(row, difference)| (difference - fit.dot(row)).powi(2)).sum::<f64>() / pixels as f64);
        Some(crate::statistics::upper_median(squares.collect()))
    }
}
