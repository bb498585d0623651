//! The sensor: one thread that exposes when it is triggered (or by itself), reads out, and sends.
//!
//! ```text
//!   Start ─► wait ── trigger, or due in free run ───────► expose ──► read out ──► packets, paced ──► wait
//!              ▲                                            │ way of the shaft meanwhile             │
//!              └────────────────────────────────────────────┴───────────── Stop ─────────────────────┘
//! ```
//! A trigger during an exposure is lost, as with the real camera. A trigger during readout is accepted.
//!
//! In free run the exposures are at the instants of rig time that the rate gives, also when this thread is late: the shaft knows where
//! it stood. Their frames then come later, in order, with their true times. If too many wait, the camera loses frames: their numbers are
//! missing.

use super::faults::CameraFaults;
use super::features::{CONTINUOUS, SINGLE_FRAME};
use super::gvsp::{Block, next_block};
use super::memory::Memory;
use crate::clock::RigClock;
use crate::scene::Exposure;
use crate::shaft::Shaft;
use crate::sight::{PixelFormat, Pixels, Sight, WireFormat};
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
/// Packets are sent in bursts of this length, and the thread sleeps between them. A scheduler cannot time shorter pauses.
const BURST: Duration = Duration::from_micros(250);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Start,
    Stop,
    /// A software trigger, or a pulse on the line.
    Trigger,
    /// Power was lost. Frame numbers and kept frames are lost too.
    Restart,
    Quit,
}

/// The part of the stream that the control channel uses.
pub(super) struct Stream {
    pub socket: UdpSocket,
    kept: Mutex<VecDeque<(Arc<Block>, SocketAddrV4)>>,
    /// `true` from a trigger to the end of its exposure.
    pub exposing: AtomicBool,
}

impl Stream {
    pub fn new(socket: UdpSocket) -> Self {
        Self { socket, kept: Mutex::new(VecDeque::new()), exposing: AtomicBool::new(false) }
    }

    /// A kept frame and its destination.
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

    /// Drops all kept frames. Returns the last one.
    fn forget(&self) -> Option<Arc<Block>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let last = kept.pop_back();
        kept.clear();
        last.map(|(block, _)| block)
    }
}

pub(super) struct Sensor {
    pub clock: RigClock,
    pub shaft: Arc<Shaft>,
    pub sight: Arc<dyn Sight>,
    pub nominal_exposure_us: Option<f32>,
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
    /// Remaining frames of an acquisition that ends by itself.
    left: Option<u32>,
    block: u16,
    number: u64,
    triggers: u32,
    /// When the next exposure in free run is due, s of rig time.
    due_s: Option<f64>,
    /// The last frame of the acquisition before.
    stale: Option<Arc<Block>>,
    /// A frame that a fault sends again.
    again: Option<Arc<Block>>,
}

