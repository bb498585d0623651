//! A GigE Vision camera on loopback: discovery, control, stream and packet resend with the real protocol.
//!
//! ```text
//!   host ── broadcast ── discovery thread ── identity
//!   host ── UDP 3956 ── control thread ── memory (registers, GenICam description)
//!                           │ start, stop, trigger
//!   host ◄── stream ──── sensor thread ── Sight (the image at the true angle of the shaft)
//! ```

mod bytes;
mod control;
mod discovery;
mod faults;
mod features;
mod gvcp;
mod gvsp;
mod memory;
mod sensor;

pub use faults::CameraFaults;

use crate::clock::RigClock;
use crate::shaft::Shaft;
use crate::sight::{PixelFormat, Sight};
use crate::truth::Truth;
use control::Control;
use discovery::Discovery;
use memory::{Identity, Memory};
use sensor::{Order, Sensor, State, Stream};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;

/// Vendor name of the camera.
pub const VENDOR: &str = "carved";
/// Model name of the camera.
pub const MODEL: &str = "Emulated GE1050C";
/// The UDP port of GigE Vision devices.
const PORT: u16 = 3956;

/// The emulated camera at its address.
pub struct GigeCamera {
    address: Ipv4Addr,
    serial: String,
    faults: Arc<CameraFaults>,
    truth: Arc<Truth>,
    memory: Arc<Mutex<Memory>>,
    stream: Arc<Stream>,
    quit: Arc<AtomicBool>,
    orders: mpsc::Sender<Order>,
    threads: Vec<JoinHandle<()>>,
}

impl GigeCamera {
    /// Starts a camera at `address`. It sends the given format until a host chooses another one. Frames have the brightness of the
    /// image source at the nominal exposure time, us. If this is `None`, the exposure time does not change the brightness.
    ///
    /// # Errors
    /// Another camera listens at the address, or a socket or thread cannot be made.
    pub fn start(
        address: Ipv4Addr,
        (format, nominal_exposure_us, sight): (PixelFormat, Option<f32>, Arc<dyn Sight>),
        clock: RigClock,
        shaft: Arc<Shaft>,
    ) -> std::io::Result<Self> {
        let socket = UdpSocket::bind(SocketAddrV4::new(address, PORT))?;
        let stream_socket = socket2::Socket::from(UdpSocket::bind(SocketAddrV4::new(address, 0))?);
        // The buffer holds a frame, so that the sender sets the pace. A smaller buffer is no error.
        let _ = stream_socket.set_send_buffer_size(4 << 20);
        let stream_socket: UdpSocket = stream_socket.into();
        let [_, b, c, d] = address.octets();
        let serial = format!("E1050C-{b:02x}{c:02x}{d:02x}");
        let stream_port = stream_socket.local_addr()?.port();
        let identity = Identity { vendor: VENDOR, model: MODEL, serial: serial.clone(), address, stream_port };
        let memory = Arc::new(Mutex::new(Memory::new(&identity, sight.size(), format)));
        let stream = Arc::new(Stream::new(stream_socket));
        let faults = Arc::new(CameraFaults::new(clock));
        let truth = Arc::new(Truth::default());
        let quit = Arc::new(AtomicBool::new(false));
        let (orders, inbox) = mpsc::channel();
        let sensor = Sensor {
            clock,
            shaft,
            sight,
            nominal_exposure_us,
            memory: Arc::clone(&memory),
            stream: Arc::clone(&stream),
            faults: Arc::clone(&faults),
            truth: Arc::clone(&truth),
            orders: inbox,
            state: State::default(),
        };
        // Without discovery a host still finds the camera by its address.
        let discovery = Discovery::listen(socket.try_clone()?, Arc::clone(&memory), Arc::clone(&faults), Arc::clone(&quit)).ok();
        let (registers, sender) = (Arc::clone(&memory), Arc::clone(&stream));
        let control = Control::new(socket, clock, registers, sender, Arc::clone(&faults), orders.clone(), Arc::clone(&quit));
        let mut camera = Self { address, serial, faults, truth, memory, stream, quit, orders, threads: Vec::new() };
        let spawn = |name: &str, run: Box<dyn FnOnce() + Send>| std::thread::Builder::new().name(name.into()).spawn(run);
        camera.threads.push(spawn("sim-sensor", Box::new(move || sensor.run()))?);
        camera.threads.push(spawn("sim-gvcp", Box::new(move || control.run()))?);
        if let Some(discovery) = discovery {
            camera.threads.push(spawn("sim-discovery", Box::new(move || discovery.run()))?);
        }
        Ok(camera)
    }

    pub fn address(&self) -> Ipv4Addr {
        self.address
    }

    pub fn serial(&self) -> &str {
        &self.serial
    }

    pub fn faults(&self) -> &CameraFaults {
        &self.faults
    }

    /// Sets a feature as another program, a knob or the camera itself does. Returns whether the camera has it and takes the value.
    pub fn leave(&self, feature: &str, raw: u32) -> bool {
        let Some(register) = features::Register::named(feature) else { return false };
        self.memory.lock().unwrap_or_else(PoisonError::into_inner).values.write(register, raw)
    }

    /// The register of a feature. `None` if the camera does not have it.
    pub fn feature(&self, name: &str) -> Option<u32> {
        let memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        features::Register::named(name).map(|register| memory.values.read(register))
    }

    /// Puts another camera of the same model, with this serial number, in the place of this one.
    pub fn exchange(&self, serial: &str) {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner).exchange(serial);
        self.faults.restart();
    }

    /// Sends a pulse on the trigger line. It is lost if the camera does not wait for one.
    pub fn pulse_line(&self) {
        let waits = self.memory.lock().unwrap_or_else(PoisonError::into_inner).values.waits_for_line();
        if waits && !self.stream.exposing.swap(true, Ordering::SeqCst) {
            let _ = self.orders.send(Order::Trigger);
        }
    }

    pub(crate) fn truth(&self) -> &Truth {
        &self.truth
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::SeqCst);
        let _ = self.orders.send(Order::Quit);
        // A datagram wakes the control thread.
        if let Ok(socket) = UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)) {
            let _ = socket.send_to(&[], SocketAddrV4::new(self.address, PORT));
        }
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
