//! What the frame shows: nothing, or a specimen that lies within the field or leaves it.

use super::Mask;
use super::foreground::Component;
use serde::{Deserialize, Serialize};

/// What was detected, with a confidence from 0.5 (could be either) to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Detection {
    Empty { confidence: f64 },
    Specimen { confidence: f64, clipped_left: bool, clipped_right: bool },
}

impl Detection {
    pub fn is_specimen(&self) -> bool {
        matches!(self, Self::Specimen { .. })
    }

    pub fn confidence(&self) -> f64 {
        match self {
            Self::Empty { confidence } | Self::Specimen { confidence, .. } => *confidence,
        }
    }

    /// Decides on the largest piece of foreground. The confidence is a logistic curve in the logarithm of its area over
    /// the least area of a specimen: 0.5 at that area, 0.9 at three times or a third of it.
    pub(super) fn decide(mask: &Mask, largest: Option<&Component>, least_px: f64) -> Self {
        let evidence = largest.map_or(f64::NEG_INFINITY, |c| (c.area_px as f64 / least_px).ln() * 2.0);
        let specimen = 1.0 / (1.0 + (-evidence).exp());
        if mask.area_px() == 0 {
            return Self::Empty { confidence: (1.0 - specimen).max(0.5) };
        }
        let last = mask.width() - 1;
        let any = |u: usize| (0..mask.height()).any(|v| mask.get(u, v));
        Self::Specimen { confidence: specimen.max(0.5), clipped_left: any(0), clipped_right: any(last) }
    }
}
