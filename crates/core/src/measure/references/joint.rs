//! Volume and area together: the distance of a larva from the distribution of n larvae.
//!
//! ```text
//!  d^2 = (zv^2 - 2 r zv za + za^2) / (1 - r^2)       Mahalanobis, r = covariance / (SDv SDa)
//!  T^2 = d^2 n / (n + 1)                             Hotelling, one new larva
//!  F   = T^2 (n - 2) / (2 (n - 1))                   of F with 2 and n - 2 degrees of freedom
//! ```

use super::group::{Group, Moments};
use super::matching::Mismatch;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::f64::consts::TAU;

/// The place of volume and area together in a group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct JointPlace {
    /// Name of the group.
    pub group: String,
    /// Larvae of the group.
    pub n: u32,
    /// Correlation of volume and area over the group's larvae.
    pub correlation: f64,
    /// Mahalanobis' distance, in standard deviations.
    pub distance: f64,
    /// Hotelling's T^2, for one new larva.
    pub t_squared: f64,
    /// The value of F that belongs to it, with 2 and n - 2 degrees of freedom.
    pub f: f64,
    /// Share of larvae of the group that lie as far out or further.
    pub p: f64,
    /// Differences between the specimen and the group.
    pub mismatches: Vec<Mismatch>,
}

/// The joint distribution of the next larva's volume and area.
#[derive(Debug, Clone, Copy)]
pub(super) struct JointPredictive {
    volume: Moments,
    area: Moments,
    correlation: f64,
    n: u32,
    fisher: FisherSnedecor,
}

impl JointPredictive {
    /// `None` without a covariance, or for fewer than three larvae.
    pub fn of(group: &Group) -> Option<Self> {
        let (volume, area, covariance) = (group.volume_um3?, group.area_um2?, group.covariance_um5?);
        let fisher = FisherSnedecor::new(2.0, f64::from(group.n) - 2.0).ok()?;
        Some(Self { volume, area, correlation: covariance / (volume.sd * area.sd), n: group.n, fisher })
    }

    /// Square of Mahalanobis' distance.
    fn squared(&self, volume_um3: f64, area_um2: f64) -> f64 {
        let zv = (volume_um3 - self.volume.mean) / self.volume.sd;
        let za = (area_um2 - self.area.mean) / self.area.sd;
        let r = self.correlation;
        (zv * zv - 2.0 * r * zv * za + za * za) / (1.0 - r * r)
    }

    pub fn place(&self, volume_um3: f64, area_um2: f64, group: &str, mismatches: Vec<Mismatch>) -> JointPlace {
        let n = f64::from(self.n);
        let squared = self.squared(volume_um3, area_um2);
        let t_squared = squared * n / (n + 1.0);
        let f = t_squared * (n - 2.0) / (2.0 * (n - 1.0));
        JointPlace {
            group: group.to_owned(),
            n: self.n,
            correlation: self.correlation,
            distance: squared.sqrt(),
            t_squared,
            f,
            p: self.fisher.sf(f),
            mismatches,
        }
    }

    /// Logarithm of the density, per um^5: Student's t in two dimensions with n - 2 degrees of freedom, centre at the means and
    /// scale matrix S (n - 1)(n + 1) / (n (n - 2)), which is the distribution that F above comes from.
    pub fn ln_density(&self, volume_um3: f64, area_um2: f64) -> f64 {
        let n = f64::from(self.n);
        let degrees = n - 2.0;
        let scale = (n - 1.0) * (n + 1.0) / (n * degrees);
        let root_of_determinant = scale * self.volume.sd * self.area.sd * (1.0 - self.correlation * self.correlation).sqrt();
        let squared = self.squared(volume_um3, area_um2) / scale;
        -f64::ln(TAU * root_of_determinant) - (degrees / 2.0 + 1.0) * f64::ln_1p(squared / degrees)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::references::tests;

    // python3 -c "import numpy as np; from scipy.stats import f, multivariate_t
    // for n, r, zv, za in [(8, .7, 1.2, -.5), (3, 0, 1, 1), (24, -.2, 3, 2)]:
    //     S = np.array([[1, r], [r, 1]]); z = np.array([zv, za]); d2 = z @ np.linalg.solve(S, z); T2 = d2*n/(n+1); F = T2*(n-2)/(2*(n-1))
    //     print(d2**.5, T2, F, f.sf(F, 2, n-2), multivariate_t.logpdf(z, shape=S*(n-1)*(n+1)/(n*(n-2)), df=n-2))"
    #[test]
    fn distances_and_densities_are_those_of_scipy() {
        let expected = [
            (
                8,
                0.7,
                1.2,
                -0.5,
                2.227_281_821_801_069,
                4.409_586_056_644_879,
                1.889_822_595_704_948,
                0.230_932_179_803_692_2,
                -3.727_313_445_915_620_5,
            ),
            (3, 0.0, 1.0, 1.0, std::f64::consts::SQRT_2, 1.5, 0.375, 0.755_928_946_018_454_5, -3.658_130_001_324_205_5),
            (24, -0.2, 3.0, 2.0, 4.005_204_946_899_306, 15.4, 7.365_217_391_304_348, 0.003_559_284_703_428_196_4, -8.053_498_750_214_683),
        ];
        for (n, r, zv, za, distance, t_squared, f, p, ln_density) in expected {
            let (volume, area) = (Moments { mean: 2.7e8, sd: 2e7 }, Moments { mean: 3.3e6, sd: 1.5e5 });
            let covariance_um5 = Some(r * volume.sd * area.sd);
            let group = Group { n, volume_um3: Some(volume), area_um2: Some(area), covariance_um5, ..tests::group("g", 4.0) };
            let (v, a) = (volume.mean + zv * volume.sd, area.mean + za * area.sd);
            let predictive = JointPredictive::of(&group).unwrap();
            let place = predictive.place(v, a, "g", Vec::new());
            let close = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9 * wanted.abs(), "n {n}: {found} is not {wanted}");
            close(place.distance, distance);
            close(place.t_squared, t_squared);
            close(place.f, f);
            close(place.p, p);
            close(predictive.ln_density(v, a) + (volume.sd * area.sd).ln(), ln_density);
            assert!(JointPredictive::of(&Group { covariance_um5: None, ..group }).is_none());
        }
    }
}
