//! One new larva against n: the distribution of the next value when mean and SD are themselves known from n larvae only.
//!
//! ```text
//!  z = (x - mean) / SD       t = z / sqrt(1 + 1/n), Student's with n - 1 degrees of freedom
//! ```

use super::group::Moments;
use super::matching::Mismatch;
use serde::{Deserialize, Serialize};
use statrs::distribution::{Continuous, ContinuousCDF, StudentsT};

/// The place of a value in a group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Place {
    /// Name of the group.
    pub group: String,
    /// Larvae of the group.
    pub n: u32,
    /// Mean of the group, in the unit of the value.
    pub mean: f64,
    /// Standard deviation of the group, in the unit of the value.
    pub sd: f64,
    /// Standard deviations above the mean.
    pub z: f64,
    /// z with the error of the mean: z / sqrt(1 + 1/n). It has Student's t distribution with n - 1 degrees of freedom.
    pub t: f64,
    /// Two-sided probability: share of larvae of the group that are as far off or further.
    pub p: f64,
    /// Share of larvae of the group that are smaller, %.
    pub percentile: f64,
    /// Interval that holds 95 % of further larvae of the group, in the unit of the value.
    pub interval_95: [f64; 2],
    /// Differences between the specimen and the group.
    pub mismatches: Vec<Mismatch>,
}

/// The distribution of the next value of a group.
#[derive(Debug, Clone, Copy)]
pub struct Predictive {
    mean: f64,
    sd: f64,
    n: u32,
    student: StudentsT,
}

impl Predictive {
    /// `None` where the spread is not known: fewer than two larvae, or an SD that is not above 0.
    pub fn new(Moments { mean, sd }: Moments, n: u32) -> Option<Self> {
        let student = StudentsT::new(0.0, 1.0, f64::from(n) - 1.0).ok()?;
        (mean.is_finite() && sd.is_finite() && sd > 0.0).then_some(Self { mean, sd, n, student })
    }

    /// Standard deviation of the next value about the mean of the n.
    fn spread(&self) -> f64 {
        self.sd * (1.0 + 1.0 / f64::from(self.n)).sqrt()
    }

    /// The place of a value. `group` is the name of the group, `mismatches` are its differences from the specimen.
    pub fn place(&self, value: f64, group: &str, mismatches: Vec<Mismatch>) -> Place {
        let t = (value - self.mean) / self.spread();
        let half = self.student.inverse_cdf(0.975) * self.spread();
        Place {
            group: group.to_owned(),
            n: self.n,
            mean: self.mean,
            sd: self.sd,
            z: (value - self.mean) / self.sd,
            t,
            p: 2.0 * self.student.cdf(-t.abs()),
            percentile: 100.0 * self.student.cdf(t),
            interval_95: [self.mean - half, self.mean + half],
            mismatches,
        }
    }

    /// Logarithm of the density at a value, per unit of the value.
    pub fn ln_density(&self, value: f64) -> f64 {
        self.student.ln_pdf((value - self.mean) / self.spread()) - self.spread().ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // python3 -c "from scipy.stats import t; import math
    // for n, z in [(24, -0.8), (12, 2.5), (3, 4.0)]:
    //     q = z / math.sqrt(1 + 1/n); print(q, 2*t.sf(abs(q), n-1), 100*t.cdf(q, n-1), t.ppf(.975, n-1)*math.sqrt(1+1/n))"
    #[test]
    fn places_are_those_of_scipy() {
        let expected = [
            (24, -0.8, -0.783_836_717_690_617, 0.441_133_918_638_366_6, 22.056_695_931_918_33, 2.111_314_832_521_591_4),
            (12, 2.5, 2.401_922_307_076_307, 0.035_112_919_242_060_62, 98.244_354_037_896_97, 2.290_857_986_546_144),
            (3, 4.0, 3.464_101_615_137_755, 0.074_179_900_227_448_54, 96.291_004_988_627_58, 4.968_275_423_500_66),
        ];
        for (n, z, t, p, percentile, half) in expected {
            let place = Predictive::new(Moments { mean: 3.34, sd: 0.17 }, n).unwrap().place(3.34 + 0.17 * z, "g", Vec::new());
            let close = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9 * wanted.abs(), "n {n}: {found} is not {wanted}");
            close(place.z, z);
            close(place.t, t);
            close(place.p, p);
            close(place.percentile, percentile);
            close(place.interval_95[1] - 3.34, 0.17 * half);
            close(3.34 - place.interval_95[0], 0.17 * half);
        }
    }

    #[test]
    fn no_spread_is_no_distribution() {
        let found = |mean, sd, n| Predictive::new(Moments { mean, sd }, n).is_some();
        assert!(found(1.0, 1.0, 2));
        assert!(!found(1.0, 1.0, 1) && !found(1.0, 0.0, 9) && !found(f64::NAN, 1.0, 9));
    }
}
