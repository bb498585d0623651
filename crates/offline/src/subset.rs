//! An even subset of the views of a turn, with which a method of fewer views measures it.

use carved_records::{LedgerEntry, Method};

/// Why a turn cannot be measured with this number of views.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SubsetError {
    /// The number does not divide that of the captured views.
    #[error("{asd} of {captured} views (asd) cannot be evenly spaced. Possible numbers: {}", .possible.iter().map(u32::to_string).collect::<Vec<_>>().join(", "))]
    NoDivisor {
        /// Views captured.
        captured: u32,
        /// Views requested.
        asd: u32,
        /// The numbers that are possible.
        possible: Vec<u32>,
    },
    /// A view is missing.
    #[error("{asd} views (asd): the ledger has no view {view}")]
    NoView {
        /// Views requested.
        asd: u32,
        /// Number of the missing view.
        view: u32,
    },
    /// A view is not in its place.
    #[error(
        "{asd} views (asd): view {view} stands {off_deg:.2} deg from its even place around the turn, more than the {spacing_deg:.2} deg between \
         captured views: this turn has no even subset; measure it whole"
    )]
    Uneven {
        /// Views requested.
        asd: u32,
        /// Number of the view.
        view: u32,
        /// Distance from its even place, deg.
        off_deg: f64,
        /// Spacing of the captured views, deg.
        spacing_deg: f64,
    },
}

/// Every (captured / asd)-th view, starting at view 0, and the closure view.
///
/// # Errors
/// No such views, or views that do not stand evenly around the turn.
pub(super) fn subset<'a>(entries: &[&'a LedgerEntry], captured: u32, asd: u32) -> Result<Vec<&'a LedgerEntry>, SubsetError> {
    let possible: Vec<u32> = (Method::LEAST_ASD..=captured).filter(|n| captured.is_multiple_of(*n)).collect();
    if !possible.contains(&asd) {
        return Err(SubsetError::NoDivisor { captured, asd, possible });
    }
    let stride = captured / asd;
    let chosen: Vec<&LedgerEntry> = entries.iter().copied().filter(|e| e.closure || e.view.is_multiple_of(stride)).collect();
    let omega = |view: u32| {
        let found = chosen.iter().find(|e| e.view == view && !e.closure).map(|e| e.omega.to_degrees());
        found.ok_or(SubsetError::NoView { asd, view })
    };
    let first = omega(0)?;
    let spacing_deg = 360.0 / f64::from(captured);
    for at in 1..asd {
        let view = at * stride;
        let found = omega(view)? - first;
        let even = 360.0 * f64::from(at) / f64::from(asd);
        // The turn may go in either direction.
        let off_deg =
            [found - even, found + even].map(|x| (x - 360.0 * (x / 360.0).round()).abs()).into_iter().fold(f64::INFINITY, f64::min);
        if off_deg > spacing_deg {
            return Err(SubsetError::Uneven { asd, view, off_deg, spacing_deg });
        }
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::units::Steps;

    fn turn(angles_deg: impl Iterator<Item = f64>, closure: bool) -> Vec<LedgerEntry> {
        let mut entries: Vec<LedgerEntry> = (0..)
            .zip(angles_deg)
            .map(|(view, deg)| LedgerEntry {
                view,
                retake: 0,
                commanded_steps: Steps(0),
                achieved_steps: Steps(0),
                epoch: 1,
                omega: deg.to_radians(),
                swept: None,
                moved_ms: 0.0,
                settle_ms: 0.0,
                grab_ms: 0.0,
                trigger_ms: 0.0,
                light: None,
                second: None,
                frame_id: 0,
                attempts: 1,
                sha256: String::new(),
                closure: false,
            })
            .collect();
        entries.last_mut().unwrap().closure = closure;
        entries
    }

    fn views(entries: &[LedgerEntry], captured: u32, asd: u32) -> Result<Vec<u32>, String> {
        subset(&entries.iter().collect::<Vec<_>>(), captured, asd).map(|s| s.iter().map(|e| e.view).collect()).map_err(|e| e.to_string())
    }

    #[test]
    fn every_divisor_is_an_even_subset_either_way_around() {
        for sense in [1.0, -1.0] {
            // Steps of 0.72 deg, as on VAST.
            let entries = turn((0..=84).map(|i| sense * 0.72 * (f64::from(i) * 500.0 / 84.0).round()), true);
            for asd in [4, 7, 12, 14, 21, 28, 42] {
                let expected: Vec<u32> = (0..=84).step_by(84 / asd as usize).collect();
                assert_eq!(views(&entries, 84, asd).unwrap(), expected);
            }
        }
        assert_eq!(views(&turn((0..84).map(|i| f64::from(i) * 4.32), false), 84, 4).unwrap(), [0, 21, 42, 63]);
    }

    #[test]
    fn what_is_no_even_subset_is_refused_with_the_ways_out() {
        let entries = turn((0..12).map(|i| f64::from(i) * 30.0), false);
        for asd in [0, 1, 2, 5, 24] {
            assert!(views(&entries, 12, asd).unwrap_err().contains("Possible numbers: 3, 4, 6, 12"));
        }
        let half = turn((0..12).map(|i| f64::from(i) * 15.0), false);
        assert!(views(&half, 12, 4).unwrap_err().contains("no even subset"));
    }
}
