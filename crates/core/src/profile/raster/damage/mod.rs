//! Parts of a frame that no camera has taken: pixels that a dead part of the sensor, a lost packet or a program filled with one value, and
//! pixels that are copies of others.
//!
//! ```text
//!   lines      rows or columns of one value, or a part of them     borders that are sharper and straighter than optics draws
//!   blocks     a rectangle of one value                            the same on its four sides, or none of the frame's noise
//!   copies     pixels equal to others, all at the same distance    noise never repeats
//! ```

mod blocks;
mod copies;
mod lines;

use super::picture::Picture;
use crate::profile::ProfileError;
use std::ops::Range;

/// What the pixels of a damaged part are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Damage {
    /// All are this value.
    Filled(u8),
    /// They are those from another row and column on.
    Copied {
        /// Row of the first.
        row: usize,
        /// Column of the first.
        column: usize,
    },
}

impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Filled(value) => write!(f, "are all {value}"),
            Self::Copied { row, column } => write!(f, "are the same as from row {row}, column {column} on"),
        }
    }
}

/// A damaged part of a picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::profile) struct Part {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
    pub damage: Damage,
}

impl Part {
    pub fn error(self) -> ProfileError {
        let ends = |range: Range<usize>| [range.start, range.end.saturating_sub(1)];
        ProfileError::Damaged { rows: ends(self.rows), columns: ends(self.columns), damage: self.damage }
    }
}

/// The pixels of a picture in the colours in which the camera took them.
#[derive(Clone, Copy)]
struct Taken<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
    /// Distance of the nearest pixel of the same colour along a row or a column.
    period: usize,
}

impl Taken<'_> {
    fn at(&self, u: usize, v: usize) -> u8 {
        self.pixels[v * self.width + u]
    }
}

/// Whether a filled part ends between a pixel of it and the one beside it. A border that optics has drawn goes on to change beyond its first
/// pixel. `further`: the next pixel of the colour of `beside`, if the picture has it.
fn is_sharp(least_step: u8, filled_with: u8, beside: u8, further: Option<u8>) -> bool {
    let step = filled_with.abs_diff(beside);
    step >= least_step && further.is_none_or(|further| 2 * u16::from(further.abs_diff(beside)) <= u16::from(step))
}

/// Looks for damaged parts. Keeps its memory from picture to picture.
#[derive(Default)]
pub(in crate::profile) struct Inspector {
    taken: Vec<u8>,
    blocks: blocks::Blocks,
    copies: copies::Copies,
}

