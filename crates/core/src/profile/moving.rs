//! Dark spots that move in the pictures of one turn.
//!
//! ```text
//!  pictures ── grey ─┬─ median over the turn, pixel by pixel: walls, window, light ── a picture of what stands still
//!                    └─ darker than it, less what all of a row has in common (a wall that trembles) ── connected spots
//! ```

use super::bore::walls::WallFinder;
use super::{Picture, ProfileError, WallSettings, Walls};
use crate::parallel::prelude::*;

/// A dark spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Column of its middle, px, weighted by darkness.
    pub u_px: f64,
    /// Row of its middle, px.
    pub v_px: f64,
    /// Sum over its pixels of the share of light that is missing: pixels of ink.
    pub ink_px: f64,
}

/// The pictures of a turn in grey, with what they have in common.
pub struct Moving {
    width: usize,
    greys: Vec<Vec<u8>>,
    still: Vec<u8>,
}

/// Why pictures cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MovingError {
    /// Too few pictures.
    #[error("at least {LEAST_PICTURES} pictures are needed to find moving spots; found {found}")]
    Few {
        /// Pictures given.
        found: usize,
    },
    /// The pictures differ in size.
    #[error("picture {at} (counted from 0) is {found:?} px, the first {expected:?}; pictures of one camera are expected")]
    Size {
        /// Number of the picture, from 0.
        at: usize,
        /// Its width and height, px.
        found: [usize; 2],
        /// Width and height of the first, px.
        expected: [usize; 2],
    },
}

/// The median of fewer pictures still shows what moves.
const LEAST_PICTURES: usize = 5;
/// Least share of the light that a spot takes: five times the noise of a pixel on dark glass.
const DARK: f32 = 0.15;
/// Least pixels of a spot. Fewer are noise.
const LEAST_PX: usize = 6;
/// Most spots of a picture, the darkest first. More are the texture of something large.
const MOST_SPOTS: usize = 48;
/// Least light, grey values: a share of less light means nothing.
const LEAST_LIGHT: f32 = 16.0;

impl Moving {
    /// Compares the pictures of one turn.
    ///
    /// # Errors
    /// Too few pictures, and pictures of unlike size.
    pub fn new(pictures: impl IntoIterator<Item = Picture>) -> Result<Self, MovingError> {
        let (mut greys, mut size): (Vec<Vec<u8>>, Option<[usize; 2]>) = (Vec::new(), None);
        for (at, picture) in pictures.into_iter().enumerate() {
            let found = [picture.width(), picture.height()];
            let expected = *size.get_or_insert(found);
            if found != expected {
                return Err(MovingError::Size { at, found, expected });
            }
            let [red, green, blue] = picture.planes();
            let grey = |((&r, &g), &b): ((&u8, &u8), &u8)| ((u16::from(r) + 2 * u16::from(g) + u16::from(b)) / 4) as u8;
            greys.push(red.iter().zip(green).zip(blue).map(grey).collect());
        }
        if greys.len() < LEAST_PICTURES {
            return Err(MovingError::Few { found: greys.len() });
        }
        let pixels = greys[0].len();
        let median = |i: usize| {
            let mut values: Vec<u8> = greys.iter().map(|grey| grey[i]).collect();
            let middle = values.len() / 2;
            *values.select_nth_unstable(middle).1
        };
        let still = (0..pixels).into_par_iter().map(median).collect();
        Ok(Self { width: size.map_or(0, |s| s[0]), greys, still })
    }

    /// The walls in the picture of what stands still.
    ///
    /// # Errors
    /// A picture without two walls.
    pub fn walls(&self, settings: &WallSettings) -> Result<Walls, ProfileError> {
        WallFinder::default().find(&Picture::from_grey(self.width, self.still.clone()), settings)
    }

    /// Width of the pictures, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The dark spots of each picture, the darkest first.
    pub fn spots(&self) -> Vec<Vec<Spot>> {
        self.greys.par_iter().map(|grey| self.spots_of(grey)).collect()
    }

