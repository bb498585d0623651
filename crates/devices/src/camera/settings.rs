//! The `[camera]` table of a GigE Vision camera.

use crate::DeviceError;
use crate::setting::in_range;
use carved_core::frame::PixelFormat;
use carved_core::range::{OutOfRange, Range, Ranged, outside_in};
use carved_core::ranges;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How a camera is found, and its configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct AravisSettings {
    /// Which camera: `{ address = "192.168.1.20" }`, `{ id = "Vendor-Model-Serial" }`, `{ serial = "02-2200A-06123" }` or
    /// `{ mac = "00:0f:31:02:12:34" }`. An address needs no discovery, and works behind a router.
    pub select: CameraSelect,
    /// Format of the frames.
    pub pixel_format: PixelFormat,
    /// Packed format in which the camera sends frames of `pixel_format = "Mono8"`. The highest 8 of its 10 or 12 bits are kept. Left out:
    /// the camera sends `pixel_format` itself.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub sent_as: Option<Packed>,
    /// Width of the region of the sensor, px.
    pub width: u32,
    /// Height of the region, px.
    pub height: u32,
    /// First column of the region, px.
    #[serde(default)]
    pub offset_x: u32,
    /// First row of the region, px.
    #[serde(default)]
    pub offset_y: u32,
    /// Exposure, us. A longer exposure gives a brighter picture: `carved camera exposure` finds it.
    pub exposure_us: f64,
    /// `Gain`, in the camera's own unit, mostly dB. It is not changed if left out.
    #[serde(default)]
    pub gain: Option<f64>,
    /// `GainRaw`, in the camera's own integer scale. It is not changed if left out.
    #[serde(default)]
    pub gain_raw: Option<i64>,
    /// What begins an exposure.
    #[serde(default)]
    pub trigger: Trigger,
    /// Bytes of a stream packet with its headers: 1500, or 8228 if every device between has an MTU of 9000.
    #[serde(default = "default_packet_size")]
    pub packet_size: u32,
    /// Receive buffer of the stream's socket, bytes. The kernel grants at most `net.core.rmem_max`.
    #[serde(default = "default_socket_buffer_bytes")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub socket_buffer_bytes: u32,
    /// Whether to receive through a ring of raw packets. It needs `CAP_NET_RAW`, and an interface with one camera only, because it also
    /// receives the packets of other cameras.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub packet_socket: bool,
    /// Whether to request lost packets again.
    #[serde(default = "default_resend")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub resend: bool,
    /// Longest wait for the frame of one trigger before the next trigger, ms.
    #[serde(default = "default_frame_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub frame_timeout_ms: u32,
    /// Seconds of the camera's clock per second of this computer's: 1, except for an emulated camera whose time runs faster or slower. The
    /// two clocks are compared while the camera runs free.
    #[serde(default = "default_time_scale")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub time_scale: f64,
    /// Further GenICam features as `[name, value]`, set in this order before everything above.
    #[serde(default)]
    pub features: Vec<(String, String)>,
}

/// A layout of grey pixels of 10 or 12 bits, by its GenICam name. Those that end in `p` are streams of bits, the lowest first (PFNC); the others are
/// groups of two pixels in three bytes (GigE Vision).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Packed {
    /// Four pixels in five bytes.
    Mono10p,
    /// Two pixels in three bytes.
    Mono12p,
    /// Two pixels in three bytes; the middle byte has the lowest two bits of both.
    Mono10Packed,
    /// Two pixels in three bytes; the middle byte has the lowest four bits of both.
    Mono12Packed,
}

