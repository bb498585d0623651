//! The carver against its definition.

use super::*;
use crate::geometry::{BoxUm, Camera, GlassTube, Lookup};
use proptest::prelude::*;

fn camera(f: f64) -> Camera {
    Camera {
        f,
        kx: 0.25,
        ky: 0.25,
        ux: 40.0,
        uy: 30.0,
        s: 0.0,
        alpha: 0.0,
        gamma: 0.0,
        phi: std::f64::consts::FRAC_PI_2,
        width: 80,
        height: 60,
        glass: None,
    }
}

/// The definition of the module's head, word for word and voxel by voxel.
fn brute_force(grid: &VoxelGrid, planned: usize, epsilon: f64, views: &[(Mask, Projection, Leaves)]) -> Vec<bool> {
    let budget = (epsilon * planned as f64 + 1e-9).floor() as usize;
    let lookups: Vec<_> = views.iter().map(|(_, projection, _)| projection.lookup()).collect();
    let [nx, ny, nz] = grid.counts();
    let mut live = Vec::with_capacity(grid.len());
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let x = [grid.centre(0, i), grid.centre(1, j), grid.centre(2, k)];
                let covered = |((mask, _, leaves), lookup): &(&(Mask, Projection, Leaves), &Lookup)| {
                    lookup.project(x).is_some_and(|(u, v)| {
                        let last = (mask.width() - 1) as f64;
                        let beyond = if leaves.left && u < 0.0 {
                            0.0
                        } else if leaves.right && u > last {
                            last
                        } else {
                            u
                        };
                        mask.covers(beyond, v)
                    })
                };
                let missed = views.len() - views.iter().zip(&lookups).filter(covered).count();
                live.push(missed <= budget);
            }
        }
    }
    live
}

/// Whether a voxel is live, by the bits of its block.
pub(crate) fn is_live(carver: &Carver, voxel: [usize; 3]) -> bool {
    let bits = carver.block(voxel.map(|n| (n / BLOCK) as i32));
    let [x, y, z] = voxel.map(|n| n % BLOCK);
    bits[z] >> (BLOCK * y + x) & 1 != 0
}

fn live(carver: &Carver) -> Vec<bool> {
    let [nx, ny, nz] = carver.grid().counts();
    let mut out = Vec::with_capacity(carver.grid().len());
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                out.push(is_live(carver, [i, j, k]));
            }
        }
    }
    out
}

/// Blobs with holes and specks: a few discs added and taken away.
fn mask() -> impl Strategy<Value = Mask> {
    let disc = (-10.0..90.0f64, -10.0..70.0f64, 0.5..40.0f64, prop::bool::weighted(0.7));
    // Widths around whole words, and wider ones; a band across all columns reaches beyond anything.
    let size = (prop_oneof![Just(80usize), Just(1), Just(63), Just(64), Just(65), Just(128), 200..700usize], prop::bool::weighted(0.2));
    // Specks on every so-manyth pixel make ragged edges and rows of many runs.
    (prop::collection::vec(disc, 0..6), prop_oneof![Just(0), 2..40usize], size).prop_map(|(discs, every, (width, banded))| {
        let mut mask = Mask::empty(width, 60);
        if banded {
            (width / 5..width).for_each(|u| (0..60).for_each(|v| mask.set(u, v, true)));
        }
        for (cu, cv, r, inside) in discs {
            for v in 0..60 {
                for u in 0..width {
                    if (u as f64 - cu).hypot(v as f64 - cv) <= r {
                        mask.set(u, v, inside);
                    }
                }
            }
        }
        if every > 0 {
            (0..width * 60).step_by(every).for_each(|n| mask.set(n % width, n / width, !mask.get(n % width, n / width)));
        }
        mask
    })
}

fn leaves() -> impl Strategy<Value = Leaves> {
    prop_oneof![3 => Just(Leaves::default()), 1 => (any::<bool>(), any::<bool>()).prop_map(|(left, right)| Leaves { left, right })]
}

