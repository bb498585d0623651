//! Pixels that are copies of others.

use super::{Damage, Part, Taken};
use std::ops::Range;

/// Pixels of a window.
const WINDOW_PX: usize = 8;
/// Column of the first window: the blocks of a JPEG, some of which are equal, begin elsewhere.
const FIRST: usize = 4;
/// Least pixels of a window, and least share of a run, that differ from the one before of their colour. What does not change is no copy.
const LEAST_CHANGES: usize = 5;
const LEAST_CHANGING: f64 = 0.6;
/// Least windows that are found again at one distance, and least pixels of a run.
const LEAST_FOUND: usize = 8;
const LEAST_RUN_PX: usize = 12;
/// Least pixels of a copy.
const LEAST_COPY_PX: usize = 192;
/// A picture that was enlarged by repeating pixels has a copy in so many rows at least, at one distance, over this share of the rows.
const ENLARGED_ROWS: usize = 3;
const ENLARGED_SHARE: f64 = 0.5;
/// Most windows that are found again. Where there are more, the frame has too little noise to tell.
const MOST_FOUND: usize = 1 << 18;

/// A window that is found again: how far, and where it is.
type Found = (i64, u32);

#[derive(Default)]
pub(super) struct Copies {
    /// Positions of windows plus one, by hash; 0 where there is none.
    table: Vec<u32>,
    found: Vec<Found>,
}

fn window(pixels: &[u8], at: usize) -> u64 {
    pixels.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u64::from_ne_bytes(*bytes))
}

fn hash(window: u64) -> usize {
    (window.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as usize
}

impl Copies {
    /// The first part in `rows` that is a copy of another.
    pub fn find(&mut self, taken: &Taken, rows: &Range<usize>) -> Option<Part> {
        let Taken { pixels, width, height, period } = *taken;
        let rows = rows.start..rows.end.min(height);
        let count = rows.len();
        let per_row = width.saturating_sub(FIRST) / WINDOW_PX;
        let size = (2 * rows.len() * per_row).next_power_of_two().clamp(1 << 10, 1 << 20);
        self.table.clear();
        self.table.resize(size, 0);
        for v in rows {
            for at in (0..per_row).map(|k| v * width + FIRST + k * WINDOW_PX) {
                let changes = (at..at + WINDOW_PX).filter(|&i| pixels[i] != pixels[i - period]).count();
                // One of two windows with the same hash is enough.
                if changes >= LEAST_CHANGES {
                    let place = &mut self.table[hash(window(pixels, at)) & (size - 1)];
                    if *place == 0 {
                        *place = at as u32 + 1;
                    }
                }
            }
        }
        self.found.clear();
        for at in 0..pixels.len().saturating_sub(WINDOW_PX) {
            let here = window(pixels, at);
            let place = self.table[hash(here) & (size - 1)] as usize;
            if place > 0 && place != at + 1 && window(pixels, place - 1) == here {
                if self.found.len() == MOST_FOUND {
                    return None;
                }
                self.found.push((at as i64 - (place as i64 - 1), place as u32 - 1));
            }
        }
        self.found.sort_unstable();
        self.found.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() >= LEAST_FOUND).find_map(|same| copy(taken, same, count))
    }
}

/// The first rows of pixels, one below the other, that are equal at the distance of these windows.
fn copy(taken: &Taken, found: &[Found], rows_looked_at: usize) -> Option<Part> {
    let Taken { pixels, width, period, .. } = *taken;
    let distance = found.first()?.0;
    let other = |i: usize| usize::try_from(i as i64 + distance).ok().and_then(|k| pixels.get(k));
    let is_equal = |i: &usize| other(*i) == Some(&pixels[*i]);
    let (mut area, mut rows, mut columns, mut done) = (0, 0..0, 0..0, 0);
    let mut first = None;
    // Groups of rows with a long run, whatever it shows: how many, and the first and the last row.
    let (mut repeats, mut repeated) = (0, found.first()?.1 as usize / width..0);
    for at in found.iter().map(|(_, at)| *at as usize) {
        if at < done {
            continue;
        }
        let v = at / width;
        let start = (v * width..at).rev().take_while(is_equal).last().unwrap_or(at);
        let end = (at..(v + 1) * width).take_while(is_equal).last().unwrap_or(at) + 1;
        done = end;
        if end - start >= LEAST_COPY_PX {
            repeats += usize::from(v > repeated.end);
            repeated.end = v + 1;
        }
        let changing = (start.max(period)..end).filter(|&i| pixels[i] != pixels[i - period]).count();
        if end - start < LEAST_RUN_PX || (changing as f64) < LEAST_CHANGING * (end - start) as f64 {
            continue;
        }
        let run = start % width..(end - 1) % width + 1;
        if v > rows.end {
            (area, rows, columns) = (0, v..v + 1, run.clone());
        }
        area += run.len();
        rows.end = v + 1;
        columns = columns.start.min(run.start)..columns.end.max(run.end);
        if area >= LEAST_COPY_PX && first.as_ref().is_none_or(|(known, _): &(Range<usize>, _)| known.start == rows.start) {
            first = Some((rows.clone(), columns.clone()));
        }
    }
    let is_enlarged = repeated.len() <= ENLARGED_ROWS * repeats && repeated.len() as f64 >= ENLARGED_SHARE * rows_looked_at as f64;
    let (rows, columns) = first.filter(|_| !is_enlarged)?;
    let from = usize::try_from((rows.start * width + columns.start) as i64 + distance).unwrap_or(0);
    Some(Part { rows, columns, damage: Damage::Copied { row: from / width, column: from % width } })
}