    fn spots_of(&self, grey: &[u8]) -> Vec<Spot> {
        let mut missing: Vec<f32> = Vec::with_capacity(grey.len());
        let mut sorted = Vec::new();
        for (row, still) in grey.chunks(self.width).zip(self.still.chunks(self.width)) {
            let start = missing.len();
            missing.extend(row.iter().zip(still).map(|(&g, &s)| 1.0 - f32::from(g) / f32::from(s).max(LEAST_LIGHT)));
            sorted.clear();
            sorted.extend_from_slice(&missing[start..]);
            let common = *sorted.select_nth_unstable_by(self.width / 2, f32::total_cmp).1;
            missing[start..].iter_mut().for_each(|m| *m -= common);
        }
        let mut spots = connected(&mut missing, self.width);
        spots.sort_by(|a, b| b.ink_px.total_cmp(&a.ink_px));
        spots.truncate(MOST_SPOTS);
        spots
    }
}

/// The connected dark places; `missing` is used up.
fn connected(missing: &mut [f32], width: usize) -> Vec<Spot> {
    let height = missing.len() / width.max(1);
    let mut spots = Vec::new();
    let mut open = Vec::new();
    for first in 0..missing.len() {
        if missing[first] < DARK {
            continue;
        }
        let (mut pixels, mut ink, mut u_sum, mut v_sum) = (0, 0.0, 0.0, 0.0);
        open.push((first, missing[first]));
        missing[first] = 0.0;
        while let Some((at, share)) = open.pop() {
            let (u, v) = (at % width, at / width);
            let share = f64::from(share);
            pixels += 1;
            ink += share;
            u_sum += share * u as f64;
            v_sum += share * v as f64;
            for v in v.saturating_sub(1)..(v + 2).min(height) {
                for u in u.saturating_sub(1)..(u + 2).min(width) {
                    let next = v * width + u;
                    if missing[next] >= DARK {
                        open.push((next, missing[next]));
                        missing[next] = 0.0;
                    }
                }
            }
        }
        if pixels >= LEAST_PX {
            spots.push(Spot { u_px: u_sum / ink, v_px: v_sum / ink, ink_px: ink });
        }
    }
    spots
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light of 200 with a square of 4 x 4 px, black, at the place; and a window's spot that stands still.
    fn picture(at: [usize; 2], brighter_row: usize) -> Picture {
        let mut grey = vec![200u8; 64 * 48];
        grey[brighter_row * 64..][..64].fill(120);
        for (u, v) in (0..16).map(|i| (i % 4, i / 4)) {
            grey[(at[1] + v) * 64 + at[0] + u] = 20;
            grey[(5 + v) * 64 + 50 + u] = 30;
        }
        Picture::from_grey(64, grey)
    }

    #[test]
    fn what_moves_is_found_and_neither_a_window_s_spot_nor_a_trembling_row() {
        let places: Vec<[usize; 2]> = (0..7).map(|i| [20, 4 * i + 10]).collect();
        let moving = Moving::new(places.iter().enumerate().map(|(i, &at)| picture(at, 40 + i % 2))).unwrap();
        for (spots, [u, v]) in moving.spots().into_iter().zip(places) {
            let [spot] = spots[..] else { panic!("{spots:?}") };
            assert!((spot.u_px - (u as f64 + 1.5)).abs() < 1e-6 && (spot.v_px - (v as f64 + 1.5)).abs() < 1e-6, "{spot:?}");
            assert!((spot.ink_px - 16.0 * 0.9).abs() < 0.01, "{spot:?}");
        }
    }

    #[test]
    fn pictures_that_are_no_turn_are_refused_with_both_numbers() {
        let said = |pictures: Vec<Picture>| Moving::new(pictures).err().unwrap().to_string();
        assert!(said(vec![picture([1, 1], 0); 4]).ends_with("found 4"));
        let mut pictures = vec![picture([1, 1], 0); 5];
        pictures[3] = Picture::from_grey(8, vec![0; 64]);
        assert!(said(pictures).contains("picture 3 (counted from 0) is [8, 8] px, the first [64, 48]"));
    }
}
