//! The quick way for capillaries that lie along the image: a row of voxels is a line of the image, and all rows are
//! nearly parallel ones.
//!
//! ```text
//!  mask, rolled by m         column by column moved up by m u      the line of a row of voxels
//!      ______▟███               ▁▁▁███████                          miss ── unsure ── covered ── miss
//!  ▟███████▀▀‾‾      ──────►   ▟██████████       ──────►                0      ua       ub       uc       u, px
//!   ‾‾‾‾                        ▔▔▔▔▔▔▔▔▔▔                                      i = (u - u0) / (du/di)    voxels
//! ```
//! An upright capillary's row of voxels samples one row of the mask: its runs, turned into voxels, are all there is to
//! know. A rolled one's row climbs through many. So the mask is sheared by the common slope once per view, for a few
//! fractions of a pixel (phases) of a line's height. Within a column a line then lies between two neighbouring phases'
//! pixels: where both are covered it is covered, where neither is it is missed, and only where they differ the voxels are
//! looked at one by one. Ends of runs become voxels by the inverse of the projection; an end within a millionth of a voxel
//! of a centre is decided by the definition.

use super::Runs;
use super::counts::{ROW, ones};
use super::definition::View;
use super::misses::Spans;

/// Unsafe distance from a rounding border, px or voxels: millions of times what rounding can move.
const MARGIN: f64 = 1e-6;
/// Rounding errors of an image point beyond this leave no room in the margin, px.
const ROUNDING_MAX: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    Missed,
    Unsure,
    Covered,
}

/// From this column on a line is of this class; before the first event and after the last it is outside the image.
#[derive(Debug, Clone, Copy)]
struct Event {
    column: u16,
    class: Class,
}

/// The buffers of [`Lines`], kept from view to view.
#[derive(Debug, Clone, Default)]
pub(super) struct Buffers {
    /// Line `first + n` has the events `events[starts[n]..starts[n + 1]]`.
    starts: Vec<u32>,
    events: Vec<Event>,
    /// The longest covered run of each line.
    cores: Vec<[u16; 2]>,
    /// How many of the lines before have an event.
    filled: Vec<u32>,
    /// `1 / (size (a_x - t c_x))` for `t = column - 0.5`: with it a column's border becomes a voxel without a division.
    inverse: Vec<f64>,
    /// The mask's words by column of words, and each phase's sheared ones.
    bits: Vec<u64>,
    sheared: Vec<u64>,
}

/// What the lines of one view look like.
pub(super) struct Lines<'a> {
    view: View<'a>,
    size: f64,
    counts: [usize; 3],
    /// Columns grow with x.
    ascending: bool,
    tilt: Option<Tilt>,
    /// Number of the first line: rows of the mask, or phases of them.
    first: i64,
    buffers: &'a Buffers,
}

/// How the lines run.
#[derive(Debug, Clone, Copy)]
struct Tilt {
    /// dv/du.
    slope: f64,
    /// Lines per pixel of height.
    phases: usize,
    /// The column in which a line's height is taken.
    middle: f64,
    /// How far a voxel's own line may lie from that of its column's centre, px.
    pad: f64,
}

/// What a view says of a tile as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Inside,
    Outside,
    Cut,
}

impl Tilt {
    /// The span of a pixel's height that one line stands for: two phases.
    fn window(self) -> f64 {
        2.0 / self.phases as f64
    }

    /// Height of the line through an image point, px above or below the middle column's.
    fn height(self, [u, v]: [f64; 2]) -> f64 {
        v - self.slope * (u - self.middle)
    }
}

