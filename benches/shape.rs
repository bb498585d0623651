//! The shape of a body of 250 000 triangles: `cargo bench --bench shape`.
//!
//! ```text
//!      _______
//!    /        \________________         an arched tube that tapers, twice as high as wide
//!   (           ______________===
//!    \_________/
//! ```

use carved_core::measure::shape::Shape;
use carved_core::surface::Mesh;
use criterion::{Criterion, criterion_group, criterion_main};
use std::f64::consts::{PI, TAU};
use std::hint::black_box;

const RINGS: u32 = 500;
const AROUND: u32 = 250;

/// Rings along x, closed at both ends by fans.
fn body() -> Mesh {
    let mut vertices = vec![[-2000.0, 200.0, 0.0], [2000.0, 200.0, 0.0]];
    for ring in 1..RINGS {
        let t = PI * f64::from(ring) / f64::from(RINGS);
        let s = f64::midpoint(1.0, -t.cos());
        let half = (300.0 - 200.0 * s) * t.sin();
        vertices.extend((0..AROUND).map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(AROUND)).sin_cos();
            [4000.0 * (s - 0.5), 200.0 * (2.0 * s - 1.0).powi(2) + half * cos, half / 2.0 * sin]
        }));
    }
    let at = |ring: u32, k: u32| 2 + ring * AROUND + k % AROUND;
    let mut triangles = Vec::new();
    for k in 0..AROUND {
        triangles.extend([[0, at(0, k + 1), at(0, k)], [1, at(RINGS - 2, k), at(RINGS - 2, k + 1)]]);
        for ring in 0..RINGS - 2 {
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    Mesh { vertices, triangles }
}

fn shape(c: &mut Criterion) {
    let mesh = body();
    let found = Shape::of(&mesh);
    println!("{} triangles; {:?} {:?}", mesh.triangles.len(), found.body_reason, found.harmonics_reason);
    let mut group = c.benchmark_group("shape");
    group.sample_size(20);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap_or_else(|e| panic!("{e}"));
        group.bench_function(format!("{threads} threads"), |b| pool.install(|| b.iter(|| Shape::of(black_box(&mesh)))));
    }
    group.finish();
}

criterion_group!(benches, shape);
criterion_main!(benches);
