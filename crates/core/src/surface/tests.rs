//! Surfaces of fields whose area and volume are known.

use super::topology::Topology;
use super::*;
use crate::carver::tests::is_live;
use crate::carver::{BLOCK, Carver, Leaves};
use crate::geometry::{BoxUm, Projection, VoxelGrid};
use crate::profile::Mask;
use proptest::prelude::*;
use std::f64::consts::PI;

/// A field from a function of position, on a lattice of its own extent.
struct Made<F> {
    from: [i32; 3],
    to: [i32; 3],
    spacing: f64,
    level: f32,
    value: F,
}

impl<F: Fn([f64; 3]) -> f32 + Sync> Field for Made<F> {
    fn origin(&self) -> [f64; 3] {
        [0.0; 3]
    }

    fn spacing(&self) -> f64 {
        self.spacing
    }

    fn blocks(&self) -> Vec<[i32; 3]> {
        let range = |a: usize| self.from[a]..self.to[a];
        range(2).flat_map(|z| range(1).flat_map(move |y| range(0).map(move |x| [x, y, z]))).collect()
    }

    fn inside(&self, block: [i32; 3]) -> Inside {
        let row = |n: usize| {
            let within = |x: usize| [x, n % SIDE, n / SIDE];
            (0..SIDE).fold(0, |bits, x| bits | u16::from(self.at(sample(block, within(x))) > self.level) << x)
        };
        std::array::from_fn(row)
    }

    fn crossing(&self, at: [i32; 3], axis: usize) -> f64 {
        let mut next = at;
        next[axis] += 1;
        let (a, b) = (self.at(at), self.at(next));
        f64::from(self.level - a) / f64::from(b - a)
    }
}

impl<F: Fn([f64; 3]) -> f32> Made<F> {
    fn at(&self, sample: [i32; 3]) -> f32 {
        (self.value)(sample.map(|c| f64::from(c) * self.spacing))
    }
}

/// A block's sample in the lattice's own numbers.
fn sample(block: [i32; 3], within: [usize; 3]) -> [i32; 3] {
    std::array::from_fn(|a| block[a] * BLOCK as i32 + within[a] as i32)
}

fn ball_field(radius: f64, spacing: f64, centre: [f64; 3]) -> impl Field {
    let reach = ((radius + 3.0 * spacing) / spacing / BLOCK as f64).ceil() as i32;
    let value = move |x: [f64; 3]| (radius - (0..3).map(|a| (x[a] - centre[a]).powi(2)).sum::<f64>().sqrt()) as f32;
    Made { from: [-reach - 1; 3], to: [reach + 1; 3], spacing, level: 0.0, value }
}

fn area(mesh: &Mesh) -> f64 {
    mesh.triangles
        .iter()
        .map(|&t| {
            let [a, b, c] = mesh.corners(t);
            let n = mesh::cross(mesh::sub(b, a), mesh::sub(c, a));
            mesh::dot(n, n).sqrt() / 2.0
        })
        .sum()
}

fn volume(mesh: &Mesh) -> f64 {
    mesh.triangles
        .iter()
        .map(|&t| {
            let [a, b, c] = mesh.corners(t);
            mesh::dot(a, mesh::cross(b, c)) / 6.0
        })
        .sum()
}

/// Triangles inscribed in a ball of radius R with sides up to sqrt(3) h lose at most the sagitta `3 h^2 / 8 R` of the
/// radius, twice its share in area and three times in volume; interpolation along the edges adds `h^2 / 8 R` at most. So the
/// relative error is below `4 (h / R)^2 / 8` times 2 and 3, and shrinks with the square of h.
#[test]
fn balls_have_their_area_and_volume_at_three_resolutions() {
    let radius = 100.0;
    for spacing in [20.0, 10.0, 5.0] {
        let mesh = extract(&ball_field(radius, spacing, [1.3, -2.7, 0.4]));
        let topology = Topology::of(&mesh);
        assert!(topology.is_closed() && topology.euler_characteristic() == 2, "{topology:?}");
        let bound = 0.5 * (spacing / radius) * (spacing / radius);
        let area_error = area(&mesh) / (4.0 * PI * radius * radius) - 1.0;
        let volume_error = volume(&mesh) / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0;
        assert!(area_error.abs() < 2.0 * bound, "spacing {spacing}: area {area_error}");
        assert!(volume_error < 0.0 && -volume_error < 3.0 * bound, "spacing {spacing}: volume {volume_error}");
    }
}

