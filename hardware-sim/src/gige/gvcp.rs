//! The packets of the control protocol.
//!
//! ```text
//!   command   42 | flags | command(2) | length(2) | id(2) | payload
//!   answer    status(2)  | command(2) | length(2) | id(2) | payload
//! ```

use super::bytes::{u16_at, u32_at};

const KEY: u8 = 0x42;
const ACKNOWLEDGE: u8 = 1;
pub(super) const HEADER: usize = 8;

/// Why a command is refused, with the status code of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum Refusal {
    NotImplemented = 0x8001,
    InvalidParameter = 0x8002,
    InvalidAddress = 0x8003,
    WriteProtect = 0x8004,
    BadAlignment = 0x8005,
    AccessDenied = 0x8006,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Command {
    Discovery,
    Resend { block: u16, first: u32, last: u32 },
    ReadRegisters(Vec<u32>),
    WriteRegisters(Vec<(u32, u32)>),
    ReadMemory { address: u32, count: u16 },
    WriteMemory { address: u32, data: Vec<u8> },
    Unknown(u16),
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Request {
    pub command: Command,
    pub code: u16,
    pub id: u16,
    pub wants_answer: bool,
}

impl Request {
    /// Reads a command. `None` if the packet is not a command of this protocol or is incomplete.
    pub fn parse(packet: &[u8]) -> Option<Self> {
        let [KEY, flags, ..] = packet else { return None };
        let (code, length, id) = (u16_at(packet, 2)?, u16_at(packet, 4)?, u16_at(packet, 6)?);
        let payload = packet.get(HEADER..HEADER + usize::from(length))?;
        let words: Vec<u32> = payload.chunks_exact(4).filter_map(|c| u32_at(c, 0)).collect();
        let command = match code {
            0x02 => Command::Discovery,
            0x40 => Command::Resend {
                block: u16_at(payload, 2)?,
                first: u32_at(payload, 4)? & 0x00ff_ffff,
                last: u32_at(payload, 8)? & 0x00ff_ffff,
            },
            0x80 => Command::ReadRegisters(words),
            0x82 => Command::WriteRegisters(words.chunks_exact(2).map(|w| (w[0], w[1])).collect()),
            0x84 => Command::ReadMemory { address: u32_at(payload, 0)?, count: u16_at(payload, 6)? },
            0x86 => Command::WriteMemory { address: u32_at(payload, 0)?, data: payload.get(4..)?.to_vec() },
            other => Command::Unknown(other),
        };
        Some(Self { command, code, id, wants_answer: flags & ACKNOWLEDGE != 0 })
    }

    /// The answer to this command. Its code is that of the command plus one.
    pub fn answer(&self, outcome: Result<&[u8], Refusal>) -> Vec<u8> {
        let (status, payload) = match outcome {
            Ok(payload) => (0, payload),
            Err(refusal) => (refusal as u16, &[][..]),
        };
        let mut packet = Vec::with_capacity(HEADER + payload.len());
        for word in [status, self.code | 1, payload.len() as u16, self.id] {
            packet.extend_from_slice(&word.to_be_bytes());
        }
        packet.extend_from_slice(payload);
        packet
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_register_read_and_its_answer() {
        let packet = [0x42, 1, 0, 0x80, 0, 4, 0x12, 0x34, 0, 0, 0x0a, 0];
        let request = Request::parse(&packet).unwrap();
        assert_eq!(request.command, Command::ReadRegisters(vec![0xa00]));
        assert!(request.wants_answer);
        assert_eq!(request.answer(Ok(&[0, 0, 0, 2])), [0, 0, 0, 0x81, 0, 4, 0x12, 0x34, 0, 0, 0, 2]);
        assert_eq!(request.answer(Err(Refusal::AccessDenied)), [0x80, 6, 0, 0x81, 0, 0, 0x12, 0x34]);
    }

    proptest! {
        #[test]
        fn no_packet_makes_it_panic(packet in proptest::collection::vec(any::<u8>(), 0..64), code in 0u8..0x90) {
            let _ = Request::parse(&packet);
            let mut likely = packet;
            if likely.len() >= 6 {
                likely[..4].copy_from_slice(&[0x42, 1, 0, code]);
                likely[4] = 0;
                likely[5] %= 64;
            }
            let _ = Request::parse(&likely);
        }
    }
}
