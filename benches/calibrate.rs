//! Calibrating a larva's turn: `cargo bench --bench calibrate`.
//!
//! Profiles of the phantom larva as a day's drift leaves them: camera, angles, views and edges off.

use carved::calibration::{Calibration, GivenView, Priors, Psi, Vrv, calibrate, coherence, gate};
use carved::carver::Runs;
use carved::geometry::{BoxUm, Camera, VoxelGrid};
use carved::profile::{Columns, Mask};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hardware_sim::analytic::{self, Disturbance, Phantom};
use std::f64::consts::TAU;

struct Turn {
    camera: Camera,
    columns: Vec<Columns>,
    runs: Vec<Runs>,
    ledger: Vec<f64>,
}

fn turn(asd: u32) -> Turn {
    let nominal = hardware_sim::scene::Camera::default();
    let ledger: Vec<f64> = (0..asd).map(|i| TAU * f64::from(i) / f64::from(asd)).collect();
    let larva = Phantom::larva(4, 1).unwrap_or_else(|e| panic!("{e}"));
    let views = larva.views(&nominal, &ledger, &Disturbance::drift(1));
    let coverage: Vec<_> = views.iter().map(|v| analytic::coverage(&v.outline, nominal.width, nominal.height)).collect();
    let size = 1024;
    let mask = |data: &[u8]| Mask::from_coverage(size, size, data.to_vec()).unwrap_or_else(|e| panic!("{e}"));
    Turn {
        camera: Camera::published(nominal.width, nominal.height),
        columns: coverage.iter().map(|c| Columns::from_coverage(size, size, &c.data)).collect(),
        runs: coverage.iter().map(|c| Runs::new(&mask(&c.data)).unwrap_or_else(|e| panic!("{e}"))).collect(),
        ledger,
    }
}

impl Turn {
    fn calibrated(&self) -> Calibration {
        let given: Vec<GivenView> = self.columns.iter().zip(&self.ledger).map(|(columns, &omega)| GivenView { columns, omega }).collect();
        calibrate(&self.camera, &given, Priors::default()).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Every view's: what the two objectives cost does not depend on the last px.
    fn psi(&self) -> Psi {
        Psi::new(self.calibrated().camera, self.ledger.clone())
    }
}

fn calibrating(c: &mut Criterion) {
    let mut group = c.benchmark_group("calibrate");
    group.sample_size(20);
    let grid = |size: f64| VoxelGrid::new(BoxUm::PAPER, size).unwrap_or_else(|e| panic!("{e}"));
    for asd in [21, 84] {
        let turn = turn(asd);
        let views: Vec<(&Runs, f64)> = turn.runs.iter().zip(turn.ledger.iter().copied()).collect();
        group.bench_function(BenchmarkId::new("least squares", asd), |b| b.iter(|| turn.calibrated()));
        for size in [10.0, 17.1] {
            let both = || gate(&turn.calibrated(), &views, grid(size)).unwrap_or_else(|e| panic!("{e}"));
            group.bench_function(BenchmarkId::new(format!("least squares and gate at {size} um"), asd), |b| b.iter(both));
            let psi = turn.psi();
            let mut vrv = Vrv::new(turn.runs.iter().collect(), grid(size), 0.0).unwrap_or_else(|e| panic!("{e}"));
            group.bench_function(BenchmarkId::new(format!("vrv at {size} um"), asd), |b| b.iter(|| vrv.voxels(&psi)));
        }
        let psi = turn.psi();
        let columns: Vec<&Columns> = turn.columns.iter().collect();
        group.bench_function(BenchmarkId::new("coherence", asd), |b| b.iter(|| coherence(&columns, &psi)));
    }
    group.finish();
}

criterion_group!(benches, calibrating);
criterion_main!(benches);
