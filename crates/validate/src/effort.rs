//! The number of phantoms of each part, and the progress bar that counts them.

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

/// Numbers of phantoms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    pub beads: usize,
    /// Larvae of 3, 4 and 5 dpf.
    pub larvae: [usize; 3],
    /// Phantoms of each clean solid.
    pub solids: usize,
    pub finned: usize,
    /// Calibrated turns.
    pub calibrated: usize,
    /// Turns of each fault.
    pub faults: usize,
    pub ablation: usize,
    pub orders: usize,
    pub early: usize,
    pub live: usize,
    /// Rendered turns with fins, of each age.
    pub finned_frames: usize,
    /// Rendered turns that look as those of `make run`.
    pub demo: usize,
    pub coverage: usize,
    /// Edge of a voxel for the larvae that are carved, um.
    pub voxel_um: f64,
}

impl Effort {
    pub const FULL: Self = Self {
        beads: 25,
        larvae: [12, 24, 24],
        solids: 10,
        finned: 60,
        calibrated: 100,
        faults: 10,
        ablation: 30,
        orders: 30,
        early: 1000,
        live: 60,
        finned_frames: 8,
        demo: 24,
        coverage: 1000,
        voxel_um: 6.93,
    };

    /// Enough to check that every part works.
    pub const QUICK: Self = Self {
        beads: 1,
        larvae: [1; 3],
        finned: 2,
        calibrated: 4,
        finned_frames: 0,
        demo: 0,
        coverage: 8,
        voxel_um: 17.1,
        ..Self::FULL.with_seeds(1)
    };

    /// The same with `seeds` phantoms in every part that draws phantoms. The paper's own counts do not change.
    #[must_use]
    pub const fn with_seeds(self, seeds: usize) -> Self {
        Self {
            solids: seeds,
            finned: seeds,
            calibrated: seeds,
            faults: seeds,
            ablation: seeds,
            orders: seeds,
            early: seeds,
            live: seeds,
            finned_frames: seeds,
            demo: seeds,
            coverage: seeds,
            ..self
        }
    }
}

/// What a part needs for its work.
#[derive(Debug)]
pub struct Work {
    pub effort: Effort,
    /// Added to every phantom's seed.
    pub seed: u64,
    bar: ProgressBar,
}

impl Work {
    pub fn new(effort: Effort, seed: u64) -> anyhow::Result<Self> {
        let bar = ProgressBar::new(0).with_style(ProgressStyle::with_template("{msg:28} {bar:30} {pos}/{len} {elapsed}")?);
        Ok(Self { effort, seed, bar })
    }

    /// Begins a task with this number of steps.
    pub fn begin(&self, what: &'static str, steps: usize) {
        self.bar.set_length(steps as u64);
        self.bar.set_position(0);
        self.bar.set_message(what);
    }

    pub fn step(&self) {
        self.bar.inc(1);
    }

    /// Runs `of` for each of `n` phantoms, numbered from 0, on all threads. Returns the results in order.
    ///
    /// # Errors
    /// The first error of `of`.
    pub fn each<T: Send>(&self, what: &'static str, n: usize, of: impl Fn(u64) -> anyhow::Result<T> + Sync) -> anyhow::Result<Vec<T>> {
        self.begin(what, n);
        let one = |i| {
            let found = of(i);
            self.step();
            found
        };
        (0..n as u64).into_par_iter().map(one).collect()
    }

    pub fn end(&self) {
        self.bar.finish_and_clear();
    }
}
