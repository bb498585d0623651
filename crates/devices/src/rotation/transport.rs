//! The two ways to a motor controller: a serial port, or a TCP connection to a program beside it.

use serialport::{SerialPort, TTYPort};
use std::io::{Read, Result, Write};
use std::net::TcpStream;
use std::time::Duration;

pub(super) enum Transport {
    Serial(TTYPort),
    Tcp(TcpStream),
}

impl Transport {
    /// A second hold on the same connection, for the one who stops.
    pub fn duplicate(&self) -> Result<Self> {
        Ok(match self {
            Self::Serial(port) => Self::Serial(port.try_clone_native()?),
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
        })
    }

    /// How long the next read may wait for its first byte.
    pub fn wait_at_most(&mut self, wait: Duration) -> Result<()> {
        match self {
            Self::Serial(port) => Ok(port.set_timeout(wait)?),
            // No wait at all cannot be asked of a socket.
            Self::Tcp(stream) => stream.set_read_timeout(Some(wait.max(Duration::from_millis(1)))),
        }
    }

    pub fn receive(&mut self, into: &mut [u8]) -> Result<usize> {
        match self {
            Self::Serial(port) => port.read(into),
            Self::Tcp(stream) => stream.read(into),
        }
    }

    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        match self {
            Self::Serial(port) => port.write_all(bytes),
            Self::Tcp(stream) => stream.write_all(bytes),
        }
    }
}