/// The same samples meshed by an independent dual method. Its vertices are means of the crossings of a cell, inside the ball
/// by up to the sagitta of a cell: `3 h^2 / 8 R`, that is 0.4 % of the radius at h = R / 10, 0.8 % of area, 1.2 % of volume.
#[test]
fn an_independent_mesher_agrees() {
    use fast_surface_nets::ndshape::{ConstShape, ConstShape3u32};
    type Shape = ConstShape3u32<32, 32, 32>;
    let (radius, spacing) = (100.0, 10.0);
    let samples: Vec<f32> = (0..Shape::SIZE)
        .map(|n| {
            let at = Shape::delinearize(n).map(|c| (f64::from(c) - 16.0) * spacing);
            ((at[0] * at[0] + at[1] * at[1] + at[2] * at[2]).sqrt() - radius) as f32
        })
        .collect();
    let mut nets = fast_surface_nets::SurfaceNetsBuffer::default();
    fast_surface_nets::surface_nets(&samples, &Shape {}, [0; 3], [31; 3], &mut nets);
    let theirs = Mesh {
        vertices: nets.positions.iter().map(|p| p.map(|c| (f64::from(c) - 16.0) * spacing)).collect(),
        triangles: nets.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    };
    let ours = extract(&ball_field(radius, spacing, [0.0; 3]));
    // A quad of theirs stands for each crossed edge, a vertex of ours: V and 2 V triangles, 2 V - 4 by Euler.
    let ratio = ours.triangles.len() as f64 / theirs.triangles.len() as f64;
    assert!(ours.triangles.len() > 1000 && (0.95..1.05).contains(&ratio), "{ratio}");
    assert!((area(&ours) / area(&theirs) - 1.0).abs() < 0.008, "{} {}", area(&ours), area(&theirs));
    assert!((volume(&ours) / volume(&theirs).abs() - 1.0).abs() < 0.012, "{} {}", volume(&ours), volume(&theirs));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every ambiguous pattern occurs in noise: the surface must bound a volume all the same, to the last block's edge.
    #[test]
    fn the_surface_of_noise_is_closed_and_encloses_what_is_inside(seed in any::<u64>(), share in 0.05..0.95f64) {
        let inside = move |x: [f64; 3]| {
            let within = x.iter().all(|&c| (-7.5..11.5).contains(&c));
            // A hash of the position, mixed by multiplications.
            let mut h = seed;
            for c in x {
                h = (h ^ (c as i64 as u64)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                h ^= h >> 29;
            }
            f32::from(u8::from(within && ((h >> 11) as f64 / (1u64 << 53) as f64) < share))
        };
        let field = Made { from: [-2; 3], to: [3; 3], spacing: 1.0, level: 0.5, value: inside };
        let mesh = extract(&field);
        let topology = Topology::of(&mesh);
        prop_assert!(topology.is_closed(), "{:?}", topology);
        prop_assert!(volume(&mesh) > 0.0);
        let mut used = mesh.triangles.concat();
        used.sort_unstable();
        used.dedup();
        prop_assert_eq!(used.len(), mesh.vertices.len(), "every vertex belongs to a triangle");
    }
}

/// A carver whose hull is what a mask lets through along z: a prism, here over the whole depth of the grid.
fn prism() -> Carver {
    let grid = VoxelGrid::new(BoxUm { min: [0.0; 3], max: [43.0, 21.0, 19.0] }, 1.0).unwrap();
    let mut mask = Mask::empty(50, 30);
    for v in 0..30 {
        for u in 0..50 {
            // A ring, so that the surface has a handle, reaching over the grid's edge at the left.
            let r = (u as f64 - 8.0).hypot(v as f64 - 10.0);
            mask.set(u, v, (3.0..9.5).contains(&r));
        }
    }
    let mut carver = Carver::new(grid, 1, 0.0).unwrap();
    // From so far away the rays are parallel to 20 parts in a million.
    let far = Projection::from_matrix([[1e6, 0.0, 0.0, 0.0], [0.0, 1e6, 0.0, 0.0], [0.0, 0.0, 1.0, 1e6]]).unwrap();
    carver.observe(&mask, &far, Leaves::default()).unwrap();
    carver
}

#[test]
fn the_binary_field_is_the_hull_to_the_grids_edge() {
    let carver = prism();
    let field = Occupancy(&carver);
    let mesh = extract(&field);
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed(), "{topology:?}");
    assert_eq!(topology.euler_characteristic(), 0, "a ring has one handle");
    // The surface passes half a voxel outside the centres of the outermost live voxels: between the hull's volume and the
    // volume of a hull whose edges are all chamfered.
    let voxels = carver.live_voxels() as f64;
    assert!((0.9..1.0).contains(&(volume(&mesh) / voxels)), "{} {voxels}", volume(&mesh));
    // No block with surface was left out: marching over all blocks finds the same.
    let all = extract(&Made {
        from: [-1; 3],
        to: [8; 3],
        spacing: 1.0,
        level: 0.5,
        value: |x: [f64; 3]| {
            let live = x.iter().all(|&c| c >= 0.0) && is_live(&carver, x.map(|c| c as usize));
            f32::from(u8::from(live))
        },
    });
    assert_eq!(all.triangles, mesh.triangles);
}

