//! The features of the camera, with the names of a Prosilica GE1050, and their registers. The GenICam description is made from this
//! table, and register writes are checked by it.

use super::bytes::u32_at;
use crate::sight::{PixelFormat, WireFormat};
use std::fmt::Write;

/// Addresses of the first feature register and of the description.
pub(super) const FEATURES: u32 = 0x0001_0000;
pub(super) const DESCRIPTION: u32 = 0x0010_0000;

/// Registers in the order of their addresses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Register {
    SensorWidth,
    SensorHeight,
    Width,
    Height,
    OffsetX,
    OffsetY,
    WidthMax,
    HeightMax,
    OffsetXMax,
    OffsetYMax,
    PixelFormat,
    PayloadSize,
    AcquisitionMode,
    AcquisitionFrameCount,
    AcquisitionStart,
    AcquisitionStop,
    AcquisitionAbort,
    AcquisitionFrameRateAbs,
    TriggerSelector,
    TriggerMode,
    TriggerSource,
    TriggerActivation,
    TriggerSoftware,
    ExposureMode,
    ExposureAuto,
    ExposureTimeAbs,
    GainRaw,
    StreamBytesPerSecond,
    PacketSize,
    ReverseX,
    ReverseY,
    GainAuto,
    Gamma,
    BinningHorizontal,
    AcquisitionFrameRateLimit,
}

impl Register {
    pub const fn address(self) -> u32 {
        FEATURES + 4 * self as u32
    }

    pub fn named(name: &str) -> Option<Self> {
        FEATURE_TABLE.iter().find(|f| f.name == name).map(|f| f.register)
    }

