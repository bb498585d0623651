//! Rectangles of one value.

use super::{Damage, Part, Taken, is_sharp};
use std::ops::Range;

/// Least width and height. The blocks of a JPEG are as large.
const LEAST_PX: usize = 8;
/// Most that the rows of a block differ in where they begin and end: a pixel beside it can have its value by chance.
const MOST_RAGGED_PX: usize = 2;
/// Values that differ by no more are those of a surface that goes on.
const MOST_ALIKE: u8 = 2;
/// Least share of the pixels beside each side that are not alike.
const LEAST_ENDED: f64 = 0.75;
/// Least share of the pixels around the block at which it ends sharply, and least step there.
const LEAST_SHARP: f64 = 0.5;
const LEAST_STEP: u8 = 8;
/// Least width and height of a block that a frame without noise does not have. A JPEG has flat blocks of half of this.
const LARGE_PX: usize = 16;
/// A frame has noise if fewer than one in so many of its short runs of pixels have one value.
const NOISY: usize = 100;

/// A rectangle that the rows so far have in common.
#[derive(Debug, Clone, Copy)]
struct Open {
    /// First and last row, and the columns of the first row.
    top: usize,
    bottom: usize,
    first: [usize; 2],
    /// The columns that all rows have.
    left: usize,
    right: usize,
    value: u8,
}

#[derive(Default)]
pub(super) struct Blocks {
    open: Vec<Open>,
    next: Vec<Open>,
    closed: Vec<Open>,
}

impl Blocks {
    /// The first block of one value that reaches into `rows`.
    pub fn find(&mut self, taken: &Taken, rows: &Range<usize>) -> Option<Part> {
        let Self { open, next, closed } = self;
        open.clear();
        closed.clear();
        let (mut windows, mut even) = (0, 0);
        for v in 0..taken.height {
            let row = &taken.pixels[v * taken.width..(v + 1) * taken.width];
            for window in row.chunks_exact(LEAST_PX) {
                windows += 1;
                even += usize::from((1..u8::MAX).contains(&window[0]) && is_even(window));
            }
            next.clear();
            each_run(row, |run| {
                let value = row[run.start];
                let fits = |o: &&Open| {
                    o.value == value && o.first[0].abs_diff(run.start) <= MOST_RAGGED_PX && o.first[1].abs_diff(run.end) <= MOST_RAGGED_PX
                };
                next.push(open.iter().find(fits).map_or(
                    Open { top: v, bottom: v, first: [run.start, run.end], left: run.start, right: run.end, value },
                    |o| Open { bottom: v, left: o.left.max(run.start), right: o.right.min(run.end), ..*o },
                ));
            });
            closed.extend(
                open.iter().filter(|o| o.bottom + 1 - o.top >= LEAST_PX && !next.iter().any(|n| n.top == o.top && n.first == o.first)),
            );
            std::mem::swap(open, next);
        }
        closed.extend(open.iter().filter(|o| o.bottom + 1 - o.top >= LEAST_PX));
        closed.retain(|o| o.top < rows.end && rows.start <= o.bottom && o.ends(taken));
        let in_blocks: usize = closed.iter().map(|o| (o.bottom + 1 - o.top) * ((o.right - o.left) / LEAST_PX)).sum();
        // White and black are cut off: there noise is not seen.
        let is_noisy = even.saturating_sub(in_blocks) * NOISY < windows;
        let found = closed.iter().find(|o| o.is_sharp(taken) || (is_noisy || o.is_large()) && (1..u8::MAX).contains(&o.value))?;
        Some(Part { rows: found.top..found.bottom + 1, columns: found.left..found.right, damage: Damage::Filled(found.value) })
    }
}

fn is_even(window: &[u8]) -> bool {
    window.iter().all(|value| *value == window[0])
}

/// Calls `found` with each run of one value of at least [`LEAST_PX`].
fn each_run(row: &[u8], mut found: impl FnMut(Range<usize>)) {
    let mut at = 0;
    while at + LEAST_PX <= row.len() {
        // The last of these pixels that has another value than the one after it ends the run.
        let window = &row[at..at + LEAST_PX];
        if let Some(changed) = window.windows(2).rposition(|pair| pair[0] != pair[1]) {
            at += changed + 1;
            continue;
        }
        let end = at + row[at..].iter().take_while(|value| **value == row[at]).count();
        found(at..end);
        at = end;
    }
}

impl Open {
    /// Calls `see` for each pixel beside the block, side by side, with the next one of its colour. A side on which the picture ends is left out.
    fn each_beside(&self, taken: &Taken, mut see: impl FnMut(usize, u8, Option<u8>)) {
        let (w, h, period) = (taken.width, taken.height, taken.period);
        for u in self.left..self.right {
            if self.top > 0 {
                see(0, taken.at(u, self.top - 1), (self.top > period).then(|| taken.at(u, self.top - 1 - period)));
            }
            if self.bottom + 1 < h {
                let further = self.bottom + 1 + period;
                see(1, taken.at(u, self.bottom + 1), (further < h).then(|| taken.at(u, further)));
            }
        }
        for v in self.top..=self.bottom {
            if self.left > 0 {
                see(2, taken.at(self.left - 1, v), (self.left > period).then(|| taken.at(self.left - 1 - period, v)));
            }
            if self.right < w {
                let further = self.right + period;
                see(3, taken.at(self.right, v), (further < w).then(|| taken.at(further, v)));
            }
        }
    }

    /// Whether the value ends on all sides of a block that is large enough.
    fn ends(&self, taken: &Taken) -> bool {
        let (mut seen, mut other) = ([0_usize; 4], [0_usize; 4]);
        self.each_beside(taken, |side, beside, _| {
            seen[side] += 1;
            other[side] += usize::from(beside.abs_diff(self.value) > MOST_ALIKE);
        });
        let sides = seen.iter().filter(|seen| **seen > 0).count();
        self.right >= self.left + LEAST_PX && sides >= 2 && (0..4).all(|side| other[side] as f64 >= LEAST_ENDED * seen[side] as f64)
    }

    /// Whether it ends as no optics draws a border.
    fn is_sharp(&self, taken: &Taken) -> bool {
        let (mut seen, mut sharp) = (0_usize, 0_usize);
        self.each_beside(taken, |_, beside, further| {
            seen += 1;
            sharp += usize::from(is_sharp(LEAST_STEP, self.value, beside, further));
        });
        sharp as f64 >= LEAST_SHARP * seen as f64
    }

    fn is_large(&self) -> bool {
        self.bottom + 1 - self.top >= LARGE_PX && self.right >= self.left + LARGE_PX
    }
}