/// How a projection's lines run, or nothing where they are no lines that a shear could follow.
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
        let far: [f64; 3] = std::array::from_fn(|axis| ends(axis).map(|i| view.centres[axis][i].abs()).into_iter().fold(0.0, f64::max));
        let magnitude = |r: &[f64; 4]| r[0].abs() * far[0] + r[1].abs() * far[1] + r[2].abs() * far[2] + r[3].abs();
        for (j, k) in ends(1).into_iter().flat_map(|j| ends(2).map(|k| (j, k))) {
            let rest = view.rest(j, k);
            // Of a row's line: du/dx and dv/dx are these over the squared depth.
            let (du, dv) = (a[0] * rest[2] - c[0] * rest[0], b[0] * rest[2] - c[0] * rest[1]);
            let slope = dv / du;
            (lowest, highest) = (lowest.min(slope), highest.max(slope));
            for i in ends(0) {
                let [u, _, w] = view.image(i, &rest);
                let step = du * size / (w * w);
                let grows = step > 0.0;
                // The depth's own rounding, relative, moves an image point by that share of its coordinates.
                let moved = f64::EPSILON * 16.0 * (magnitude(a) + magnitude(b) + (u.abs() + 1.0) * magnitude(c)) / w;
                if !(w > 0.0 && (0.02..50.0).contains(&step.abs()) && moved < ROUNDING_MAX) || ascending.is_some_and(|up| up != grows) {
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
        // Within half the image's width from its middle a row leaves the common slope by this.
        let bend = (highest - lowest) / 2.0 * (right - left) / 2.0;
        let pad = slope.abs() / 2.0 + MARGIN;
        let phases = [8usize, 4, 2].into_iter().find(|&n| 2.0 * (bend + pad) < 1.0 / n as f64)?;
        Some(Self { ascending, tilt: Some(Tilt { slope, phases, middle: f64::midpoint(left, right), pad }) })
    }
}

impl<'a> Lines<'a> {
    /// The lines of a view, or nothing where its rows are not nearly parallel to the image's.
    pub fn new(view: View<'a>, size: f64, counts: [usize; 3], buffers: &'a mut Buffers) -> Option<Self> {
        let Family { ascending, tilt } = Family::of(&view, size, counts)?;
        let (a, c) = (view.rows[0][0], view.rows[2][0]);
        buffers.inverse.clear();
        buffers.inverse.extend((0..=view.runs.width()).map(|column| 1.0 / (size * (a - (column as f64 - 0.5) * c))));
        let first = match tilt {
            None => buffers.take_rows(view.runs),
            Some(tilt) => buffers.shear(view.runs, tilt),
        };
        buffers.sum_up();
        Some(Self { view, size, counts, ascending, tilt, first, buffers })
    }

    fn events(&self, line: i64) -> &[Event] {
        match usize::try_from(line - self.first) {
            Ok(n) if n + 1 < self.buffers.starts.len() => {
                &self.buffers.events[self.buffers.starts[n] as usize..self.buffers.starts[n + 1] as usize]
            }
            _ => &[],
        }
    }

    /// What the view says of the voxels `span` of the rows from `lo` to before `hi` along y and z.
    pub fn judge(&self, span: [usize; 2], lo: [usize; 2], hi: [usize; 2]) -> Verdict {
        if self.view.leaves.any() {
            return Verdict::Cut;
        }
        // The image of a box lies within that of its corners.
        let (mut top, mut bottom) = (f64::INFINITY, f64::NEG_INFINITY);
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for (j, k) in [lo[0], hi[0] - 1].into_iter().flat_map(|j| [lo[1], hi[1] - 1].map(|k| (j, k))) {
            let rest = self.view.rest(j, k);
            for i in [span[0], span[1] - 1] {
                let [u, v, _] = self.view.image(i, &rest);
                let height = self.tilt.map_or(v, |tilt| tilt.height([u - 0.5, v - 0.5]));
                (top, bottom) = (top.min(height), bottom.max(height));
                (left, right) = (left.min(u), right.max(u));
            }
        }
        let (pad, phases) = self.tilt.map_or((MARGIN, 1.0), |tilt| (tilt.pad + MARGIN, tilt.phases as f64));
        let [from, to] = [(top - pad) * phases, (bottom + pad) * phases].map(|line| line.floor() as i64);
        let held = self.buffers.cores.len() as i64;
        let inner = |line: i64| (line - self.first).clamp(0, held) as usize;
        if self.buffers.filled[inner(from)] == self.buffers.filled[inner(to + 1)] {
            return Verdict::Outside;
        }
        let inside = from >= self.first
            && to < self.first + held
            && self.buffers.cores[inner(from)..=inner(to)]
                .iter()
                .all(|&[start, end]| left >= f64::from(start) + MARGIN && right < f64::from(end) - MARGIN);
        if inside { Verdict::Inside } else { Verdict::Cut }
    }

    /// Tells `spans` which voxels of `span` the view covers in the row `(j, k)`.
    pub fn look(&self, span: [usize; 2], (j, k): (usize, usize), row: usize, spans: &mut Spans) {
        let rest = self.view.rest(j, k);
        let line = match self.tilt {
            None => Some((rest[1] / rest[2] + 0.5).floor() as i64),
            Some(tilt) => {
                let [top, bottom] = {
                    let [a, b] = [span[0], span[1] - 1].map(|i| {
                        let [u, v, _] = self.view.image(i, &rest);
                        tilt.height([u - 0.5, v - 0.5])
                    });
                    [a.min(b) - tilt.pad, a.max(b) + tilt.pad]
                };
                let line = (top * tilt.phases as f64).floor();
                (bottom <= line / tilt.phases as f64 + tilt.window()).then_some(line as i64)
            }
        };
        let Some(line) = line else {
            // Wider than a line: voxel by voxel.
            self.one_by_one(span[0], span[1], &rest, row, spans);
            return;
        };
        let events = self.events(line);
        let leaves = self.view.leaves;
        match *events {
            [Event { column: start, class: Class::Covered }, Event { column: end, class: Class::Missed }] if !leaves.any() => {
                let [start, end] = [start, end].map(|column| self.border(usize::from(column), &rest));
                spans.cover(row, start.min(end), start.max(end));
            }
            _ => self.walk(events, span, &rest, row, spans),
        }
    }

    /// The stretches of a line, as voxels in growing order.
    fn walk(&self, events: &[Event], span: [usize; 2], rest: &[f64; 3], row: usize, spans: &mut Spans) {
        let (leaves, width) = (self.view.leaves, self.view.runs.width());
        let class = |goes_on: bool| if goes_on { Class::Unsure } else { Class::Missed };
        let n = events.len();
        // Stretch 0 is left of the image, stretch 1 its begin before the first event, the last one right of it.
        let stretch = |at: usize| match at {
            0 => class(leaves.left),
            1 => Class::Missed,
            at if at < n + 2 => events[at - 2].class,
            _ => class(leaves.right),
        };
        let border = |at: usize| match at {
            0 => self.outermost(true),
            1 => self.border(0, rest),
            at if at < n + 2 => self.border(usize::from(events[at - 2].column), rest),
            at if at == n + 2 => self.border(width, rest),
            _ => self.outermost(false),
        };
        let stretches = n + 3;
        let mut from = if self.ascending { border(0) } else { border(stretches) };
        for step in 0..stretches {
            let at = if self.ascending { step } else { stretches - 1 - step };
            let to = border(if self.ascending { at + 1 } else { at });
            let (a, b) = (from.max(span[0]), to.min(span[1]));
            if a < b {
                match stretch(at) {
                    Class::Missed => {}
                    Class::Covered => spans.cover(row, a, b),
                    Class::Unsure => self.one_by_one(a, b, rest, row, spans),
                }
            }
            from = to;
        }
    }

    fn one_by_one(&self, from: usize, to: usize, rest: &[f64; 3], row: usize, spans: &mut Spans) {
        let mut open = None;
        for i in from..to {
            match (self.view.covers(i, rest), open) {
                (true, None) => open = Some(i),
                (false, Some(start)) => {
                    spans.cover(row, start, i);
                    open = None;
                }
                _ => {}
            }
        }
        if let Some(start) = open {
            spans.cover(row, start, to);
        }
    }

    /// The voxel border that stands for everything left of all columns, or right of them.
    fn outermost(&self, left: bool) -> usize {
        if left == self.ascending { 0 } else { self.counts[0] }
    }

    /// The first voxel of a row in `column` or beyond where columns grow with x; where they fall, the one after the last.
    fn border(&self, column: usize, rest: &[f64; 3]) -> usize {
        let t = column as f64 - 0.5;
        let n = self.counts[0];
        let at = (t * rest[2] - rest[0]) * self.buffers.inverse[column] - self.view.centres[0][0] / self.size;
        let above = at.clamp(-1.0, n as f64) + 1.0;
        let whole = above as usize;
        let part = above - whole as f64;
        if part > MARGIN && part < 1.0 - MARGIN {
            return whole.min(n);
        }
        // A centre lies on the border, as far as this can tell.
        let Some(near) = (whole + usize::from(part > 0.5)).checked_sub(1) else { return 0 };
        if near >= n {
            return n;
        }
        let reached = self.view.image(near, rest)[0] >= column as f64;
        near + usize::from(reached != self.ascending)
    }
}

impl Buffers {
    /// Bytes on the heap.
    pub fn bytes(&self) -> usize {
        self.starts.capacity() * size_of::<u32>()
            + self.events.capacity() * size_of::<Event>()
            + self.cores.capacity() * size_of::<[u16; 2]>()
            + self.filled.capacity() * size_of::<u32>()
            + self.inverse.capacity() * size_of::<f64>()
            + (self.bits.capacity() + self.sheared.capacity()) * size_of::<u64>()
    }

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

    fn sum_up(&mut self) {
        self.filled.clear();
        self.filled.push(0);
        let mut before = 0;
        for pair in self.starts.windows(2) {
            before += u32::from(pair[0] != pair[1]);
            self.filled.push(before);
        }
    }

    /// An upright view's lines are the rows of the mask; returns the number of the first.
    fn take_rows(&mut self, runs: &Runs) -> i64 {
        self.clear();
        for v in runs.rows() {
            for &[start, end] in runs.row(v) {
                self.events.push(Event { column: start, class: Class::Covered });
                self.events.push(Event { column: end, class: Class::Missed });
            }
            self.close_line();
        }
        runs.rows().start as i64
    }

    /// A tilted view's lines, a phase apart; returns the number of the first.
    fn shear(&mut self, runs: &Runs, tilt: Tilt) -> i64 {
        self.clear();
        let (rows, columns) = (runs.rows(), runs.width().div_ceil(ROW));
        let held = rows.len();
        self.bits.clear();
        self.bits.resize(columns * held, 0);
        for v in rows.clone() {
            for &[start, end] in runs.row(v) {
                for_words(usize::from(start), usize::from(end), |word, bits| self.bits[word * held + v - rows.start] |= bits);
            }
        }
        // Rows of the sheared picture, so that each row of the mask is in it whatever the column.
        let reach = (tilt.slope.abs() * tilt.middle.max(runs.width() as f64 - tilt.middle)).ceil() as usize + 2;
        let height = held + 2 * reach;
        let per_phase = columns * height;
        self.sheared.clear();
        self.sheared.resize(per_phase * tilt.phases, 0);
        for (phase, sheared) in self.sheared.chunks_exact_mut(per_phase.max(1)).enumerate() {
            let moved = |column: usize| {
                let at = phase as f64 / tilt.phases as f64 + tilt.slope * (column as f64 - tilt.middle);
                (at + 0.5).floor() as i64
            };
            let mut start = 0;
            while start < runs.width() {
                let by = moved(start);
                let end = last_alike(start, runs.width(), |column| moved(column) == by);
                // Sheared row s holds the mask's row `s - reach + by`.
                let (from, to) = ((-by).max(-(reach as i64)), (held as i64 - by).min((held + reach) as i64));
                if from < to {
                    for_words(start, end, |word, bits| {
                        let source = &self.bits[word * held..][(from + by) as usize..(to + by) as usize];
                        let target = &mut sheared[word * height..][(from + reach as i64) as usize..(to + reach as i64) as usize];
                        for (t, s) in target.iter_mut().zip(source) {
                            *t |= s & bits;
                        }
                    });
                }
                start = end;
            }
        }
        for line in 0..height * tilt.phases {
            self.take_line(line, tilt.phases, columns, height, runs.width());
        }
        (rows.start as i64 - reach as i64) * tilt.phases as i64
    }

    /// The line between phase `line` and the one two further on: covered where both are, missed where neither is.
    fn take_line(&mut self, line: usize, phases: usize, columns: usize, height: usize, width: usize) {
        let per_phase = columns * height;
        let place = |line: usize| (line / phases < height).then(|| line % phases * per_phase + line / phases);
        let (near, far) = (place(line), place(line + 2));
        let mut last = [false; 2];
        for word in 0..columns {
            let [a, b] = [near, far].map(|at| at.map_or(0, |at| self.sheared[at + word * height]));
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
                self.events.push(Event { column: (word * ROW) as u16 + bit as u16, class });
            }
            last = [both, either].map(|bits| bits >> (ROW - 1) != 0);
        }
        if last != [false; 2] {
            self.events.push(Event { column: width as u16, class: Class::Missed });
        }
        self.close_line();
    }
}

/// The end of the stretch from `start` in which `alike`, true at `start`, stays true.
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