#[cfg(feature = "aravis")]
impl Packed {
    /// The GenICam name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Mono10p => "Mono10p",
            Self::Mono12p => "Mono12p",
            Self::Mono10Packed => "Mono10Packed",
            Self::Mono12Packed => "Mono12Packed",
        }
    }

    /// Bits that a pixel takes on the wire.
    fn bits(self) -> usize {
        if self == Self::Mono10p { 10 } else { 12 }
    }

    /// Bytes of so many pixels.
    pub(super) fn bytes(self, pixels: usize) -> usize {
        (pixels * self.bits()).div_ceil(8)
    }

    /// The highest 8 bits of each pixel. Bytes that are too few give fewer pixels.
    pub(super) fn unpack(self, bytes: &[u8], pixels: usize) -> Vec<u8> {
        let of_pixel = |pixel: usize| match self {
            Self::Mono10p | Self::Mono12p => {
                let first = pixel * self.bits() + self.bits() - 8;
                let low = u16::from(*bytes.get(first / 8)?);
                // The last byte of a frame has no next one, and a pixel that ends in it needs none.
                let high = u16::from(bytes.get(first / 8 + 1).copied().or(first.is_multiple_of(8).then_some(0))?);
                Some(((low | high << 8) >> (first % 8)) as u8)
            }
            Self::Mono10Packed | Self::Mono12Packed => bytes.get(pixel / 2 * 3 + pixel % 2 * 2).copied(),
        };
        (0..pixels).map_while(of_pixel).collect()
    }
}

/// What begins an exposure.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(rename_all = "snake_case")]
pub enum Trigger {
    /// A command of this program for each view.
    #[default]
    Software,
    /// A pulse on a line, `{ line = "Line1" }`, for example from a controller that has arrived.
    Line(String),
    /// The camera's own rate, `{ fixed_rate_hz = 15.0 }`. The first frame is taken that was fully exposed after the axis came to rest.
    FixedRateHz(f64),
}

/// How a camera is named.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum CameraSelect {
    /// By its IPv4 address.
    Address(std::net::Ipv4Addr),
    /// By its Aravis id.
    Id(String),
    /// By its serial number.
    Serial(String),
    /// By its hardware address.
    Mac(MacAddress),
}

/// A hardware address, as `00:0f:31:02:12:34` or with dashes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(try_from = "String", into = "String")]
pub struct MacAddress([u8; 6]);

impl MacAddress {
    /// From the two registers of GigE Vision's bootstrap: bytes 0 and 1 in the lower half of the first, bytes 2 to 5 in the second.
    #[cfg(feature = "aravis")]
    pub(super) fn of_registers(high: u32, low: u32) -> Self {
        let ([_, _, a, b], [c, d, e, f]) = (high.to_be_bytes(), low.to_be_bytes());
        Self([a, b, c, d, e, f])
    }
}

impl std::str::FromStr for MacAddress {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let bytes: Option<Vec<u8>> =
            text.split([':', '-']).map(|part| u8::from_str_radix(part, 16).ok().filter(|_| part.len() == 2)).collect();
        let bytes = bytes.and_then(|b| <[u8; 6]>::try_from(b).ok());
        bytes.map(Self).ok_or_else(|| format!("{text:?} is not a hardware address; it has six bytes, as 00:0f:31:02:12:34"))
    }
}

impl TryFrom<String> for MacAddress {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<MacAddress> for String {
    fn from(mac: MacAddress) -> Self {
        mac.to_string()
    }
}

impl std::fmt::Display for MacAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [a, b, c, d, e, g] = self.0;
        write!(f, "{a:02x}:{b:02x}:{c:02x}:{d:02x}:{e:02x}:{g:02x}")
    }
}

impl std::fmt::Display for CameraSelect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Address(address) => write!(f, "address {address}"),
            Self::Id(id) => write!(f, "id {id:?}"),
            Self::Serial(serial) => write!(f, "serial number {serial:?}"),
            Self::Mac(mac) => write!(f, "hardware address {mac}"),
        }
    }
}

/// No sensor has more rows or columns.
const SENSOR_MOST_PX: f64 = 65_535.0;

fn default_packet_size() -> u32 {
    1500
}

/// With 15 frames of 1 MiB per second, the kernel's default of 208 KiB loses most frames, and 4 MiB loses none.
fn default_socket_buffer_bytes() -> u32 {
    4 << 20
}