impl Sensor {
    pub fn run(mut self) {
        while !self.state.quit {
            if self.state.triggers > 0 {
                self.state.triggers -= 1;
                self.frame(self.clock.now_s());
                continue;
            }
            let free_run = self.state.streaming && self.lock().values.runs_free();
            if free_run {
                self.free_run();
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
                if !self.faults.keeps_numbers() {
                    state.block = self.faults.first_number() - 1;
                }
                state.due_s = None;
                state.triggers = 0;
                state.again = None;
                self.stream.exposing.store(false, Ordering::SeqCst);
                state.stale = self.stream.forget();
            }
            Order::Stop => self.stop(),
            Order::Restart => {
                self.stop();
                self.stream.forget();
                self.state = State { number: self.state.number, ..State::default() };
            }
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

    /// Sleeps and executes orders meanwhile. Returns `false` as soon as the acquisition was ended or started again.
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

    /// Takes the next frame that needs no trigger.
    fn free_run(&mut self) {
        let (now_s, period_s) = (self.clock.now_s(), 1.0 / f64::from(self.lock().values.rate_hz()));
        let due_s = *self.state.due_s.get_or_insert(now_s);
        if now_s - due_s > self.faults.most_waiting() * period_s {
            if self.pause_until(Instant::now()) {
                self.state.due_s = Some(due_s + period_s);
                self.lose_frame(due_s);
            }
            return;
        }
        self.state.due_s = Some(due_s + period_s);
        let jitter_s = self.faults.takes_jitter_s();
        self.frame(due_s + jitter_s);
    }

    /// An exposure for whose frame there is no room.
    fn lose_frame(&mut self, begin_s: f64) {
        self.state.block = next_block(self.state.block);
        let middle_s = begin_s + 0.5e-6 * f64::from(self.lock().values.exposure_us);
        self.truth.add(ExposureRecord {
            frame_id: u64::from(self.state.block),
            number: self.state.number,
            middle_s,
            camera_ns: self.faults.clock_ns(middle_s),
            angle_rad: self.shaft.angle_at_rad(middle_s),
            sha256: [0; 32],
            sent: false,
        });
        self.state.number += 1;
        self.count_down();
    }

    /// Exposes at an instant of rig time, reads out and sends one frame, unless the acquisition ends meanwhile.
    fn frame(&mut self, begin_s: f64) {
        let values = {
            let mut memory = self.lock();
            memory.values.choose_exposure();
            memory.values.clone()
        };
        let exposure_s = f64::from(values.exposure_us) * 1e-6;
        if !self.pause_until(self.clock.instant(begin_s + exposure_s)) {
            return;
        }
        let shaft = Arc::clone(&self.shaft);
        let path_rad = move |part: f64| shaft.seen_at_rad(begin_s + part * exposure_s);
        let exposure = Exposure { angle_rad: path_rad(0.5), number: self.state.number };
        let middle_s = begin_s + 0.5 * exposure_s;
        let timestamp_ns = self.faults.clock_ns(middle_s);
        let image = values.format.image();
        let picture = self.look(&exposure, &path_rad, image);
        // The acquisition may have ended while the picture was made. A fault may hold the frame back.
        if !self.pause_until(Instant::now() + self.faults.takes_hold()) {
            return;
        }
        self.stream.exposing.store(false, Ordering::SeqCst);
        self.state.number += 1;
        let again = self.state.again.take().map(|again| {
            self.state.block = next_block(self.state.block);
            Arc::new(Block { id: self.state.block, ..Block::clone(&again) })
        });
        self.state.block = next_block(self.state.block);
        let mut bytes = picture.crop(values.offset.0, values.offset.1, values.width, values.height);
        reverse(&mut bytes, values.width as usize, image.bytes_per_pixel(), values.reversed);
        let longer = self.nominal_exposure_us.map_or(1.0, |nominal| f64::from(values.exposure_us / nominal));
        amplify(&mut bytes, longer * 10f64.powf(f64::from(values.gain_db) / 20.0));
        let mut bytes = values.format.of(bytes);
        let sent = !self.faults.takes_frame();
        self.truth.add(ExposureRecord {
            frame_id: u64::from(self.state.block),
            number: exposure.number,
            middle_s,
            camera_ns: timestamp_ns,
            angle_rad: self.shaft.angle_at_rad(middle_s),
            sha256: Sha256::digest(&bytes).into(),
            sent,
        });
        let misshapen = self.faults.misshapes_frame();
        let height = if misshapen { values.height / 2 } else { values.height };
        bytes.truncate(values.format.bytes(values.width as usize * height as usize));
        let block = Arc::new(Block {
            id: self.state.block,
            timestamp_ns,
            format: if self.faults.reformats_frame() { another(values.format) } else { values.format },
            width: values.width,
            height,
            offset: values.offset,
            packet_size: values.packet_size as usize,
            cut: self.faults.cuts_frame(),
            bytes,
        });
        let destination = self.lock().destination().filter(|_| sent);
        if let Some(to) = destination {
            self.send_what_is_stale(to, values.bytes_per_second);
            if let Some(again) = again {
                self.stream.keep(&again, to);
                self.send(&again, 0, to, values.bytes_per_second);
            }
            self.stream.keep(&block, to);
            self.send(&block, 0, to, values.bytes_per_second);
            if self.faults.repeats_frame() {
                self.state.again = Some(block);
            }
        }
        self.count_down();
    }

    /// Ends an acquisition of a number of frames after its last one.
    fn count_down(&mut self) {
        if let Some(left) = &mut self.state.left {
            *left = left.saturating_sub(1);
            if *left == 0 {
                self.stop();
            }
        }
    }

    fn look(&self, exposure: &Exposure, path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        let (width, height) = self.sight.size();
        let picture = self.sight.look_along(exposure, path_rad, format);
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

    /// Sends the packets that a fault keeps of the acquisition before.
    fn send_what_is_stale(&mut self, to: SocketAddrV4, bytes_per_second: u32) {
        if let Some(stale) = self.state.stale.take() {
            let from = (stale.last_packet() + 1).saturating_sub(self.faults.takes_stale_packets());
            self.send(&stale, from, to, bytes_per_second);
        }
    }

    /// Sends the packets of a frame from `first` on, at the pace of the stream. They are in order unless a fault swaps them.
    fn send(&mut self, block: &Block, first: u32, to: SocketAddrV4, bytes_per_second: u32) {
        let burst_bytes = f64::from(bytes_per_second) * BURST.as_secs_f64();
        let begin = Instant::now();
        let (mut sent, mut next_pause) = (0.0, burst_bytes);
        let mut held_back = None;
        for id in first..=block.last_packet() {
            let Some(packet) = block.packet(id) else { continue };
            if held_back.is_none() && id < block.last_packet() && self.faults.swaps_packet() {
                held_back = Some(packet);
                continue;
            }
            self.send_packet(&packet, to);
            if let Some(late) = held_back.take() {
                self.send_packet(&late, to);
                sent += block.packet_size as f64;
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

    fn send_packet(&self, packet: &[u8], to: SocketAddrV4) {
        let times = match (
            self.faults.loses_packet() || self.faults.is_unplugged() || self.faults.is_too_long(packet),
            self.faults.doubles_packet(),
        ) {
            (true, _) => 0,
            (false, true) => 2,
            (false, false) => 1,
        };
        for _ in 0..times {
            // If nobody listens, the host notices a missing frame.
            let _ = self.stream.socket.send_to(packet, to);
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Another format with the same number of bytes per pixel, or the same format if there is none.
fn another(format: WireFormat) -> WireFormat {
    match format {
        WireFormat::Plain(PixelFormat::Mono8) => WireFormat::Plain(PixelFormat::BayerRG8),
        WireFormat::Plain(PixelFormat::RGB8Packed) | WireFormat::Mono10p => format,
        WireFormat::Plain(_) => WireFormat::Plain(PixelFormat::Mono8),
        WireFormat::Mono12p => WireFormat::Mono12Packed,
        WireFormat::Mono10Packed | WireFormat::Mono12Packed => WireFormat::Mono12p,
    }
}

/// Reads the columns, and the rows, out from the other end.
fn reverse(bytes: &mut Vec<u8>, width: usize, pixel: usize, [columns, rows]: [bool; 2]) {
    if columns {
        *bytes = bytes.chunks(width * pixel).flat_map(|row| row.chunks(pixel).rev().flatten()).copied().collect();
    }
    if rows {
        *bytes = bytes.chunks(width * pixel).rev().flatten().copied().collect();
    }
}

/// Multiplies all bytes by `factor`, with saturation.
#[allow(clippy::float_cmp)]
fn amplify(bytes: &mut [u8], factor: f64) {
    // The factor is exactly 1 by default.
    if factor == 1.0 {
        return;
    }
    let table: [u8; 256] = std::array::from_fn(|v| (v as f64 * factor).round().min(255.0) as u8);
    for byte in bytes {
        *byte = table[usize::from(*byte)];
    }
}
