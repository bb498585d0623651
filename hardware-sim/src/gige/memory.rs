//! The address space of the camera: bootstrap registers, feature registers, GenICam description.
//!
//! ```text
//!   0x000000  bootstrap: identity, control, destination of the stream
//!   0x010000  features
//!   0x100000  GenICam description
//! ```

use super::features::{self, DESCRIPTION, FEATURES, Register, Values};
use super::gvcp::Refusal;
use crate::sight::PixelFormat;
use std::net::{Ipv4Addr, SocketAddrV4};

pub(super) const CONTROL_PRIVILEGE: u32 = 0xa00;
const HEARTBEAT_MS: u32 = 0x938;
const TIMESTAMP_CONTROL: u32 = 0x944;
const TIMESTAMP_LATCHED: u32 = 0x948;
const STREAM_PORT: u32 = 0xd00;
const STREAM_PACKET_SIZE: u32 = 0xd04;
const STREAM_DELAY: u32 = 0xd08;
const STREAM_DESTINATION: u32 = 0xd18;
const STREAM_SOURCE_PORT: u32 = 0xd1c;
const USER_NAME: std::ops::Range<u32> = 0xe8..0xf8;
const BOOTSTRAP_BYTES: usize = 0x1000;
/// The bootstrap registers that a discovery answer contains.
const DISCOVERY_BYTES: usize = 0xf8;
/// The longest read, bytes.
const READ_LIMIT: u16 = 536;

/// The identity of the camera.
#[derive(Debug, Clone)]
pub(super) struct Identity {
    pub vendor: &'static str,
    pub model: &'static str,
    pub serial: String,
    pub address: Ipv4Addr,
    pub stream_port: u16,
}

/// What the sensor must do after a register was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effect {
    None,
    Start,
    Stop,
    Trigger,
}

pub(super) struct Memory {
    bootstrap: Vec<u8>,
    pub values: Values,
    /// Both as they are at power-up.
    at_power_on: (Vec<u8>, Values),
    description: Vec<u8>,
    pub streaming: bool,
}

impl Memory {
    pub fn new(identity: &Identity, sensor: (u32, u32), format: PixelFormat) -> Self {
        let description = features::description(identity.vendor, identity.model).into_bytes();
        let values = Values::new(sensor, format);
        let at_power_on = (Vec::new(), values.clone());
        let mut memory = Self { bootstrap: vec![0; BOOTSTRAP_BYTES], values, at_power_on, description, streaming: false };
        let [a, b, c, d] = identity.address.octets();
        for (address, value) in [
            // GigE Vision 1.2; big-endian, UTF-8.
            (0x000, 0x0001_0002),
            (0x004, 0x8000_0001),
            // A locally administered hardware address, derived from the IP address.
            (0x008, 0x0000_0200 | u32::from(a)),
            (0x00c, u32::from_be_bytes([b, c, d, 0x50])),
            // Persistent address.
            (0x010, 1),
            (0x014, 1),
            (0x024, u32::from(identity.address)),
            (0x034, 0xff00_0000),
            (0x600, 1),
            (0x64c, u32::from(identity.address)),
            (0x65c, 0xff00_0000),
            (0x670, 1000),
            (0x904, 1),
            // Capabilities: memory writes, several registers per command, packet resend.
            (0x934, 0b0111),
            (HEARTBEAT_MS, 3000),
            // Ticks of the timestamp per second: nanoseconds.
            (0x940, 1_000_000_000),
            (STREAM_SOURCE_PORT, u32::from(identity.stream_port)),
        ] {
            memory.put(address, value);
        }
        let url = format!("Local:emulated_ge1050c.xml;{DESCRIPTION:x};{:x}", memory.description.len());
        for (address, size, text) in [
            (0x48, 32, identity.vendor),
            (0x68, 32, identity.model),
            (0x88, 32, env!("CARGO_PKG_VERSION")),
            (0xa8, 48, "not a camera: a simulation"),
            (0xd8, 16, identity.serial.as_str()),
            (0x200, 512, url.as_str()),
        ] {
            let text = &text.as_bytes()[..text.len().min(size - 1)];
            memory.bootstrap[address..address + text.len()].copy_from_slice(text);
        }
        memory.at_power_on.0.clone_from(&memory.bootstrap);
        memory
    }