    pub fn at(address: u32) -> Option<Self> {
        FEATURE_TABLE.iter().map(|f| f.register).find(|r| r.address() == address)
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Integer { min: u32, max: Max<u32>, step: u32 },
    ReadOnly,
    ReadOnlyFloat,
    Float { min: f32, max: Max<f32>, unit: &'static str },
    Enumeration(&'static [(&'static str, u32)]),
    Boolean,
    Command,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Max<T> {
    Value(T),
    Of(Register),
}

impl<T: std::fmt::Display> Max<T> {
    fn node(&self) -> String {
        match self {
            Self::Value(max) => format!("<Max>{max}</Max>"),
            Self::Of(register) => {
                FEATURE_TABLE.iter().find(|f| f.register == *register).map_or_else(String::new, |f| format!("<pMax>{}</pMax>", f.name))
            }
        }
    }
}

pub(super) struct Feature {
    pub register: Register,
    pub name: &'static str,
    pub group: &'static str,
    pub kind: Kind,
}

const fn feature(group: &'static str, name: &'static str, register: Register, kind: Kind) -> Feature {
    Feature { register, name, group, kind }
}

/// The sensor reads 1024 rows out 59 times per second.
const FULL_RATE_HZ: f32 = 59.0;
const FULL_ROWS: f32 = 1024.0;

/// The selector of the frame trigger. The other selectors only store whether they are on.
pub(super) const FRAME_START: u32 = 0;
pub(super) const SELECTORS: usize = 4;
pub(super) const FREERUN: u32 = 0;
pub(super) const LINE1: u32 = 1;
const FIXED_RATE: u32 = 5;
pub(super) const SOFTWARE: u32 = 6;
pub(super) const CONTINUOUS: u32 = 0;
pub(super) const SINGLE_FRAME: u32 = 1;
pub(super) const MULTI_FRAME: u32 = 2;

const AUTO: &[(&str, u32)] = &[("Off", 0), ("Once", 1), ("Continuous", CONTINUOUSLY)];
/// The camera changes the value by itself.
const CONTINUOUSLY: u32 = 2;

const IMAGE: &str = "ImageFormat";
const ACQUISITION: &str = "Acquisition";
const EXPOSURE: &str = "Exposure";
const TRANSPORT: &str = "GigE";

const FORMATS: [(&str, u32); WireFormat::ALL.len()] = {
    let mut formats = [("", 0); WireFormat::ALL.len()];
    let mut i = 0;
    while i < formats.len() {
        let (name, sent) = WireFormat::ALL[i];
        formats[i] = (name, sent.code());
        i += 1;
    }
    formats
};

pub(super) const FEATURE_TABLE: &[Feature] = &[
    feature(IMAGE, "SensorWidth", Register::SensorWidth, Kind::ReadOnly),
    feature(IMAGE, "SensorHeight", Register::SensorHeight, Kind::ReadOnly),
    feature(IMAGE, "Width", Register::Width, Kind::Integer { min: 2, max: Max::Of(Register::WidthMax), step: 2 }),
    feature(IMAGE, "Height", Register::Height, Kind::Integer { min: 2, max: Max::Of(Register::HeightMax), step: 2 }),
    feature(IMAGE, "OffsetX", Register::OffsetX, Kind::Integer { min: 0, max: Max::Of(Register::OffsetXMax), step: 2 }),
    feature(IMAGE, "OffsetY", Register::OffsetY, Kind::Integer { min: 0, max: Max::Of(Register::OffsetYMax), step: 2 }),
    feature(IMAGE, "WidthMax", Register::WidthMax, Kind::ReadOnly),
    feature(IMAGE, "HeightMax", Register::HeightMax, Kind::ReadOnly),
    feature(IMAGE, "OffsetXMax", Register::OffsetXMax, Kind::ReadOnly),
    feature(IMAGE, "OffsetYMax", Register::OffsetYMax, Kind::ReadOnly),
    feature(IMAGE, "PixelFormat", Register::PixelFormat, Kind::Enumeration(&FORMATS)),
    feature(IMAGE, "PayloadSize", Register::PayloadSize, Kind::ReadOnly),
    feature(
        ACQUISITION,
        "AcquisitionMode",
        Register::AcquisitionMode,
        Kind::Enumeration(&[("Continuous", CONTINUOUS), ("SingleFrame", SINGLE_FRAME), ("MultiFrame", MULTI_FRAME)]),
    ),
    feature(
        ACQUISITION,
        "AcquisitionFrameCount",
        Register::AcquisitionFrameCount,
        Kind::Integer { min: 1, max: Max::Value(65_535), step: 1 },
    ),
    feature(ACQUISITION, "AcquisitionStart", Register::AcquisitionStart, Kind::Command),
    feature(ACQUISITION, "AcquisitionStop", Register::AcquisitionStop, Kind::Command),
    feature(ACQUISITION, "AcquisitionAbort", Register::AcquisitionAbort, Kind::Command),
    feature(
        ACQUISITION,
        "AcquisitionFrameRateAbs",
        Register::AcquisitionFrameRateAbs,
        Kind::Float { min: 0.01, max: Max::Of(Register::AcquisitionFrameRateLimit), unit: "Hz" },
    ),
    feature(
        ACQUISITION,
        "TriggerSelector",
        Register::TriggerSelector,
        Kind::Enumeration(&[("FrameStart", FRAME_START), ("AcquisitionStart", 1), ("AcquisitionEnd", 2), ("AcquisitionRecord", 3)]),
    ),
    feature(ACQUISITION, "TriggerMode", Register::TriggerMode, Kind::Enumeration(&[("Off", 0), ("On", 1)])),
    feature(
        ACQUISITION,
        "TriggerSource",
        Register::TriggerSource,
        Kind::Enumeration(&[
            ("Freerun", FREERUN),
            ("Line1", LINE1),
            ("Line2", 2),
            ("Line3", 3),
            ("Line4", 4),
            ("FixedRate", FIXED_RATE),
            ("Software", SOFTWARE),
        ]),
    ),
    feature(
        ACQUISITION,
        "TriggerActivation",
        Register::TriggerActivation,
        Kind::Enumeration(&[("RisingEdge", 0), ("FallingEdge", 1), ("AnyEdge", 2), ("LevelHigh", 3), ("LevelLow", 4)]),
    ),
    feature(ACQUISITION, "TriggerSoftware", Register::TriggerSoftware, Kind::Command),
    feature(EXPOSURE, "ExposureMode", Register::ExposureMode, Kind::Enumeration(&[("Timed", 0)])),
    feature(EXPOSURE, "ExposureAuto", Register::ExposureAuto, Kind::Enumeration(AUTO)),
    feature(EXPOSURE, "ExposureTimeAbs", Register::ExposureTimeAbs, Kind::Float { min: 10.0, max: Max::Value(60_000_000.0), unit: "us" }),
    feature(EXPOSURE, "GainRaw", Register::GainRaw, Kind::Integer { min: 0, max: Max::Value(24), step: 1 }),
    feature(
        TRANSPORT,
        "StreamBytesPerSecond",
        Register::StreamBytesPerSecond,
        Kind::Integer { min: 1_000_000, max: Max::Value(124_000_000), step: 1 },
    ),
    feature(TRANSPORT, "GevSCPSPacketSize", Register::PacketSize, Kind::Integer { min: 500, max: Max::Value(16_384), step: 4 }),
    feature(IMAGE, "ReverseX", Register::ReverseX, Kind::Boolean),
    feature(IMAGE, "ReverseY", Register::ReverseY, Kind::Boolean),
    feature(EXPOSURE, "GainAuto", Register::GainAuto, Kind::Enumeration(AUTO)),
    feature(EXPOSURE, "Gamma", Register::Gamma, Kind::Float { min: 0.45, max: Max::Value(1.0), unit: "" }),
    feature(IMAGE, "BinningHorizontal", Register::BinningHorizontal, Kind::Integer { min: 1, max: Max::Value(8), step: 1 }),
    feature(ACQUISITION, "AcquisitionFrameRateLimit", Register::AcquisitionFrameRateLimit, Kind::ReadOnlyFloat),
];

/// Text features in the bootstrap registers: name, address, length, whether they can be written.
const TEXTS: [(&str, u32, u32, bool); 5] = [
    ("DeviceVendorName", 0x48, 32, false),
    ("DeviceModelName", 0x68, 32, false),
    ("DeviceFirmwareVersion", 0x88, 32, false),
    ("DeviceID", 0xd8, 16, false),
    ("DeviceUserID", 0xe8, 16, true),
];

/// The values of the feature registers.
#[derive(Debug, Clone)]
pub(super) struct Values {
    sensor: (u32, u32),
    pub width: u32,
    pub height: u32,
    pub offset: (u32, u32),
    pub format: WireFormat,
    pub mode: u32,
    pub frame_count: u32,
    frame_rate_hz: f32,
    selector: u32,
    trigger_on: [bool; SELECTORS],
    trigger_source: u32,
    trigger_activation: u32,
    pub exposure_us: f32,
    pub gain_db: u32,
    pub bytes_per_second: u32,
    pub packet_size: u32,
    /// Whether the columns, and the rows, are read out from the other end.
    pub reversed: [bool; 2],
    exposure_auto: u32,
    gain_auto: u32,
    gamma: f32,
    binning: u32,
}

impl Values {
    pub fn new(sensor: (u32, u32), format: PixelFormat) -> Self {
        Self {
            sensor,
            width: sensor.0,
            height: sensor.1,
            offset: (0, 0),
            format: WireFormat::Plain(format),
            mode: CONTINUOUS,
            frame_count: 1,
            frame_rate_hz: 59.0,
            selector: FRAME_START,
            trigger_on: [true, false, false, false],
            trigger_source: FREERUN,
            trigger_activation: 0,
            exposure_us: 5000.0,
            gain_db: 0,
            bytes_per_second: 115_000_000,
            packet_size: 1500,
            reversed: [false; 2],
            exposure_auto: 0,
            gain_auto: 0,
            gamma: 1.0,
            binning: 1,
        }
    }

