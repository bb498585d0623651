//! The blur of a frame, estimated from its clear edges.
//!
//! ```text
//!   residual of all clear edges       \                     /     sharp: step and rims
//!   under models of each blur           '.     ..      __.-'      rounded: root as well
//!                                          '--'  '----'           the least one is the frame's
//!                                     0.3 px ......... 4 px
//! ```

use super::onset::{Kind, Onsets};

/// A blur that differs by this share moves an edge by 0.07 px at most.
pub(in crate::profile) const SAME_BLUR: f64 = 0.04;
/// The fit overestimates the blur of sharp edges by this factor. What lies under the surface rounds an edge a little, and that looks like
/// blur: of beads of known blur (0.7 to 1.6 px through a colour mosaic) it is 0.5 %, of larvae with pigment 3 %.
const READ_HIGH: f64 = 1.02;
/// The fit underestimates the blur of rounded edges by this factor: a root that begins further outside looks like less blur. An edge moves
/// inwards by 0.04 px per per cent of it. With this factor larvae without fins are 0.2 % too large in path-traced frames, and 0.1 % in emulated
/// ones if all their edges are taken as rounded.
const READ_LOW: f64 = 0.96;

/// Strides of the descent to the kind of edges, and of the one to their blur, in steps. The residual rises faster towards sharper
/// edges than towards blurred ones, so that a parabola over wide strides would find the blur too large.
const WIDE: [i32; 4] = [16, -16, 8, -8];
const NARROW: [i32; 4] = [4, -4, 2, -2];

/// The blur, px, near an expected one, and the kind of edges, with the smallest residual, which is in units of the noise, one of them
/// added. Rounded edges are accepted where they explain `rounded_better` times more than sharp ones, or all but the noise.
pub(in crate::profile) fn estimated(near_px: f64, rounded_better: f64, mut residual: impl FnMut(f64, Kind) -> f64) -> (f64, Kind) {
    /// Largest residual of edges that are explained but for the noise. Those of the second renderer, which blurs by a disc, have a median of 8 or more.
    const NOISE_ALONE: f64 = 2.5;
    /// What leaves so much less than the other kind, and the noise alone, is the truth.
    const NOISE_ALONE_BETTER: f64 = 1.5;
    let start = Models::step(near_px);
    let mut kind = Kind::Sharp;
    let mut at = |step: i32, kind: Kind| residual(Models::blur_px(step), kind);
    let mut best = least_near(start, WIDE, |step| at(step, kind));
    // No residual is below 1.
    if best.1 >= NOISE_ALONE_BETTER {
        let rounded = least_near(best.0, WIDE, |step| at(step, Kind::Rounded));
        let better = if rounded.1 <= NOISE_ALONE { NOISE_ALONE_BETTER } else { rounded_better };
        if rounded.1 * better < best.1 {
            (best, kind) = (rounded, Kind::Rounded);
        }
    }
    let read = if kind == Kind::Sharp { READ_HIGH } else { READ_LOW };
    (Models::blur_px_between(between(best.0, |step| at(step, kind))) / read, kind)
}

/// The models by blur, the newest ones.
#[derive(Default)]
pub(in crate::profile) struct Models {
    pub search_px: [f64; 2],
    made: Vec<(i32, Kind, [f64; 2], Onsets)>,
}

impl Models {
    /// Steps per doubling of the blur. An edge moves by 0.012 px per half step.
    const PER_DOUBLING: f64 = 48.0;
    const RANGE_PX: (f64, f64) = (0.3, 4.0);
    /// Models that are kept, about 0.6 MB each. A frame needs fifteen, and the frames of a turn much the same ones.
    const KEPT: usize = 48;

    fn steps() -> std::ops::RangeInclusive<i32> {
        Self::step(Self::RANGE_PX.0)..=Self::step(Self::RANGE_PX.1)
    }

    fn step(blur_px: f64) -> i32 {
        (blur_px.clamp(Self::RANGE_PX.0, Self::RANGE_PX.1).log2() * Self::PER_DOUBLING).round() as i32
    }

    fn blur_px(step: i32) -> f64 {
        Self::blur_px_between(f64::from(step))
    }

    fn blur_px_between(step: f64) -> f64 {
        (step / Self::PER_DOUBLING).exp2()
    }

    pub fn get(&mut self, blur_px: f64, kind: Kind) -> &Onsets {
        let key = (Self::step(blur_px), kind, self.search_px);
        let at = self.made.iter().position(|(step, kind, search_px, _)| (*step, *kind, *search_px) == key).unwrap_or_else(|| {
            if self.made.len() == Self::KEPT {
                self.made.remove(0);
            }
            self.made.push((key.0, kind, self.search_px, Onsets::new(Self::blur_px(key.0), kind, self.search_px)));
            self.made.len() - 1
        });
        &self.made[at].3
    }
}

/// Descends from `start` by these strides, one after the other. Returns the step with the smallest residual, and the residual.
fn least_near(start: i32, strides: [i32; 4], mut residual: impl FnMut(i32) -> f64) -> (i32, f64) {
    let mut best = (start, residual(start));
    for stride in strides {
        while Models::steps().contains(&(best.0 + stride)) {
            let next = (best.0 + stride, residual(best.0 + stride));
            if next.1 >= best.1 {
                break;
            }
            best = next;
        }
    }
    best
}

/// Descends from `start` by narrow strides, and interpolates between them by a parabola.
fn between(start: i32, mut residual: impl FnMut(i32) -> f64) -> f64 {
    let (step, b) = least_near(start, NARROW, &mut residual);
    let stride = NARROW[2];
    if ![step - stride, step + stride].iter().all(|step| Models::steps().contains(step)) {
        return f64::from(step);
    }
    let (a, c) = (residual(step - stride), residual(step + stride));
    let bend = a - 2.0 * b + c;
    let part = if bend > 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
    f64::from(step) + f64::from(stride) * part.clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parabola over the blur's logarithm, at any blur in range and begun from another one.
    #[test]
    fn the_least_residual_tells_the_blur_and_the_kind() {
        for truth in [0.5, 1.1, 3.0] {
            for (kind, rounded_by) in [(Kind::Sharp, 0.6), (Kind::Rounded, 0.4)] {
                let residual = |blur_px: f64, of: Kind| {
                    10.0 * (1.0 + (blur_px / truth).log2().powi(2)) * if of == Kind::Rounded { rounded_by } else { 1.0 }
                };
                let (found, seen_as) = estimated(1.2, 2.0, residual);
                let read = if kind == Kind::Sharp { READ_HIGH } else { READ_LOW };
                assert!((found * read / truth - 1.0).abs() < 0.01 && seen_as == kind, "{found} for {truth}, {seen_as:?}");
            }
        }
    }
}
