//! What the driver lends to a run, to a look at the devices, or to a search for lost ones.

use carved_devices::sampler::Sampler;
use carved_devices::{Camera, Rig};

/// The devices and the sampler.
pub struct Instrument {
    pub rig: Rig,
    /// A second camera. It is triggered for each view after the first camera.
    pub second: Option<Box<dyn Camera>>,
    pub sampler: Box<dyn Sampler>,
}
