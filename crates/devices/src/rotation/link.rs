//! One connection to a controller, with its received bytes and its stop.
//!
//! ```text
//! rig worker ── send / line / exact ──► reader ◄── transport (tty, TCP)
//!                  │
//!                  ▼
//!           transmitter (mutex: transport, latch) ──► transport
//!                  ▲
//! any thread ── Stopper
//! ```
//! The only owner of a port is the rig worker, which blocks anyway. There is no thread per port. Reading needs no lock. Every write
//! takes the transmitter's lock for one request, which the kernel's buffer of 4096 bytes takes at once. So a stop is on the wire at
//! once, even while the owner waits for an answer. Latch and bytes change under the same lock: either a command precedes the stop on
//! the wire, and the stop ends it, or the command finds the latch and is never sent. A stop of several pieces keeps the lock until
//! the last piece, so that nothing comes between them.
//!
//! A serial port is opened exclusively. Dropping the owner closes the connection, also if stop handles still exist.

use super::port::Port;
use super::transport::Transport;
use crate::DeviceError;
use crate::cancel::CancelToken;
use serialport::SerialPort;
use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often a wait checks the latch. Received bytes wake it at once.
const LATCH_LOOK: Duration = Duration::from_millis(50);
/// A wait that lasts longer than it should by more than this shows that the computer did not run this thread.
const LATE_WAKE: Duration = Duration::from_millis(20);
/// Longest wait until the kernel takes a few bytes. It takes them at once unless the device is dead.
const WRITE_TIMEOUT: Duration = Duration::from_millis(200);
/// Longest wait until the other computer accepts a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// No controller sends longer lines. More bytes without a line end are noise.
const LONGEST_LINE: usize = 512;

/// As many bytes of a line that cannot be read as an error shows.
const FIRST_BYTES: usize = 24;

/// The owner's side of a connection.
pub(super) struct Link {
    device: &'static str,
    reader: Transport,
    /// Name of the port, or address of the program.
    address: String,
    /// The first bytes that came since the connection was opened.
    first: Vec<u8>,
    /// Received bytes that were not read yet.
    pending: Vec<u8>,
    /// Requests pass a latched stop.
    passes_latch: bool,
    transmitter: Arc<Transmitter>,
}

/// The sending side, which the owner and its stop handles share.
struct Transmitter {
    device: &'static str,
    stop: Stop,
    state: Mutex<State>,
}

struct State {
    /// `None` after the owner has closed the connection.
    transport: Option<Transport>,
    /// A stop was requested and not released.
    latched: bool,
    /// The owner has started a motion and has not seen its end.
    moving: bool,
    /// Stops that were written since the owner asked.
    stops: u32,
}

/// The bytes that stop the motor in a protocol; none if nothing stops it.
#[derive(Debug, Clone, Default)]
pub(super) struct Stop {
    /// Written in this order.
    pub pieces: Vec<Vec<u8>>,
    /// Pause between two pieces. On a half-duplex wire the answer to one piece would collide with the next piece.
    pub gap: Duration,
}

impl Stop {
    /// A stop of one piece.
    pub fn of(bytes: &[u8]) -> Self {
        Self { pieces: vec![bytes.to_vec()], gap: Duration::ZERO }
    }
}

/// Stops the motor from any thread, and keeps it stopped until the owner releases the latch.
#[derive(Clone)]
pub(super) struct Stopper(Arc<Transmitter>);

impl Stopper {
    /// Latches, and writes the stop.
    pub fn stop(&self) {
        self.latch(true);
    }

    /// Tells whether the other end has hung up, or the owner has closed the connection.
    pub fn link(&self) -> crate::Link {
        let transmitter = Arc::clone(&self.0);
        crate::Link::new(move || transmitter.lock().transport.as_ref().is_none_or(Transport::is_hung_up))
    }

    /// Latches, and writes the stop only if the owner has a motion under way.
    pub fn end_motion(&self) {
        self.latch(false);
    }

