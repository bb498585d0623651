//! What was really exposed: the log that a test holds against what arrived.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Exposures that are remembered; at 59 fps more than an hour.
const KEPT: usize = 250_000;

/// One exposure as it happened.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposureRecord {
    /// The stream's 16-bit number of the frame; starts at 1 with each acquisition.
    pub frame_id: u64,
    /// Exposures since the rig was started, from 0.
    pub number: u64,
    /// True angle of the shaft at the middle of the exposure, unwrapped and counted from the index.
    pub angle_rad: f64,
    /// Of the bytes that left the camera.
    pub sha256: [u8; 32],
    /// False where a fault kept the frame from being sent.
    pub sent: bool,
}

#[derive(Debug, Default)]
pub(crate) struct Truth(Mutex<VecDeque<ExposureRecord>>);

impl Truth {
    pub fn add(&self, record: ExposureRecord) {
        let mut log = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if log.len() == KEPT {
            log.pop_front();
        }
        log.push_back(record);
    }

    pub fn all(&self) -> Vec<ExposureRecord> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }
}