    pub fn restart(&mut self) {
        (self.bootstrap, self.values) = self.at_power_on.clone();
        self.streaming = false;
    }

    /// Another camera of the same model takes the place of this one.
    pub fn exchange(&mut self, serial: &str) {
        let image = &mut self.at_power_on.0;
        image[0xd8..0xe8].fill(0);
        let text = &serial.as_bytes()[..serial.len().min(15)];
        image[0xd8..0xd8 + text.len()].copy_from_slice(text);
        image[0x0f] ^= 0xff;
    }

    pub fn discovery(&self) -> &[u8] {
        &self.bootstrap[..DISCOVERY_BYTES]
    }

    pub fn heartbeat_ms(&self) -> u32 {
        features::word(&self.bootstrap, HEARTBEAT_MS).max(500)
    }

    /// The destination of the stream. `None` until a host has set it.
    pub fn destination(&self) -> Option<SocketAddrV4> {
        let port = features::word(&self.bootstrap, STREAM_PORT) as u16;
        let address = Ipv4Addr::from(features::word(&self.bootstrap, STREAM_DESTINATION));
        (port != 0).then(|| SocketAddrV4::new(address, port))
    }

    /// Clears the destination of the stream, when its host has lost control.
    pub fn forget_destination(&mut self) {
        self.put(STREAM_PORT, 0);
    }

    pub fn read_register(&self, address: u32) -> Result<u32, Refusal> {
        if !address.is_multiple_of(4) {
            return Err(Refusal::BadAlignment);
        }
        if address == STREAM_PACKET_SIZE {
            return Ok(self.values.packet_size);
        }
        if (address as usize) < BOOTSTRAP_BYTES {
            return Ok(features::word(&self.bootstrap, address));
        }
        Register::at(address).map(|r| self.values.read(r)).ok_or(Refusal::InvalidAddress)
    }

    pub fn read_memory(&self, address: u32, count: u16) -> Result<Vec<u8>, Refusal> {
        if !address.is_multiple_of(4) || !count.is_multiple_of(4) {
            return Err(Refusal::BadAlignment);
        }
        if count > READ_LIMIT {
            return Err(Refusal::InvalidParameter);
        }
        let from = |image: &[u8], start: u32| {
            let start = start as usize;
            // A host reads whole words, so the last word may extend beyond the description.
            let padded = image.len().next_multiple_of(4);
            (start + usize::from(count) <= padded)
                .then(|| (start..start + usize::from(count)).map(|i| image.get(i).copied().unwrap_or(0)).collect())
                .ok_or(Refusal::InvalidAddress)
        };
        if address >= DESCRIPTION {
            from(&self.description, address - DESCRIPTION)
        } else if address >= FEATURES {
            let words = (address..address + u32::from(count)).step_by(4).map(|a| self.read_register(a));
            Ok(words.collect::<Result<Vec<_>, _>>()?.into_iter().flat_map(u32::to_be_bytes).collect())
        } else {
            from(&self.bootstrap, address)
        }
    }

    /// Writes a register. The control privilege is not one of them: the control channel has it.
    pub fn write_register(&mut self, address: u32, value: u32, now_ns: u64) -> Result<Effect, Refusal> {
        if !address.is_multiple_of(4) {
            return Err(Refusal::BadAlignment);
        }
        match address {
            HEARTBEAT_MS | STREAM_DELAY | STREAM_DESTINATION => self.put(address, value),
            STREAM_PORT => self.put(address, value & 0xffff),
            TIMESTAMP_CONTROL => {
                if value & 2 != 0 {
                    self.put(TIMESTAMP_LATCHED, (now_ns >> 32) as u32);
                    self.put(TIMESTAMP_LATCHED + 4, now_ns as u32);
                }
            }
            STREAM_PACKET_SIZE => return self.write_feature(Register::PacketSize, value & 0xffff),
            _ if (address as usize) < BOOTSTRAP_BYTES => return Err(Refusal::WriteProtect),
            _ => return self.write_feature(Register::at(address).ok_or(Refusal::InvalidAddress)?, value),
        }
        Ok(Effect::None)
    }

