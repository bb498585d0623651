//! Fast lookup for capillaries along the image's rows: a row of voxels maps to a line of the image, and all these lines are
//! nearly parallel.
//!
//! ```text
//!  mask, rolled by m         column by column moved up by m u      the line of a row of voxels
//!      ______▟███               ▁▁▁███████                          miss ── unsure ── covered ── miss
//!  ▟███████▀▀‾‾      ──────►   ▟██████████       ──────►                0      ua       ub       uc       u, px
//!   ‾‾‾‾                        ▔▔▔▔▔▔▔▔▔▔                                      i = (u - u0) / (du/di)    voxels
//! ```
//! In an upright capillary a row of voxels samples one row of the mask, and the runs of that row, converted to voxels, contain
//! everything. In a rolled capillary the row crosses many rows of the mask. The mask is therefore sheared by the common slope
//! once per view, for a few fractions of a pixel (phases) of a line's height. Within a column a line then lies between the
//! pixels of two neighbouring phases: where both are covered it is covered, where neither is it is missed, and only where they
//! differ the voxels are judged one by one. Ends of runs are converted to voxels by the inverse of the projection. An end
//! within a millionth of a voxel of a centre is decided by the definition.

use super::Runs;
use super::counts::{ROW, ones};
use super::definition::{ROUNDING, View};
use super::misses::{Spans, Verdict};
use crate::parallel::prelude::*;

/// Distance from a rounding border within which a result is not safe, px or voxels: at least twenty times what rounding can
/// move, see the next two.
const MARGIN: f64 = 1e-6;
/// The same for the image of a tile through glass, px: rays of one tile are turned by angles that differ by up to a tenth, in which the
/// corners of 8 voxels lie this far beside a straight line at most.
const GLASS_PX: f64 = 1.0;
/// Rounding error of an image point beyond which it does not fit into the margin, px.
const ROUNDING_MAX: f64 = 1e-9;
/// Range of a voxel's advance, px. With a smaller one the rounding in pixels would be too large in voxels; with a larger one
/// rows do not map to lines.
const STEP_PX: std::ops::Range<f64> = 0.02..50.0;
/// Columns further than this from the grid, in voxels, exceed the whole numbers that can be found by adding.
const FARTHEST: f64 = (1 << 30) as f64;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    Missed,
    Unsure,
    Covered,
}

/// From this column on a line is of this class. Before the first event and after the last it is outside of the image.
#[derive(Debug, Clone, Copy)]
struct Event {
    column: u16,
    class: Class,
}

/// The buffers of [`Lines`], reused from view to view.
#[derive(Debug, Clone, Default)]
pub(super) struct Buffers {
    /// The lines of each phase of a pixel's height. An upright view has one phase.
    phases: Vec<Phase>,
    /// `1 / (size (a_x - t c_x))` for `t = column - 0.5`: with it a column's border is converted to a voxel without a division.
    inverse: Vec<f64>,
    /// The mask's words by column of words, and the sheared words of each phase.
    bits: Vec<u64>,
    sheared: Vec<Vec<u64>>,
}

/// The lines whose heights have the same fraction of a pixel.
#[derive(Debug, Clone, Default)]
struct Phase {
    /// Line `n` has the events `events[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    events: Vec<Event>,
    /// The longest covered run of each line.
    cores: Vec<[u16; 2]>,
}

/// The lines of one view.
pub(super) struct Lines<'a> {
    view: View<'a>,
    counts: [usize; 3],
    /// Centre of voxel 0 along x, in voxels.
    first_x: f64,
    /// Whether columns increase with x.
    ascending: bool,
    tilt: Option<Tilt>,
    /// Height of each phase's first line, in whole pixels.
    first: i64,
    buffers: &'a Buffers,
}

/// The direction of the lines.
#[derive(Debug, Clone, Copy)]
struct Tilt {
    /// dv/du.
    slope: f64,
    /// Lines per pixel of height.
    phases: usize,
    /// The column at which a line's height is taken.
    middle: f64,
    /// Largest distance of a voxel's own line from that of its column's centre, px.
    pad: f64,
}