fn default_resend() -> bool {
    true
}

fn default_frame_timeout_ms() -> u32 {
    500
}

fn default_time_scale() -> f64 {
    1.0
}

impl Ranged for AravisSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        width: 1.0, SENSOR_MOST_PX, "px";
        height: 1.0, SENSOR_MOST_PX, "px";
        offset_x: 0.0, SENSOR_MOST_PX, "px";
        offset_y: 0.0, SENSOR_MOST_PX, "px";
        // As long as the longest deadline of a frame.
        exposure_us: 0.1, 6e7, "us";
        gain: -1000.0, 1000.0, "(the camera's unit)";
        gain_raw: -1e6, 1e6, "(the camera's integer scale)";
        // The minimum of GigE Vision, and the maximum of a jumbo frame.
        packet_size: 576.0, 9000.0, "bytes";
        socket_buffer_bytes: 1.0, i32::MAX as f64, "bytes";
        frame_timeout_ms: 1.0, 60_000.0, "ms";
        time_scale: 0.001, 1000.0, "";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        outside_in("trigger", &self.trigger).collect()
    }
}

impl Ranged for Trigger {
    const RANGES: &'static [Range<Self>] = &[Range {
        key: "fixed_rate_hz",
        numbers: |trigger| match trigger {
            Self::FixedRateHz(rate) => vec![*rate],
            Self::Software | Self::Line(_) => Vec::new(),
        },
        least: 0.001,
        most: 10_000.0,
        unit: "Hz",
    }];
}

