//! One sample of values.

use crate::statistics::{self, Spread};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Level of every interval of this module.
const LEVEL: f64 = 0.95;

/// A sample of values, in their unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of values.
    pub n: usize,
    /// Arithmetic mean.
    pub mean: f64,
    /// Standard deviation with the divisor n - 1. `None` of a single value.
    pub sd: Option<f64>,
    /// 95 % confidence interval of the mean, by Student's t with n - 1 degrees of freedom. `None` of a single value.
    pub mean_interval_95: Option<[f64; 2]>,
    /// The median; of an even number of values the mean of the middle two.
    pub median: f64,
    /// Median of the distances from the median, not scaled. Times 1.4826 it is the standard deviation of normal values.
    pub mad: f64,
}

impl Summary {
    /// The statistics of values. `None` without any, and where one is not finite.
    pub fn of(values: &[f64]) -> Option<Self> {
        let spread = Spread::of(values).filter(|_| values.iter().all(|v| v.is_finite()))?;
        let median = statistics::median(values.to_vec())?;
        let distances: Vec<f64> = values.iter().map(|v| (v - median).abs()).collect();
        let half = spread.sd_of_mean().zip(student(spread.n as f64 - 1.0)).map(|(sd, t)| t * sd);
        Some(Self {
            n: spread.n,
            mean: spread.mean,
            sd: spread.sd,
            mean_interval_95: half.map(|half| [spread.mean - half, spread.mean + half]),
            median,
            mad: statistics::median(distances)?,
        })
    }
}

/// Half width of the interval, in standard deviations, with so many degrees of freedom. `None` without any.
pub(super) fn student(degrees: f64) -> Option<f64> {
    let t = StudentsT::new(0.0, 1.0, degrees).ok()?;
    Some(t.inverse_cdf(0.5 + LEVEL / 2.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64) {
        assert!((found - wanted).abs() <= 1e-9 * wanted.abs().max(1e-9), "{found} is not {wanted}");
    }

    // numpy.mean, std(ddof=1), median, scipy.stats.median_abs_deviation, t.interval(0.95, 5, mean, sem): tests/oracles/assay.py.
    #[test]
    fn a_sample_has_the_statistics_of_scipy() {
        let s = Summary::of(&[2.1, 3.4, 1.9, 5.6, 2.2, 3.0]).unwrap();
        assert_eq!(s.n, 6);
        near(s.mean, 3.033_333_333_333_333);
        near(s.sd.unwrap(), 1.383_714_806_839_424_7);
        let [low, high] = s.mean_interval_95.unwrap();
        near(low, 1.581_213_699_584_253_2);
        near(high, 4.485_452_967_082_413);
        near(s.median, 2.6);
        near(s.mad, 0.6);
    }

    #[test]
    fn too_few_values_leave_out_what_they_do_not_determine() {
        assert_eq!(Summary::of(&[]), None);
        assert_eq!(Summary::of(&[1.0, f64::NAN]), None);
        let one = Summary::of(&[4.0]).unwrap();
        assert_eq!((one.n, one.sd, one.mean_interval_95, one.mad), (1, None, None, 0.0));
    }
}