/// A capillary along the image, as a rig has it: from upright to a few degrees of roll and tilt, either way round.
fn capillary(roll_max: f64, tilt_max: f64, nearest: f64) -> impl Strategy<Value = Projection> {
    let roll = prop_oneof![Just(0.0), -1e-7..1e-7f64, -roll_max..roll_max];
    let tilt = prop_oneof![Just(0.0), -tilt_max..tilt_max];
    let turned = prop_oneof![Just(0.0), Just(std::f64::consts::PI)];
    (prop_oneof![Just(60_000.0), nearest..70_000.0], roll, tilt, turned, 0.0..6.3f64, 0.1..0.5f64, -30.0..30.0f64).prop_map(
        |(f, gamma, alpha, turned, omega, k, at)| {
            let base = camera(f);
            Camera { alpha, gamma: gamma + turned, kx: k, ux: base.ux + at, uy: base.uy - at / 3.0, ..base }.projection(omega)
        },
    )
}

/// A capillary of water with a glass wall in water, or with a thin one in air. The wall may stand outside of all voxels or among them.
fn through_glass() -> impl Strategy<Value = Projection> {
    let roll_and_tilt = (-0.2..0.2f64, prop_oneof![Just(0.0), -0.05..0.05f64]);
    let tube = (40.0..200.0f64, 1.02..1.5f64, prop_oneof![3 => Just(1.333), 1 => Just(1.0)]);
    (2000.0..70_000.0f64, roll_and_tilt, 0.0..6.3f64, 0.1..0.5f64, tube).prop_map(
        |(f, (gamma, alpha), omega, k, (bore, ratio, outside))| {
            let glass = GlassTube { bore_radius_um: bore, outer_radius_um: bore * ratio, inside: 1.333, glass: 1.474, outside };
            Camera { alpha, gamma, kx: k, ky: k * 1.333 / outside, glass: Some(glass), ..camera(f) }.projection(omega)
        },
    )
}

/// A small box seen along an oblique x axis, whose vanishing point may lie in the image.
fn oblique() -> impl Strategy<Value = Projection> {
    (20.0..600.0f64, 0.1..1.4f64, -0.2..0.2f64, 300.0..9000.0f64, -60.0..60.0f64).prop_map(|(focal, turn, roll, depth, at)| {
        let r = nalgebra::Rotation3::from_euler_angles(0.0, turn, roll);
        let k = nalgebra::Matrix3::new(focal, 0.0, 40.0 + at, 0.0, focal, 30.0 - at / 2.0, 0.0, 0.0, 1.0);
        let m = k * r.matrix();
        let offset = k * nalgebra::Vector3::new(0.0, 0.0, depth);
        Projection::from_matrix(std::array::from_fn(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)], offset[i]])).unwrap()
    })
}

/// From weak perspective to a camera inside the box; any rotation, or any matrix at all.
fn projection() -> impl Strategy<Value = Projection> {
    let psi = (prop_oneof![Just(60_000.0), 150.0..2000.0f64], -0.5..0.5f64, -0.5..0.5f64, -0.3..0.3f64, 0.0..6.3f64)
        .prop_map(|(f, alpha, gamma, s, omega)| Camera { alpha, gamma, s: s * f, ..camera(f) }.projection(omega));
    let any = prop::array::uniform3(prop::array::uniform4(-1.0..1.0f64)).prop_filter_map("no camera", |m| {
        Projection::from_matrix(std::array::from_fn(|r| {
            // Offsets of the size of the box's coordinates put the camera near it or far from it.
            std::array::from_fn(|c| m[r][c] * if c == 3 { 300.0 } else { 1.0 } * if r < 2 { 40.0 } else { 1.0 })
        }))
        .ok()
    });
    // Whole numbers put many centres on the border between two pixels: exactly, and off it by what rounding does.
    let ties = (0..4u8, prop_oneof![Just(1.0), Just(-1.0)], prop::bool::ANY).prop_map(|(quarter, way, rounded)| {
        if rounded {
            let gamma = if way < 0.0 { std::f64::consts::PI } else { 0.0 };
            return Camera { gamma, ..camera(60_000.0) }.projection(f64::from(quarter) * std::f64::consts::FRAC_PI_2);
        }
        let (c, s) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarter as usize];
        let (u, v) = ([250.0 * way, 40.0 * s, 40.0 * c, 40_000.0], [0.0, 250.0 * way * c, 250.0 * way * s, 30_000.0]);
        Projection::from_matrix([u, v, [0.0, s, c, 1000.0]]).unwrap()
    });
    prop_oneof![4 => capillary(0.2, 0.05, 2000.0), 3 => through_glass(), 3 => psi, 2 => any, 2 => ties, 2 => oblique()]
}

