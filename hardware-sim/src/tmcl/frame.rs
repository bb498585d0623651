//! Frames of nine bytes. Request: `ADR CMD TYPE MOTOR VALUE(4, big endian) SUM8`. Reply: `HOST ADR STATUS CMD VALUE(4) SUM8`.

pub(super) const BYTES: usize = 9;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Status {
    WrongChecksum = 1,
    InvalidCommand = 2,
    WrongType = 3,
    InvalidValue = 4,
    Ok = 100,
}

/// A received request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Request {
    pub address: u8,
    pub command: u8,
    pub kind: u8,
    pub motor: u8,
    pub value: i32,
    pub intact: bool,
}

impl Request {
    pub fn read(bytes: [u8; BYTES]) -> Self {
        let [address, command, kind, motor, a, b, c, d, sum] = bytes;
        let value = i32::from_be_bytes([a, b, c, d]);
        Self { address, command, kind, motor, value, intact: sum == sum8(&bytes[..BYTES - 1]) }
    }
}

pub(super) fn reply(host: u8, module: u8, status: Status, command: u8, value: i32) -> [u8; BYTES] {
    let [a, b, c, d] = value.to_be_bytes();
    let mut bytes = [host, module, status as u8, command, a, b, c, d, 0];
    bytes[BYTES - 1] = sum8(&bytes[..BYTES - 1]);
    bytes
}

fn sum8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, b| sum.wrapping_add(*b))
}