#[test]
fn the_coarse_field_is_the_share_of_live_voxels() {
    let carver = prism();
    let coarse = Coarse::new(&carver);
    assert_eq!(coarse.spacing(), 4.0);
    assert_eq!(coarse.origin(), [2.0; 3]);
    // The level is half the cube: 32 of its 64 voxels; where two cubes differ in sign, the crossing tells their shares.
    let live = |at: [i32; 3]| {
        let of = |n: i32| -> [i32; 3] { std::array::from_fn(|a| 4 * at[a] + [n % 4, n / 4 % 4, n / 16][a]) };
        let counted = |v: &[i32; 3]| v.iter().all(|&c| c >= 0) && is_live(&carver, v.map(|c| c as usize));
        (0..64).map(of).filter(counted).count() as f64 / 64.0
    };
    let mut crossed = 0;
    for block in coarse.blocks() {
        let inside = coarse.inside(block);
        for n in 0..SIDE * SIDE * SIDE {
            let within = [n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE];
            let at = sample(block, within);
            assert_eq!(inside[n / SIDE] >> within[0] & 1 != 0, live(at) > 0.5, "{at:?}");
            let next = [at[0] + 1, at[1], at[2]];
            let (a, b) = (live(at), live(next));
            if (a > 0.5) != (b > 0.5) {
                crossed += 1;
                assert!((coarse.crossing(at, 0) - (0.5 - a) / (b - a)).abs() < 1e-6, "{at:?}");
            }
        }
    }
    assert!(crossed > 10);
    assert!(Topology::of(&extract(&coarse)).is_closed());
}

/// Against the dense solution of the same system.
#[test]
fn one_iteration_solves_the_implicit_system() {
    let mesh = extract(&ball_field(3.0, 1.0, [0.2, 0.1, 0.3]));
    let n = mesh.vertices.len();
    let lambda = 0.8;
    let mut neighbours = vec![std::collections::BTreeSet::new(); n];
    for t in &mesh.triangles {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            neighbours[t[a] as usize].insert(t[b] as usize);
            neighbours[t[b] as usize].insert(t[a] as usize);
        }
    }
    let faired = fair(&mesh, Fairing { lambda, iterations: 1 }).unwrap();
    // (I - lambda U) applied to the answer gives the question.
    for (i, list) in neighbours.iter().enumerate() {
        for c in 0..3 {
            let mean = list.iter().map(|&j| faired.vertices[j][c]).sum::<f64>() / list.len() as f64;
            let back = faired.vertices[i][c] - lambda * (mean - faired.vertices[i][c]);
            // The residual of the whole is 1e-6 of the coordinates' norm, some 3 sqrt(n).
            assert!((back - mesh.vertices[i][c]).abs() < 1e-6 * 3.0 * (n as f64).sqrt() * 3.0, "vertex {i}");
        }
    }
    assert_eq!(fair(&mesh, Fairing { lambda: -1.0, iterations: 1 }), Err(FairingError::Lambda { found: -1.0 }));
    let mut open = mesh.clone();
    let [a, b, _] = open.triangles.pop().unwrap();
    assert!(matches!(fair(&open, Fairing { lambda, iterations: 1 }), Err(FairingError::Open { .. })), "side {a}-{b} has no partner");
    assert_eq!(fair(&mesh, Fairing { lambda, iterations: 0 }).unwrap().triangles, mesh.triangles);
}

/// The paper's path on a binary ball of 500 um, SD 6.93. Marching cubes on the staircase exceeds the area by 8 to 10 %;
/// ten iterations with lambda 0.8 bring it within 1 %. (What remains is pinned, not promised: shrinkage and residual
/// steps cancel at about this sampling.)
#[test]
fn fairing_takes_the_staircase_off_a_binary_ball() {
    let radius: f64 = 250.0;
    let value = move |x: [f64; 3]| f32::from(u8::from((x[0] - 1.1).powi(2) + (x[1] + 2.0).powi(2) + x[2].powi(2) <= radius * radius));
    let mesh = extract(&Made { from: [-6; 3], to: [6; 3], spacing: 6.93, level: 0.5, value });
    let truth = 4.0 * PI * radius * radius;
    let raw = area(&mesh) / truth - 1.0;
    assert!((0.08..0.10).contains(&raw), "raw {raw}");
    let faired = fair(&mesh, Fairing { lambda: 0.8, iterations: 10 }).unwrap();
    let area_error = area(&faired) / truth - 1.0;
    assert!(area_error.abs() < 0.01, "faired {area_error}");
    let loss = 1.0 - volume(&faired) / volume(&mesh);
    assert!((0.0..0.01).contains(&loss), "volume loss {loss}");
}