impl AravisSettings {
    /// Settings with these values, and defaults for all others.
    pub fn new(select: CameraSelect, pixel_format: PixelFormat, width: u32, height: u32, exposure_us: f64) -> Self {
        Self {
            select,
            pixel_format,
            sent_as: None,
            width,
            height,
            offset_x: 0,
            offset_y: 0,
            exposure_us,
            gain: None,
            gain_raw: None,
            trigger: Trigger::default(),
            packet_size: default_packet_size(),
            socket_buffer_bytes: default_socket_buffer_bytes(),
            packet_socket: false,
            resend: default_resend(),
            frame_timeout_ms: default_frame_timeout_ms(),
            time_scale: default_time_scale(),
            features: Vec::new(),
        }
    }

    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range("camera", self)?;
        if let Some(packed) = self.sent_as.filter(|_| self.pixel_format != PixelFormat::Mono8) {
            let rule = format!("it unpacks to Mono8, and pixel_format is {}; set pixel_format = \"Mono8\"", self.pixel_format.name());
            let found = format!("{packed:?}");
            return Err(DeviceError::Setting { device: "camera", name: "sent_as".into(), found, rule });
        }
        Ok(())
    }

    /// Longest wait for the frame of one trigger.
    pub fn frame_timeout(&self) -> Duration {
        Duration::from_millis(self.frame_timeout_ms.into())
    }

    #[cfg(feature = "aravis")]
    pub(super) fn frame_bytes(&self) -> usize {
        let pixels = self.width as usize * self.height as usize;
        self.sent_as.map_or(pixels * self.pixel_format.bytes_per_pixel(), |packed| packed.bytes(pixels))
    }

    /// The GenICam name of the format in which the camera sends.
    #[cfg(feature = "aravis")]
    pub(super) fn format_sent(&self) -> &'static str {
        self.sent_as.map_or(self.pixel_format.name(), Packed::name)
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
            (AravisSettings { sent_as: Some(Packed::Mono12p), ..good.clone() }, "sent_as = Mono12p"),
            (AravisSettings { height: 0, ..good.clone() }, "height = 0"),
            (AravisSettings { exposure_us: -1.0, ..good.clone() }, "exposure_us = -1"),
            (AravisSettings { packet_size: 100, ..good.clone() }, "packet_size = 100"),
            (AravisSettings { socket_buffer_bytes: u32::MAX, ..good.clone() }, "socket_buffer_bytes = 4294967295"),
            (AravisSettings { frame_timeout_ms: 0, ..good.clone() }, "frame_timeout_ms = 0"),
            (AravisSettings { trigger: Trigger::FixedRateHz(0.0), ..good.clone() }, "trigger.fixed_rate_hz = 0"),
        ] {
            let said = bad.check().unwrap_err().to_string();
            assert!(said.contains(name), "{said}");
        }
    }

    /// Pixels 0x3a5, 0x0f1, 0x25a, 0x181 of 10 bits and 0xabc, 0x123 of 12 bits, laid out by hand from the pictures of the standards.
    #[cfg(feature = "aravis")]
    #[test]
    fn packed_pixels_are_those_of_the_standards() {
        let stream = |pixels: &[u16], bits: usize| {
            let mut bytes = vec![0u8; (pixels.len() * bits).div_ceil(8)];
            for (at, pixel) in pixels.iter().enumerate() {
                for bit in (0..bits).filter(|bit| pixel >> bit & 1 == 1) {
                    bytes[(at * bits + bit) / 8] |= 1 << ((at * bits + bit) % 8);
                }
            }
            bytes
        };
        let (of_10, of_12): ([u16; 4], [u16; 2]) = ([0x3a5, 0x0f1, 0x25a, 0x181], [0xabc, 0x123]);
        assert_eq!(stream(&of_12, 12), [0xbc, 0x3a, 0x12], "Mono12p: low byte, nibbles, high byte");
        assert_eq!(Packed::Mono12p.unpack(&[0xbc, 0x3a, 0x12], 2), [0xab, 0x12]);
        assert_eq!(Packed::Mono12Packed.unpack(&[0xab, 0x3c, 0x12], 2), [0xab, 0x12]);
        // 0x3a5 = 11 1010 0101, 0x0f1 = 00 1111 0001, 0x25a = 10 0101 1010, 0x181 = 01 1000 0001.
        assert_eq!(stream(&of_10, 10), [0b1010_0101, 0b1100_0111, 0b1010_0011, 0b0110_0101, 0b0110_0000]);
        assert_eq!(Packed::Mono10p.unpack(&stream(&of_10, 10), 4), of_10.map(|pixel| (pixel >> 2) as u8));
        assert_eq!(Packed::Mono10Packed.unpack(&[0xe9, 0x11, 0x3c], 2), [0xe9, 0x3c]);
        // An odd number of pixels ends within a byte.
        assert_eq!(Packed::Mono12p.unpack(&stream(&[0xabc, 0x123, 0xfed], 12), 3), [0xab, 0x12, 0xfe]);
        assert_eq!([Packed::Mono10p.bytes(3), Packed::Mono12p.bytes(3), Packed::Mono12Packed.bytes(4)], [4, 5, 6]);
        // Too few bytes give too few pixels, which no frame has.
        assert_eq!(Packed::Mono12p.unpack(&[0xbc], 2).len() + Packed::Mono12Packed.unpack(&[], 2).len(), 0);
    }

    #[test]
    fn hardware_addresses_are_read_however_they_are_written() {
        let named = LEAST.replace(r#"{"address": "127.0.0.2"}"#, r#"{"mac": "00-0F-31-02-12-34"}"#);
        let settings: AravisSettings = serde_json::from_str(&named).unwrap();
        assert_eq!(settings.select.to_string(), "hardware address 00:0f:31:02:12:34");
        let wrong = serde_json::from_str::<AravisSettings>(&named.replace("00-0F", "00-0G")).unwrap_err().to_string();
        assert!(wrong.contains("00:0f:31:02:12:34"), "{wrong}");
    }

    #[cfg(not(feature = "aravis"))]
    #[test]
    fn a_build_without_aravis_says_how_to_get_it() {
        let said = super::super::open(serde_json::from_str(LEAST).unwrap()).err().unwrap().to_string();
        assert!(said.contains("apt-get install libaravis-dev libusb-1.0-0-dev"), "{said}");
    }
}