    pub fn payload(&self) -> u32 {
        self.format.bytes(self.width as usize * self.height as usize) as u32
    }

    /// The most frames per second: an exposure must end before the next one begins, and rows and bytes take their time.
    pub fn rate_limit_hz(&self) -> f32 {
        let rows = FULL_RATE_HZ * FULL_ROWS / self.height.max(1) as f32;
        let bytes = self.bytes_per_second as f32 / self.payload().max(1) as f32;
        rows.min(bytes).min(1e6 / self.exposure_us)
    }

    /// Frames per second in free run.
    pub fn rate_hz(&self) -> f32 {
        self.frame_rate_hz.min(self.rate_limit_hz())
    }

    /// Shortens the exposure a little if the camera chooses it by itself.
    pub fn choose_exposure(&mut self) {
        if self.exposure_auto == CONTINUOUSLY {
            self.exposure_us = (0.9 * self.exposure_us).max(10.0);
        }
    }

    /// Whether each frame waits for a software trigger.
    pub fn waits_for_software(&self) -> bool {
        self.trigger_on[FRAME_START as usize] && self.trigger_source == SOFTWARE
    }

    /// Whether each frame waits for a pulse on the trigger line. Only one line is wired.
    pub fn waits_for_line(&self) -> bool {
        self.trigger_on[FRAME_START as usize] && self.trigger_source == LINE1
    }

    /// Whether the camera takes frames without triggers, at the frame rate.
    pub fn runs_free(&self) -> bool {
        !self.waits_for_software() && !self.waits_for_line()
    }

