//! The serial port of a controller: a pty. The host opens its slave end like `/dev/ttyUSB0`.
//!
//! ```text
//!   host ── /dev/pts/N ═ pty ═ master ── one thread: poll(master, opens and closes, waker) ── Firmware
//!                                    └── SerialFaults
//! ```
//! The thread itself keeps the slave open, so that a host may close it and open it again.

use super::faults::{Sent, SerialFaults};
use super::plug::{Plug, point};
use super::{Button, Firmware};
use crate::clock::RigClock;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time of the bootloader. A real board needs a second or two. This is long enough for a host that flushes its input after opening:
/// the greeting comes later.
const BOOT: Duration = Duration::from_millis(60);

enum Order {
    Reboot,
    Noise(Vec<u8>),
    Button(Button, bool),
    Unplug(mpsc::Sender<()>),
    Replug(mpsc::Sender<nix::Result<()>>),
    Quit,
}

/// The emulated controller on its port.
pub struct SerialPort {
    orders: mpsc::Sender<Order>,
    waker: UnixStream,
    path: Arc<Mutex<PathBuf>>,
    link: Option<PathBuf>,
    faults: Arc<SerialFaults>,
    thread: Option<JoinHandle<()>>,
}

impl SerialPort {
    /// Plugs the controller in. `link`, if given, points to the present device name while the cable is plugged in. `firmware` gets the
    /// faults that act inside the controller.
    pub fn start(
        clock: RigClock,
        firmware: impl FnOnce(Arc<SerialFaults>) -> Box<dyn Firmware>,
        link: Option<PathBuf>,
    ) -> std::io::Result<Self> {
        let faults = Arc::new(SerialFaults::default());
        let plug = Plug::open()?;
        if let Some(link) = &link {
            point(link, &plug.path)?;
        }
        let path = Arc::new(Mutex::new(plug.path.clone()));
        let (waker, wake) = UnixStream::pair()?;
        wake.set_nonblocking(true)?;
        let (orders, inbox) = mpsc::channel();
        let worker = Worker {
            clock,
            firmware: firmware(Arc::clone(&faults)),
            faults: Arc::clone(&faults),
            plug: Some(plug),
            path: Arc::clone(&path),
            link: link.clone(),
            inbox,
            wake,
            boot_at: Some(Instant::now()),
            outgoing: VecDeque::new(),
        };
        let thread = std::thread::Builder::new().name("sim-serial".into()).spawn(move || worker.run())?;
        Ok(Self { orders, waker, path, link, faults, thread: Some(thread) })
    }

