//! How much smaller than it is a bead looks, by what it is made of.
//!
//! ```text
//!   light of the lamp, at the angle 2 d from the axis        the camera looks along the axis
//!        \                                                    |
//!         \  reflected under the grazing angle d              |
//!          `-._ ___-------------------------------------------'   height r cos d
//!            .'   bead   '.                                        edge of the shadow: below r
//! ```
//! A surface under a grazing angle reflects nearly all light, so the outermost ring of a bead is not dark. The ring that is lost
//! has the width `r * integral of R(d) L(2 d) sin(d) over d`, with Fresnel's reflectance R and the radiance L of the lamp relative
//! to that on the axis. It is proportional to the radius, so it looks like another scale. A larva's refractive index is so near to
//! that of water that its ring is a few times narrower, and its edges are not round.

use serde::de::IntoDeserializer;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// What a bead is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum BeadMaterial {
    /// Not stated: nothing is corrected, and what the most refractive material does counts as uncertainty.
    #[default]
    Unknown,
    /// Polystyrene.
    Polystyrene,
    /// Acrylic glass.
    Pmma,
    /// Soda-lime glass.
    Glass,
    /// Metal, black plastic or an emulated bead: its shadow is as large as the bead.
    Opaque,
}

/// How much smaller a bead looks, as a share of its diameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limb {
    /// Expected share.
    pub share: f64,
    /// Standard deviation of the share: the width of the lamp is not known.
    pub sd: f64,
}

const WATER: f64 = 1.333;
/// Lamps from nearly parallel to wide: standard deviations of the radiance over the angle, deg. The middle one is that of the
/// path-traced beads.
const LAMPS_DEG: [f64; 3] = [5.0, 18.0, 25.0];
/// Share of the ring that the edge of the outline loses. Its inner part is dark enough to be seen. On path-traced frames a polystyrene
/// bead of 500 um under the middle lamp reads 497.83 um, where the whole ring would make it 496.26 um.
const SEEN_OF_RING: f64 = 0.58;

impl BeadMaterial {
    fn index(self) -> Option<f64> {
        match self {
            Self::Unknown | Self::Opaque => None,
            Self::Polystyrene => Some(1.59),
            Self::Pmma => Some(1.49),
            Self::Glass => Some(1.52),
        }
    }

    /// How much smaller a bead of this material looks in water.
    pub fn limb(self) -> Limb {
        match (self, self.index()) {
            (_, Some(index)) => {
                let [least, share, most] = LAMPS_DEG.map(|lamp_deg| SEEN_OF_RING * ring(index, lamp_deg));
                Limb { share, sd: (most - least) / 12f64.sqrt() }
            }
            (Self::Opaque, None) => Limb { share: 0.0, sd: 0.0 },
            // From 0 to the share of polystyrene.
            (_, None) => Limb { share: 0.0, sd: Self::Polystyrene.limb().share / 3f64.sqrt() },
        }
    }

    /// The diameter, um, that a bead of a known diameter shows, and the standard deviation of the difference.
    pub fn apparent_um(self, diameter_um: f64) -> [f64; 2] {
        let limb = self.limb();
        [diameter_um * (1.0 - limb.share), diameter_um * limb.sd]
    }
}

impl FromStr for BeadMaterial {
    type Err = serde::de::value::Error;

    /// A material by the name that it has in a configuration. The error lists the names.
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::deserialize(name.into_deserializer())
    }
}

/// Width of the ring that light grazing a bead in water leaves bright, as a share of the radius, under a lamp whose radiance falls
/// with the angle like a Gaussian of this standard deviation. By Simpson's rule.
fn ring(index: f64, lamp_deg: f64) -> f64 {
    const PANELS: u32 = 2000;
    let (relative, lamp) = (index / WATER, lamp_deg.to_radians());
    let at = |grazing: f64| {
        let (cos_in, sin_in) = (grazing.sin(), grazing.cos());
        let cos_out = (1.0 - (sin_in / relative).powi(2)).sqrt();
        let across = (cos_in - relative * cos_out) / (cos_in + relative * cos_out);
        let along = (relative * cos_in - cos_out) / (relative * cos_in + cos_out);
        let reflected = 0.5 * (across * across + along * along);
        reflected * (-0.5 * (2.0 * grazing / lamp).powi(2)).exp() * grazing.sin()
    };
    let step = std::f64::consts::FRAC_PI_4 / f64::from(2 * PANELS);
    let weight = |k: u32| if k == 0 || k == 2 * PANELS { 1.0 } else { f64::from(2 + 2 * (k % 2)) };
    (0..=2 * PANELS).map(|k| weight(k) * at(f64::from(k) * step)).sum::<f64>() * step / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the same integral by another program (numpy, complex arithmetic, trapezoids of 4 urad), in per cent.
    #[test]
    fn the_ring_is_the_integral_over_the_grazing_angles() {
        for (index, lamp_deg, percent) in
            [(1.59, 18.0, 0.7487), (1.59, 5.0, 0.1297), (1.49, 25.0, 0.8000), (1.52, 10.0, 0.3401), (1.37, 18.0, 0.2673)]
        {
            let found = 100.0 * ring(index, lamp_deg);
            assert!((found - percent).abs() < 6e-5, "n {index}, lamp {lamp_deg} deg: {found:.4} %");
        }
    }

    /// The path-traced bead comes back to its diameter, and what is not stated covers each material within two standard deviations.
    #[test]
    fn a_bead_of_known_material_has_its_diameter() {
        let [expected_um, sd_um] = BeadMaterial::Polystyrene.apparent_um(500.0);
        assert!((expected_um - 497.83).abs() < 0.1, "{expected_um:.2}");
        assert!((0.5..1.0).contains(&sd_um), "{sd_um:.2}");
        let unknown = BeadMaterial::Unknown.limb();
        for material in [BeadMaterial::Polystyrene, BeadMaterial::Pmma, BeadMaterial::Glass, BeadMaterial::Opaque] {
            assert!(material.limb().share - unknown.share <= 2.0 * unknown.sd, "{material:?}");
        }
        assert_eq!(BeadMaterial::Opaque.apparent_um(500.0).map(f64::to_bits), [500.0f64, 0.0].map(f64::to_bits));
    }
}
