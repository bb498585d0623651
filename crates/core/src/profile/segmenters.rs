//! Segmenters for as many frames as are segmented at once.
//!
//! ```text
//! frame ─> a segmenter that is free, or a new one ─> profile
//!              ^───────── put back, with its memory ──'
//! ```

use super::{EmptyCapillary, Picture, Profile, ProfileError, SegmentSettings, Segmenter};
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
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut segmenter = free.unwrap_or_default();
        let profile = segmenter.segment(picture, settings, empty);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(segmenter);
        profile
    }
}
