//! Points of neighbouring slices joined to the free edges of fins.

use super::body::smoothed;
use super::points::Point;
use super::{Fin, Slice};
use crate::statistics::upper_median;

/// Largest distance of a point from the end of a chain, px, and what each missing slice adds to it.
const JUMP_PX: f64 = 5.0;
const JUMP_PER_GAP: f64 = 0.2;
/// Most slices between two points of a chain.
const GAP_MOST: usize = 20;
/// Points at the end of a chain whose median is its end.
const END: usize = 5;
/// Least points of a fin.
const POINTS_LEAST: usize = 30;
/// Slices over which a chain's points are the median, and those of the mean after it.
const MEDIAN: usize = 9;
const SIGMA: f64 = 5.0;

/// A chain: slices and their points.
type Chain = Vec<(usize, Point)>;

/// The fins that go on from slice to slice.
pub(super) fn chained(slices: &[Slice], points: &[Vec<Point>], px_um: f64) -> Vec<Fin> {
    let mut chains: Vec<Chain> = Vec::new();
    for (at, here) in points.iter().enumerate() {
        for &point in here {
            let nearest = chains
                .iter_mut()
                .filter_map(|chain| Some((distance(chain, at, point)?, chain)))
                .filter(|(distance, _)| *distance < JUMP_PX * px_um)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((_, chain)) => chain.push((at, point)),
                None => chains.push(vec![(at, point)]),
            }
        }
    }
    chains.iter().filter(|chain| chain.len() >= POINTS_LEAST).map(|chain| fin(chain, slices)).collect()
}

/// Distance of a point from the end of a chain, less for a chain whose end is farther back. `None` where it cannot go on there.
fn distance(chain: &Chain, at: usize, point: Point) -> Option<f64> {
    let (last, _) = *chain.last()?;
    let gap = at - last;
    if gap == 0 || gap > GAP_MOST {
        return None;
    }
    let end = &chain[chain.len().saturating_sub(END)..];
    let [y, z] = [0, 1].map(|k| upper_median(end.iter().map(|(_, p)| p.at_um[k]).collect()) - point.at_um[k]);
    Some(y.hypot(z) / (1.0 + JUMP_PER_GAP * gap as f64))
}

/// A chain without holes, smoothed.
fn fin(chain: &Chain, slices: &[Slice]) -> Fin {
    let n = chain.len();
    let (first, last) = (chain[0].0, chain[n - 1].0);
    let [y, z] = [0, 1].map(|k| {
        let medians: Vec<f64> = (0..n)
            .map(|i| upper_median((0..MEDIAN).map(|j| chain[(i + j).saturating_sub(MEDIAN / 2).min(n - 1)].1.at_um[k]).collect()))
            .collect();
        let filled: Vec<f64> = (first..=last)
            .map(|x| {
                let after = chain.partition_point(|(at, _)| *at < x);
                if chain[after].0 == x {
                    return medians[after];
                }
                let (from, to) = (chain[after - 1].0, chain[after].0);
                medians[after - 1] + (x - from) as f64 / (to - from) as f64 * (medians[after] - medians[after - 1])
            })
            .collect();
        smoothed(&filled, SIGMA)
    });
    let points_um = (first..=last).zip(y.iter().zip(&z)).map(|(x, (&y, &z))| [slices[x].x_um, y, z]).collect();
    Fin { points_um, edges: upper_median(chain.iter().map(|(_, p)| p.edges as f64).collect()) as usize }
}
