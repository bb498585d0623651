//! Segmenters for as many frames as are segmented at once.
//!
//! ```text
//! frame ─> a segmenter that is free, or a new one ─> profile
//!              ^───────── put back, with its memory ──'
//! ```

use super::{EmptyCapillary, FinBorders, Picture, Profile, ProfileError, SegmentSettings, Segmenter};
use std::sync::{Mutex, PoisonError};

/// Lends each caller a segmenter of its own. The profile does not depend on which one.
#[derive(Default)]
pub struct Segmenters(Mutex<Vec<Segmenter>>);

impl Segmenters {
    /// Separates the specimen from the capillary, as [`Segmenter::segment`] does.
    ///
    /// # Errors
    /// As [`Segmenter::segment`].
    pub fn segment(&self, picture: &Picture, settings: &SegmentSettings, empty: Option<&EmptyCapillary>) -> Result<Profile, ProfileError> {
        self.with_one(|segmenter| segmenter.segment(picture, settings, empty))
    }

    /// Separates the specimen in a view of a turn, as [`Segmenter::segment_view`] does.
    ///
    /// # Errors
    /// As [`Segmenter::segment`].
    pub fn segment_view(
        &self,
        picture: &Picture,
        settings: &SegmentSettings,
        empty: Option<&EmptyCapillary>,
    ) -> Result<(Profile, Option<FinBorders>), ProfileError> {
        self.with_one(|segmenter| segmenter.segment_view(picture, settings, empty))
    }

    fn with_one<T>(&self, work: impl FnOnce(&mut Segmenter) -> T) -> T {
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut segmenter = free.unwrap_or_default();
        let result = work(&mut segmenter);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(segmenter);
        result
    }
}
