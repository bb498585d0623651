//! The socket of a stream, before the first packet comes.
//!
//! Aravis gives the socket its receive buffer only when the first packet of a frame is there. The first frame of each acquisition would
//! be received with the kernel's default, which holds a fraction of it. Aravis also takes packets of any sender. The socket belongs to this
//! process, so both are set here.

use aravis::GvDevice;
use gio::prelude::{Cast, InetAddressExt, InetSocketAddressExt};
use nix::fcntl::{FcntlArg, fcntl};
use socket2::{SockAddr, SockRef, Type};
use std::io::{Error, Result};
use std::net::{IpAddr, SocketAddr};
use std::os::fd::{BorrowedFd, FromRawFd, OwnedFd, RawFd};

/// Gives the stream's socket its receive buffer, and lets it receive from the camera alone.
///
/// # Errors
/// The socket was not found, or the kernel refuses.
pub(super) fn prepare(device: &GvDevice, port: u16, bytes: usize) -> Result<()> {
    let socket = of_stream(device, port)?;
    let socket = SockRef::from(&socket);
    socket.set_recv_buffer_size(bytes)?;
    // Port 0: a camera may send from any of its ports, and not every camera tells which.
    socket.connect(&SockAddr::from(SocketAddr::new(ip(device.device_address())?, 0)))
}

/// A duplicate of the socket on which the stream of a device is received.
pub(super) fn of_stream(device: &GvDevice, port: u16) -> Result<OwnedFd> {
    find(SocketAddr::new(ip(device.interface_address())?, port))
}

fn ip(address: Option<gio::SocketAddress>) -> Result<IpAddr> {
    let named = |what: Option<gio::SocketAddress>| {
        let address = what?.downcast::<gio::InetSocketAddress>().ok()?.address();
        address.to_str().parse::<IpAddr>().ok()
    };
    named(address).ok_or_else(|| Error::other("the addresses of the camera are not known"))
}

/// A duplicate of this process' datagram socket at an address.
fn find(here: SocketAddr) -> Result<OwnedFd> {
    for entry in std::fs::read_dir("/proc/self/fd")? {
        let Some(number) = entry?.file_name().to_str().and_then(|name| name.parse::<RawFd>().ok()) else { continue };
        let Some(copy) = duplicate(number) else { continue };
        let socket = SockRef::from(&copy);
        let is_here = socket.local_addr().is_ok_and(|address| address.as_socket() == Some(here));
        if is_here && socket.r#type().is_ok_and(|kind| kind == Type::DGRAM) {
            return Ok(copy);
        }
    }
    Err(Error::other(format!("this process has no socket at {here}")))
}

/// Another thread may close the descriptor meanwhile, so that only a duplicate can be examined. `None` if it is closed already.
#[allow(unsafe_code)]
fn duplicate(number: RawFd) -> Option<OwnedFd> {
    // SAFETY: the borrow ends with the system call, which refuses a number that is not open.
    let open = unsafe { BorrowedFd::borrow_raw(number) };
    let copy = fcntl(open, FcntlArg::F_DUPFD_CLOEXEC(0)).ok()?;
    // SAFETY: the call has just made this descriptor, and nothing else owns it.
    Some(unsafe { OwnedFd::from_raw_fd(copy) })
}
