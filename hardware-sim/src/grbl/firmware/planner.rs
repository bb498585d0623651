//! The queue of moves between the main loop and the stepper.
//!
//! ```text
//!   G-code, $J= ──► Block::plan ──► Planner, 15 or 100 blocks ──► Stepper
//!                                      ▲                             │
//!                                      └── the rest of a held move ◄─┘
//! ```

use crate::grbl::Settings;
use std::collections::VecDeque;

/// The slowest speed and acceleration, units/s and units/s^2. A setting of 0 would never end a move.
pub(super) const SLOWEST: f64 = 1e-3;

/// A straight move from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Block {
    /// Signed steps of the axes X, Y and Z.
    pub steps: [i64; 3],
    /// Path length, units.
    pub length: f64,
    /// Highest speed along the path, units/s.
    pub speed: f64,
    /// Acceleration along the path, units/s^2.
    pub acceleration: f64,
}

impl Block {
    /// Plans a move from `from`, in steps, to `target`, in units. `feed` is in units/min; without it the axes go as fast as they
    /// may. Returns `None` if the target is the same step.
    pub fn plan(from: [i64; 3], target: [f32; 3], feed: Option<f32>, settings: &Settings) -> Option<Self> {
        let per_unit = settings.per_axis(100);
        let steps: [i64; 3] = std::array::from_fn(|i| (target[i] * per_unit[i]).round() as i64 - from[i]);
        if steps == [0; 3] {
            return None;
        }
        let units: [f64; 3] = std::array::from_fn(|i| steps[i] as f64 / f64::from(per_unit[i]));
        let length = units.iter().map(|u| u * u).sum::<f64>().sqrt();
        // The axis that reaches its own limit first limits the path.
        let along_path = |limits: [f32; 3]| {
            (0..3).filter(|&i| steps[i] != 0).map(|i| f64::from(limits[i]) * length / units[i].abs()).fold(f64::INFINITY, f64::min)
        };
        let rapid = along_path(settings.per_axis(110)) / 60.0;
        let speed = feed.map_or(rapid, |f| rapid.min(f64::from(f) / 60.0));
        Some(Self { steps, length, speed: speed.max(SLOWEST), acceleration: along_path(settings.per_axis(120)).max(SLOWEST) })
    }
}

/// Moves that have not begun.
pub(super) struct Planner {
    blocks: VecDeque<Block>,
    capacity: usize,
}

impl Planner {
    /// An empty queue for `capacity` blocks.
    pub fn new(capacity: usize) -> Self {
        Self { blocks: VecDeque::new(), capacity }
    }

    /// Free blocks. The block of a move in progress keeps its place until the move has ended.
    pub fn free(&self, is_moving: bool) -> usize {
        self.capacity.saturating_sub(self.blocks.len() + usize::from(is_moving))
    }

    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    pub fn push(&mut self, block: Block) {
        self.blocks.push_back(block);
    }

    /// Puts the rest of a held move before all others.
    pub fn push_rest(&mut self, block: Block) {
        self.blocks.push_front(block);
    }

    pub fn pop(&mut self) -> Option<Block> {
        self.blocks.pop_front()
    }

    pub fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Where the axes stand after all queued moves, steps, if they stand at `from` before.
    pub fn end(&self, from: [i64; 3]) -> [i64; 3] {
        self.blocks.iter().fold(from, |at, block| std::array::from_fn(|i| at[i] + block.steps[i]))
    }
}