    fn latch(&self, at_rest_too: bool) {
        let mut state = self.0.lock();
        state.latched = true;
        if !state.moving && !at_rest_too {
            return;
        }
        if let Err(e) = self.0.write_stop(&mut state) {
            tracing::error!(device = self.0.device, error = %e, "stop could not be sent");
        }
    }
}

impl Transmitter {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, state: &mut State, bytes: &[u8]) -> Result<(), DeviceError> {
        tracing::trace!(device = self.device, "> {}", bytes.escape_ascii());
        let gone = |why| DeviceError::Gone { device: self.device, why };
        let transport = state.transport.as_mut().ok_or_else(|| gone("the connection has been closed".into()))?;
        transport.send(bytes).map_err(|e| gone(e.to_string()))
    }

    fn write_stop(&self, state: &mut State) -> Result<(), DeviceError> {
        for (i, piece) in self.stop.pieces.iter().enumerate() {
            if i > 0 {
                std::thread::sleep(self.stop.gap);
            }
            self.write(state, piece)?;
        }
        state.stops = state.stops.saturating_add(1);
        Ok(())
    }
}

/// A line without its end. Noise, as the bytes of a boot loader, is escaped: it matches no answer and can be shown and stored.
fn printable(line: &[u8]) -> String {
    let end = line.iter().rposition(|byte| !matches!(byte, b'\r' | b'\n')).map_or(0, |last| last + 1);
    let line = &line[..end];
    match std::str::from_utf8(line) {
        Ok(text) if !text.chars().any(|c| c.is_control() && c != '\t') => text.to_owned(),
        _ => line.escape_ascii().to_string(),
    }
}

/// Other programs that have a device file open, as far as this process may see them. `None` if there is none.
fn users_of(path: &str) -> Option<String> {
    let device = std::fs::canonicalize(path).ok()?;
    let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_open_in = |process: &Path| entries(&process.join("fd")).any(|fd| std::fs::read_link(fd).is_ok_and(|file| file == device));
    let number = |process: &Path| process.file_name()?.to_str()?.parse::<u32>().ok();
    let others = entries(Path::new("/proc")).filter_map(|process| Some((number(&process)?, process)));
    let users: Vec<String> = others
        .filter(|(number, process)| *number != std::process::id() && is_open_in(process))
        .map(|(number, process)| {
            let name = std::fs::read_to_string(process.join("comm")).unwrap_or_default();
            format!("{} (process {number})", name.trim())
        })
        .collect();
    (!users.is_empty()).then(|| users.join(", "))
}

impl Link {
    /// Opens a serial port, exclusively.
    pub fn serial(device: &'static str, port: &Port, baud: u32, stop: Stop) -> Result<Self, DeviceError> {
        let path = &port.resolve(device)?;
        let refused = |e: &serialport::Error| {
            let why = users_of(path).map_or_else(|| e.to_string(), |users| format!("{e}; {users} has it open"));
            let remedy = match e.kind() {
                serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => "Add the daemon's user to the group dialout",
                serialport::ErrorKind::NoDevice => "Close the other program that has the port open",
                _ => "Check the cable and the name of the port in the configuration",
            };
            DeviceError::Open { device, address: path.clone(), why, remedy }
        };
        let mut port = serialport::new(path, baud).exclusive(true).timeout(WRITE_TIMEOUT).open_native().map_err(|e| refused(&e))?;
        // A pty has no modem lines. On an Arduino this line may restart the controller, and the handshake waits for that.
        if let Err(e) = port.write_data_terminal_ready(true) {
            tracing::debug!(device, error = %e, "the port has no DTR line");
        }
        Self::through(device, path, Transport::Serial(port), stop)
    }

    /// Connects to a program that drives the controller, at `host:port`.
    pub fn tcp(device: &'static str, address: &str, stop: Stop) -> Result<Self, DeviceError> {
        let refused = |e: std::io::Error| DeviceError::Open {
            device,
            address: address.into(),
            why: e.to_string(),
            remedy: "Check that the program is started on that computer, the address in the configuration and the firewall",
        };
        let mut last = std::io::Error::new(ErrorKind::NotFound, "the name has no address");
        for candidate in address.to_socket_addrs().map_err(refused)? {
            match TcpStream::connect_timeout(&candidate, CONNECT_TIMEOUT) {
                Ok(stream) => {
                    // Requests have a few bytes each, and their answers are waited for.
                    stream.set_nodelay(true).map_err(refused)?;
                    stream.set_write_timeout(Some(WRITE_TIMEOUT)).map_err(refused)?;
                    return Self::through(device, address, Transport::Tcp(stream), stop);
                }
                Err(e) => last = e,
            }
        }
        Err(refused(last))
    }

