//! Why a specimen is measured by its voxels.

use super::support::{SectionsError, SensitivityError};

/// Why the voxels are trusted and not the support functions of the slices. Files state it in these words.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fallback {
    /// The views have no slices in common.
    #[error(transparent)]
    NoSlices(#[from] SectionsError),
    /// Views show slices hollow, or as two bodies.
    #[error("{percent:.0} % of the volume lies in slices that a view shows to be hollow, or two bodies: they are not convex")]
    Hollow {
        /// Share of the volume in such slices, %.
        percent: f64,
    },
    /// The hull is much smaller than the slices filled to their convex outlines.
    #[error("the hull is {percent:.0} % smaller than its slices filled to their convex outlines: they are not convex")]
    SmallHull {
        /// By how much the hull is smaller, %.
        percent: f64,
    },
    /// Slices between the ends of the specimen have no outline.
    #[error(
        "slices are missing between the ends of the specimen, and {percent:.0} % of the volume lies beyond them. Look at the frames for what hides it"
    )]
    Cut {
        /// Share of the volume beyond the missing slices, %.
        percent: f64,
    },
    /// Much of the volume is error of the profiles.
    #[error(
        "the views agree too badly for slices' outlines: their errors alone make {percent:.0} % of the volume. The turn has a gap, or the camera is off"
    )]
    AllError {
        /// What errors of the profiles add, % of the volume.
        percent: f64,
    },
    /// The part of the calibration in the standard deviation is not known, so none is stated.
    #[error("how uncertain the calibration makes the numbers is not known, so they have no standard deviation: {0}")]
    NoCalibrationSd(#[from] SensitivityError),
}

impl Fallback {
    /// Whether slices are hollow, or two bodies.
    pub fn is_nonconvex(&self) -> bool {
        matches!(self, Self::Hollow { .. } | Self::SmallHull { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files of earlier versions have these words.
    #[test]
    fn a_file_states_the_reason_in_the_same_words() {
        let said = |why: Fallback| (why.is_nonconvex(), why.to_string());
        let hollow = "31 % of the volume lies in slices that a view shows to be hollow, or two bodies: they are not convex";
        assert_eq!(said(Fallback::Hollow { percent: 31.2 }), (true, hollow.into()));
        let small = "the hull is 12 % smaller than its slices filled to their convex outlines: they are not convex";
        assert_eq!(said(Fallback::SmallHull { percent: 12.4 }), (true, small.into()));
        let cut = "slices are missing between the ends of the specimen, and 9 % of the volume lies beyond them. Look at the frames for \
                   what hides it";
        assert_eq!(said(Fallback::Cut { percent: 9.3 }), (false, cut.into()));
        let error = "the views agree too badly for slices' outlines: their errors alone make 4 % of the volume. The turn has a gap, \
                     or the camera is off";
        assert_eq!(said(Fallback::AllError { percent: 4.0 }), (false, error.into()));
        assert_eq!(said(SectionsError::NoProfile.into()), (false, "no view shows the specimen".into()));
    }
}
