//! Iso-surface, fairing, field and decimation of a larva-like solid, 84 views of 30e6 voxels: `cargo bench --bench surface`.
//!
//! ```text
//!      ___________
//!    /  head      ---_______________ ___
//!   (      body                     |fin|==      ellipsoids: an ellipsoid's outline is an ellipse, exactly
//!    \_ yolk _____------------------|___|
//! ```

use carved::export;
use carved_core::carver::{Carver, Leaves};
use carved_core::geometry::{BoxUm, Camera, Projection, VoxelGrid};
use carved_core::profile::Mask;
use carved_core::surface::{Coarse, Contour, Distance, Fairing, Occupancy, extract, fair};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Matrix3x4, Matrix4};
use std::hint::black_box;

const SD_UM: f64 = 5.5;
const VIEWS: u32 = 84;
/// Centre and half axes, um.
const PARTS: [([f64; 3], [f64; 3]); 4] = [
    ([-150.0, 0.0, 0.0], [1750.0, 185.0, 165.0]),
    ([-1350.0, -10.0, 10.0], [480.0, 255.0, 265.0]),
    ([-950.0, 150.0, 0.0], [430.0, 200.0, 205.0]),
    ([950.0, 0.0, 20.0], [950.0, 230.0, 16.0]),
];

/// The image of an ellipsoid, an ellipse, as the matrix of its points: inside, `x C x` has the same sign as at the centre.
struct Ellipse {
    points: Matrix3<f64>,
    low: [f64; 2],
    high: [f64; 2],
}

impl Ellipse {
    /// Planes that touch the ellipsoid are imaged as lines that touch the ellipse: `P Q* P^T`.
    fn of((centre, half): ([f64; 3], [f64; 3]), projection: &Projection) -> Self {
        let p = Matrix3x4::from_fn(|i, j| projection.rows()[i][j]);
        let mut place = Matrix4::identity();
        (0..3).for_each(|a| place[(a, 3)] = centre[a]);
        let sizes = Matrix4::from_diagonal(&nalgebra::Vector4::new(half[0] * half[0], half[1] * half[1], half[2] * half[2], -1.0));
        let lines = p * place * sizes * place.transpose() * p.transpose();
        let bound = |a: usize, side: f64| {
            let (middle, scale) = (lines[(a, 2)], lines[(2, 2)]);
            (middle + side * (middle * middle - lines[(a, a)] * scale).sqrt()) / scale
        };
        let ends =
            |a: usize| if bound(a, -1.0) < bound(a, 1.0) { [bound(a, -1.0), bound(a, 1.0)] } else { [bound(a, 1.0), bound(a, -1.0)] };
        let points = lines.try_inverse().unwrap_or_else(|| panic!("an ellipsoid in front of the camera has an outline"));
        let middle = nalgebra::Vector3::new(lines[(0, 2)] / lines[(2, 2)], lines[(1, 2)] / lines[(2, 2)], 1.0);
        let sign = (middle.transpose() * points * middle)[0].signum();
        Self { points: points * sign, low: [ends(0)[0], ends(1)[0]], high: [ends(0)[1], ends(1)[1]] }
    }

    fn fill(&self, mask: &mut Mask) {
        for v in self.low[1].ceil() as usize..=self.high[1].floor() as usize {
            for u in self.low[0].ceil() as usize..=self.high[0].floor() as usize {
                let x = nalgebra::Vector3::new(u as f64, v as f64, 1.0);
                if (x.transpose() * self.points * x)[0] >= 0.0 {
                    mask.set(u, v, true);
                }
            }
        }
    }
}

fn views() -> Vec<(Mask, Projection)> {
    let camera = Camera::published(1024, 1024);
    let view = |i: u32| {
        let projection = camera.projection(std::f64::consts::TAU * f64::from(i) / f64::from(VIEWS));
        let mut mask = Mask::empty(1024, 1024);
        for part in PARTS {
            Ellipse::of(part, &projection).fill(&mut mask);
        }
        (mask, projection)
    };
    (0..VIEWS).map(view).collect()
}

fn surfaces(c: &mut Criterion) {
    let views = views();
    let grid = VoxelGrid::new(BoxUm::PAPER, SD_UM).unwrap_or_else(|e| panic!("{e}"));
    let mut carver = Carver::new(grid, views.len(), 0.05).unwrap_or_else(|e| panic!("{e}"));
    for (mask, projection) in &views {
        carver.observe(mask, projection, Leaves::default()).unwrap_or_else(|e| panic!("{e}"));
    }
    let contour = |(mask, projection): &(Mask, Projection)| {
        Contour::new(mask, &[], projection, Leaves::default(), [0.0; 3], Distance::reach_um(&grid))
    };
    let contours: Vec<Contour> = views.iter().map(contour).collect::<Result<_, _>>().unwrap_or_else(|e| panic!("{e}"));
    let binary = extract(&Occupancy(&carver));
    let field = extract(&Distance::new(&carver, &contours));
    println!("{} triangles of the voxels, {} of the field", binary.triangles.len(), field.triangles.len());

    let mut group = c.benchmark_group("surface");
    group.sample_size(10);
    group.bench_function("extract the voxels'", |b| b.iter(|| extract(&Occupancy(black_box(&carver)))));
    let fairing = Fairing { lambda: 0.8, iterations: 10 };
    group.bench_function("fair, 10 iterations", |b| b.iter(|| fair(black_box(&binary), fairing)));
    group.bench_function("contour of one view", |b| b.iter(|| contour(black_box(&views[0]))));
    group.bench_function("field of 84 views", |b| b.iter(|| Distance::new(black_box(&carver), &contours)));
    let distance = Distance::new(&carver, &contours);
    group.bench_function("extract the field's", |b| b.iter(|| extract(black_box(&distance))));
    group.bench_function("decimate to 1 um", |b| b.iter(|| export::decimate(black_box(&field), 1.0)));
    group.bench_function("live mesh", |b| b.iter(|| extract(&Coarse::new(black_box(&carver)))));
    let live = extract(&Coarse::new(&carver));
    group.bench_function("live mesh as GLB", |b| {
        b.iter(|| {
            let mut glb = Vec::new();
            export::write_glb(black_box(&live), None, export::Unit::M, &[], &mut glb).unwrap_or_else(|e| panic!("{e}"));
            glb.len()
        });
    });
    group.finish();
}

criterion_group!(benches, surfaces);
criterion_main!(benches);
