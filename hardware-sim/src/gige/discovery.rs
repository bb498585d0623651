//! Answers to broadcasts of hosts that search for cameras. The address of the camera itself receives no broadcasts.
//!
//! All emulated cameras of this computer share the broadcast address, and the kernel gives each of them every broadcast.

use super::PORT;
use super::faults::CameraFaults;
use super::gvcp::{Command, Request};
use super::memory::Memory;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often the thread checks whether it must end.
const LOOK: Duration = Duration::from_millis(100);

pub(super) struct Discovery {
    broadcasts: UdpSocket,
    /// Answers are sent from the address of the camera.
    pub socket: UdpSocket,
    pub memory: Arc<Mutex<Memory>>,
    pub faults: Arc<CameraFaults>,
    pub quit: Arc<AtomicBool>,
}

impl Discovery {
    pub fn listen(
        socket: UdpSocket,
        memory: Arc<Mutex<Memory>>,
        faults: Arc<CameraFaults>,
        quit: Arc<AtomicBool>,
    ) -> std::io::Result<Self> {
        let broadcasts = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None)?;
        broadcasts.set_reuse_address(true)?;
        broadcasts.bind(&SocketAddrV4::new(Ipv4Addr::BROADCAST, PORT).into())?;
        broadcasts.set_read_timeout(Some(LOOK))?;
        Ok(Self { broadcasts: broadcasts.into(), socket, memory, faults, quit })
    }

    pub fn run(self) {
        let mut packet = [0; 64];
        while !self.quit.load(Ordering::SeqCst) {
            if let Ok((length, from)) = self.broadcasts.recv_from(&mut packet)
                && let Some(request) = Request::parse(&packet[..length])
                && matches!(request.command, Command::Discovery)
                && !(self.faults.is_mute() || self.faults.is_unplugged())
            {
                let memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
                let _ = self.socket.send_to(&request.answer(Ok(memory.discovery())), from);
            }
        }
    }
}
