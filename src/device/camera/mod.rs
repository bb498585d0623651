//! Cameras: drivers behind [`super::Camera`].
//!
//! ```text
//! open(AravisSettings) ── feature aravis ──► AravisCamera ── libaravis ── GigE Vision (GVCP, GVSP)
//!                     └── built without ───► DeviceError::NotBuilt, with the way to the feature
//! ```

#[cfg(feature = "aravis")]
mod aravis;
mod settings;

pub use settings::{AravisSettings, CameraSelect, MacAddress, Trigger};

use super::{Camera, DeviceError};

/// Opens and configures the camera that `settings` name.
///
/// # Errors
/// A build without Aravis, a camera that is not there or belongs to another program, a feature that does not take its value.
#[cfg(feature = "aravis")]
pub fn open(settings: AravisSettings) -> Result<Box<dyn Camera>, DeviceError> {
    Ok(Box::new(aravis::AravisCamera::open(settings)?))
}

/// Opens and configures the camera that `settings` name.
///
/// # Errors
/// Always: this build has no Aravis.
#[cfg(not(feature = "aravis"))]
pub fn open(_settings: AravisSettings) -> Result<Box<dyn Camera>, DeviceError> {
    Err(DeviceError::NotBuilt {
        device: "camera",
        driver: "aravis",
        remedy: "sudo apt-get install libaravis-dev libusb-1.0-0-dev pkg-config, then build with the feature aravis (the default)",
    })
}