impl Inspector {
    /// The first damaged part that reaches into `rows`, from wall to wall, if there is one. Without known walls, these are all rows.
    pub fn find(&mut self, picture: &Picture, rows: &Range<usize>) -> Option<Part> {
        picture.taken(&mut self.taken);
        let taken = Taken { pixels: &self.taken, width: picture.width(), height: picture.height(), period: picture.period() };
        lines::find(&taken, rows).or_else(|| self.blocks.find(&taken, rows)).or_else(|| self.copies.find(&taken, rows))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{PixelFormat, RawFrame};
    use Damage::{Copied, Filled};

    const WIDTH: usize = 320;
    const HEIGHT: usize = 120;
    const WALLS: Range<usize> = 10..110;

    fn noise(i: usize) -> usize {
        let mixed = (i as u64 ^ i as u64 >> 7).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        ((mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as usize % 9
    }

    /// Noise around 180, a black and a white thing with blurred borders, and dark walls.
    fn pixels() -> Vec<u8> {
        let thing = |u: usize, v: usize, left: usize| {
            let depth = [u.saturating_sub(left), (left + 80).saturating_sub(u), v.saturating_sub(30), 90_usize.saturating_sub(v)];
            (20 * depth.into_iter().min().unwrap_or(0)).min(255)
        };
        let wall = |v: usize| 40 * (3 - v.abs_diff(12).min(v.abs_diff(107)).min(3));
        let grey =
            |u: usize, v: usize| (180 + noise(v * WIDTH + u) + thing(u, v, 20)).saturating_sub(2 * thing(u, v, 150) + wall(v)).min(255);
        (0..WIDTH * HEIGHT).map(|i| grey(i % WIDTH, i / WIDTH) as u8).collect()
    }

    /// What is found in a picture of each format.
    fn found(pixels: &[u8]) -> Option<Part> {
        let of = |format| {
            let frame = RawFrame::new(WIDTH as u32, HEIGHT as u32, format, pixels.to_vec()).unwrap();
            Inspector::default().find(&Picture::from_frame(&frame), &WALLS)
        };
        let mono = of(PixelFormat::Mono8);
        for format in PixelFormat::ALL.into_iter().filter(|format| format.first_red().is_some()) {
            assert_eq!(of(format).map(|part| part.damage), mono.as_ref().map(|part| part.damage), "{format:?}");
        }
        mono
    }

    fn part(rows: Range<usize>, columns: Range<usize>, damage: Damage) -> Part {
        Part { rows, columns, damage }
    }

    fn filled(rows: Range<usize>, columns: Range<usize>, value: u8) -> Option<Part> {
        let mut pixels = pixels();
        for v in rows {
            pixels[v * WIDTH..][columns.clone()].fill(value);
        }
        found(&pixels)
    }

    #[test]
    fn what_is_filled_is_found_and_black_and_white_things_are_not() {
        let sound = pixels();
        assert!(sound.contains(&0) && sound.contains(&255));
        assert_eq!(found(&sound), None);
        for value in [0, 128, 255] {
            for rows in [20..21, 51..53, 70..HEIGHT, 0..40] {
                assert_eq!(filled(rows.clone(), 0..WIDTH, value), Some(part(rows, 0..WIDTH, Filled(value))));
            }
            for columns in [10..11, 200..201, 280..WIDTH, 0..100] {
                assert_eq!(filled(0..HEIGHT, columns.clone(), value), Some(part(0..HEIGHT, columns, Filled(value))));
            }
            assert_eq!(filled(40..56, 112..128, value), Some(part(40..56, 112..128, Filled(value))));
            // A packet begins and ends within a row.
            let mut packet = pixels();
            packet[32 * WIDTH + 70..35 * WIDTH + 20].fill(value);
            assert_eq!(found(&packet), Some(part(32..36, 0..WIDTH, Filled(value))));
        }
        // A part of a thing's inside that is of one value, a block that is too small, and a picture of one value only.
        assert_eq!(filled(40..44, 125..129, 128), None);
        for value in [0, 128, 255] {
            assert_eq!(filled(0..HEIGHT, 0..WIDTH, value), None);
        }
    }

    #[test]
    fn rows_of_zeros_beyond_the_walls_are_no_damage_unless_there_is_little_else() {
        assert_eq!(filled(WALLS.end..HEIGHT, 0..WIDTH, 0), None);
        let mut pixels = pixels();
        pixels[70 * WIDTH..].fill(0);
        let picture = Picture::from_frame(&RawFrame::new(WIDTH as u32, HEIGHT as u32, PixelFormat::Mono8, pixels).unwrap());
        assert_eq!(Inspector::default().find(&picture, &(5..14)), Some(part(70..HEIGHT, 0..WIDTH, Filled(0))), "the two lines of one wall");
        assert_eq!(Inspector::default().find(&picture, &(5..60)), None);
    }

    #[test]
    fn what_is_copied_is_found_and_an_enlarged_picture_is_not() {
        let copied = |rows: Range<usize>, columns: Range<usize>, back: usize| {
            let (sound, mut pixels) = (pixels(), pixels());
            for v in rows {
                for u in columns.clone() {
                    pixels[v * WIDTH + u] = sound[v * WIDTH + u - back];
                }
            }
            found(&pixels).map(|part| matches!(part.damage, Copied { .. }))
        };
        assert_eq!(copied(28..29, 0..WIDTH, WIDTH), Some(true));
        assert_eq!(copied(30..50, 0..WIDTH, 20 * WIDTH), Some(true));
        assert_eq!(copied(60..76, 272..288, 48), Some(true));
        assert_eq!(copied(20..24, 0..WIDTH, 4 * WIDTH + 36), Some(true));
        assert_eq!(copied(40..44, 112..120, 4 * WIDTH), None, "too small");
        for apart in [2, 3, 8] {
            let (sound, mut pixels) = (pixels(), pixels());
            for v in (20..20 + 12 * apart).step_by(apart).filter(|&v| apart == 8 || v < 50) {
                pixels[v * WIDTH..][..WIDTH].copy_from_slice(&sound[(v - 1) * WIDTH..v * WIDTH]);
            }
            assert!(matches!(found(&pixels), Some(Part { damage: Copied { .. }, .. })), "rows that are {apart} apart");
        }
        let enlarged = (0..WIDTH * HEIGHT).map(|i| 180 + noise(i / WIDTH * 2 / 3 * WIDTH + i % WIDTH * 2 / 3) as u8).collect();
        let frame = RawFrame::new(WIDTH as u32, HEIGHT as u32, PixelFormat::Mono8, enlarged).unwrap();
        assert_eq!(Inspector::default().find(&Picture::from_frame(&frame), &WALLS), None);
    }
}