/// The integer part, rounded down. `f64::floor` is a function call where the target has no instruction for it.
fn floor(x: f64) -> i64 {
    let whole = x as i64;
    whole - i64::from(x < whole as f64)
}

impl Tilt {
    /// The range of a pixel's height that one line represents: two phases.
    fn window(self) -> f64 {
        2.0 / self.phases as f64
    }

    /// The row that replaces that of v in a projection. It gives the height of the line through an image point,
    /// `v - slope (u - middle)`.
    fn height(self, [u, v, w]: [f64; 3]) -> f64 {
        v - self.slope * u + self.slope * self.middle * w
    }
}

/// The direction of a projection's lines, or `None` where they are not lines that a shear could follow.
struct Family {
    ascending: bool,
    tilt: Option<Tilt>,
}

impl Family {
    fn of(view: &View, size: f64, counts: [usize; 3]) -> Option<Self> {
        let [a, b, c] = view.rows;
        let ends = |axis: usize| [0, counts[axis] - 1];
        let mut ascending = None;
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        let magnitude = view.magnitude();
        // A row's line ends at its vanishing point, in column a_x / c_x; no column beyond it contains a point of the line. The
        // image must therefore end before it.
        let places = [-0.5, view.runs.width() as f64 - 0.5].map(|t| (t, size * (a[0] - t * c[0])));
        for (j, k) in ends(1).into_iter().flat_map(|j| ends(2).map(|k| (j, k))) {
            let rest = view.rest(j, k);
            // For a row's line, du/dx and dv/dx are these over the squared depth.
            let (du, dv) = (a[0] * rest[2] - c[0] * rest[0], b[0] * rest[2] - c[0] * rest[1]);
            let slope = dv / du;
            (lowest, highest) = (lowest.min(slope), highest.max(slope));
            for i in ends(0) {
                let [u, _, w] = view.image(i, &rest);
                let step = du * size / (w * w);
                let grows = step > 0.0;
                // The relative rounding error of the depth moves an image point by that share of its coordinates.
                let moved = ROUNDING * (magnitude[0] + magnitude[1] + (u.abs() + 1.0) * magnitude[2]) / w;
                let near = |(t, per_voxel): (f64, f64)| {
                    (per_voxel > 0.0) == grows && ((t * rest[2] - rest[0]) / per_voxel - view.centres[0][0] / size).abs() < FARTHEST
                };
                let is_line = w > 0.0 && STEP_PX.contains(&step.abs()) && moved < ROUNDING_MAX && places.into_iter().all(near);
                if !is_line || ascending.is_some_and(|up| up != grows) {
                    return None;
                }
                ascending = Some(grows);
                (left, right) = (left.min(u), right.max(u));
            }
        }
        let ascending = ascending?;
        if b[0] == 0.0 && c[0] == 0.0 {
            return Some(Self { ascending, tilt: None });
        }
        let width = view.runs.width() as f64;
        let (left, right) = (left.clamp(0.0, width), right.clamp(0.0, width));
        let slope = f64::midpoint(lowest, highest);
        // Within half the image's width from its middle a row departs from the common slope by this.
        let bend = (highest - lowest) / 2.0 * (right - left) / 2.0;
        let pad = slope.abs() / 2.0 + MARGIN;
        let phases = [16usize, 8, 4, 2].into_iter().find(|&n| 2.0 * (bend + pad) < 1.0 / n as f64)?;
        Some(Self { ascending, tilt: Some(Tilt { slope, phases, middle: f64::midpoint(left, right), pad }) })
    }
}

impl<'a> Lines<'a> {
    /// The lines of a view. `None` where its rows are not nearly parallel to the image's.
    pub fn new(view: View<'a>, size: f64, counts: [usize; 3], buffers: &'a mut Buffers) -> Option<Self> {
        let Family { ascending, tilt } = Family::of(&view, size, counts)?;
        let (a, c) = (view.rows[0][0], view.rows[2][0]);
        buffers.inverse.clear();
        buffers.inverse.extend((0..=view.runs.width()).map(|column| 1.0 / (size * (a - (column as f64 - 0.5) * c))));
        let first = match tilt {
            None => buffers.take_rows(view.runs),
            Some(tilt) => buffers.shear(view.runs, tilt),
        };
        Some(Self { view, counts, first_x: view.centres[0][0] / size, ascending, tilt, first, buffers })
    }

