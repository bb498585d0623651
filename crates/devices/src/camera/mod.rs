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

#[cfg(any(test, feature = "testing"))]
pub use control::answer_of_camera;
pub use control::{Controller, controller};
pub use settings::{AravisSettings, CameraSelect, MacAddress, Packed, Trigger};

use super::{Camera, DeviceError};

/// A camera that answers to discovery, with the texts that it sends.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Listed {
    /// The id that Aravis makes of the names and the serial number.
    pub id: Option<String>,
    /// Name of the vendor.
    pub vendor: Option<String>,
    /// Name of the model.
    pub model: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
    /// Hardware address.
    pub mac: Option<String>,
    /// IPv4 address.
    pub address: Option<String>,
}

/// The cameras that answer to a broadcast on the networks of this computer. It takes a second.
#[cfg(feature = "aravis")]
pub fn discover() -> Vec<Listed> {
    aravis::discover()
}

/// Returns no camera: this build has no Aravis.
#[cfg(not(feature = "aravis"))]
pub fn discover() -> Vec<Listed> {
    Vec::new()
}

/// Opens and configures the camera that `settings` name.
///
/// # Errors
/// The camera does not answer, another program controls it, or it refuses a value.
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