/// Any box; or voxels of whole pixels around the origin, whose centres lie on the borders between pixels.
fn grid() -> impl Strategy<Value = VoxelGrid> {
    let places = prop_oneof![
        3 => (2.0..7.0f64, prop::array::uniform3(-60.0..60.0f64)),
        1 => Just((4.0, [0.0; 3])),
    ];
    (1..210usize, 1..40usize, 1..40usize, places).prop_map(|(nx, ny, nz, (size, at))| {
        let sides = [nx, ny, nz].map(|n| n as f64 * size);
        let bounds = BoxUm { min: std::array::from_fn(|a| at[a] - sides[a] / 2.0), max: std::array::from_fn(|a| at[a] + sides[a] / 2.0) };
        VoxelGrid::new(bounds, size).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn carving_is_the_definition_voxel_by_voxel(
        grid in grid(),
        views in prop::collection::vec((mask(), projection(), leaves()), 1..9),
        spare in 0..3usize,
        epsilon in prop_oneof![Just(0.0), Just(0.05), 0.1..0.8f64],
        left_out in any::<prop::sample::Index>(),
    ) {
        let planned = views.len() + spare;
        let mut carver = Carver::new(grid, planned, epsilon).unwrap();
        for (mask, projection, leaves) in &views {
            carver.observe(mask, projection, *leaves).unwrap();
        }
        let truth = brute_force(&grid, planned, epsilon, &views);
        prop_assert_eq!(carver.live_voxels(), truth.iter().filter(|&&l| l).count() as u64);
        prop_assert_eq!(&live(&carver), &truth);
        let voxels = grid.counts();
        let [nx, ny, nz] = carver.block_counts().map(|n| n as i32);
        for at in (-1..=nz).flat_map(|z| (-1..=ny).flat_map(move |y| (-1..=nx).map(move |x| [x, y, z]))) {
            let bits = carver.block(at);
            let expected = |n: usize| {
                // Negative coordinates wrap to huge ones.
                let within = [n % 8, n / 8 % 8, n / 64];
                let [i, j, k]: [usize; 3] = std::array::from_fn(|a| (at[a] * 8 + within[a] as i32) as usize);
                i < voxels[0] && j < voxels[1] && k < voxels[2] && truth[(k * voxels[1] + j) * voxels[0] + i]
            };
            prop_assert!((0..512).all(|n| (bits[n / 64] >> (n % 64) & 1 != 0) == expected(n)), "block {:?}", at);
            let kind = match bits.iter().map(|b| b.count_ones()).sum::<u32>() {
                0 => BlockKind::Dead,
                512 => BlockKind::Full,
                _ => BlockKind::Mixed,
            };
            prop_assert_eq!(carver.block_kind(at), kind);
        }

        let mut reversed = Carver::new(grid, planned, epsilon).unwrap();
        for (mask, projection, leaves) in views.iter().rev() {
            let before = live(&reversed);
            reversed.observe(mask, projection, *leaves).unwrap();
            prop_assert!(live(&reversed).iter().zip(&before).all(|(now, then)| !now || *then), "a voxel came back");
        }
        prop_assert_eq!(live(&reversed), live(&carver), "the order of views matters");

        let mut fewer = views.clone();
        fewer.remove(left_out.index(views.len()));
        let others: Vec<(usize, Projection)> =
            (0..views.len()).filter(|&at| at != left_out.index(views.len())).map(|at| (at, views[at].1)).collect();
        let mut carver = carver.through(&others);
        prop_assert_eq!(live(&carver), brute_force(&grid, planned, epsilon, &fewer), "carved again without one view");
        carver.replan(views.len()).unwrap();
        prop_assert_eq!(live(&carver), brute_force(&grid, views.len(), epsilon, &fewer), "the same with another plan");
    }

    #[test]
    fn the_residual_volume_is_what_all_views_leave(
        grid in grid(),
        views in prop::collection::vec((mask(), projection(), Just(Leaves::default())), 1..6),
        epsilon in prop_oneof![Just(0.0), 0.1..0.8f64],
    ) {
        let mut residual = ResidualVolume::new(grid, epsilon).unwrap();
        let runs: Vec<_> = views.iter().map(|(mask, ..)| Runs::new(mask).unwrap()).collect();
        // Counting all views first, then fewer: nothing of a count may be left for the next.
        for used in (1..=views.len()).rev() {
            let found = residual.count(runs[..used].iter().zip(views[..used].iter().map(|(_, p, _)| *p))).unwrap();
            let truth = brute_force(&grid, used, epsilon, &views[..used]);
            prop_assert_eq!(found, truth.iter().filter(|&&l| l).count() as u64);
        }
    }

    /// The quick way is taken where it was made for: a check of the two ways that only ever took one would prove nothing.
    #[test]
    fn capillaries_are_carved_by_lines(projection in prop_oneof![capillary(0.1, 0.02, 40_000.0), through_glass()], mask in mask()) {
        let grid = VoxelGrid::new(BoxUm { min: [-100.0; 3], max: [100.0; 3] }, 5.0).unwrap();
        let (runs, centres) = (Runs::new(&mask).unwrap(), definition::centres(&grid));
        let lookup = projection.lookup();
        let view = View::new(&runs, Leaves::default(), &lookup, &centres);
        prop_assert!(Lines::new(view, grid.size(), grid.counts(), &mut lines::Buffers::default()).is_some());
    }
}

/// Rows of voxels run to a vanishing point within the image: columns beyond it have no place on them.
#[test]
fn an_image_that_reaches_past_the_vanishing_point_is_carved_by_the_definition() {
    let covered = |width: usize, height: usize, from: usize| {
        let mut mask = Mask::empty(width, height);
        (from..width).for_each(|u| (0..height).for_each(|v| mask.set(u, v, true)));
        mask
    };
    let row = VoxelGrid::new(BoxUm { min: [0.0, -0.5, -0.5], max: [10.0, 0.5, 0.5] }, 1.0).unwrap();
    let near = Projection::from_matrix([[110.0, 0.0, -20.0, 500.0], [6.0, 100.0, 8.0, 100.0], [0.6, 0.0, 0.8, 10.0]]).unwrap();
    let cube = VoxelGrid::new(BoxUm { min: [-20.0; 3], max: [20.0; 3] }, 1.0).unwrap();
    let c = std::f64::consts::FRAC_1_SQRT_2;
    let (u, v) = ([500.0 * c, 0.0, -300.0 * c, 400_000.0], [100.0 * c, 400.0, 100.0 * c, 400_000.0]);
    let far = Projection::from_matrix([u, v, [c, 0.0, c, 4000.0]]).unwrap();
    for (grid, mask, projection) in [(row, covered(300, 20, 60), near), (cube, covered(1000, 200, 100), far)] {
        let views = [(mask, projection, Leaves::default())];
        let mut carver = Carver::new(grid, 1, 0.0).unwrap();
        carver.observe(&views[0].0, &projection, Leaves::default()).unwrap();
        let truth = brute_force(&grid, 1, 0.0, &views);
        assert!(truth.iter().any(|&l| l) && truth.iter().any(|&l| !l), "the outline passes the box");
        assert!(live(&carver) == truth);
    }
}

#[test]
fn counts_end_where_numbers_do() {
    let grid = VoxelGrid::new(BoxUm { min: [0.0; 3], max: [3.0, 1.0, 1.0] }, 1.0).unwrap();
    let mut carver = Carver::new(grid, 5_000_000_000, 0.99).unwrap();
    carver.observe(&Mask::empty(80, 60), &camera(60_000.0).projection(0.0), Leaves::default()).unwrap();
    assert_eq!((carver.live_voxels(), carver.budget()), (3, u32::MAX - 1));
}

/// Silhouette of a ball at `centre`, by the distance of each pixel's ray from it: no voxel is involved.
fn ball(camera: &Camera, omega: f64, centre: [f64; 3], radius: f64) -> Mask {
    let (sin, cos) = omega.sin_cos();
    let [x, y, z] = centre;
    let turned = [x, cos * y - sin * z, sin * y + cos * z + camera.f];
    let mut mask = Mask::empty(camera.width as usize, camera.height as usize);
    for v in 0..mask.height() {
        for u in 0..mask.width() {
            let ray = [(u as f64 - camera.ux) / (camera.kx * camera.f), (v as f64 - camera.uy) / (camera.ky * camera.f), 1.0];
            let dot: f64 = (0..3).map(|a| ray[a] * turned[a]).sum();
            let length2: f64 = ray.iter().map(|r| r * r).sum();
            let to2: f64 = turned.iter().map(|t| t * t).sum();
            mask.set(u, v, to2 - dot * dot / length2 <= radius * radius);
        }
    }
    mask
}

/// The bias table of the method: the hull of a disc from n directions, with the miss budget, exceeds the disc by
/// `tan` terms alone. A ball is a stack of discs about the axis, each with that same bias, so its volume has it too.
///
/// Tolerance 0.5 %. A pixel of 1.1 um is covered when its centre is, so an outline errs by up to half a pixel, evenly; of
/// two opposite views the smaller one carves, which loses 1/6 pixel on average, 0.07 % of the radius of 250 um and 0.15 % of
/// the volume, at worst (both always short) twice that. The grid's count of a ball of 45 voxels' radius errs by less than
/// 0.1 %. From 60 mm the outlines of opposite views lie R / f = 0.24 deg apart, 3 % of the spacing of 42 directions: 0.1 %.
#[test]
fn the_bias_of_few_directions_is_the_theory() {
    use std::f64::consts::{PI, TAU};
    let camera = Camera { f: 60_000.0, kx: 1.0 / 1.1, ky: 1.0 / 1.1, ux: 255.3, uy: 255.9, width: 512, height: 512, ..camera(1.0) };
    let radius = 250.0;
    let truth = 4.0 / 3.0 * PI * radius * radius * radius;
    let grid = VoxelGrid::new(BoxUm { min: [-300.0; 3], max: [300.0; 3] }, 5.5).unwrap();
    for asd in [7u32, 12, 21, 28] {
        // Opposite views see the same outline: an even number of views are half as many slabs, each seen twice, so that
        // 28 views with one miss allowed tolerate no slab, and 21 with one miss tolerate one side of one.
        let n = f64::from(if asd % 2 == 0 { asd } else { 2 * asd });
        let d = TAU / n;
        let theory = if asd == 21 { n * (d.tan() - (d / 2.0).tan()) / PI } else { n * (PI / n).tan() / PI } - 1.0;
        let mut carver = Carver::new(grid, asd as usize, 0.05).unwrap();
        for view in 0..asd {
            let omega = TAU * f64::from(view) / f64::from(asd);
            carver.observe(&ball(&camera, omega, [3.0, -2.0, 1.0], radius), &camera.projection(omega), Leaves::default()).unwrap();
        }
        let found = carver.volume_um3() / truth - 1.0;
        assert!((found - theory).abs() < 0.005, "ASD {asd}: {:.3} % of bias, theory {:.3} %", 100.0 * found, 100.0 * theory);
    }
}

#[test]
fn the_voxels_are_the_live_ones_at_their_places_with_a_dead_border() {
    let camera = camera(60_000.0);
    let grid = VoxelGrid::new(BoxUm { min: [-300.0, -280.0, -290.0], max: [310.0, 270.0, 300.0] }, 21.0).unwrap();
    let mut carver = Carver::new(grid, 4, 0.0).unwrap();
    assert_eq!(carver.voxels().unwrap().counts, grid.counts().map(|n| n + 2), "nothing is carved yet");
    for view in 0..4 {
        let omega = std::f64::consts::FRAC_PI_4 * f64::from(view);
        let projection = camera.projection(omega);
        carver.observe(&ball(&camera, omega, [40.0, -20.0, 10.0], 120.0), &projection, Leaves::default()).unwrap();
    }
    let voxels = carver.voxels().unwrap();
    assert_eq!(voxels.inside.iter().map(|&v| u64::from(v)).sum::<u64>(), carver.live_voxels());
    let [nx, ny, nz] = voxels.counts;
    let first: [usize; 3] = std::array::from_fn(|a| ((voxels.origin[a] - grid.centre(a, 0)) / grid.size()).round() as usize);
    let mut at_the_border = 0;
    for (z, y, x) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
        let inside = voxels.inside[x + nx * (y + ny * z)] == 1;
        assert_eq!(inside, is_live(&carver, [first[0] + x, first[1] + y, first[2] + z]), "{x} {y} {z}");
        let is_outermost = |n: usize, count: usize| n == 0 || n + 1 == count;
        assert!(!inside || !(is_outermost(x, nx) || is_outermost(y, ny) || is_outermost(z, nz)), "{x} {y} {z} is at the border");
        at_the_border += usize::from(inside && x == 1);
    }
    assert!(at_the_border > 0, "the border is one voxel wide");
}

#[test]
fn what_cannot_be_carved_is_refused_with_its_numbers() {
    let grid = VoxelGrid::new(BoxUm { min: [0.0; 3], max: [10.0; 3] }, 1.0).unwrap();
    assert_eq!(Carver::new(grid, 0, 0.05).unwrap_err(), CarveError::NoViews);
    assert_eq!(Carver::new(grid, 4, 1.0).unwrap_err(), CarveError::Epsilon { found: 1.0 });
    let mut carver = Carver::new(grid, 1, 0.05).unwrap();
    let view = camera(60_000.0).projection(0.0);
    assert_eq!(
        carver.observe(&Mask::empty(0, 5), &view, Leaves::default()),
        Err(CarveError::MaskSize { width: 0, height: 5, limit: 65_535 })
    );
    carver.observe(&Mask::empty(80, 60), &view, Leaves::default()).unwrap();
    assert_eq!(carver.live_voxels(), 0);
    assert_eq!(carver.observe(&Mask::empty(80, 60), &view, Leaves::default()), Err(CarveError::TooManyViews { planned: 1, found: 2 }));
    assert_eq!(carver.replan(0), Err(CarveError::PlanTooSmall { planned: 0, observed: 1 }));
    assert_eq!(carver.through(&[]).live_voxels(), 1000, "nothing carves any more");
}

#[test]
fn budgets_are_those_of_the_axial_sampling_densities() {
    let grid = VoxelGrid::new(BoxUm { min: [0.0; 3], max: [10.0; 3] }, 1.0).unwrap();
    for (views, budget) in [(4, 0), (7, 0), (12, 0), (14, 0), (20, 1), (21, 1), (28, 1), (42, 2), (60, 3), (84, 4)] {
        assert_eq!(Carver::new(grid, views, 0.05).unwrap().budget(), budget, "{views} views");
    }
}