    /// A line's events and its longest covered run.
    fn line(&self, line: i64) -> (&[Event], [u16; 2]) {
        // Phases are a power of two.
        let phases = self.phases();
        let phase = &self.buffers.phases[line as usize & (phases - 1)];
        match usize::try_from((line >> phases.trailing_zeros()) - self.first) {
            Ok(n) if n < phase.cores.len() => (&phase.events[phase.starts[n] as usize..phase.starts[n + 1] as usize], phase.cores[n]),
            _ => (&[], [0; 2]),
        }
    }

    /// What the view shows of the voxels `span` of the rows from `lo` to before `hi` along y and z.
    pub fn judge(&self, span: [usize; 2], lo: [usize; 2], hi: [usize; 2]) -> Verdict {
        if self.view.leaves.any() {
            return Verdict::Cut;
        }
        // The image of a box lies within that of its corners.
        let (mut top, mut bottom) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for (j, k) in [lo[0], hi[0] - 1].into_iter().flat_map(|j| [lo[1], hi[1] - 1].map(|k| (j, k))) {
            let rest = self.view.rest(j, k);
            let [a, b] = self.heights(span, &rest);
            (top, bottom) = (top.min(a).min(b), bottom.max(a).max(b));
            for i in [span[0], span[1] - 1] {
                let u = self.view.image(i, &rest)[0];
                (left, right) = (left.min(u), right.max(u));
            }
        }
        // Through glass lines that pass by at one height are not quite parallel, and the box lies within that of its corners to this.
        let margin = if self.view.lookup.is_through_glass() { GLASS_PX } else { MARGIN };
        let [from, to] = [top - margin, bottom + margin].map(|height| floor(height * self.phases() as f64));
        let held = self.buffers.phases[0].cores.len() as i64;
        let phases = self.phases() as i64;
        let (first, last) = (self.first * phases, (self.first + held) * phases - 1);
        // Lines that are not stored are missed throughout.
        let (mut outside, mut inside) = (true, from >= first && to <= last);
        for line in from.max(first)..=to.min(last) {
            let (events, [start, end]) = self.line(line);
            outside &= events.is_empty();
            inside &= left >= f64::from(start) + margin && right < f64::from(end) - margin;
            if !outside && !inside {
                return Verdict::Cut;
            }
        }
        if outside { Verdict::Outside } else { Verdict::Inside }
    }

    fn phases(&self) -> usize {
        self.tilt.map_or(1, |tilt| tilt.phases)
    }

    /// The range of heights of a row's line over the voxels of `span`: `v + 0.5` of an upright one.
    fn heights(&self, span: [usize; 2], rest: &[f64; 3]) -> [f64; 2] {
        let Some(tilt) = self.tilt else { return [rest[1] / rest[2] + 0.5; 2] };
        let per_x = tilt.height(self.view.rows.map(|row| row[0]));
        let offset = tilt.height(*rest);
        let [a, b] = [span[0], span[1] - 1].map(|i| {
            let x = self.view.centres[0][i];
            (per_x * x + offset) / (self.view.rows[2][0] * x + rest[2])
        });
        [a.min(b) - tilt.pad, a.max(b) + tilt.pad]
    }

    /// Records in `spans` which of the voxels `span` of the row `(j, k)` the view covers.
    pub fn look(&self, span: [usize; 2], (j, k): (usize, usize), row: usize, spans: &mut Spans) {
        let rest = self.view.rest(j, k);
        let [top, bottom] = self.heights(span, &rest);
        let line = floor(top * self.phases() as f64);
        if self.tilt.is_some_and(|tilt| bottom > line as f64 / tilt.phases as f64 + tilt.window()) {
            // The row is wider than a line: voxel by voxel.
            spans.open(row, span);
            spans.settle(row, span, true);
            self.one_by_one(span, &rest, row, spans);
            return;
        }
        let (events, core) = self.line(line);
        if self.view.leaves.any() {
            return self.turn(events, span, &rest, row, spans);
        }
        if events.is_empty() {
            return;
        }
        let [a, b] = core.map(|column| self.border(usize::from(column), &rest));
        let core = [a.min(b), a.max(b)];
        if events.len() == 2 && core[0] < core[1] || core[0] <= span[0] && core[1] >= span[1] {
            spans.cover(row, core[0], core[1]);
        } else if let Some([from, to]) = self.soften(events, core, span, &rest) {
            spans.cover(row, from, to);
        } else {
            self.turn(events, span, &rest, row, spans);
        }
    }

