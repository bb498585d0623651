//! An emulated relay: the Windows program that controls VAST by its library and serves it over TCP.
//!
//! ```text
//!   host ── TCP ── frames (u32 little endian, then as many characters) ── one thread ── Vast ── steps ──► Shaft
//!                  boot  rot,24  busy  mabs,0,x,y  mrel,0,x,y  get_xy_pos  set_autost,dir  get_autost
//! ```
//! Every request has one answer, and an answer does not name its request. `rot` is answered when the turn begins. `busy` answers 0
//! when nothing moves. A turn continues after the client has disconnected.

mod knobs;
mod vast;

pub use knobs::Knobs;

use crate::clock::RigClock;
use crate::shaft::Shaft;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use vast::Vast;

/// How often the relay checks whether it must end while the client sends nothing.
const LOOK: Duration = Duration::from_millis(20);
const LONGEST_REQUEST: usize = 256;

#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pub speed_deg_per_s: f64,
    pub acceleration_deg_per_s2: f64,
    pub knobs: Knobs,
}

impl Default for Settings {
    fn default() -> Self {
        Self { speed_deg_per_s: 360.0, acceleration_deg_per_s2: 3600.0, knobs: Knobs::default() }
    }
}

/// A running relay, joined when it is dropped.
pub struct Relay {
    address: SocketAddr,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    pub(crate) fn start(clock: RigClock, shaft: Arc<Shaft>, settings: Settings) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let ending = Arc::new(AtomicBool::new(false));
        let server = Server { clock, knobs: settings.knobs.clone(), vast: Vast::new(shaft, settings), ending: Arc::clone(&ending) };
        let thread = std::thread::Builder::new().name("sim-relay".into()).spawn(move || server.run(&listener))?;
        Ok(Self { address, ending, thread: Some(thread) })
    }

    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        // Wakes the thread, which waits for clients.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Server {
    clock: RigClock,
    knobs: Knobs,
    vast: Vast,
    ending: Arc<AtomicBool>,
}

impl Server {
    fn run(mut self, listener: &TcpListener) {
        for client in listener.incoming() {
            if self.ending.load(Ordering::Relaxed) {
                return;
            }
            if let Ok(client) = client
                && let Err(error) = self.serve(client)
            {
                tracing::debug!(%error, "the relay's client has gone");
            }
        }
    }

    fn serve(&mut self, mut client: TcpStream) -> std::io::Result<()> {
        client.set_nodelay(true)?;
        client.set_read_timeout(Some(LOOK))?;
        let mut heard = Vec::new();
        while !self.ending.load(Ordering::Relaxed) {
            while let Some(request) = take_frame(&mut heard)? {
                let now_s = self.clock.now_s();
                let answer = self.vast.obey(&request, now_s);
                if self.knobs.hangs_up(&request) {
                    return Ok(());
                }
                self.answer(&mut client, &request, &answer)?;
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

    fn answer(&self, client: &mut TcpStream, request: &str, answer: &str) -> std::io::Result<()> {
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
fn take_frame(heard: &mut Vec<u8>) -> std::io::Result<Option<String>> {
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