    fn write_feature(&mut self, register: Register, value: u32) -> Result<Effect, Refusal> {
        if self.streaming && features::is_locked_while_streaming(register) && self.values.read(register) != value {
            return Err(Refusal::WriteProtect);
        }
        if !self.values.write(register, value) {
            return Err(Refusal::InvalidParameter);
        }
        Ok(match register {
            Register::AcquisitionStart => Effect::Start,
            Register::AcquisitionStop | Register::AcquisitionAbort => {
                // The next write may come before the sensor has received the order.
                self.streaming = false;
                Effect::Stop
            }
            Register::TriggerSoftware => Effect::Trigger,
            _ => Effect::None,
        })
    }

    pub fn write_memory(&mut self, address: u32, data: &[u8], now_ns: u64) -> Result<Effect, Refusal> {
        let end = address.saturating_add(data.len() as u32);
        if USER_NAME.contains(&address) && end <= USER_NAME.end {
            self.bootstrap[address as usize..end as usize].copy_from_slice(data);
            return Ok(Effect::None);
        }
        match data.first_chunk() {
            Some(word) if data.len() == 4 => self.write_register(address, u32::from_be_bytes(*word), now_ns),
            _ => Err(Refusal::WriteProtect),
        }
    }

    fn put(&mut self, address: u32, value: u32) {
        let at = address as usize;
        self.bootstrap[at..at + 4].copy_from_slice(&value.to_be_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory() -> Memory {
        let identity = Identity { vendor: "v", model: "m", serial: "s".into(), address: Ipv4Addr::new(127, 0, 0, 9), stream_port: 4000 };
        Memory::new(&identity, (64, 48), PixelFormat::Mono8)
    }

    /// Reads the description by the first URL, as a host does.
    #[test]
    fn the_description_is_where_the_url_says() {
        let m = memory();
        let url: Vec<u8> = (0..512).step_by(256).flat_map(|i| m.read_memory(0x200 + i, 256).unwrap()).take_while(|b| *b != 0).collect();
        let url = String::from_utf8(url).unwrap();
        let parts: Vec<&str> = url.split(';').collect();
        let (at, size) = (u32::from_str_radix(parts[1], 16).unwrap(), u32::from_str_radix(parts[2], 16).unwrap());
        let mut xml = Vec::new();
        while xml.len() < size as usize {
            let count = (size - xml.len() as u32).next_multiple_of(4).min(512) as u16;
            xml.extend(m.read_memory(at + xml.len() as u32, count).unwrap());
        }
        let xml = String::from_utf8(xml[..size as usize].to_vec()).unwrap();
        assert!(xml.starts_with("<?xml") && xml.ends_with("</RegisterDescription>\n"));
        assert_eq!(m.read_memory(at + size.next_multiple_of(4), 4), Err(Refusal::InvalidAddress));
    }

    #[test]
    fn geometry_is_locked_while_frames_flow() {
        let mut m = memory();
        let width = Register::Width.address();
        assert_eq!(m.write_register(width, 32, 0), Ok(Effect::None));
        m.streaming = true;
        assert_eq!(m.write_register(width, 64, 0), Err(Refusal::WriteProtect));
        assert_eq!(m.write_register(width, 32, 0), Ok(Effect::None), "the present value may be written");
        assert_eq!(m.write_register(Register::TriggerSoftware.address(), 1, 0), Ok(Effect::Trigger));
        assert_eq!(m.write_register(0x48, 1, 0), Err(Refusal::WriteProtect));
        assert_eq!(m.write_register(0x7000, 1, 0), Err(Refusal::InvalidAddress));
        assert_eq!(m.read_register(2), Err(Refusal::BadAlignment));
    }
}
