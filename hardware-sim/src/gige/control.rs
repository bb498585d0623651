//! The control channel: one thread that answers at UDP port 3956. One host at a time may write.
//!
//! A controlling host that is silent for longer than the heartbeat loses control, and its stream ends.

use super::faults::CameraFaults;
use super::gvcp::{Command, Refusal, Request};
use super::memory::{CONTROL_PRIVILEGE, Effect, Memory};
use super::sensor::{Order, Stream};
use crate::clock::RigClock;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Control or exclusive access.
const PRIVILEGE_BITS: u32 = 0b11;
const EXCLUSIVE: u32 = 0b01;
/// The last packet of a resend request that means: to the end of the frame.
const TO_THE_END: u32 = 0x00ff_ffff;

struct Owner {
    address: SocketAddr,
    privilege: u32,
    heard: Instant,
}

pub(super) struct Control {
    pub socket: UdpSocket,
    pub clock: RigClock,
    pub memory: Arc<Mutex<Memory>>,
    pub stream: Arc<Stream>,
    pub faults: Arc<CameraFaults>,
    pub sensor: Sender<Order>,
    pub quit: Arc<AtomicBool>,
    owner: Option<Owner>,
}

impl Control {
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        socket: UdpSocket,
        clock: RigClock,
        memory: Arc<Mutex<Memory>>,
        stream: Arc<Stream>,
        faults: Arc<CameraFaults>,
        sensor: Sender<Order>,
        quit: Arc<AtomicBool>,
    ) -> Self {
        Self { socket, clock, memory, stream, faults, sensor, quit, owner: None }
    }

    pub fn run(mut self) {
        let mut packet = [0; 2048];
        loop {
            // No host has control, so no heartbeat can run out: wait without a timeout.
            if let Err(error) = self.socket.set_read_timeout(self.patience()) {
                tracing::error!(%error, "the emulated camera's control channel stops");
                break;
            }
            let received = self.socket.recv_from(&mut packet);
            if self.quit.load(Ordering::SeqCst) {
                break;
            }
            if self.faults.takes_restart() {
                self.restart();
            }
            self.watch_heartbeat();
            if let Ok((length, from)) = received
                && let Some(request) = Request::parse(&packet[..length])
            {
                if self.faults.is_unplugged() {
                    self.faults.count_unheard_request();
                } else if !self.faults.is_mute() {
                    self.answer(&request, from);
                }
            }
        }
        let _ = self.sensor.send(Order::Quit);
    }

    fn patience(&self) -> Option<Duration> {
        let owner = self.owner.as_ref()?;
        let allowed = Duration::from_millis(u64::from(self.lock().heartbeat_ms()));
        Some((owner.heard + allowed).saturating_duration_since(Instant::now()).max(Duration::from_millis(1)))
    }

    fn watch_heartbeat(&mut self) {
        let silent = match &self.owner {
            Some(owner) => owner.heard.elapsed() >= Duration::from_millis(u64::from(self.lock().heartbeat_ms())),
            None => false,
        };
        if silent || (self.faults.is_stolen() && self.owner.is_some()) {
            self.release();
        }
    }

    /// Control is given up or lost. The stream ends and has no destination any more.
    fn release(&mut self) {
        self.owner = None;
        self.lock().forget_destination();
        let _ = self.sensor.send(Order::Stop);
    }

    /// Resets everything to the state after power-up.
    fn restart(&mut self) {
        self.owner = None;
        self.faults.restart_clock();
        self.lock().restart();
        let _ = self.sensor.send(Order::Restart);
    }

    fn answer(&mut self, request: &Request, from: SocketAddr) {
        let owns = match &mut self.owner {
            Some(owner) if owner.address == from => {
                owner.heard = Instant::now();
                true
            }
            _ => false,
        };
        if let Command::Resend { block, first, last } = request.command {
            return self.resend(block, first, last, from);
        }
        let outcome = self.obey(&request.command, from, owns);
        if request.wants_answer {
            let answer = request.answer(outcome.as_deref().map_err(|r| *r));
            let _ = self.socket.send_to(&answer, from);
        }
    }

    fn obey(&mut self, command: &Command, from: SocketAddr, owns: bool) -> Result<Vec<u8>, Refusal> {
        let exclusive = self.owner.as_ref().is_some_and(|o| o.privilege & EXCLUSIVE != 0) && !owns;
        match command {
            Command::Discovery => Ok(self.lock().discovery().to_vec()),
            Command::ReadRegisters(_) | Command::ReadMemory { .. } if exclusive => Err(Refusal::AccessDenied),
            Command::ReadRegisters(addresses) => {
                let values: Result<Vec<u32>, Refusal> = addresses.iter().map(|a| self.read(*a, owns)).collect();
                Ok(values?.into_iter().flat_map(u32::to_be_bytes).collect())
            }
            Command::WriteRegisters(pairs) => {
                for (address, value) in pairs {
                    self.write(*address, *value, from)?;
                }
                Ok(vec![0, 0, 0, pairs.len() as u8])
            }
            Command::ReadMemory { address, count } => {
                let mut answer = address.to_be_bytes().to_vec();
                answer.extend(self.lock().read_memory(*address, *count)?);
                Ok(answer)
            }
            Command::WriteMemory { address, data } => {
                if !self.may_write(from) {
                    return Err(Refusal::AccessDenied);
                }
                let effect = self.lock().write_memory(*address, data, self.now_ns())?;
                self.carry_out(effect);
                Ok(vec![0, 0, (data.len() >> 8) as u8, data.len() as u8])
            }
            Command::Resend { .. } | Command::Unknown(_) => Err(Refusal::NotImplemented),
        }
    }

    fn read(&self, address: u32, owns: bool) -> Result<u32, Refusal> {
        if address == CONTROL_PRIVILEGE {
            // Each host reads its own privilege.
            return Ok(self.owner.as_ref().filter(|_| owns).map_or(0, |o| o.privilege));
        }
        self.lock().read_register(address)
    }

    fn write(&mut self, address: u32, value: u32, from: SocketAddr) -> Result<(), Refusal> {
        if address == CONTROL_PRIVILEGE {
            return self.claim(value & PRIVILEGE_BITS, from);
        }
        if !self.may_write(from) {
            return Err(Refusal::AccessDenied);
        }
        let effect = self.lock().write_register(address, value, self.now_ns())?;
        self.carry_out(effect);
        Ok(())
    }

    fn may_write(&self, from: SocketAddr) -> bool {
        self.owner.as_ref().is_some_and(|o| o.address == from)
    }

    fn claim(&mut self, privilege: u32, from: SocketAddr) -> Result<(), Refusal> {
        if self.faults.is_stolen() || self.owner.as_ref().is_some_and(|o| o.address != from) {
            return Err(Refusal::AccessDenied);
        }
        if privilege == 0 {
            if self.owner.is_some() {
                self.release();
            }
        } else {
            self.owner = Some(Owner { address: from, privilege, heard: Instant::now() });
        }
        Ok(())
    }

    fn carry_out(&self, effect: Effect) {
        let order = match effect {
            Effect::None => return,
            Effect::Start => Order::Start,
            Effect::Stop => Order::Stop,
            Effect::Trigger => {
                let deaf = !self.lock().values.waits_for_software() || self.faults.takes_trigger();
                // A trigger during an exposure is lost.
                if deaf || self.stream.exposing.swap(true, Ordering::SeqCst) {
                    return;
                }
                Order::Trigger
            }
        };
        let _ = self.sensor.send(order);
    }

    fn resend(&self, block: u16, first: u32, last: u32, from: SocketAddr) {
        let Some((frame, to)) = self.stream.find(block) else { return };
        // Only the host that gets the stream may request packets of it.
        if SocketAddr::V4(to).ip() != from.ip() {
            return;
        }
        let last = if last == TO_THE_END { frame.last_packet() } else { last.min(frame.last_packet()) };
        for packet in (first..=last).filter_map(|id| frame.packet(id)) {
            if !self.faults.is_unplugged() && !self.faults.is_too_long(&packet) {
                let _ = self.stream.socket.send_to(&packet, to);
            }
        }
    }

    fn now_ns(&self) -> u64 {
        self.faults.clock_ns(self.clock.now_s())
    }

    fn lock(&self) -> MutexGuard<'_, Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