    fn through(device: &'static str, address: &str, reader: Transport, stop: Stop) -> Result<Self, DeviceError> {
        let twin = reader.duplicate().map_err(|e| DeviceError::Open {
            device,
            address: address.into(),
            why: e.to_string(),
            remedy: "Close other programs: this computer has no file handles left",
        })?;
        let state = Mutex::new(State { transport: Some(twin), latched: false, moving: false, stops: 0 });
        let transmitter = Transmitter { device, stop, state };
        let (address, transmitter) = (address.to_owned(), Arc::new(transmitter));
        Ok(Self { device, reader, address, first: Vec::new(), pending: Vec::new(), passes_latch: false, transmitter })
    }

    /// The error of a first question that failed. Silence is only silence if nothing came, and if nobody else has the port.
    pub fn first_contact(&self, error: DeviceError) -> DeviceError {
        let DeviceError::Silent { device, request, .. } = &error else { return error };
        let has_other = users_of(&self.address).is_some();
        let found = match self.first.is_empty() {
            true if !has_other => return error,
            true => "nothing came".to_owned(),
            false => format!("the first bytes were {}", self.first.escape_ascii()),
        };
        let same_rate = || "Set the baud rate in the configuration to that of the controller".to_owned();
        let remedy = if has_other { self.exit_the_other() } else { same_rate() };
        DeviceError::Unreadable { device, request: request.clone(), found, remedy }
    }

    /// The error of a request without an answer. Another program that has the port open may have taken the answer.
    pub fn silent(&self, request: impl Into<String>, waited_ms: u128) -> DeviceError {
        // Programs of other users are hidden from the service.
        let remedy = match users_of(&self.address) {
            Some(_) => self.exit_the_other(),
            None => "Check power and cable, exit any other program that uses the port".to_owned(),
        };
        DeviceError::Silent { device: self.device, request: request.into(), waited_ms, remedy }
    }

    /// The error of answers that do not fit the request. They may be what another program that has the port open left of them.
    pub fn garbled(&self, request: impl Into<String>, expected: String, found: String) -> DeviceError {
        let device = self.device;
        if users_of(&self.address).is_none() {
            return DeviceError::Unexpected { device, expected, found };
        }
        DeviceError::Unreadable { device, request: request.into(), found, remedy: self.exit_the_other() }
    }

    /// What to do if another program may take a part of the answers.
    pub fn exit_the_other(&self) -> String {
        match users_of(&self.address) {
            Some(users) => format!("Exit the other program that has the port open: {users}"),
            None => "Exit any other program that uses the port".to_owned(),
        }
    }

    pub fn stopper(&self) -> Stopper {
        Stopper(Arc::clone(&self.transmitter))
    }