    /// The covered voxels of a line that is unsure only at the ends of its covered run, if they form one run.
    fn soften(&self, events: &[Event], core: [usize; 2], span: [usize; 2], rest: &[f64; 3]) -> Option<[usize; 2]> {
        use Class::{Covered, Missed, Unsure};
        let (left, right) = match events {
            [Event { class: Covered, .. }, unsure @ Event { class: Unsure, .. }, end @ Event { class: Missed, .. }] => {
                (None, Some([unsure, end]))
            }
            [unsure @ Event { class: Unsure, .. }, start @ Event { class: Covered, .. }, Event { class: Missed, .. }] => {
                (Some([unsure, start]), None)
            }
            [
                a @ Event { class: Unsure, .. },
                b @ Event { class: Covered, .. },
                c @ Event { class: Unsure, .. },
                d @ Event { class: Missed, .. },
            ] => (Some([a, b]), Some([c, d])),
            _ => return None,
        };
        let (below, above) = if self.ascending { (left, right) } else { (right, left) };
        let voxels = |stretch: Option<[&Event; 2]>| {
            let [a, b] = stretch?.map(|event| self.border(usize::from(event.column), rest));
            Some(a.min(b).max(span[0])..a.max(b).min(span[1]))
        };
        let [mut from, mut to] = core;
        if let Some(below) = voxels(below) {
            let covered = below.clone().rev().take_while(|&i| self.view.covers(i, rest)).count();
            from = below.end.max(below.start) - covered;
            if (below.start..from).any(|i| self.view.covers(i, rest)) {
                return None;
            }
        }
        if let Some(above) = voxels(above) {
            to = above.start + above.clone().take_while(|&i| self.view.covers(i, rest)).count();
            if (to..above.end).any(|i| self.view.covers(i, rest)) {
                return None;
            }
        }
        Some([from, to])
    }

    /// A line of several stretches. Where a stretch of another class begins the row turns; unsure stretches are decided voxel
    /// by voxel.
    fn turn(&self, events: &[Event], span: [usize; 2], rest: &[f64; 3], row: usize, spans: &mut Spans) {
        // The events within the span.
        let columns = [span[0], span[1] - 1].map(|i| self.view.image(i, rest)[0]);
        let (low, high) = (columns[0].min(columns[1]) - 1.0, columns[0].max(columns[1]) + 1.0);
        let first = events.partition_point(|e| f64::from(e.column) < low);
        let last = first + events[first..].partition_point(|e| f64::from(e.column) <= high);
        let left = first.checked_sub(1).map_or(Class::Missed, |before| events[before].class);
        let right = last.checked_sub(1).map_or(Class::Missed, |before| events[before].class);
        spans.open(row, span);
        let mut unsure = std::mem::take(&mut spans.unsure);
        let (mut class, mut from) = (left, self.outermost(true));
        for event in &events[first..last] {
            let to = self.border(usize::from(event.column), rest);
            if (class == Class::Covered) != (event.class == Class::Covered) {
                spans.turn(row, span, to);
            }
            if class == Class::Unsure {
                unsure.push([from, to]);
            }
            (class, from) = (event.class, to);
        }
        if class == Class::Unsure {
            unsure.push([from, self.outermost(false)]);
        }
        spans.settle(row, span, if self.ascending { left } else { right } != Class::Covered);
        if self.view.leaves.any() {
            unsure.push([self.outermost(true), self.border(0, rest)]);
            unsure.push([self.border(self.view.runs.width(), rest), self.outermost(false)]);
        }
        for [a, b] in unsure.drain(..) {
            self.one_by_one([a.min(b).max(span[0]), a.max(b).min(span[1])], rest, row, spans);
        }
        spans.unsure = unsure;
    }

