//! The log of true exposures. Tests compare it with the frames that have arrived.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Exposures that are kept: more than an hour at 59 fps.
const KEPT: usize = 250_000;

/// One true exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposureRecord {
    /// The 16-bit number of the frame in its stream. It starts at 1 with each acquisition.
    pub frame_id: u64,
    /// Number of the exposure since the rig was started, from 0.
    pub number: u64,
    /// Middle of the exposure, s of rig time.
    pub middle_s: f64,
    /// The camera's own clock at that instant, ns.
    pub camera_ns: u64,
    /// True angle of the shaft at the middle of the exposure, rad, unwrapped and counted from the index.
    pub angle_rad: f64,
    /// SHA-256 of the bytes that the camera has sent. It is 0 if the frame was lost in the camera.
    pub sha256: [u8; 32],
    /// `false` if a fault has prevented the frame from being sent, or if the camera lost it because too many waited.
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