    pub fn read(&self, register: Register) -> u32 {
        match register {
            Register::SensorWidth => self.sensor.0,
            Register::SensorHeight => self.sensor.1,
            Register::Width => self.width,
            Register::Height => self.height,
            Register::OffsetX => self.offset.0,
            Register::OffsetY => self.offset.1,
            Register::WidthMax => self.sensor.0 - self.offset.0,
            Register::HeightMax => self.sensor.1 - self.offset.1,
            Register::OffsetXMax => self.sensor.0 - self.width,
            Register::OffsetYMax => self.sensor.1 - self.height,
            Register::PixelFormat => self.format.code(),
            Register::PayloadSize => self.payload(),
            Register::AcquisitionMode => self.mode,
            Register::AcquisitionFrameCount => self.frame_count,
            Register::AcquisitionFrameRateAbs => self.frame_rate_hz.to_bits(),
            Register::TriggerSelector => self.selector,
            Register::TriggerMode => u32::from(self.trigger_on[self.selector as usize]),
            Register::TriggerSource => self.trigger_source,
            Register::TriggerActivation => self.trigger_activation,
            Register::ExposureTimeAbs => self.exposure_us.to_bits(),
            Register::GainRaw => self.gain_db,
            Register::StreamBytesPerSecond => self.bytes_per_second,
            Register::PacketSize => self.packet_size,
            Register::ReverseX => u32::from(self.reversed[0]),
            Register::ReverseY => u32::from(self.reversed[1]),
            Register::ExposureAuto => self.exposure_auto,
            Register::GainAuto => self.gain_auto,
            Register::Gamma => self.gamma.to_bits(),
            Register::BinningHorizontal => self.binning,
            Register::AcquisitionFrameRateLimit => self.rate_limit_hz().to_bits(),
            Register::ExposureMode
            | Register::AcquisitionStart
            | Register::AcquisitionStop
            | Register::AcquisitionAbort
            | Register::TriggerSoftware => 0,
        }
    }

    /// Stores a value. Returns `false` if the feature refuses it.
    pub fn write(&mut self, register: Register, value: u32) -> bool {
        if !self.allows(register, value) {
            return false;
        }
        match register {
            Register::Width => self.width = value,
            Register::Height => self.height = value,
            Register::OffsetX => self.offset.0 = value,
            Register::OffsetY => self.offset.1 = value,
            Register::PixelFormat => self.format = WireFormat::from_code(value).unwrap_or(self.format),
            Register::AcquisitionMode => self.mode = value,
            Register::AcquisitionFrameCount => self.frame_count = value,
            Register::AcquisitionFrameRateAbs => self.frame_rate_hz = f32::from_bits(value),
            Register::TriggerSelector => self.selector = value,
            Register::TriggerMode => self.trigger_on[self.selector as usize] = value == 1,
            // Only one line is wired. A fixed rate is free run at that rate.
            Register::TriggerSource if ![FREERUN, LINE1, FIXED_RATE, SOFTWARE].contains(&value) => return false,
            Register::TriggerSource if self.selector == FRAME_START => self.trigger_source = value,
            Register::TriggerActivation => self.trigger_activation = value,
            Register::ExposureTimeAbs => self.exposure_us = f32::from_bits(value),
            Register::GainRaw => self.gain_db = value,
            Register::StreamBytesPerSecond => self.bytes_per_second = value,
            Register::PacketSize => self.packet_size = value,
            Register::ReverseX => self.reversed[0] = value == 1,
            Register::ReverseY => self.reversed[1] = value == 1,
            Register::ExposureAuto => self.exposure_auto = value,
            Register::GainAuto => self.gain_auto = value,
            Register::Gamma => self.gamma = f32::from_bits(value),
            Register::BinningHorizontal => self.binning = value,
            _ => {}
        }
        true
    }

