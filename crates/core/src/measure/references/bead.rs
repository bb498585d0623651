//! Tests whether a set of beads has its nominal diameter: the paper's score, and the bias that it can show.
//!
//! ```text
//!  t = |mean - nominal| sqrt(n - 1) / SD         SD with the divisor n: Student's t with n - 1 degrees of freedom
//! ```
//! The paper compares the score with 2.787, the two-sided 1 % point of 25 degrees of freedom. Its 25 beads leave 24, and 2.797.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, Continuous, ContinuousCDF, Normal, StudentsT};
use statrs::statistics::Statistics;

/// Share of good sets that the test rejects, as in the paper.
pub const LEVEL: f64 = 0.01;

/// The score of a set of beads against its nominal diameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeadScore {
    /// Number of beads.
    pub n: u32,
    /// Nominal diameter.
    pub nominal_um: f64,
    /// Mean diameter.
    pub mean_um: f64,
    /// Standard deviation of the diameters, with the divisor n.
    pub sd_um: f64,
    /// The paper's score: `|mean - nominal| sqrt(n - 1) / sd`.
    pub t_score: f64,
    /// Two-sided point of Student's t with n - 1 degrees of freedom, by default at [`LEVEL`]. A larger score says that the mean
    /// is off.
    pub critical: f64,
    /// Two-sided probability of such a score or a larger one, for beads of the nominal diameter.
    pub p: f64,
    /// The deviation of the mean, um, that four of five such sets would show by a score above `critical`. A lower score only
    /// says that the mean is off by not much more than this.
    pub detectable_um: f64,
}

/// The paper's score, from the numbers in its table 1.
pub fn t_score(mean_um: f64, sd_um: f64, n: u32, nominal_um: f64) -> f64 {
    (mean_um - nominal_um).abs() * (f64::from(n) - 1.0).sqrt() / sd_um
}

/// The probability that the score of n beads exceeds the critical value at `level` when the mean is off by `deviation_um`.
///
/// With s = SD over its true value, s^2 chi-squared over its degrees of freedom, and lambda = deviation sqrt(n - 1) / SD: the
/// mean over s of Phi(lambda - critical s) + Phi(-lambda - critical s), by Simpson's rule. `None` for fewer than three beads,
/// for which the density of s has a corner at 0.
pub fn power(deviation_um: f64, sd_um: f64, n: u32, level: f64) -> Option<f64> {
    const PANELS: u32 = 1000;
    if n < 3 {
        return None;
    }
    let degrees = f64::from(n) - 1.0;
    let critical = critical(n, level)?;
    let chi = ChiSquared::new(degrees).ok()?;
    let normal = Normal::standard();
    let lambda = deviation_um.abs() * degrees.sqrt() / sd_um;
    // Beyond eight standard deviations of s (each 1 / sqrt(2 degrees) or less) nothing is left. s is not negative.
    let reach = 8.0 / (2.0 * degrees).sqrt();
    let (from, to) = ((1.0 - reach).max(0.0), 1.0 + reach);
    let step = (to - from) / f64::from(2 * PANELS);
    let at = |s: f64| {
        let density = 2.0 * degrees * s * chi.pdf(degrees * s * s);
        density * (normal.cdf(lambda - critical * s) + normal.cdf(-lambda - critical * s))
    };
    let weight = |k: u32| match k {
        0 => 1.0,
        k if k == 2 * PANELS => 1.0,
        k if k % 2 == 1 => 4.0,
        _ => 2.0,
    };
    let points = (0..=2 * PANELS).map(|k| weight(k) * at(from + f64::from(k) * step));
    Some(points.sum::<f64>() * step / 3.0)
}

/// Two-sided point of Student's t for n beads. `None` for fewer than two beads.
pub fn critical(n: u32, level: f64) -> Option<f64> {
    Some(StudentsT::new(0.0, 1.0, f64::from(n) - 1.0).ok()?.inverse_cdf(1.0 - level / 2.0))
}

impl BeadScore {
    /// The score at [`LEVEL`]. `None` for fewer than three beads, or beads without spread.
    pub fn of(diameters_um: &[f64], nominal_um: f64) -> Option<Self> {
        Self::at(diameters_um, nominal_um, LEVEL)
    }

