//! Hot pixels of the sensor.

use crate::scene::seeded::Seeded;
use serde::{Deserialize, Serialize};

/// Single pixels that add a constant to their signal, in all colours. With a Bayer mosaic each pixel has one colour only.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HotPixels {
    pub count: u32,
    /// Constant of the hottest pixel, 8-bit units. The coolest ones add a quarter of it.
    pub level: f64,
}

impl Default for HotPixels {
    fn default() -> Self {
        Self { count: 0, level: 160.0 }
    }
}

impl HotPixels {
    pub fn add(&self, light: &mut [[f32; 3]], seed: u64) {
        if light.is_empty() {
            return;
        }
        let mut seeded = Seeded::new(seed ^ 0x4079);
        for _ in 0..self.count {
            let at = (seeded.between(0.0, light.len() as f64) as usize).min(light.len() - 1);
            let heat = (self.level * seeded.between(0.25, 1.0)) as f32;
            light[at] = light[at].map(|p| p + heat);
        }
    }
}