    fn allows(&self, register: Register, value: u32) -> bool {
        let Some(feature) = FEATURE_TABLE.iter().find(|f| f.register == register) else { return false };
        match feature.kind {
            Kind::ReadOnly | Kind::ReadOnlyFloat => false,
            Kind::Command => true,
            Kind::Boolean => value <= 1,
            Kind::Enumeration(entries) => entries.iter().any(|(_, v)| *v == value),
            Kind::Float { min, max, .. } => {
                let max = match max {
                    Max::Value(max) => max,
                    Max::Of(register) => f32::from_bits(self.read(register)),
                };
                (min..=max).contains(&f32::from_bits(value))
            }
            Kind::Integer { min, max, step } => {
                let max = match max {
                    Max::Value(max) => max,
                    Max::Of(register) => self.read(register),
                };
                value == self.read(register) || ((min..=max).contains(&value) && (value - min).is_multiple_of(step))
            }
        }
    }
}

/// Whether a register is locked while the stream runs, because the geometry of the stream depends on it.
pub(super) fn is_locked_while_streaming(register: Register) -> bool {
    use Register::{Height, OffsetX, OffsetY, PacketSize, PixelFormat, Width};
    matches!(register, Width | Height | OffsetX | OffsetY | PixelFormat | PacketSize)
}

/// The GenICam description, with the schema version of a GE1050.
pub(super) fn description(vendor: &str, model: &str) -> String {
    let mut groups: Vec<(&str, Vec<&str>)> = vec![("DeviceInformation", TEXTS.iter().map(|t| t.0).collect())];
    for feature in FEATURE_TABLE {
        match groups.iter_mut().find(|g| g.0 == feature.group) {
            Some((_, names)) => names.push(feature.name),
            None => groups.push((feature.group, vec![feature.name])),
        }
    }
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<RegisterDescription ModelName=\"{}\" VendorName=\"{vendor}\" \
         ToolTip=\"Emulated camera\" StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"0\" SchemaSubMinorVersion=\"1\" \
         MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" ProductGuid=\"9a4f3d0c-5c62-4f0e-9d58-6f1f0a7b1050\" \
         VersionGuid=\"9a4f3d0c-5c62-4f0e-9d58-6f1f0a7b1051\" xmlns=\"http://www.genicam.org/GenApi/Version_1_0\">\n",
        model.replace(' ', "_")
    );
    let list = |names: &[&str]| names.iter().map(|n| format!("<pFeature>{n}</pFeature>")).collect::<Vec<_>>().concat();
    let heads: Vec<&str> = groups.iter().map(|g| g.0).collect();
    let _ = writeln!(xml, "<Category Name=\"Root\" NameSpace=\"Standard\">{}</Category>", list(&heads));
    for (group, names) in &groups {
        let _ = writeln!(xml, "<Category Name=\"{group}\" NameSpace=\"Custom\">{}</Category>", list(names));
    }
    for (name, address, length, writable) in TEXTS {
        let access = if writable { "RW" } else { "RO" };
        let _ = writeln!(
            xml,
            "<StringReg Name=\"{name}\" NameSpace=\"Standard\"><Address>0x{address:x}</Address><Length>{length}</Length>\
             <AccessMode>{access}</AccessMode><pPort>Device</pPort></StringReg>"
        );
    }
    for feature in FEATURE_TABLE {
        xml.push_str(&node(feature));
    }
    xml.push_str("<Port Name=\"Device\" NameSpace=\"Standard\"/>\n</RegisterDescription>\n");
    xml
}

fn node(feature: &Feature) -> String {
    let name = feature.name;
    let value = format!("<pValue>{name}Reg</pValue>");
    let (node, register, access) = match feature.kind {
        Kind::ReadOnly => (format!("<Integer Name=\"{name}\" NameSpace=\"Standard\">{value}</Integer>"), "IntReg", "RO"),
        Kind::ReadOnlyFloat => (format!("<Float Name=\"{name}\" NameSpace=\"Standard\">{value}</Float>"), "FloatReg", "RO"),
        Kind::Integer { min, max, step } => {
            let max = max.node();
            let text = format!("<Integer Name=\"{name}\" NameSpace=\"Standard\">{value}<Min>{min}</Min>{max}<Inc>{step}</Inc></Integer>");
            (text, "IntReg", "RW")
        }
        Kind::Float { min, max, unit } => {
            let max = max.node();
            let text = format!("<Float Name=\"{name}\" NameSpace=\"Standard\">{value}<Min>{min}</Min>{max}<Unit>{unit}</Unit></Float>");
            (text, "FloatReg", "RW")
        }
        Kind::Enumeration(entries) => {
            let entries = entries
                .iter()
                .map(|(entry, v)| format!("<EnumEntry Name=\"{entry}\" NameSpace=\"Standard\"><Value>{v}</Value></EnumEntry>"))
                .collect::<Vec<_>>()
                .concat();
            (format!("<Enumeration Name=\"{name}\" NameSpace=\"Standard\">{entries}{value}</Enumeration>"), "IntReg", "RW")
        }
        Kind::Boolean => {
            let text =
                format!("<Boolean Name=\"{name}\" NameSpace=\"Standard\">{value}<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>");
            (text, "IntReg", "RW")
        }
        Kind::Command => {
            let text = format!("<Command Name=\"{name}\" NameSpace=\"Standard\">{value}<CommandValue>1</CommandValue></Command>");
            (text, "IntReg", "WO")
        }
    };
    let sign = if register == "IntReg" { "<Sign>Unsigned</Sign>" } else { "" };
    format!(
        "{node}\n<{register} Name=\"{name}Reg\"><Address>0x{:x}</Address><Length>4</Length><AccessMode>{access}</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable>{sign}<Endianess>BigEndian</Endianess></{register}>\n",
        feature.register.address()
    )
}

