//! Carving and measurement of a larva-like solid: `cargo bench --bench carve`.
//!
//! The solid has elliptic slices and a thin fin. Its silhouettes are computed by column from the extents of the slices across the line of
//! sight. The rays are parallel, which differs from the pinhole by half a pixel at 60 mm and gives the same load.

use carved_core::carver::{Carver, Leaves};
use carved_core::geometry::{BoxUm, Camera, Projection, VoxelGrid};
use carved_core::profile::Mask;
use carved_core::reconstruction::{HullModel, ReconstructionSettings};
use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};

/// Half axes of body and fin along y and z at `x` um from the middle; the head is at the left.
fn slices(x: f64) -> [[f64; 2]; 2] {
    let t = (x + 1900.0) / 3800.0;
    if !(0.0..=1.0).contains(&t) {
        return [[0.0; 2]; 2];
    }
    let blunt = (1.0 - (1.0 - (t / 0.12).min(1.0)).powi(2)).sqrt();
    let body = blunt * (30.0 + 230.0 * (1.0 - t).powf(1.3));
    let fin = 190.0 * (1.0 - ((t - 0.75) / 0.25).powi(2)).max(0.0).sqrt();
    [[body, 0.95 * body], [fin, 14.0 * f64::from(u8::from(fin > 0.0))]]
}

fn silhouette(camera: &Camera, omega: f64) -> Mask {
    let mut mask = Mask::empty(1024, 1024);
    let (sin, cos) = omega.sin_cos();
    for u in 0..1024 {
        let x = (u as f64 - camera.ux) / camera.kx;
        let roll = camera.gamma.tan() * x;
        for [b, a] in slices(x) {
            let half = (b * cos).hypot(a * sin);
            if half > 0.0 {
                let edge = |side: f64| camera.uy + camera.ky * (roll + side * half);
                let rows = edge(-1.0).ceil().max(0.0) as usize..=edge(1.0).floor().min(1023.0) as usize;
                rows.for_each(|v| mask.set(u, v, true));
            }
        }
    }
    mask
}

fn views(count: u32, gamma_deg: f64) -> Vec<(Mask, Projection)> {
    let camera = Camera { gamma: gamma_deg.to_radians(), ..Camera::published(1024, 1024) };
    let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(count);
    (0..count).map(|i| (silhouette(&camera, angle(i)), camera.projection(angle(i)))).collect()
}

fn grid(size: f64) -> VoxelGrid {
    VoxelGrid::new(BoxUm::PAPER, size).unwrap_or_else(|e| panic!("{e}"))
}

fn carve(views: &[(Mask, Projection)], size: f64) -> Carver {
    let mut carver = Carver::new(grid(size), views.len(), 0.05).unwrap_or_else(|e| panic!("{e}"));
    for (mask, projection) in views {
        carver.observe(mask, projection, Leaves::default()).unwrap_or_else(|e| panic!("{e}"));
    }
    carver
}

fn carving(c: &mut Criterion) {
    let mut group = c.benchmark_group("carve");
    group.sample_size(10);
    for (name, count, gamma) in [("21 views", 21, 0.0), ("84 views", 84, 0.0), ("84 views rolled by 2 deg", 84, 2.0)] {
        let views = views(count, gamma);
        for size in [6.93, 5.5] {
            group.bench_with_input(BenchmarkId::new(name, size), &size, |b, &size| b.iter(|| carve(&views, size).live_voxels()));
        }
    }
    group.finish();
}

fn one_larva(c: &mut Criterion) {
    let views = views(21, 0.0);
    let mut group = c.benchmark_group("larva of 21 views at 6.93");
    group.sample_size(10);
    let new = || HullModel::new(grid(6.93), views.len(), ReconstructionSettings::default()).unwrap_or_else(|e| panic!("{e}"));
    group.bench_function("all views, surface, fairing, measures", |b| {
        b.iter_batched(
            new,
            |mut hull| {
                for (mask, projection) in &views {
                    hull.observe(mask, &[], projection, Leaves::default()).unwrap_or_else(|e| panic!("{e}"));
                }
                hull.finish(false)
            },
            BatchSize::PerIteration,
        );
    });
    group.finish();
}

criterion_group!(benches, carving, one_larva);
criterion_main!(benches);