    /// The path that a host opens: the link if there is one, otherwise the device name. A replug changes the device name.
    pub fn path(&self) -> PathBuf {
        self.link.clone().unwrap_or_else(|| self.path.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    pub fn faults(&self) -> &SerialFaults {
        &self.faults
    }

    /// Restarts the controller, also during a move. Its greeting does not mention it.
    pub fn reboot(&self) {
        self.order(Order::Reboot);
    }

    /// The controller now receives bytes that no host has sent.
    pub fn noise(&self, bytes: &[u8]) {
        self.order(Order::Noise(bytes.to_vec()));
    }

    /// Presses or releases a button at the controller.
    pub fn button(&self, button: Button, pressed: bool) {
        self.order(Order::Button(button, pressed));
    }

    /// Unplugs the cable. When this returns, the port does not exist any more, and the controller has no power.
    pub fn unplug(&self) {
        let (done, wait) = mpsc::channel();
        self.order(Order::Unplug(done));
        // An error means that the thread has ended. Then the port does not exist either.
        let _ = wait.recv();
    }

    /// Plugs the cable in again. The port gets a device name that is free.
    pub fn replug(&self) -> std::io::Result<()> {
        let (done, wait) = mpsc::channel();
        self.order(Order::Replug(done));
        Ok(wait.recv().map_err(|_| Errno::EIO)??)
    }

    fn order(&self, order: Order) {
        let _ = self.orders.send(order);
        let _ = (&self.waker).write_all(&[0]);
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        self.order(Order::Quit);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
    }
}

struct Worker {
    clock: RigClock,
    firmware: Box<dyn Firmware>,
    faults: Arc<SerialFaults>,
    plug: Option<Plug>,
    path: Arc<Mutex<PathBuf>>,
    link: Option<PathBuf>,
    inbox: mpsc::Receiver<Order>,
    wake: UnixStream,
    /// When the boot ends. `None` while the controller runs or has no power.
    boot_at: Option<Instant>,
    outgoing: VecDeque<(Instant, Vec<u8>)>,
}

impl Worker {
    fn run(mut self) {
        loop {
            if let Err(error) = self.wait() {
                tracing::error!(%error, "the emulated serial port stops");
                return;
            }
            while let Ok(order) = self.inbox.try_recv() {
                if matches!(order, Order::Quit) {
                    return;
                }
                self.obey(order);
            }
            if self.plug.as_mut().is_some_and(Plug::visitors) && self.firmware.restarts_when_opened() {
                self.restart();
            }
            if self.boot_at.is_some_and(|at| at <= Instant::now()) {
                // Bytes that arrive during the boot are lost.
                let _lost = self.read();
                self.boot_at = None;
                self.firmware.boot();
            }
            let (bytes, unplug) = self.read();
            if self.boot_at.is_none() && self.plug.is_some() {
                let now_s = self.clock.now_s();
                self.firmware.advance(now_s);
                self.firmware.receive(&bytes, now_s);
            }
            self.write();
            if unplug {
                self.pull();
            }
        }
    }

    /// Sleeps until the next byte, order, open, close or event of the firmware.
    fn wait(&mut self) -> nix::Result<()> {
        let motion = self.firmware.next_event_s().map(|at| self.clock.real(at - self.clock.now_s()));
        let now = Instant::now();
        let due = [self.boot_at, self.outgoing.front().map(|(due, _)| *due)].into_iter().flatten();
        let timeout = due.map(|at| at.saturating_duration_since(now)).chain(motion).min().map(TimeSpec::from_duration);
        let mut fds = vec![PollFd::new(self.wake.as_fd(), PollFlags::POLLIN)];
        if let Some(plug) = &self.plug {
            fds.push(PollFd::new(plug.master.as_fd(), PollFlags::POLLIN));
            fds.push(PollFd::new(plug.watch.as_fd(), PollFlags::POLLIN));
        }
        match ppoll(&mut fds, timeout, None) {
            Ok(_) | Err(Errno::EINTR) => {}
            Err(error) => return Err(error),
        }
        // A byte of the waker only means that there is an order.
        let mut sink = [0; 64];
        while matches!((&self.wake).read(&mut sink), Ok(n) if n > 0) {}
        Ok(())
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::Reboot => self.restart(),
            Order::Noise(bytes) => {
                let now_s = self.clock.now_s();
                self.firmware.advance(now_s);
                self.firmware.receive(&bytes, now_s);
            }
            Order::Button(button, pressed) => {
                let now_s = self.clock.now_s();
                self.firmware.advance(now_s);
                self.firmware.button(button, pressed, now_s);
            }
            Order::Unplug(done) => {
                self.pull();
                let _ = done.send(());
            }
            Order::Replug(done) => {
                let _ = done.send(self.replug());
            }
            Order::Quit => {}
        }
    }

    fn replug(&mut self) -> nix::Result<()> {
        let plug = Plug::open()?;
        if let Some(link) = &self.link {
            point(link, &plug.path).map_err(|e| Errno::from_raw(e.raw_os_error().unwrap_or(nix::libc::EIO)))?;
        }
        plug.path.clone_into(&mut self.path.lock().unwrap_or_else(PoisonError::into_inner));
        self.plug = Some(plug);
        self.restart();
        Ok(())
    }

    fn restart(&mut self) {
        self.firmware.lose_power(self.clock.now_s());
        self.firmware.take_output();
        self.outgoing.clear();
        self.boot_at = Some(Instant::now() + BOOT);
    }

    /// Bytes from the host, and whether the cable is unplugged after them.
    fn read(&mut self) -> (Vec<u8>, bool) {
        let mut bytes = Vec::new();
        let Some(plug) = &mut self.plug else { return (bytes, false) };
        let mut chunk = [0; 4096];
        while let Ok(n @ 1..) = plug.master.read(&mut chunk) {
            bytes.extend_from_slice(&chunk[..n]);
        }
        self.faults.received(bytes)
    }

    fn write(&mut self) {
        let Sent { pieces, unplug } = self.faults.sent(self.firmware.take_output());
        if !pieces.is_empty() {
            let due = Instant::now() + self.faults.take_delay();
            self.outgoing.extend(pieces.into_iter().map(|piece| (due, piece)));
        }
        let now = Instant::now();
        while self.outgoing.front().is_some_and(|(due, _)| *due <= now) {
            let Some((_, bytes)) = self.outgoing.pop_front() else { break };
            // A real port without a host keeps no bytes for later.
            if let Some(plug) = self.plug.as_mut().filter(|plug| plug.has_host) {
                // If the host does not read, bytes are lost, as with a UART.
                let _ = plug.master.write(&bytes);
            }
        }
        if unplug {
            self.pull();
        }
    }

    fn pull(&mut self) {
        self.firmware.lose_power(self.clock.now_s());
        self.outgoing.clear();
        // As udev does. The device name is free from now on, and the next pty of this computer gets it.
        if let Some(link) = &self.link {
            let _ = std::fs::remove_file(link);
        }
        self.plug = None;
        self.boot_at = None;
    }
}
