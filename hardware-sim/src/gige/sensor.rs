//! The sensor: one thread that exposes when it is triggered (or by itself), reads out, and sends.
//!
//! ```text
//!   Start ─► wait ── trigger, or its turn in free run ──► expose ──► read out ──► packets, paced ──► wait
//!              ▲                                            │ angle of the shaft at the middle      │
//!              └────────────────────────────────────────────┴───────────── Stop ─────────────────────┘
//! ```
//! A trigger during an exposure is lost, as on the camera; one during readout is taken.

use super::faults::CameraFaults;
use super::features::{CONTINUOUS, SINGLE_FRAME};
use super::gvsp::{Block, next_block};
use super::memory::Memory;
use crate::clock::RigClock;
use crate::scene::Exposure;
use crate::shaft::Shaft;
use crate::sight::{PixelFormat, Pixels, Sight};
use crate::truth::{ExposureRecord, Truth};

use sha2::{Digest, Sha256};
use std::collections::VecDeque;
use std::net::{SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Frames that can still be sent again.
const KEPT_FRAMES: usize = 8;
/// Packets leave in bursts this long, then the thread sleeps until the next is due: shorter ones a scheduler cannot time.
const BURST: Duration = Duration::from_micros(250);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Start,
    Stop,
    Trigger,
    Quit,
}

/// What the control channel needs of the stream.
pub(super) struct Stream {
    pub socket: UdpSocket,
    kept: Mutex<VecDeque<(Arc<Block>, SocketAddrV4)>>,
    /// Between a trigger and the end of its exposure.
    pub exposing: AtomicBool,
}

impl Stream {
    pub fn new(socket: UdpSocket) -> Self {
        Self { socket, kept: Mutex::new(VecDeque::new()), exposing: AtomicBool::new(false) }
    }

