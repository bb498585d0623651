//! The appearance of an individual beyond its age and seed, and what ails it.
//!
//! ```text
//!   Look::default()         the reference larva: paler and slimmer at the eyes than real ones, without pectoral fins
//!   Look::drawn(dpf, seed)  as larvae look in a VAST: dense, striped, with pectoral fins; a quarter of them are sick
//! ```

use crate::scene::seeded::{Seeded, mixed};
use serde::{Deserialize, Serialize};

/// The appearance of a larva. The default is the reference larva, whose numbers tests rely on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Look {
    /// Factor on the absorption of the tissue.
    pub density: f64,
    /// Pigment in addition to that of the reference larva: 0 is none, 1 gives a nearly continuous stripe along back and belly and rows of
    /// blots on the flanks.
    pub stripes: f64,
    /// Factor on the absorption of the fin fold and its edge.
    pub fin_contrast: f64,
    /// Absorption of the pectoral fins. `None` is a larva without them.
    pub pectoral_per_mm: Option<f64>,
    /// Factor on the height of the body. The volume stays, so that a smaller height gives a wider body.
    pub height: f64,
    /// Factor on the width of the body behind the eyes.
    pub trunk: f64,
    /// Factor on how far the eyes bulge.
    pub eyes: f64,
    pub condition: Condition,
    /// The swim bladder, at ages that have one.
    pub bladder: Bladder,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            density: 1.0,
            stripes: 0.0,
            fin_contrast: 1.0,
            pectoral_per_mm: None,
            height: 1.0,
            trunk: 1.0,
            eyes: 1.0,
            condition: Condition::Healthy,
            bladder: Bladder::OneLobe,
        }
    }
}

/// The form of a swim bladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bladder {
    /// One ellipsoid of gas.
    #[default]
    OneLobe,
    /// Two ellipsoids of gas behind each other, the smaller one in front.
    TwoLobes,
    /// A narrow tube of tissue without gas, below the pigment that covers a swim bladder.
    NotInflated,
}

/// What ails a larva.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    #[default]
    Healthy,
    /// Fluid around the heart: a clear bulge in front of the yolk.
    HeartOedema,
    /// Fluid around the yolk: a clear swollen belly.
    YolkOedema,
    /// The tail is bent to one side from the anus on.
    BentTail,
    /// The whole body is bent.
    Curled,
    /// Four fifths of the length.
    Short,
    NoSwimBladder,
    /// No pigment cells.
    Unpigmented,
}

impl Condition {
    /// All conditions except [`Condition::Healthy`].
    pub const SICK: [Self; 7] =
        [Self::HeartOedema, Self::YolkOedema, Self::BentTail, Self::Curled, Self::Short, Self::NoSwimBladder, Self::Unpigmented];
}

impl Condition {
    /// Part by which fluid moves the belly away from the centre line at `s`.
    pub(super) fn swelling(self, s: f64) -> f64 {
        let bump = |at: f64, wide: f64, part: f64| part * (-((s - at) / wide).powi(2)).exp();
        match self {
            Self::HeartOedema => bump(0.148, 0.035, 0.35),
            Self::YolkOedema => bump(0.25, 0.09, 0.28),
            _ => 0.0,
        }
    }
}

/// The part of drawn larvae that is sick.
const SICK: f64 = 0.25;

impl Look {
    /// A larva as VAST frames show it. The seed draws its appearance and whether it is sick.
    pub fn drawn(dpf: u8, seed: u64) -> Self {
        let mut draw = Seeded::new(mixed(seed ^ 0x1007));
        let sick = draw.between(0.0, 1.0) < SICK;
        let which = draw.between(0.0, Condition::SICK.len() as f64) as usize;
        let condition = if sick { Condition::SICK[which.min(Condition::SICK.len() - 1)] } else { Condition::Healthy };
        Self { condition, ..Self::healthy(dpf, mixed(seed)) }
    }

    /// A healthy larva as VAST frames show it.
    pub fn healthy(dpf: u8, seed: u64) -> Self {
        let mut draw = Seeded::new(mixed(seed ^ 0x1008));
        // Pigment cells multiply up to 3 dpf.
        let grown = if dpf < 3 { 0.4 } else { 1.0 };
        let pectoral = draw.between(11.0, 28.0);
        Self {
            density: draw.between(1.0, 1.5),
            stripes: grown * draw.between(0.5, 1.0),
            // Equally often fainter and stronger: a quarter to 2.5 times the reference.
            fin_contrast: 0.79 * 3.16f64.powf(draw.between(-1.0, 1.0)),
            // At 2 dpf they are buds. At 3 dpf they are small and clear.
            pectoral_per_mm: match dpf {
                0..3 => None,
                3 => Some(0.3 * pectoral),
                _ => Some(pectoral),
            },
            height: draw.between(0.80, 0.88),
            trunk: draw.between(0.80, 0.90),
            eyes: draw.between(1.4, 2.2),
            condition: Condition::Healthy,
            bladder: Bladder::OneLobe,
        }
    }
}
