//! Whether a larva is opaque beside those that the same rig measured before it.
//!
//! ```text
//!  opacities of the newest larvae ── RecentOpacities ── UsualOpacity ──┐
//!  opacity of this larva ──────────────────────────────────────────────┴── beyond it?
//! ```
//! Lamp, aperture and strain decide how dark a living larva looks. Living larvae of three renderers have opacities from 0.17 to 0.74, and dead
//! ones of one of them from 0.46 to 0.78. So one limit for all rigs cannot tell them apart.

use crate::statistics::lower_quantile;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Times the usual optical density from which on a larva is opaque.
const DENSER: f64 = 2.0;
/// Opacity beyond which the optical density is not known: hardly any light is left.
const BLACK: f64 = 0.98;

/// How opaque living larvae look on a rig.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct UsualOpacity {
    /// Opacity that three quarters of the larvae exceed: 0 is clear, 1 is black. Dead ones among them raise it little.
    pub opacity: f64,
    /// Number of larvae.
    pub larvae: u32,
}

impl UsualOpacity {
    /// Whether a larva of this opacity is at least twice as dense.
    pub fn is_exceeded_by(&self, opacity: f64) -> bool {
        density(opacity) >= DENSER * density(self.opacity)
    }
}

/// Optical density to base e: a body twice as thick has twice the density.
fn density(opacity: f64) -> f64 {
    -(1.0 - opacity.clamp(0.0, BLACK)).ln()
}

/// Opacities of the newest larvae of a rig. The newest one is the last.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecentOpacities(VecDeque<f64>);

impl RecentOpacities {
    /// Larvae that are remembered.
    const KEPT: usize = 24;
    /// Larvae that show how they usually look, at least.
    const LEAST: usize = 4;

    /// Adds a larva.
    pub fn add(&mut self, opacity: f64) {
        if self.0.len() == Self::KEPT {
            self.0.pop_front();
        }
        self.0.push_back(opacity);
    }

    /// How larvae usually look. `None` where too few are known.
    pub fn usual(&self) -> Option<UsualOpacity> {
        let known: Vec<f64> = self.0.iter().copied().collect();
        let larvae = known.len() as u32;
        (known.len() >= Self::LEAST).then(|| lower_quantile(known, 0.25))?.map(|opacity| UsualOpacity { opacity, larvae })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usual(opacities: &[f64]) -> Option<UsualOpacity> {
        let mut recent = RecentOpacities::default();
        for opacity in opacities {
            recent.add(*opacity);
        }
        recent.usual()
    }

    #[test]
    fn a_larva_is_opaque_beside_those_of_its_rig() {
        // On one rig a living larva is as dark as a dead one is on another.
        let (clear, dark) = (usual(&[0.2, 0.25, 0.3, 0.3]).unwrap(), usual(&[0.70, 0.72, 0.74, 0.71]).unwrap());
        assert_eq!([0.3, 0.6, 0.74].map(|opacity| clear.is_exceeded_by(opacity)), [false, true, true]);
        assert_eq!([0.6, 0.74, 0.95, 1.0].map(|opacity| dark.is_exceeded_by(opacity)), [false, false, true, true]);
        assert!(!usual(&[0.99; 4]).unwrap().is_exceeded_by(1.0), "nothing is known of what is black");
    }

    #[test]
    fn dead_larvae_among_them_change_little_and_few_say_nothing() {
        let half_dead = usual(&[0.7, 0.25, 0.8, 0.3, 0.7, 0.25, 0.75, 0.28]).unwrap();
        assert_eq!(half_dead.larvae, 8);
        assert!(half_dead.is_exceeded_by(0.7) && !half_dead.is_exceeded_by(0.35), "{half_dead:?}");
        assert_eq!(usual(&[0.2, 0.3, 0.2]), None);
    }

    #[test]
    fn a_rig_that_was_changed_has_new_usual_larvae() {
        let found = usual(&[vec![0.2; 24], vec![0.7; 24]].concat()).unwrap();
        assert_eq!(found, UsualOpacity { opacity: 0.7, larvae: 24 });
    }
}
