//! The dark parts of a specimen: voxels that nearly all views show as dark.

use super::Lit;
use super::ellipsoid::Ellipsoid;
use crate::geometry::BoxUm;
use crate::parallel::prelude::*;
use nalgebra::{Matrix3, Vector3};

/// Edge of a voxel, um: a quarter of an eye's smallest half axis.
const VOXEL_UM: f64 = 16.0;
/// Largest transmissions of a dark pixel, in the order in which they are tried. Eyes transmit a tenth at most, and the densest tissue a third.
pub(super) const LEVELS: [f64; 4] = [0.05, 0.1, 0.16, 0.24];
/// Share of the length, from either end, in which eyes lie.
const HEAD: f64 = 0.3;
/// Largest shift of one eye along the body against the other, over their distance.
const MOST_ASKEW: f64 = 0.6;
/// Least size of one part over that of the other, in voxels.
const LEAST_SHARE: f64 = 0.04;
/// Share of the views that may show a dark voxel brighter, as beside a reflection.
const MISSES: f64 = 0.1;
/// A part reaches at least this many voxels deep, so it is three voxels thick or more. The pigment of the skin is thinner.
const LEAST_DEPTH: u8 = 2;
/// Thickest parts among which the pair is chosen.
const MOST_PARTS: usize = 4;
/// Shares of the greatest depth at which parts are told apart, until there are two.
const SPLITS: [f64; 4] = [0.5, 0.65, 0.8, 0.95];

/// A block of voxels. The number of voxel (x, y, z) is (z ny + y) nx + x.
struct Block {
    at: [f64; 3],
    counts: [usize; 3],
}

impl Block {
    fn of(extents: &BoxUm) -> Self {
        let sides: [f64; 3] = std::array::from_fn(|a| extents.max[a] - extents.min[a]);
        Self { at: extents.min, counts: sides.map(|side| (side / VOXEL_UM).ceil().max(1.0) as usize) }
    }

    fn centre(&self, voxel: usize) -> Vector3<f64> {
        let [nx, ny, _] = self.counts;
        let index = [voxel % nx, voxel / nx % ny, voxel / nx / ny];
        Vector3::from_fn(|a, _| self.at[a] + (index[a] as f64 + 0.5) * VOXEL_UM)
    }

    /// The six neighbours. `None` beyond the block.
    fn around(&self, voxel: usize) -> [Option<usize>; 6] {
        let [nx, ny, nz] = self.counts;
        let (x, y, z) = (voxel % nx, voxel / nx % ny, voxel / nx / ny);
        [
            (x > 0).then(|| voxel - 1),
            (x + 1 < nx).then(|| voxel + 1),
            (y > 0).then(|| voxel - nx),
            (y + 1 < ny).then(|| voxel + nx),
            (z > 0).then(|| voxel - nx * ny),
            (z + 1 < nz).then(|| voxel + nx * ny),
        ]
    }
}

/// The two thickest dark parts near one end of the specimen as rough ellipsoids, the thicker first. They are up to 30 % too large or too small.
/// One where there are no two beside each other. A pixel is dark up to transmission `level`.
pub(super) fn thickest(views: &[Lit], extents: &BoxUm, level: f64) -> Vec<Ellipsoid> {
    let block = Block::of(extents);
    let reach_um = HEAD * (extents.max[0] - extents.min[0]);
    let dark = dark(&block, views, level);
    let near_end = |is_left: bool| {
        let is_near = |voxel: usize| {
            let x = block.centre(voxel).x;
            if is_left { x < extents.min[0] + reach_um } else { x > extents.max[0] - reach_um }
        };
        two(&block, &depths(&block, (0..dark.len()).map(|v| dark[v] && is_near(v)).collect()))
    };
    let [left, right] = [true, false].map(near_end);
    if right.len() > left.len() { right } else { left }
}

