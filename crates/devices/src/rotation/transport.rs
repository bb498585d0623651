//! The byte transport to a motor controller: a serial port, or a TCP connection to a program that drives it.

use nix::errno::Errno;
use nix::sys::socket::{MsgFlags, recv};
use serialport::{SerialPort, TTYPort};
use std::io::{Read, Result, Write};
use std::net::TcpStream;
use std::os::fd::AsRawFd;
use std::time::Duration;

/// An open connection.
pub(super) enum Transport {
    Serial(TTYPort),
    Tcp(TcpStream),
}

impl Transport {
    /// A second handle of the same connection, for the stop.
    pub fn duplicate(&self) -> Result<Self> {
        Ok(match self {
            Self::Serial(port) => Self::Serial(port.try_clone_native()?),
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
        })
    }

    /// Sets how long the next read may wait for its first byte.
    pub fn wait_at_most(&mut self, wait: Duration) -> Result<()> {
        match self {
            Self::Serial(port) => Ok(port.set_timeout(wait)?),
            // A socket does not accept a timeout of 0.
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

    /// Whether the kernel knows that the other end has hung up. Nothing is sent or read.
    pub fn is_hung_up(&self) -> bool {
        match self {
            // The kernel answers nothing about a tty that was hung up.
            Self::Serial(port) => port.bytes_to_read().is_err(),
            Self::Tcp(stream) => match recv(stream.as_raw_fd(), &mut [0], MsgFlags::MSG_PEEK | MsgFlags::MSG_DONTWAIT) {
                Ok(waiting) => waiting == 0,
                Err(why) => !matches!(why, Errno::EAGAIN | Errno::EINTR),
            },
        }
    }
}