    /// Decides the voxels of a range of a row by the definition. The range counts as missed before.
    fn one_by_one(&self, [from, to]: [usize; 2], rest: &[f64; 3], row: usize, spans: &mut Spans) {
        for i in from..to {
            if self.view.covers(i, rest) {
                spans.find(row, i);
            }
        }
    }

    /// The voxel border that represents everything left of all columns, or right of them.
    fn outermost(&self, left: bool) -> usize {
        if left == self.ascending { 0 } else { self.counts[0] }
    }

    /// The first voxel of a row in `column` or beyond it where columns increase with x. Where they decrease, the one after the
    /// last.
    fn border(&self, column: usize, rest: &[f64; 3]) -> usize {
        // Adding and subtracting it leaves the nearest whole number, which its lowest bits contain in between.
        const WHOLE: f64 = 1.5 * (1u64 << 52) as f64;
        let t = column as f64 - 0.5;
        let at = (t * rest[2] - rest[0]) * self.buffers.inverse[column] - self.first_x;
        let sum = at + WHOLE;
        let (near, off) = (sum.to_bits() as i32, at - (sum - WHOLE));
        let next = if off.abs() < MARGIN {
            // A centre lies on the border within the accuracy of this computation.
            let reached = usize::try_from(near).is_ok_and(|i| i < self.counts[0] && self.view.image(i, rest)[0] >= column as f64);
            near + i32::from(reached != self.ascending)
        } else {
            near + i32::from(off > 0.0)
        };
        next.clamp(0, self.counts[0] as i32) as usize
    }
}

impl Buffers {
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        let phase = |p: &Phase| {
            p.starts.capacity() * size_of::<u32>() + p.events.capacity() * size_of::<Event>() + p.cores.capacity() * size_of::<[u16; 2]>()
        };
        let words = self.bits.capacity() + self.sheared.iter().map(Vec::capacity).sum::<usize>();
        self.phases.iter().map(phase).sum::<usize>() + self.inverse.capacity() * size_of::<f64>() + words * size_of::<u64>()
    }

    /// Reserves this number of phases. Those that a view does not use remain for the next.
    fn grow(&mut self, phases: usize) {
        let held = self.phases.len().max(phases);
        self.phases.resize_with(held, Phase::default);
        self.sheared.resize_with(held, Vec::new);
    }

    /// The rows of the mask as the lines of an upright view. Returns the height of the first one.
    fn take_rows(&mut self, runs: &Runs) -> i64 {
        self.grow(1);
        let phase = &mut self.phases[0];
        phase.clear();
        for v in runs.rows() {
            for &[start, end] in runs.row(v) {
                phase.events.push(Event { column: start, class: Class::Covered });
                phase.events.push(Event { column: end, class: Class::Missed });
            }
            phase.close_line();
        }
        runs.rows().start as i64
    }

    /// The lines of a tilted view, one phase apart. Returns the height of the first ones in whole pixels.
    fn shear(&mut self, runs: &Runs, tilt: Tilt) -> i64 {
        let (rows, columns) = (runs.rows(), runs.width().div_ceil(ROW));
        let held = rows.len();
        self.bits.clear();
        self.bits.resize(columns * held, 0);
        for v in rows.clone() {
            for &[start, end] in runs.row(v) {
                for_words(usize::from(start), usize::from(end), |word, bits| self.bits[word * held + v - rows.start] |= bits);
            }
        }
        // Rows of the sheared picture, so that it contains each row of the mask in every column.
        let reach = (tilt.slope.abs() * tilt.middle.max(runs.width() as f64 - tilt.middle)).ceil() as usize + 2;
        let height = held + 2 * reach;
        self.grow(tilt.phases);
        let bits = &self.bits;
        self.sheared[..tilt.phases].par_iter_mut().enumerate().for_each(|(phase, sheared)| {
            shear(bits, sheared, runs.width(), [held, reach], |column| {
                let at = phase as f64 / tilt.phases as f64 + tilt.slope * (column as f64 - tilt.middle);
                floor(at + 0.5)
            });
        });
        // A line lies between its phase and the one two further on, some of which are a pixel lower.
        let sheared = &self.sheared;
        self.phases[..tilt.phases].par_iter_mut().enumerate().for_each(|(phase, lines)| {
            let far = &sheared[(phase + 2) % tilt.phases];
            lines.take([&sheared[phase], far], usize::from(phase + 2 >= tilt.phases), height, runs.width());
        });
        rows.start as i64 - reach as i64
    }
}