    /// The score at another level: the share of good sets that may be rejected.
    pub fn at(diameters_um: &[f64], nominal_um: f64, level: f64) -> Option<Self> {
        let n = u32::try_from(diameters_um.len()).ok().filter(|n| *n > 2)?;
        let (mean_um, sd_um) = (diameters_um.mean(), diameters_um.population_std_dev());
        if !(sd_um > 0.0 && sd_um.is_finite()) {
            return None;
        }
        let t_score = t_score(mean_um, sd_um, n, nominal_um);
        let student = StudentsT::new(0.0, 1.0, f64::from(n) - 1.0).ok()?;
        Some(Self {
            n,
            nominal_um,
            mean_um,
            sd_um,
            t_score,
            critical: critical(n, level)?,
            p: 2.0 * student.cdf(-t_score),
            detectable_um: detectable(sd_um, n, level)?,
        })
    }
}

/// The deviation at which the power is 0.8, by bisection.
fn detectable(sd_um: f64, n: u32, level: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, sd_um);
    while power(high, sd_um, n, level)? < 0.8 {
        high *= 2.0;
    }
    for _ in 0..40 {
        let middle = f64::midpoint(low, high);
        if power(middle, sd_um, n, level)? < 0.8 { low = middle } else { high = middle }
    }
    Some(high)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Its table 1, ASD and SD in um, mean and standard deviation of 25 beads, t as printed.
    #[test]
    fn the_papers_scores_follow_from_its_means() {
        let table = [
            (84, 5.5, 498.05, 25.36, 0.38),
            (4, 5.5, 512.42, 25.86, 2.35),
            (7, 17.1, 494.6, 25.69, 1.03),
            (42, 10.0, 496.88, 25.34, 0.60),
            (21, 7.94, 498.7, 25.28, 0.25),
        ];
        for (asd, size_um, mean, sd, printed) in table {
            let t = t_score(mean, sd, 25, 500.0);
            assert!((t - printed).abs() < 0.0051, "ASD {asd}, SD {size_um} um: {t} is not {printed}");
        }
    }

    // python3 -c "from scipy.stats import t; print(t.ppf(.995, 24), t.ppf(.995, 25), t.ppf(.995, 4))"
    #[test]
    fn the_critical_value_is_that_of_the_beads_there_are() {
        for (n, wanted) in [(25, 2.796_939_504_774_456), (26, 2.787_435_813_676_97), (5, 4.604_094_871_349_992)] {
            let found = critical(n, LEVEL).unwrap();
            assert!((found - wanted).abs() < 1e-9, "{n} beads: {found} is not {wanted}");
        }
    }

    // python3 -c "from scipy.stats import t, nct; import math
    // for d, s, n in [(0,25,25), (10,25,25), (20,25,25), (30,25,4), (60,25,3)]:
    //     c = t.ppf(.995, n-1); l = d*math.sqrt(n-1)/s; print(nct.sf(c, n-1, l) + nct.cdf(-c, n-1, l))"
    #[test]
    fn the_power_is_that_of_the_noncentral_t() {
        let expected = [
            (0.0, 25, 0.01),
            (10.0, 25, 0.226_755_830_390_094_86),
            (20.0, 25, 0.857_267_604_755_931_3),
            (30.0, 4, 0.081_529_932_993_692_4),
            (60.0, 3, 0.117_215_653_012_209_21),
        ];
        for (deviation, n, wanted) in expected {
            let found = power(deviation, 25.0, n, LEVEL).unwrap();
            assert!((found - wanted).abs() < 1e-7, "{deviation} um, {n} beads: {found} is not {wanted}");
        }
        assert_eq!(power(10.0, 25.0, 2, LEVEL), None);
    }

    // scipy.stats.ttest_1samp([497.1, 503.4, 499.0, 512.5, 488.9, 505.2], 500), and the deviation by scipy.optimize.brentq of the
    // power above less 0.8.
    #[test]
    fn a_set_of_beads_has_its_score() {
        let score = BeadScore::of(&[497.1, 503.4, 499.0, 512.5, 488.9, 505.2], 500.0).unwrap();
        assert!((score.t_score - 0.310_674_245_188_313_9).abs() < 1e-9, "{score:?}");
        assert!((score.p - 0.768_581_981_453_392_6).abs() < 1e-9, "{score:?}");
        assert!((score.sd_um - 7.317_425_928_714_431).abs() < 1e-9, "{score:?}");
        assert!((score.detectable_um - 16.908_197_008_657_16).abs() < 1e-5, "{score:?}");
        assert_eq!(BeadScore::of(&[500.0, 501.0], 500.0), None);
        assert_eq!(BeadScore::of(&[500.0; 4], 500.0), None);
    }
}
