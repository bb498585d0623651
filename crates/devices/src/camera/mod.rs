//! Cameras: drivers behind [`super::Camera`].
//!
//! ```text
//! open(AravisSettings) ── feature aravis ──► AravisCamera ── libaravis ── GigE Vision (GVCP, GVSP)
//!                     └── built without ───► DeviceError::NotBuilt, with the way to the feature
//! ```

#[cfg(feature = "aravis")]
mod aravis;
mod control;
mod settings;

pub use control::{Controller, controller};
pub use settings::{AravisSettings, CameraSelect, MacAddress, Trigger};

use super::{Camera, DeviceError};

/// A camera that answers to discovery, in its own words.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Listed {
    /// As Aravis makes it of the names and the serial number.
    pub id: Option<String>,
    pub vendor: Option<String>,
    pub model: Option<String>,
    pub serial: Option<String>,
    pub mac: Option<String>,
    pub address: Option<String>,
}

/// The cameras that answer to a broadcast on the networks of this computer; takes a second.
#[cfg(feature = "aravis")]
pub fn discover() -> Vec<Listed> {
    aravis::discover()
}

/// None: this build has no Aravis.
#[cfg(not(feature = "aravis"))]
pub fn discover() -> Vec<Listed> {
    Vec::new()
}

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
