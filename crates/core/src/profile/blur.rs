//! The blur of a frame, estimated from its clear edges.
//!
//! ```text
//!   residual of all clear edges       \                     /     sharp: step and rims
//!   under models of each blur           '.     ..      __.-'      rounded: root as well
//!                                          '--'  '----'           the least one is the frame's
//!                                     0.3 px ......... 4 px
//! ```

use super::onset::{Kind, Onsets};

/// A blur that differs by at most this share moves no edge by 0.05 px.
pub(super) const SAME_BLUR: f64 = 0.04;
/// The fit overestimates the blur of discs of known blur (0.6 to 2.0 px) by this factor.
const READ_HIGH: f64 = 1.05;

/// The blur, px, near an expected one, and the kind of edges, with the smallest residual. Rounded edges are accepted where they
/// explain `rounded_better` times more than sharp ones.
pub(super) fn estimated(near_px: f64, rounded_better: f64, mut residual: impl FnMut(f64, Kind) -> f64) -> (f64, Kind) {
    /// The right blur lowers the residual of rounded edges by this factor at most.
    const BETTER_BLUR: f64 = 4.0;
    let start = Models::step(near_px);
    let sharp = least_near(start, |step| residual(Models::blur_px(step), Kind::Sharp));
    let rounded = residual(Models::blur_px(sharp.0.round() as i32), Kind::Rounded);
    if rounded * rounded_better > BETTER_BLUR * sharp.1 {
        return (Models::blur_px_between(sharp.0) / READ_HIGH, Kind::Sharp);
    }
    let rounded = least_near(start, |step| residual(Models::blur_px(step), Kind::Rounded));
    let (best, kind) = if rounded.1 * rounded_better < sharp.1 { (rounded, Kind::Rounded) } else { (sharp, Kind::Sharp) };
    (Models::blur_px_between(best.0) / READ_HIGH, kind)
}

/// The models by blur, each made once. A frame needs few of them, and the next frame the same ones.
#[derive(Default)]
pub(super) struct Models {
    pub search_px: [f64; 2],
    made: Vec<(i32, Kind, [f64; 2], Onsets)>,
}

impl Models {
    /// Steps per doubling of the blur. A step is less than [`SAME_BLUR`] of the blur to either side.
    const PER_DOUBLING: f64 = 12.0;
    const RANGE_PX: (f64, f64) = (0.3, 4.0);

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
            self.made.push((key.0, kind, self.search_px, Onsets::new(Self::blur_px(key.0), kind, self.search_px)));
            self.made.len() - 1
        });
        &self.made[at].3
    }
}

/// Descends in steps of the blur from `start`, first wide, then narrow, and interpolates between steps by a parabola. Returns
/// the place and the smallest residual.
fn least_near(start: i32, mut residual: impl FnMut(i32) -> f64) -> (f64, f64) {
    let bounds = Models::step(Models::RANGE_PX.0)..=Models::step(Models::RANGE_PX.1);
    // The neighbours of the best step are asked for twice.
    let mut known = [None; 64];
    let mut residual = |step: i32| *known[(step - bounds.start()) as usize % known.len()].get_or_insert_with(|| residual(step));
    let mut best = (start, residual(start));
    for stride in [4, -4, 2, -2] {
        while bounds.contains(&(best.0 + stride)) {
            let next = (best.0 + stride, residual(best.0 + stride));
            if next.1 >= best.1 {
                break;
            }
            best = next;
        }
    }
    if !bounds.contains(&(best.0 - 2)) || !bounds.contains(&(best.0 + 2)) {
        return (f64::from(best.0), best.1);
    }
    let (a, c) = (residual(best.0 - 2), residual(best.0 + 2));
    let bend = a - 2.0 * best.1 + c;
    let part = if bend > 0.0 { (a - c) / bend } else { 0.0 };
    (f64::from(best.0) + part.clamp(-2.0, 2.0), best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parabola over the blur's logarithm, at any blur in range and begun from another one.
    #[test]
    fn the_least_residual_tells_the_blur_and_the_kind() {
        for truth in [0.5, 1.1, 3.0] {
            for (kind, rounded_by) in [(Kind::Sharp, 0.6), (Kind::Rounded, 0.4)] {
                let residual =
                    |blur_px: f64, of: Kind| (1.0 + (blur_px / truth).log2().powi(2)) * if of == Kind::Rounded { rounded_by } else { 1.0 };
                let (found, seen_as) = estimated(1.2, 2.0, residual);
                assert!((found * READ_HIGH / truth - 1.0).abs() < 0.01 && seen_as == kind, "{found} for {truth}, {seen_as:?}");
            }
        }
    }
}