impl Phase {
    fn clear(&mut self) {
        self.starts.clear();
        self.starts.push(0);
        self.events.clear();
        self.cores.clear();
    }

    /// Ends a line after its events.
    fn close_line(&mut self) {
        let events = &self.events[self.starts.last().map_or(0, |&n| n as usize)..];
        let mut core = [0, 0];
        for pair in events.windows(2) {
            if pair[0].class == Class::Covered && pair[1].column - pair[0].column > core[1] - core[0] {
                core = [pair[0].column, pair[1].column];
            }
        }
        self.cores.push(core);
        self.starts.push(self.events.len() as u32);
    }

    /// The lines between two sheared pictures, where the far one's rows are `lower` down: covered where both are, missed where
    /// neither is.
    fn take(&mut self, [near, far]: [&[u64]; 2], lower: usize, height: usize, width: usize) {
        self.clear();
        for row in 0..height {
            let mut last = [false; 2];
            for (word, column) in (0..near.len()).step_by(height).zip((0u32..).step_by(ROW)) {
                let (a, b) = (near[word + row], if row + lower < height { far[word + row + lower] } else { 0 });
                let (both, either) = (a & b, a | b);
                let turns = |bits: u64, before: bool| bits ^ (bits << 1 | u64::from(before));
                let mut left = turns(both, last[0]) | turns(either, last[1]);
                while left != 0 {
                    let bit = left.trailing_zeros();
                    left &= left - 1;
                    let class = match (both >> bit & 1, either >> bit & 1) {
                        (1, _) => Class::Covered,
                        (_, 1) => Class::Unsure,
                        _ => Class::Missed,
                    };
                    self.events.push(Event { column: (column + bit) as u16, class });
                }
                last = [both, either].map(|bits| bits >> (ROW - 1) != 0);
            }
            if last != [false; 2] {
                self.events.push(Event { column: width as u16, class: Class::Missed });
            }
            self.close_line();
        }
    }
}

/// Moves the mask's columns up: row `s` of the sheared picture contains the mask's row `s - reach + by(column)`.
fn shear(mask: &[u64], sheared: &mut Vec<u64>, width: usize, [held, reach]: [usize; 2], by: impl Fn(usize) -> i64) {
    let height = held + 2 * reach;
    sheared.clear();
    sheared.resize(width.div_ceil(ROW) * height, 0);
    let mut start = 0;
    while start < width {
        let moved = by(start);
        let end = last_alike(start, width, |column| by(column) == moved);
        let (from, to) = ((-moved).max(-(reach as i64)), (held as i64 - moved).min((held + reach) as i64));
        if from < to {
            for_words(start, end, |word, bits| {
                let source = &mask[word * held..][(from + moved) as usize..(to + moved) as usize];
                let target = &mut sheared[word * height..][(from + reach as i64) as usize..(to + reach as i64) as usize];
                for (t, s) in target.iter_mut().zip(source) {
                    *t |= s & bits;
                }
            });
        }
        start = end;
    }
}

/// The end of the stretch from `start` in which `alike`, which is true at `start`, stays true.
fn last_alike(start: usize, end: usize, alike: impl Fn(usize) -> bool) -> usize {
    // Doubling steps, then halving ones.
    let (mut yes, mut step) = (start, 1);
    while yes + step < end && alike(yes + step) {
        yes += step;
        step *= 2;
    }
    let mut no = (yes + step).min(end);
    while no - yes > 1 {
        let middle = usize::midpoint(yes, no);
        if alike(middle) { yes = middle } else { no = middle }
    }
    no
}

/// The bits from `start` to before `end`, word by word.
fn for_words(start: usize, end: usize, mut each: impl FnMut(usize, u64)) {
    for word in start / ROW..end.div_ceil(ROW) {
        let from = start.saturating_sub(word * ROW);
        let to = (end - word * ROW).min(ROW);
        each(word, ones(to) & !ones(from));
    }
}