    /// Sends bytes, unless the stop is latched.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), DeviceError> {
        let mut state = self.transmitter.lock();
        if state.latched && !self.passes_latch {
            return Err(DeviceError::Stopped);
        }
        self.transmitter.write(&mut state, bytes)
    }

    /// Lets requests pass a latched stop, or not. Only for requests that move nothing: a light is switched off after a stop too.
    pub fn pass_latch(&mut self, passes: bool) {
        self.passes_latch = passes;
    }

    /// Whether a stop is latched that ends requests.
    fn is_ended(&self) -> bool {
        self.is_stopped() && !self.passes_latch
    }

    /// Writes the stop without latching.
    pub fn write_stop(&mut self) -> Result<(), DeviceError> {
        let mut state = self.transmitter.lock();
        self.transmitter.write_stop(&mut state)
    }

    /// Number of stops that were written since the last call, by the owner or by a handle.
    pub fn take_stops(&mut self) -> u32 {
        std::mem::take(&mut self.transmitter.lock().stops)
    }

    /// Stops the motor without latching, as the owner's reaction to a fault.
    pub fn halt(&mut self) {
        if let Err(e) = self.write_stop() {
            tracing::warn!(device = self.device, error = %e, "halt could not be sent");
        }
    }

    /// Releases a latched stop, unless `cancel` is cancelled. A caller that stops for good cancels first. So under the lock either the
    /// cancellation precedes the release, or the stop follows it and latches again.
    pub fn release(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        let mut transmitter = self.transmitter.lock();
        if cancel.is_cancelled() {
            return Err(DeviceError::Stopped);
        }
        transmitter.latched = false;
        Ok(())
    }

    /// Records whether the owner has started a motion and has not seen its end.
    pub fn set_moving(&mut self, moving: bool) {
        self.transmitter.lock().moving = moving;
    }

    pub fn is_moving(&self) -> bool {
        self.transmitter.lock().moving
    }

    /// The next line without its line end; `None` if none came until `until`. A latched stop ends the wait with an error.
    pub fn line(&mut self, until: Instant) -> Result<Option<String>, DeviceError> {
        self.await_some(until, Self::take_line)
    }

    /// The next `N` bytes; `None` if fewer came until `until`. Those stay for the next call. A latched stop ends the wait with an error.
    pub fn exact<const N: usize>(&mut self, until: Instant) -> Result<Option<[u8; N]>, DeviceError> {
        self.await_some(until, |link| {
            let bytes = *link.pending.first_chunk()?;
            link.pending.drain(..N);
            tracing::trace!(device = link.device, "< {}", bytes.escape_ascii());
            Some(bytes)
        })
    }

    /// The next `count` bytes, as [`Self::exact`].
    pub fn bytes(&mut self, count: usize, until: Instant) -> Result<Option<Vec<u8>>, DeviceError> {
        self.await_some(until, |link| {
            let bytes: Vec<u8> = (link.pending.len() >= count).then(|| link.pending.drain(..count).collect())?;
            tracing::trace!(device = link.device, "< {}", bytes.escape_ascii());
            Some(bytes)
        })
    }

    /// Whether a stop is latched.
    pub fn is_stopped(&self) -> bool {
        self.transmitter.lock().latched
    }

    /// Whether there are no unread bytes.
    pub fn is_silent(&mut self) -> Result<bool, DeviceError> {
        self.receive(Duration::ZERO)?;
        Ok(self.pending.is_empty())
    }

    /// Replaces the connection. Stop handles and a latched stop stay valid.
    pub fn go_on_through(&mut self, mut fresh: Self) {
        std::mem::swap(&mut self.reader, &mut fresh.reader);
        self.pending.clear();
        self.transmitter.lock().transport = fresh.transmitter.lock().transport.take();
    }

    /// Waits for bytes until `take` returns something; `None` if it returned nothing until `until`.
    fn await_some<T>(&mut self, mut until: Instant, mut take: impl FnMut(&mut Self) -> Option<T>) -> Result<Option<T>, DeviceError> {
        loop {
            // Checked first: an answer that comes after a stop is of no use to the request that the stop has ended.
            if self.is_ended() {
                return Err(DeviceError::Stopped);
            }
            if let Some(taken) = take(self) {
                return Ok(Some(taken));
            }
            if self.receive_until(&mut until)? {
                return Ok(take(self));
            }
        }
    }

    /// Waits for bytes until `until`, or for [`LATCH_LOOK`] if that is shorter, and keeps them. Returns whether the time is over; bytes
    /// that had arrived by then are kept too. Time in which the computer did not run this thread does not count, so `until` moves: a
    /// controller that is emulated or on the same computer did not run either.
    fn receive_until(&mut self, until: &mut Instant) -> Result<bool, DeviceError> {
        let begun = Instant::now();
        let wait = until.saturating_duration_since(begun).min(LATCH_LOOK);
        self.receive(wait)?;
        *until += begun.elapsed().saturating_sub(wait + LATE_WAKE);
        Ok(wait.is_zero())
    }

    /// A line that has already arrived; `None` without one. Does not wait.
    pub fn line_now(&mut self) -> Result<Option<String>, DeviceError> {
        if self.is_ended() {
            return Err(DeviceError::Stopped);
        }
        self.receive(Duration::ZERO)?;
        Ok(self.take_line())
    }

    /// Checks by the kernel that the connection stands. Nothing is sent, and received bytes are kept.
    pub fn still_there(&mut self) -> Result<(), DeviceError> {
        self.receive(Duration::ZERO).map(|_came| ())
    }

    /// Sends a question also while the stop is latched, so `question` must not move anything. Returns the lines that came; none without
    /// an answer.
    pub fn probe(&mut self, question: &[u8], wait: Duration) -> Result<Vec<String>, DeviceError> {
        {
            let mut state = self.transmitter.lock();
            self.transmitter.write(&mut state, question)?;
        }
        let mut until = Instant::now() + wait;
        loop {
            let over = self.receive_until(&mut until)?;
            let lines: Vec<String> = std::iter::from_fn(|| self.take_line()).collect();
            if over || !lines.is_empty() {
                return Ok(lines);
            }
        }
    }

    /// Like [`Self::probe`], for answers that are not lines. Returns the bytes that came; none without an answer.
    pub fn probe_bytes(&mut self, question: &[u8], wait: Duration) -> Result<Vec<u8>, DeviceError> {
        self.take_unread()?;
        {
            let mut state = self.transmitter.lock();
            self.transmitter.write(&mut state, question)?;
        }
        let mut until = Instant::now() + wait;
        while !self.receive_until(&mut until)? && self.pending.is_empty() {}
        Ok(std::mem::take(&mut self.pending))
    }

    /// Removes and returns all unread bytes.
    pub fn take_unread(&mut self) -> Result<Vec<u8>, DeviceError> {
        self.receive(Duration::ZERO)?;
        if !self.pending.is_empty() {
            tracing::trace!(device = self.device, "< (unasked) {}", self.pending.escape_ascii());
        }
        Ok(std::mem::take(&mut self.pending))
    }

    /// Drops everything that arrives until the line has been silent for `silence`, at most until `until`.
    pub fn quiet(&mut self, silence: Duration, until: Instant) -> Result<(), DeviceError> {
        while Instant::now() < until && self.receive(silence)? {
            tracing::trace!(device = self.device, "< (dropped) {}", self.pending.escape_ascii());
            self.pending.clear();
        }
        self.pending.clear();
        Ok(())
    }

    fn take_line(&mut self) -> Option<String> {
        let end = self.pending.iter().position(|b| *b == b'\n')?;
        let line: Vec<u8> = self.pending.drain(..=end).collect();
        tracing::trace!(device = self.device, "< {}", line.escape_ascii());
        Some(printable(&line))
    }

    /// Waits at most `wait` for bytes and keeps them. False if none came.
    fn receive(&mut self, wait: Duration) -> Result<bool, DeviceError> {
        let gone = |device, why| Err(DeviceError::Gone { device, why });
        let mut bytes = [0; LONGEST_LINE];
        if let Err(e) = self.reader.wait_at_most(wait) {
            return gone(self.device, e.to_string());
        }
        match self.reader.receive(&mut bytes) {
            // A hung-up tty returns 0 bytes, at once and for ever.
            Ok(0) => gone(self.device, "end of file".into()),
            Ok(n) => {
                if self.pending.len() + n > 2 * LONGEST_LINE {
                    tracing::debug!(device = self.device, "noise without a line end dropped: {}", self.pending.escape_ascii());
                    self.pending.clear();
                }
                self.pending.extend_from_slice(&bytes[..n]);
                self.first.extend(bytes[..n].iter().take(FIRST_BYTES.saturating_sub(self.first.len())));
                Ok(true)
            }
            Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) => Ok(false),
            Err(e) => gone(self.device, e.to_string()),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.transmitter.lock().transport = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::net::TcpListener;

    #[test]
    fn noise_is_escaped_and_never_an_answer() {
        for (sent, line) in [
            (&b"ok\r\n"[..], "ok"),
            (b"\x88\x00<Grbl 1.1h ['$' for help]\r\n", r"\x88\x00<Grbl 1.1h [\'$\' for help]"),
            (b"\x00ok\n", r"\x00ok"),
            ("[MSG:\u{b5}]\n".as_bytes(), "[MSG:\u{b5}]"),
            (b"\n", ""),
        ] {
            assert_eq!(printable(sent), line);
        }
    }

    #[test]
    fn an_answer_that_has_arrived_is_read_although_the_time_is_over() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut link = Link::tcp("controller", &listener.local_addr().unwrap().to_string(), Stop::default()).unwrap();
        let (mut controller, _) = listener.accept().unwrap();
        assert_eq!(link.line(Instant::now()).unwrap(), None);
        controller.write_all(b"ok\nrest").unwrap();
        assert_eq!(link.line(Instant::now()).unwrap().as_deref(), Some("ok"));
        assert_eq!(link.line(Instant::now()).unwrap(), None);
    }

    /// Waits until the kernel has told.
    fn lost(link: &crate::Link) -> bool {
        let ends = Instant::now() + Duration::from_secs(60);
        while !link.is_lost() && Instant::now() < ends {
            std::thread::sleep(Duration::from_millis(1));
        }
        link.is_lost()
    }

    #[test]
    fn a_program_that_hangs_up_is_noticed_without_an_exchange_and_unread_bytes_stay() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut link = Link::tcp("controller", &listener.local_addr().unwrap().to_string(), Stop::default()).unwrap();
        let (mut controller, _) = listener.accept().unwrap();
        controller.write_all(b"ok\n").unwrap();
        let watched = link.stopper().link();
        assert!(!watched.is_lost());
        assert_eq!(link.line(Instant::now() + Duration::from_secs(60)).unwrap().as_deref(), Some("ok"));
        assert!(!watched.is_lost());
        drop(controller);
        assert!(lost(&watched));
    }

    /// Another program holds the port open, and this one does not see what it takes.
    #[test]
    fn another_program_that_has_the_port_is_named() {
        let pty = nix::pty::openpty(None, None).unwrap();
        let path = nix::unistd::ttyname(&pty.slave).unwrap();
        let path = path.to_str().unwrap();
        assert_eq!(users_of(path), None, "this process does not count");
        let mut other = std::process::Command::new("sleep").arg("60").stdin(pty.slave.try_clone().unwrap()).spawn().unwrap();
        let link = Link::serial("controller", &Port::from(path), 115_200, Stop::default()).unwrap();
        let garbled = || link.garbled("?", "a status report".into(), "<Id".into());
        let [first, later, partly] =
            [link.first_contact(link.silent("?", 1)), link.silent("?", 1), garbled()].map(|error| error.to_string());
        let refused = Link::serial("controller", &Port::from(path), 115_200, Stop::default()).err().unwrap().to_string();
        other.kill().unwrap();
        other.wait().unwrap();
        for said in [&first, &later, &partly, &refused] {
            assert!(said.contains(&format!("sleep (process {})", other.id())), "{said}");
        }
        for said in [first, later, partly] {
            assert!(said.contains("Exit the other program") && !said.contains("cable") && !said.contains("baud"), "{said}");
        }
        let alone = link.first_contact(link.silent("?", 1));
        assert!(matches!(&alone, DeviceError::Silent { remedy, .. } if remedy.contains("cable")), "nobody else is there: {alone}");
        assert!(matches!(garbled(), DeviceError::Unexpected { .. }));
    }

    #[test]
    fn a_pulled_serial_cable_and_a_closed_port_are_noticed_without_an_exchange() {
        let pty = nix::pty::openpty(None, None).unwrap();
        let path = nix::unistd::ttyname(&pty.slave).unwrap();
        drop(pty.slave);
        let port = Port::from(path.to_str().unwrap());
        let link = Link::serial("controller", &port, 115_200, Stop::default()).unwrap();
        let watched = link.stopper().link();
        assert!(!watched.is_lost());
        drop(pty.master);
        assert!(lost(&watched));
        drop(link);
        assert!(watched.is_lost());
    }
}