/// Reads a word of a byte image. It is 0 beyond the end.
pub(super) fn word(image: &[u8], address: u32) -> u32 {
    u32_at(image, address as usize).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    // A register returns exactly the bits that were written.
    #![allow(clippy::float_cmp)]

    use super::*;

    #[test]
    fn the_region_stays_on_the_sensor() {
        let mut v = Values::new((1024, 768), PixelFormat::Mono8);
        assert!(!v.write(Register::Width, 1026) && !v.write(Register::OffsetX, 2));
        assert!(v.write(Register::Width, 512) && v.write(Register::OffsetX, 512));
        assert!(!v.write(Register::Width, 514), "would reach beyond the edge");
        assert!(!v.write(Register::OffsetX, 3), "odd offsets would turn the Bayer mosaic");
        assert_eq!(v.read(Register::WidthMax), 512);
        assert_eq!(v.payload(), 512 * 768);
        assert!(v.write(Register::PixelFormat, WireFormat::Plain(PixelFormat::RGB8Packed).code()));
        assert_eq!(v.payload(), 512 * 768 * 3);
    }

    #[test]
    fn the_rate_has_its_limit_from_region_format_and_exposure() {
        let mut v = Values::new((1024, 1024), PixelFormat::Mono8);
        assert_eq!(v.rate_limit_hz(), 59.0);
        assert!(!v.write(Register::AcquisitionFrameRateAbs, 60f32.to_bits()));
        assert!(v.write(Register::Height, 512) && v.write(Register::AcquisitionFrameRateAbs, 60f32.to_bits()));
        assert!(v.write(Register::ExposureTimeAbs, 25_000f32.to_bits()));
        assert_eq!((v.rate_limit_hz(), v.rate_hz()), (40.0, 40.0), "25 ms of exposure");
        assert!(v.write(Register::ExposureTimeAbs, 1000f32.to_bits()) && v.write(Register::Height, 1024));
        assert!(v.write(Register::PixelFormat, WireFormat::Plain(PixelFormat::RGB8Packed).code()));
        assert!((v.rate_limit_hz() - 115e6 / (3.0 * 1024.0 * 1024.0)).abs() < 1e-3, "three bytes per pixel");
    }

    #[test]
    fn triggers_are_kept_per_selector() {
        let mut v = Values::new((64, 64), PixelFormat::Mono8);
        assert!(!v.waits_for_software(), "free run");
        assert!(v.write(Register::TriggerSource, SOFTWARE) && v.waits_for_software());
        assert!(v.write(Register::TriggerSelector, 1) && v.write(Register::TriggerMode, 0));
        assert!(v.waits_for_software(), "another selector's mode");
        assert!(v.write(Register::TriggerSelector, FRAME_START) && v.write(Register::TriggerMode, 0));
        assert!(!v.waits_for_software());
        assert!(!v.write(Register::TriggerSource, 2), "this line is not wired");
        assert!(v.write(Register::TriggerMode, 1) && v.write(Register::TriggerSource, LINE1) && v.waits_for_line() && !v.runs_free());
        assert!(v.write(Register::TriggerSource, FIXED_RATE) && v.runs_free());
    }

    #[test]
    fn floats_out_of_range_and_not_a_number_are_refused() {
        let mut v = Values::new((64, 64), PixelFormat::Mono8);
        for bad in [9.0, f32::NAN, 1e9] {
            assert!(!v.write(Register::ExposureTimeAbs, f32::to_bits(bad)));
        }
        assert!(v.write(Register::ExposureTimeAbs, 250.5f32.to_bits()) && v.exposure_us == 250.5);
    }

    #[test]
    fn every_feature_has_its_register_in_the_description() {
        let xml = description("carved", "Emulated GE1050C");
        for feature in FEATURE_TABLE {
            assert!(xml.contains(&format!("Name=\"{}\"", feature.name)), "{}", feature.name);
            assert!(xml.contains(&format!("<Address>0x{:x}</Address>", feature.register.address())), "{}", feature.name);
        }
    }
}
