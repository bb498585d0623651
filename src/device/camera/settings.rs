//! The `[camera]` table of a GigE Vision camera.

use crate::device::DeviceError;
use crate::frame::PixelFormat;
use serde::{Deserialize, Serialize};
#[cfg(feature = "aravis")]
use std::time::Duration;

/// How a camera is found and what it is told before the first frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AravisSettings {
    /// Which camera: `{ address = "192.168.1.20" }`, `{ id = "Vendor-Model-Serial" }` or `{ serial = "02-2200A-06123" }`.
    /// An address needs no discovery and is found behind a router.
    pub select: CameraSelect,
    pub pixel_format: PixelFormat,
    /// Region of the sensor, px.
    pub width: u32,
    pub height: u32,
    #[serde(default)]
    pub offset_x: u32,
    #[serde(default)]
    pub offset_y: u32,
    /// Exposure, us.
    pub exposure_us: f64,
    /// `GainRaw`, in the camera's own integer scale; left as it is where absent.
    #[serde(default)]
    pub gain_raw: Option<i64>,
    /// Bytes of a stream packet with its headers: 1500, or 8228 where every device on the way has an MTU of 9000.
    #[serde(default = "default_packet_size")]
    pub packet_size: u32,
    /// Receive buffer of the stream's socket, bytes. The kernel grants at most `net.core.rmem_max`.
    #[serde(default = "default_socket_buffer_bytes")]
    pub socket_buffer_bytes: u32,
    /// Receive through a ring of raw packets, which needs `CAP_NET_RAW` and an interface with one camera: on a shared one the
    /// ring also sees the other cameras' packets.
    #[serde(default)]
    pub packet_socket: bool,
    /// Ask the camera again for lost packets.
    #[serde(default = "default_resend")]
    pub resend: bool,
    /// Longest wait for the frame of one trigger before it is triggered again, ms.
    #[serde(default = "default_frame_timeout_ms")]
    pub frame_timeout_ms: u32,
    /// Further GenICam features as `[name, value]`, set in this order before everything above.
    #[serde(default)]
    pub features: Vec<(String, String)>,
}

/// The name under which a camera is known.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraSelect {
    Address(std::net::Ipv4Addr),
    Id(String),
    Serial(String),
}

impl std::fmt::Display for CameraSelect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Address(address) => write!(f, "address {address}"),
            Self::Id(id) => write!(f, "id {id:?}"),
            Self::Serial(serial) => write!(f, "serial number {serial:?}"),
        }
    }
}

fn default_packet_size() -> u32 {
    1500
}

/// At 15 frames a second of 1 MiB, the kernel's default of 208 KiB loses most frames; 4 MiB loses none.
fn default_socket_buffer_bytes() -> u32 {
    4 << 20
}

fn default_resend() -> bool {
    true
}

fn default_frame_timeout_ms() -> u32 {
    500
}

impl AravisSettings {
    /// # Errors
    /// Names the first value that no camera can have.
    pub fn check(&self) -> Result<(), DeviceError> {
        let bad = |name, found: String, rule: &str| Err(DeviceError::Setting { device: "camera", name, found, rule: rule.into() });
        if self.width == 0 || self.height == 0 {
            return bad("width, height", format!("{} x {}", self.width, self.height), "both must be at least 1");
        }
        if !(self.exposure_us.is_finite() && self.exposure_us > 0.0) {
            return bad("exposure_us", self.exposure_us.to_string(), "it must be above 0");
        }
        // GigE Vision's least, and the most that fits a jumbo frame.
        if !(576..=9000).contains(&self.packet_size) {
            return bad("packet_size", self.packet_size.to_string(), "it must be from 576 to 9000 bytes");
        }
        if i32::try_from(self.socket_buffer_bytes).is_err() || self.socket_buffer_bytes == 0 {
            return bad("socket_buffer_bytes", self.socket_buffer_bytes.to_string(), "it must be from 1 to 2^31 - 1 bytes");
        }
        if self.frame_timeout_ms == 0 {
            return bad("frame_timeout_ms", "0".into(), "it must be at least 1");
        }
        Ok(())
    }

    #[cfg(feature = "aravis")]
    pub(super) fn frame_timeout(&self) -> Duration {
        Duration::from_millis(self.frame_timeout_ms.into())
    }

    #[cfg(feature = "aravis")]
    pub(super) fn frame_bytes(&self) -> usize {
        self.width as usize * self.height as usize * self.pixel_format.bytes_per_pixel()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: &str =
        r#"{"select": {"address": "127.0.0.2"}, "pixel_format": "BayerRG8", "width": 64, "height": 32, "exposure_us": 4000}"#;

    #[test]
    fn what_is_left_out_has_its_default_and_what_is_unknown_is_refused() {
        let settings: AravisSettings = serde_json::from_str(LEAST).unwrap();
        assert_eq!((settings.packet_size, settings.socket_buffer_bytes, settings.resend), (1500, 4_194_304, true));
        assert!(settings.check().is_ok());
        assert!(serde_json::from_str::<AravisSettings>(&LEAST.replace("width", "with")).is_err());
    }

    #[test]
    fn values_no_camera_can_have_are_named() {
        let good: AravisSettings = serde_json::from_str(LEAST).unwrap();
        for (bad, name) in [
            (AravisSettings { height: 0, ..good.clone() }, "64 x 0"),
            (AravisSettings { exposure_us: -1.0, ..good.clone() }, "exposure_us = -1"),
            (AravisSettings { packet_size: 100, ..good.clone() }, "packet_size = 100"),
            (AravisSettings { socket_buffer_bytes: u32::MAX, ..good.clone() }, "socket_buffer_bytes = 4294967295"),
            (AravisSettings { frame_timeout_ms: 0, ..good.clone() }, "frame_timeout_ms = 0"),
        ] {
            let said = bad.check().unwrap_err().to_string();
            assert!(said.contains(name), "{said}");
        }
    }

    #[cfg(not(feature = "aravis"))]
    #[test]
    fn a_build_without_aravis_says_how_to_get_it() {
        let said = super::super::open(serde_json::from_str(LEAST).unwrap()).err().unwrap().to_string();
        assert!(said.contains("apt-get install libaravis-dev libusb-1.0-0-dev"), "{said}");
    }
}
