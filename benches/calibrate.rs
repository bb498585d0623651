//! Calibration of a larva's turn: `cargo bench --bench calibrate`.
//!
//! Profiles of the phantom larva after one day's drift, which affects camera, angles, views and edges.

use carved_core::calibration::{Calibration, GivenView, Priors, Psi, Vrv, calibrate, check_vrv, coherence};
use carved_core::carver::{Leaves, Runs};
use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
use carved_core::profile::{Columns, Mask};
use carved_core::reconstruction::{Reconstruction, ReconstructionSettings};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hardware_sim::analytic::{self, Disturbance, Phantom};
use std::f64::consts::TAU;

struct Turn {
    camera: Camera,
    columns: Vec<Columns>,
    masks: Vec<Mask>,
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
    let masks: Vec<Mask> = coverage.iter().map(|c| mask(&c.data)).collect();
    Turn {
        camera: Camera::published(nominal.width, nominal.height),
        columns: coverage.iter().map(|c| Columns::from_coverage(size, size, &c.data)).collect(),
        runs: masks.iter().map(|m| Runs::new(m).unwrap_or_else(|e| panic!("{e}"))).collect(),
        masks,
        ledger,
    }
}

impl Turn {
    fn given(&self) -> Vec<GivenView<'_>> {
        self.columns.iter().zip(&self.ledger).map(|(columns, &omega)| GivenView { columns, omega }).collect()
    }

    fn calibrated(&self) -> Calibration {
        calibrate(&self.camera, &self.given(), Priors::default()).unwrap_or_else(|e| panic!("{e}"))
    }

    /// psi with the parameters of every view, close to the truth: the cost of the two objectives does not depend on the last px.
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
        let given = turn.given();
        let found = turn.calibrated();
        group.bench_function(BenchmarkId::new("least squares", asd), |b| b.iter(|| turn.calibrated()));
        group.bench_function(BenchmarkId::new("gate", asd), |b| b.iter(|| check_vrv(&found, &turn.camera, &given)));
        group.bench_function(BenchmarkId::new("least squares and gate", asd), |b| {
            b.iter(|| check_vrv(&turn.calibrated(), &turn.camera, &given));
        });
        let psi = turn.psi();
        for size in [10.0, 17.1] {
            let mut vrv = Vrv::new(turn.runs.iter().collect(), grid(size), 0.0).unwrap_or_else(|e| panic!("{e}"));
            group.bench_function(BenchmarkId::new(format!("vrv at {size} um"), asd), |b| b.iter(|| vrv.voxels(&psi)));
        }
        let columns: Vec<&Columns> = turn.columns.iter().collect();
        group.bench_function(BenchmarkId::new("coherence", asd), |b| b.iter(|| coherence(&columns, &psi)));
        // The calibration after the last view of a turn, and from time to time in the live model: 6.93 um, 15e6 voxels.
        let settings = ReconstructionSettings::default();
        let mut model = Reconstruction::new(&turn.camera, grid(6.93), turn.ledger.len(), settings).unwrap_or_else(|e| panic!("{e}"));
        for ((mask, columns), &omega) in turn.masks.iter().zip(&turn.columns).zip(&turn.ledger) {
            model.observe_edges(mask, &[], columns.clone(), omega, Leaves::default()).unwrap_or_else(|e| panic!("{e}"));
        }
        group.bench_function(BenchmarkId::new("calibrated and carved again", asd), |b| b.iter(|| model.refine(false)));
    }
    group.finish();
}

criterion_group!(benches, calibrating);
criterion_main!(benches);
