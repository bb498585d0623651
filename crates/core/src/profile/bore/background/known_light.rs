//! What is known about the light before the bore of a frame is read.

use crate::profile::bore::{Bore, MARGIN_PX};

/// The known look of the empty bore in one colour, before the frame's own bore is read.
pub(super) enum KnownLight<'a> {
    /// The empty capillary's picture, and this frame's bore between that picture's walls.
    EmptyCapillary { plane: &'a [u8], bore: Bore },
    /// Without such a picture, the light beside the capillary.
    Surroundings(Surroundings),
}

impl KnownLight<'_> {
    /// Grey value at table row `t` in column `u`. Beyond the picture its border is continued.
    pub fn at(&self, t: f64, u: usize) -> f32 {
        match self {
            Self::EmptyCapillary { plane, bore } => {
                let width = bore.width;
                let last = plane.len() / width - 1;
                let v = bore.v_of(t, u as f64).clamp(0.0, last as f64);
                let v0 = v as usize;
                let part = (v - v0 as f64) as f32;
                let (a, b) = (f32::from(plane[v0 * width + u]), f32::from(plane[(v0 + 1).min(last) * width + u]));
                a + part * (b - a)
            }
            Self::Surroundings(beside) => beside.columns[u][0] + t as f32 * beside.columns[u][1],
        }
    }
}

/// The light along the capillary, taken from the water above and below it and interpolated in between.
#[derive(Debug, Default)]
pub(super) struct Surroundings {
    /// Grey value at table row 0, and its slope per row.
    pub columns: Vec<[f32; 2]>,
    /// One block's pixels on one side.
    greys: Vec<u8>,
}

impl Surroundings {
    /// Blocks of columns whose middle grey value is taken; between them it is interpolated linearly.
    const BLOCKS: usize = 24;
    /// Fewest pixels that determine a block's light.
    const LEAST_SEEN: usize = 16;
    /// Fewest rows that show the light of a side, where the other side has so many. Fewer are all as near to the glass and what it reflects.
    const LEAST_ROWS: usize = 6;

    /// Reads the light of one colour from the picture.
    pub fn read(&mut self, bore: &Bore, plane: &[u8]) {
        let w = bore.width;
        let band = (0.4 * bore.mean_px) as usize;
        let mut blocks = [[0.0f32; 2]; Self::BLOCKS];
        let mut depth = [usize::MAX; 2];
        for (block, levels) in blocks.iter_mut().enumerate() {
            let columns = block * w / Self::BLOCKS..((block + 1) * w / Self::BLOCKS).max(block * w / Self::BLOCKS + 1).min(w);
            let mid = (columns.start + columns.end) as f64 / 2.0;
            // Beyond the glass and its blur.
            let in_picture = |v: f64| v.clamp(bore.lit.start as f64, bore.lit.end as f64) as usize;
            let above = in_picture(bore.walls.upper.outer.at(mid) - MARGIN_PX as f64);
            let below = in_picture(bore.walls.lower.outer.at(mid) + MARGIN_PX as f64);
            let bands = [above.saturating_sub(band).max(bore.lit.start)..above, below..(below + band).min(bore.lit.end)];
            for (side, rows) in bands.into_iter().enumerate() {
                self.greys.clear();
                let count = rows.len();
                for v in rows.step_by(3) {
                    self.greys.extend(plane[v * w + columns.start..v * w + columns.end].iter().step_by(2));
                }
                depth[side] = depth[side].min(if self.greys.len() < Self::LEAST_SEEN { 0 } else { count });
                levels[side] = middle_half(&mut self.greys);
            }
        }
        let sides = [0, 1].map(|side| blocks.map(|levels| levels[side]));
        // Each side has a level of its own, which is not used: the lamp need not be equally bright above and below, and a row's
        // level is found in the bore.
        let shapes = sides.map(|side| {
            let mean = side.iter().sum::<f32>() / Self::BLOCKS as f32;
            side.map(|grey| grey * 128.0 / mean.max(1.0))
        });
        let least = if depth.iter().any(|rows| *rows >= Self::LEAST_ROWS) { Self::LEAST_ROWS } else { 1 };
        let [above, below] = match depth.map(|rows| rows >= least) {
            [true, true] => shapes,
            [true, false] => [shapes[0]; 2],
            [false, true] => [shapes[1]; 2],
            [false, false] => [[128.0; Self::BLOCKS]; 2],
        };
        let at = |side: &[f32; Self::BLOCKS], u: usize| {
            let x = (u as f32 + 0.5) * Self::BLOCKS as f32 / w as f32 - 0.5;
            let k = (x.max(0.0) as usize).min(Self::BLOCKS - 2);
            (side[k] + (x - k as f32) * (side[k + 1] - side[k])).max(1.0)
        };
        let rows = (bore.table_rows() - 1) as f32;
        self.columns.clear();
        self.columns.extend((0..w).map(|u| {
            let (a, b) = (at(&above, u), at(&below, u));
            // The middles of the bands lie this far beyond the table on either side, as a share of its height.
            let beyond = |wall: f64| ((wall + band as f64 / 2.0) / f64::from(rows)) as f32;
            let mid = u as f64;
            let from = beyond(bore.walls.upper.inner.at(mid) - bore.walls.upper.outer.at(mid));
            let upto = beyond(bore.walls.lower.outer.at(mid) - bore.walls.lower.inner.at(mid));
            let slope = (b - a) / (1.0 + from + upto);
            [(a + from * slope).max(1.0), slope / rows]
        }));
    }
}

/// The mean of the middle half of the values: as precise as a mean, and as robust against specks as a median. 0 without values.
fn middle_half(greys: &mut [u8]) -> f32 {
    greys.sort_unstable();
    let middle = &greys[greys.len() / 4..greys.len() - greys.len() / 4];
    middle.iter().map(|&g| f32::from(g)).sum::<f32>() / middle.len().max(1) as f32
}