    /// A kept frame and where it went.
    pub fn find(&self, block: u16) -> Option<(Arc<Block>, SocketAddrV4)> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).iter().rev().find(|(b, _)| b.id == block).cloned()
    }

    fn keep(&self, block: &Arc<Block>, to: SocketAddrV4) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() == KEPT_FRAMES {
            kept.pop_front();
        }
        kept.push_back((Arc::clone(block), to));
    }

    fn forget(&self) {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

pub(super) struct Sensor {
    pub clock: RigClock,
    pub shaft: Arc<Shaft>,
    pub sight: Arc<dyn Sight>,
    pub memory: Arc<Mutex<Memory>>,
    pub stream: Arc<Stream>,
    pub faults: Arc<CameraFaults>,
    pub truth: Arc<Truth>,
    pub orders: Receiver<Order>,
    pub state: State,
}

#[derive(Debug, Default)]
pub(super) struct State {
    streaming: bool,
    quit: bool,
    /// Frames until the acquisition ends by itself.
    left: Option<u32>,
    block: u16,
    number: u64,
    triggers: u32,
    /// When free run exposes next.
    due: Option<Instant>,
}

impl Sensor {
    pub fn run(mut self) {
        while !self.state.quit {
            if self.state.triggers > 0 {
                self.state.triggers -= 1;
                self.frame();
                continue;
            }
            let free_run = self.state.streaming && !self.lock().values.waits_for_software();
            if free_run {
                let due = *self.state.due.get_or_insert_with(Instant::now);
                if self.pause_until(due) && self.state.streaming {
                    let rate = f64::from(self.lock().values.frame_rate_hz);
                    // Behind its time it goes on from now: frames that were not taken are not made up for.
                    self.state.due = Some((due + self.clock.real(1.0 / rate)).max(Instant::now()));
                    self.frame();
                }
            } else {
                match self.orders.recv() {
                    Ok(order) => self.obey(order),
                    Err(_) => return,
                }
            }
        }
    }

    fn obey(&mut self, order: Order) {
        let state = &mut self.state;
        match order {
            Order::Start => {
                let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
                memory.streaming = true;
                let values = &memory.values;
                state.left = match values.mode {
                    CONTINUOUS => None,
                    SINGLE_FRAME => Some(1),
                    _ => Some(values.frame_count),
                };
                drop(memory);
                state.streaming = true;
                state.block = 0;
                state.due = None;
                state.triggers = 0;
                self.stream.exposing.store(false, Ordering::SeqCst);
                self.stream.forget();
            }
            Order::Stop => self.stop(),
            Order::Trigger if state.streaming => state.triggers += 1,
            Order::Trigger => self.stream.exposing.store(false, Ordering::SeqCst),
            Order::Quit => {
                state.streaming = false;
                state.quit = true;
            }
        }
    }

    fn stop(&mut self) {
        self.state.streaming = false;
        self.state.triggers = 0;
        self.stream.exposing.store(false, Ordering::SeqCst);
        self.lock().streaming = false;
    }

    /// Sleeps, yet hears orders; false as soon as the acquisition was ended or begun anew.
    fn pause_until(&mut self, until: Instant) -> bool {
        loop {
            match self.orders.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(Order::Trigger) => self.obey(Order::Trigger),
                Ok(order) => {
                    self.obey(order);
                    return false;
                }
                Err(RecvTimeoutError::Timeout) => return true,
                Err(RecvTimeoutError::Disconnected) => {
                    self.state.quit = true;
                    return false;
                }
            }
        }
    }

    /// Exposes, reads out and sends one frame, unless the acquisition ends meanwhile.
    fn frame(&mut self) {
        let values = self.lock().values.clone();
        let begin = Instant::now();
        let half = self.clock.real(f64::from(values.exposure_us) * 0.5e-6);
        if !self.pause_until(begin + half) {
            return;
        }
        let exposure = Exposure { angle_rad: self.shaft.angle_rad(), number: self.state.number };
        let timestamp_ns = (self.clock.now_s() * 1e9) as u64;
        let picture = self.look(&exposure, values.format);
        if !self.pause_until(begin + 2 * half) {
            return;
        }
        self.stream.exposing.store(false, Ordering::SeqCst);
        self.state.number += 1;
        self.state.block = next_block(self.state.block);
        let mut bytes = picture.crop(values.offset.0, values.offset.1, values.width, values.height);
        amplify(&mut bytes, values.gain_db);
        let sent = !self.faults.takes_frame();
        self.truth.add(ExposureRecord {
            frame_id: u64::from(self.state.block),
            number: exposure.number,
            angle_rad: exposure.angle_rad,
            sha256: Sha256::digest(&bytes).into(),
            sent,
        });
        let block = Block {
            id: self.state.block,
            timestamp_ns,
            format: values.format,
            width: values.width,
            height: values.height,
            offset: values.offset,
            packet_size: values.packet_size as usize,
            bytes,
        };
        let destination = self.lock().destination().filter(|_| sent);
        if let Some(to) = destination {
            self.send(block, to, values.bytes_per_second);
        }
        if let Some(left) = &mut self.state.left {
            *left = left.saturating_sub(1);
            if *left == 0 {
                self.stop();
            }
        }
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let (width, height) = self.sight.size();
        let picture = self.sight.look(exposure, format);
        if (picture.width, picture.height, picture.format) == (width, height, format) && picture.is_whole() {
            return picture;
        }
        tracing::error!(
            "the scene gave {} bytes as {} x {} {}, the sensor has {width} x {height} {}; a black frame is sent",
            picture.bytes.len(),
            picture.width,
            picture.height,
            picture.format.name(),
            format.name()
        );
        Pixels::filled(width, height, format, 0)
    }

    fn send(&mut self, block: Block, to: SocketAddrV4, bytes_per_second: u32) {
        let block = Arc::new(block);
        self.stream.keep(&block, to);
        let burst_bytes = f64::from(bytes_per_second) * BURST.as_secs_f64();
        let begin = Instant::now();
        let (mut sent, mut next_pause) = (0.0, burst_bytes);
        for id in 0..=block.last_packet() {
            let Some(packet) = block.packet(id) else { break };
            if !self.faults.loses_packet() {
                // Nobody listening is the host's affair; it shows there as a missing frame.
                let _ = self.stream.socket.send_to(&packet, to);
            }
            sent += block.packet_size as f64;
            if sent >= next_pause {
                next_pause = sent + burst_bytes;
                if !self.pause_until(begin + Duration::from_secs_f64(sent / f64::from(bytes_per_second))) {
                    return;
                }
            }
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Gain in decibels of amplitude, saturating.
fn amplify(bytes: &mut [u8], gain_db: u32) {
    if gain_db == 0 {
        return;
    }
    let factor = 10f64.powf(f64::from(gain_db) / 20.0);
    let table: [u8; 256] = std::array::from_fn(|v| (v as f64 * factor).round().min(255.0) as u8);
    for byte in bytes {
        *byte = table[usize::from(*byte)];
    }
}