/// The two thickest parts that lie beside each other, or the thickest.
fn two(block: &Block, depths: &[u8]) -> Vec<Ellipsoid> {
    let deepest = depths.iter().copied().max().unwrap_or(0);
    if deepest < LEAST_DEPTH {
        return Vec::new();
    }
    let mut first = Vec::new();
    for share in SPLITS {
        let least = ((share * f64::from(deepest)).ceil() as u8).max(1);
        let mut parts = connected(block, depths, least);
        parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
        parts.truncate(MOST_PARTS);
        let found: Vec<Ellipsoid> = parts.iter().map(|part| rough(block, part, (f64::from(least) - 0.5) * VOXEL_UM)).collect();
        // A dense head is a third part, between the eyes: the pair is large and far apart.
        let pairs = (0..found.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let best = pairs
            .filter_map(|(a, b)| {
                let apart = found[b].centre - found[a].centre;
                let [larger, smaller] = [parts[a].len() as f64, parts[b].len() as f64];
                (apart.x.abs() < MOST_ASKEW * apart.norm() && smaller >= LEAST_SHARE * larger).then(|| (smaller * apart.norm(), [a, b]))
            })
            .max_by(|x, y| x.0.total_cmp(&y.0));
        if let Some((_, [a, b])) = best {
            return vec![found[a], found[b]];
        }
        if first.is_empty() {
            first = found.into_iter().take(1).collect();
        }
    }
    first
}

fn dark(block: &Block, views: &[Lit], level: f64) -> Vec<bool> {
    let most = (MISSES * views.len() as f64) as usize;
    let lookups: Vec<_> = views.iter().map(|view| (view.projection.lookup(), view.shade)).collect();
    // Views that are next to each other show nearly the same, so every fifth comes first.
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by_key(|k| k % 5);
    let is_dark = |voxel: usize| {
        let at: [f64; 3] = block.centre(voxel).into();
        let mut misses = 0;
        for &k in &order {
            let (lookup, shade) = &lookups[k];
            if lookup.project(at).and_then(|at| shade.at(at)).is_none_or(|light| light > level) {
                misses += 1;
                if misses > most {
                    return false;
                }
            }
        }
        true
    };
    (0..block.counts.iter().product()).into_par_iter().with_min_len(4096).map(is_dark).collect()
}

/// How many voxels deep each dark voxel lies. 0 for one that is not dark, 1 at the surface.
fn depths(block: &Block, dark: Vec<bool>) -> Vec<u8> {
    let mut depths: Vec<u8> = dark.into_iter().map(u8::from).collect();
    let mut layer: Vec<usize> = (0..depths.len()).filter(|&v| depths[v] != 0).collect();
    for depth in 1..u8::MAX {
        let inner = |&v: &usize| block.around(v).into_iter().all(|n| n.is_some_and(|n| depths[n] >= depth));
        let next: Vec<usize> = layer.into_iter().filter(inner).collect();
        if next.is_empty() {
            break;
        }
        for &v in &next {
            depths[v] = depth + 1;
        }
        layer = next;
    }
    depths
}

/// The connected parts of what lies `least` voxels deep or deeper.
fn connected(block: &Block, depths: &[u8], least: u8) -> Vec<Vec<usize>> {
    let mut open: Vec<bool> = depths.iter().map(|&d| d >= least).collect();
    let mut parts = Vec::new();
    for first in 0..open.len() {
        if !std::mem::take(&mut open[first]) {
            continue;
        }
        let (mut part, mut next) = (vec![first], 0);
        while let Some(&voxel) = part.get(next) {
            next += 1;
            part.extend(block.around(voxel).into_iter().flatten().filter(|&n| std::mem::take(&mut open[n])));
        }
        parts.push(part);
    }
    parts
}

/// The ellipsoid with the moments of a part, made larger by what was peeled off.
fn rough(block: &Block, part: &[usize], peeled_um: f64) -> Ellipsoid {
    let n = part.len() as f64;
    let centre = part.iter().map(|&v| block.centre(v)).sum::<Vector3<f64>>() / n;
    let moments = part.iter().map(|&v| block.centre(v) - centre).map(|d| d * d.transpose()).sum::<Matrix3<f64>>() / n;
    let eigen = moments.symmetric_eigen();
    let half = eigen.eigenvalues.map(|e| ((5.0 * e.max(0.0)).sqrt() + peeled_um + VOXEL_UM / 2.0).powi(2));
    Ellipsoid { centre, spread: eigen.eigenvectors * Matrix3::from_diagonal(&half) * eigen.eigenvectors.transpose() }
}
