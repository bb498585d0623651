//! An emulated `VastNavigateServer`: the Windows program of UT Southwestern that controls VAST by the vendor's library.
//!
//! ```text
//!   host ── door ── frames (u32 little endian, then as many characters) ── one thread ── Vast ── steps ──► Shaft
//!                   boot  rot,24  busy  mabs,0,x,y  mrel,0,x,y  get_xy_pos  set_autost,dir  get_autost
//!
//!   door = Pipe: a Unix socket stands for the named pipe; one client per press of the connect button
//!        = Tcp:  the server together with a program that makes its pipe a TCP port; clients come and go
//! ```
//! Every request has one answer, and an answer does not name its request. It is empty, but for `busy`, `get_xy_pos` and `get_autost`.
//! A turn continues after the client has disconnected.

mod knobs;
mod vast;

pub use knobs::Knobs;

use crate::clock::RigClock;
use crate::shaft::Shaft;
use std::io::{ErrorKind, Read, Result, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use vast::Vast;

/// How often the relay checks whether it must end while the client sends nothing, and whether its connect button is pressed.
const LOOK: Duration = Duration::from_millis(20);
const LONGEST_REQUEST: usize = 256;

#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Whether VAST is started at the beginning.
    pub started: bool,
    /// Rig time from `boot` until VAST is started.
    pub boot_time: Duration,
    /// The path of the pipe. `None`: the door is a TCP port on 127.0.0.1.
    pub pipe: Option<PathBuf>,
    pub speed_deg_per_s: f64,
    pub acceleration_deg_per_s2: f64,
    pub knobs: Knobs,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            started: true,
            boot_time: Duration::from_secs(45),
            pipe: None,
            speed_deg_per_s: 360.0,
            acceleration_deg_per_s2: 3600.0,
            knobs: Knobs::default(),
        }
    }
}

/// A running relay, joined when it is dropped.
pub struct Relay {
    address: Option<SocketAddr>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    pub(crate) fn start(clock: RigClock, shaft: Arc<Shaft>, settings: Settings) -> Result<Self> {
        let (door, address) = if let Some(path) = settings.pipe.clone() {
            (Door::Pipe(path), None)
        } else {
            let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
            let address = listener.local_addr()?;
            (Door::Tcp(listener), Some(address))
        };
        let ending = Arc::new(AtomicBool::new(false));
        let server = Server { clock, knobs: settings.knobs.clone(), vast: Vast::new(shaft, settings), ending: Arc::clone(&ending) };
        let thread = std::thread::Builder::new().name("sim-relay".into()).spawn(move || server.run(&door))?;
        Ok(Self { address, ending, thread: Some(thread) })
    }

    /// Its TCP port. `None` if its door is a pipe.
    pub fn address(&self) -> Option<SocketAddr> {
        self.address
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        // Wakes the thread, which waits for clients.
        let _ = self.address.map(TcpStream::connect);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Where clients come in.
enum Door {
    Tcp(TcpListener),
    Pipe(PathBuf),
}

trait Client: Read + Write + Send {
    fn wait_at_most(&self, wait: Duration) -> Result<()>;
}

impl Client for TcpStream {
    fn wait_at_most(&self, wait: Duration) -> Result<()> {
        self.set_nodelay(true)?;
        self.set_read_timeout(Some(wait))
    }
}

impl Client for UnixStream {
    fn wait_at_most(&self, wait: Duration) -> Result<()> {
        self.set_nonblocking(false)?;
        self.set_read_timeout(Some(wait))
    }
}

struct Server {
    clock: RigClock,
    knobs: Knobs,
    vast: Vast,
    ending: Arc<AtomicBool>,
}

impl Server {
    fn run(mut self, door: &Door) {
        while !self.ending.load(Ordering::Relaxed) {
            match self.client(door) {
                Ok(Some(mut client)) => {
                    if let Err(error) = self.serve(client.as_mut()) {
                        tracing::debug!(%error, "the relay's client has gone");
                    }
                }
                Ok(None) => {}
                Err(error) => tracing::debug!(%error, "no client could come in"),
            }
        }
    }

    /// The next client. `None` if the relay must end.
    fn client(&self, door: &Door) -> Result<Option<Box<dyn Client>>> {
        match door {
            Door::Tcp(listener) => {
                let (client, _address) = listener.accept()?;
                Ok(Some(Box::new(client)))
            }
            Door::Pipe(path) => self.pipe_client(path),
        }
    }

    /// Waits for a press of the connect button, makes the pipe, and waits for one client.
    fn pipe_client(&self, path: &PathBuf) -> Result<Option<Box<dyn Client>>> {
        while !self.knobs.connect_is_pressed() {
            if self.ending.load(Ordering::Relaxed) {
                return Ok(None);
            }
            std::thread::sleep(LOOK);
        }
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        let client = loop {
            match listener.accept() {
                Ok((client, _address)) => break Some(client),
                Err(e) if e.kind() != ErrorKind::WouldBlock => return Err(e),
                Err(_) if self.ending.load(Ordering::Relaxed) => break None,
                Err(_) => std::thread::sleep(LOOK),
            }
        };
        std::fs::remove_file(path)?;
        Ok(client.map(|client| Box::new(client) as Box<dyn Client>))
    }

    fn serve(&mut self, client: &mut dyn Client) -> Result<()> {
        client.wait_at_most(LOOK)?;
        let mut heard = Vec::new();
        while !self.ending.load(Ordering::Relaxed) {
            while let Some(request) = take_frame(&mut heard)? {
                let now_s = self.clock.now_s();
                let answer = self.vast.obey(&request, now_s);
                if self.knobs.hangs_up(&request) {
                    return Ok(());
                }
                self.answer(client, &request, &answer)?;
            }
            let mut chunk = [0; 512];
            match client.read(&mut chunk) {
                Ok(0) => return Ok(()),
                Ok(n) => heard.extend_from_slice(&chunk[..n]),
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
                Err(e) => return Err(e),
            }
        }
        Ok(())
    }

    fn answer(&self, client: &mut dyn Client, request: &str, answer: &str) -> Result<()> {
        if self.knobs.spares(request) {
            return client.write_all(&frame(answer));
        }
        let Some(bytes) = self.knobs.sent(answer) else { return Ok(()) };
        std::thread::sleep(self.knobs.delay());
        if self.knobs.splits() {
            return bytes.iter().try_for_each(|byte| client.write_all(&[*byte]));
        }
        client.write_all(&bytes)
    }
}

fn frame(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

/// The next complete frame.
fn take_frame(heard: &mut Vec<u8>) -> Result<Option<String>> {
    let Some(length) = heard.first_chunk().map(|head| u32::from_le_bytes(*head) as usize) else { return Ok(None) };
    if length > LONGEST_REQUEST {
        return Err(std::io::Error::new(ErrorKind::InvalidData, format!("a request of {length} bytes")));
    }
    if heard.len() < 4 + length {
        return Ok(None);
    }
    let text = String::from_utf8_lossy(&heard[4..4 + length]).into_owned();
    heard.drain(..4 + length);
    Ok(Some(text))
}
