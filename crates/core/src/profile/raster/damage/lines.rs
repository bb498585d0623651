//! Rows and columns of one value.

use super::{Damage, Part, Taken, is_sharp};
use std::ops::Range;

/// Least length of a run, as a part of a line.
const LEAST_PART: usize = 4;
/// What tells a run that optics has not drawn: least step of grey values to the pixels beside it, and least share of these that show a sharp
/// border. A row that is filled with white has light beside it along most of its length, which may be nearly as bright.
const SHORT: Border = Border { least_step: 16, least_share: 0.6 };
const LONG: Border = Border { least_step: 6, least_share: 0.25 };
/// Largest share of the picture that rows beyond the walls may have which a program has not filled, and most of them for each row from wall to
/// wall. Where there are more, the wrong lines may have been taken for walls.
const MOST_BEYOND_SHARE: f64 = 0.45;
const MOST_BEYOND: usize = 5;

struct Border {
    least_step: u8,
    least_share: f64,
}

/// The picture as one line of pixels, row after row or column after column: what a packet fills begins and ends within a row.
struct Lines<'a> {
    taken: &'a Taken<'a>,
    are_columns: bool,
    /// Number of pixels of a line, and of lines.
    length: usize,
    count: usize,
}

/// The first rows or columns of one value that reach into `rows`.
pub(super) fn find(taken: &Taken, rows: &Range<usize>) -> Option<Part> {
    let by_rows = Lines { taken, are_columns: false, length: taken.width, count: taken.height };
    let by_columns = Lines { taken, are_columns: true, length: taken.height, count: taken.width };
    by_rows.find(rows).or_else(|| by_columns.find(rows))
}

impl Lines<'_> {
    fn at(&self, i: usize) -> u8 {
        if self.are_columns { self.taken.at(i / self.length, i % self.length) } else { self.taken.pixels[i] }
    }

    /// The run of one value around a pixel.
    fn run(&self, i: usize) -> Range<usize> {
        let value = self.at(i);
        let first = (0..i).rev().take_while(|&k| self.at(k) == value).last().unwrap_or(i);
        first..(i..self.length * self.count).take_while(|&k| self.at(k) == value).last().unwrap_or(i) + 1
    }

    /// Whether most of the pixels of a line's length beside the run show a sharp border, on both sides. A side on which the picture ends
    /// tells nothing.
    fn ends_sharply(&self, run: &Range<usize>) -> bool {
        let Border { least_step, least_share } = if 2 * run.len() >= self.length { LONG } else { SHORT };
        let (value, compared) = (self.at(run.start), run.len().min(self.length));
        let (last, further) = (self.length * self.count, self.taken.period * self.length);
        let is_most = |sharp: usize| sharp as f64 >= least_share * compared as f64;
        let before = (run.start >= self.length).then(|| {
            let beside = (run.start..run.start + compared).map(|k| k - self.length);
            is_most(beside.filter(|&k| is_sharp(least_step, value, self.at(k), k.checked_sub(further).map(|k| self.at(k)))).count())
        });
        let after = (run.end + self.length <= last).then(|| {
            let beside = (run.end - compared..run.end).map(|k| k + self.length);
            is_most(
                beside
                    .filter(|&k| is_sharp(least_step, value, self.at(k), Some(k + further).filter(|&k| k < last).map(|k| self.at(k))))
                    .count(),
            )
        });
        // A picture of one value is black or over-exposed.
        (before.is_some() || after.is_some()) && before.unwrap_or(true) && after.unwrap_or(true)
    }

    fn find(&self, rows: &Range<usize>) -> Option<Part> {
        let (step, mut done) = (self.length.div_ceil(LEAST_PART).max(1), 0);
        for line in 0..self.count {
            // A run of this length has one of these pixels.
            for i in (0..self.length).step_by(step).map(|along| line * self.length + along).filter(|i| i % self.length > 0) {
                if i < done || self.at(i) != self.at(i - 1) && i + 1 < self.length * self.count && self.at(i) != self.at(i + 1) {
                    continue;
                }
                let run = self.run(i);
                done = run.end;
                if LEAST_PART * run.len() < self.length {
                    continue;
                }
                let part = self.part(&run);
                if self.concerns(&part, rows) && (self.crosses_the_walls(&run, rows) || self.ends_sharply(&run)) {
                    return Some(part);
                }
            }
        }
        None
    }

    fn concerns(&self, part: &Part, rows: &Range<usize>) -> bool {
        let is_at_end = part.rows.start == 0 || part.rows.end == self.taken.height;
        let filled = part.rows.len();
        let is_too_much = filled as f64 > MOST_BEYOND_SHARE * self.taken.height as f64 || filled > MOST_BEYOND * rows.len();
        part.rows.start < rows.end && rows.start < part.rows.end || !self.are_columns && is_at_end && is_too_much
    }

    /// Whether a column has one value across glass and light.
    fn crosses_the_walls(&self, run: &Range<usize>, rows: &Range<usize>) -> bool {
        let is_known = rows.start > 0 && rows.end < self.taken.height && run.len() < self.length * self.count;
        let has = |line: usize| run.start <= line * self.length + rows.start && line * self.length + rows.end <= run.end;
        self.are_columns && is_known && (run.start / self.length..run.end.div_ceil(self.length)).any(has)
    }

    fn part(&self, run: &Range<usize>) -> Part {
        let damage = Damage::Filled(self.at(run.start));
        let lines = run.start / self.length..run.end.div_ceil(self.length);
        let along = if lines.len() > 1 { 0..self.length } else { run.start % self.length..(run.end - 1) % self.length + 1 };
        let (rows, columns) = if self.are_columns { (along, lines) } else { (lines, along) };
        Part { rows, columns, damage }
    }
}
