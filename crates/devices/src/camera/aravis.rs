//! A GigE Vision camera with libaravis.
//!
//! ```text
//! rig worker ── arm ──► new stream, 8 buffers, one acquisition
//!            ── grab ─► drain ─► camera's time ─► TriggerSoftware ─► pop ─► complete, as configured, not older? ─► frame
//!                          ▲                                                  │ no, or nothing came
//!                          └──────────── again, until the deadline ◄──────────┘
//!            ── stream ► trigger off, rate ─► new stream, buffers of the plan ─► pop ─► number and time counted on ─► sink
//! aravis' own thread ── control-lost ──► a flag, nothing else
//! ```
//! Aravis' objects may move between threads but must not be shared. The rig worker, which blocks anyway, owns them all.
//!
//! - A stream silently drops every frame whose number is at most 100 behind its last one. So each acquisition gets a new stream, and a
//!   rising count of ignored packets renews it.
//! - `BufferStatus::Success` alone does not mean a complete image. Size, geometry and format are checked too.
//! - A frame that was exposed before its view was requested shows an earlier position of the axis. Its timestamp by the camera's clock
//!   tells. Without a camera clock, the driver waits for outstanding frames and drops them before the next trigger.
//! - Closing a camera that does not answer blocks for seconds, so a separate thread does it.

mod accept;
mod clock;
mod configure;
mod features;
mod find;
mod free_run;
mod socket;
mod stream;

pub(super) use find::discover;

use super::{AravisSettings, CameraSelect, MacAddress, Trigger};
use crate::{Camera, ClockReading, DeviceError, FrameSink, Grabbed, Link, StreamCounters, StreamEnd, StreamPlan};
use accept::{Verdict, accept};
use aravis::GvDevice;
use aravis::glib;
use aravis::glib::prelude::Cast;
use aravis::prelude::*;
use clock::CameraClock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use stream::Armed;

/// GigE Vision's register with the time after which a silent controller loses the camera, ms.
const HEARTBEAT: u64 = 0x938;
/// GigE Vision's registers with the hardware address of the camera: its first two bytes, and the other four.
const HARDWARE_ADDRESS: [u64; 2] = [0x008, 0x00c];
/// Largest delay of a predecessor's last heartbeat.
const HEARTBEAT_SLACK: Duration = Duration::from_millis(500);

/// Longest wait for Aravis to notice that a camera does not answer its heartbeat; Aravis needs less.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(15);

/// Held while a camera is opened. The parser of libaravis 0.8.26 for a camera's description must not run in two threads at once (seen:
/// one thread frees the nodes of the other).
static OPENING: Mutex<()> = Mutex::new(());

/// A camera that is open and configured.
pub(super) struct AravisCamera {
    settings: AravisSettings,
    identity: String,
    /// `None` for a camera that is not on a network.
    hardware_address: Option<MacAddress>,
    /// `None` after a loss until the camera is opened again.
    open: Option<Open>,
    /// Shared with other threads.
    link_state: Arc<Mutex<LinkState>>,
    armed: Option<Armed>,
    /// Counters of the streams before the present one.
    counted: StreamCounters,
}

/// An open device.
struct Open {
    camera: aravis::Camera,
    /// `None` for a camera that is not on a network.
    hardware_address: Option<MacAddress>,
    clock: Option<CameraClock>,
    control_lost: Arc<AtomicBool>,
    /// The features that change the picture, as they were once it was configured.
    values: features::Values,
}

/// Tells other threads whether the camera is there.
struct LinkState {
    /// The flag of the device that is open now.
    control_lost: Arc<AtomicBool>,
    /// Since when a request has been waiting for its answer.
    asked: Option<Instant>,
}

/// A control channel answers within milliseconds. Aravis repeats a request every 500 ms for some three seconds before it gives up. A
/// camera that has been silent for this time, one repetition included, is shown as lost meanwhile.
const SLOW_ANSWER: Duration = Duration::from_millis(750);

/// The outcome of one trigger.
enum Attempt {
    /// A frame was accepted.
    Taken(Grabbed),
    /// A frame came and was not accepted.
    Refused(String),
    /// No frame came.
    Nothing(String),
}

/// Whether to wait for a camera that another program controls.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Predecessor {
    /// Wait: a crashed program loses the camera when its heartbeat times out.
    MayHaveCrashed,
    NotWaitedFor,
}

impl Open {
    fn new(settings: &AravisSettings, predecessor: Predecessor) -> Result<(Self, String), DeviceError> {
        let opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let camera = find::find(&settings.select)?;
        drop(opening);
        let control_lost = Arc::new(AtomicBool::new(false));
        let mut clock = None;
        if let Some(device) = camera.device() {
            if let Some(gv) = device.downcast_ref::<GvDevice>() {
                // If another program, or a crashed predecessor, controls the camera, it can be read but not driven.
                let ours = gv.is_controller() || (predecessor == Predecessor::MayHaveCrashed && inherits(gv));
                if !ours {
                    close_in_background(
                        None,
                        Some(Self { camera, hardware_address: None, clock, control_lost, values: features::Values::new() }),
                    );
                    return Err(DeviceError::NotController { address: settings.select.to_string() });
                }
                clock = CameraClock::of(gv);
            }
            let flag = Arc::clone(&control_lost);
            device.connect_control_lost(move |_| flag.store(true, Ordering::Release));
        }
        let mut open = Self { camera, hardware_address: None, clock, control_lost, values: features::Values::new() };
        let configured = open.identify().and_then(|identity| {
            let hardware_address = open.read_hardware_address()?;
            configure::configure(&open.camera, settings)?;
            Ok((identity, hardware_address, features::values(&open.camera, settings)?))
        });
        let identity = match configured {
            Ok((identity, hardware_address, values)) => {
                (open.hardware_address, open.values) = (hardware_address, values);
                identity
            }
            Err(error) => {
                let error = open.judged(error);
                // A camera that was lost meanwhile must be closed in the background.
                close_in_background(None, error.is_loss_of_camera().then_some(open));
                return Err(error);
            }
        };
        if open.clock.is_none() {
            tracing::warn!(identity, "this camera's clock cannot be read: late frames are recognised by their numbers only");
        }
        tracing::info!(identity, select = %settings.select, "camera opened");
        Ok((open, identity))
    }

    /// Vendor, model and serial number.
    fn identify(&self) -> Result<String, DeviceError> {
        let camera = &self.camera;
        let said = |what: &str, text: Result<glib::GString, glib::Error>| text.map_err(|e| refused(what, &e));
        Ok(format!(
            "{} {} ({})",
            said("the vendor's name", camera.vendor_name())?,
            said("the model's name", camera.model_name())?,
            said("the serial number", camera.device_serial_number())?
        ))
    }

    fn read_hardware_address(&self) -> Result<Option<MacAddress>, DeviceError> {
        let read = |gv: GvDevice| {
            let [high, low] = HARDWARE_ADDRESS.map(|register| gv.read_register(register));
            Ok(MacAddress::of_registers(high?.1, low?.1))
        };
        self.gv().map(read).transpose().map_err(|e: glib::Error| refused("its hardware address", &e))
    }

    fn is_lost(&self) -> bool {
        self.control_lost.load(Ordering::Acquire)
    }

    fn gv(&self) -> Option<GvDevice> {
        self.camera.device()?.downcast().ok()
    }

    fn answers(&self) -> bool {
        self.gv().is_none_or(|gv| gv.read_register(HEARTBEAT).is_ok())
    }

    /// The error of a request. Aravis may report a camera that does not answer as one that lacks something.
    fn judged(&self, error: DeviceError) -> DeviceError {
        match error {
            DeviceError::Camera { what, why } if !self.answers() => DeviceError::CameraSilent { request: what, why },
            error => error,
        }
    }

    /// The camera's time now, ns; `None` without a clock.
    fn now_ns(&self) -> Result<Option<u64>, glib::Error> {
        self.clock.zip(self.gv()).map(|(clock, gv)| clock.now_ns(&gv)).transpose()
    }
}

/// A camera with its hardware address: not every maker gives each camera a serial number of its own.
fn described(identity: &str, hardware_address: Option<MacAddress>) -> String {
    hardware_address.map_or_else(|| identity.to_owned(), |address| format!("{identity}, hardware address {address}"))
}

/// Waits for as long as a crashed controller can hold the camera. True if this program then controls it.
fn inherits(gv: &GvDevice) -> bool {
    let Ok((_, heartbeat_ms)) = gv.read_register(HEARTBEAT) else { return false };
    let until = Instant::now() + Duration::from_millis(heartbeat_ms.into()) + HEARTBEAT_SLACK;
    tracing::info!(heartbeat_ms, "the camera is controlled by another program; waiting until that program may have lost it");
    while gv.take_control().is_err() {
        if Instant::now() >= until {
            return false;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    true
}

impl AravisCamera {
    /// Opens and configures a camera.
    pub fn open(settings: AravisSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let (open, identity) = Open::new(&settings, Predecessor::MayHaveCrashed)?;
        warn_of_a_small_receive_buffer(settings.socket_buffer_bytes);
        let link_state = Arc::new(Mutex::new(LinkState { control_lost: Arc::clone(&open.control_lost), asked: None }));
        let hardware_address = open.hardware_address;
        Ok(Self { settings, identity, hardware_address, open: Some(open), link_state, armed: None, counted: StreamCounters::default() })
    }

    fn device(&self) -> Result<&Open, DeviceError> {
        self.open.as_ref().filter(|open| !open.is_lost()).ok_or(DeviceError::ControlLost)
    }

    /// Notes that the camera is lost, if an error says so.
    fn noted(&self, error: DeviceError) -> DeviceError {
        let error = self.open.iter().fold(error, |error, open| open.judged(error));
        if error.is_loss_of_camera() {
            self.note_loss();
        }
        error
    }

    /// Compares the features that change the picture with those of the configured camera, and sets back what differs.
    fn held(&self, which: features::Which) -> Result<(), DeviceError> {
        let open = self.device()?;
        features::hold(&open.camera, &open.values, which).map_err(|e| self.noted(e))
    }

    /// Brings the features back to the configuration before an acquisition.
    fn settle(&self) -> Result<(), DeviceError> {
        match self.held(features::Which::All) {
            Err(DeviceError::CameraChanged { name, expected, found }) => {
                tracing::warn!(name, expected, found, "a feature of the camera was changed; it is set back");
            }
            settled => return settled,
        }
        self.held(features::Which::All).map_err(|error| match error {
            DeviceError::CameraChanged { name, expected, found } => {
                let why = format!("it was {expected} when the camera was opened, and cannot be set back");
                DeviceError::Camera { what: format!("{name} = {found}"), why }
            }
            error => error,
        })
    }

    fn failed(&self, request: &str, error: &glib::Error) -> DeviceError {
        self.noted(refused(request, error))
    }

    fn link_state(&self) -> std::sync::MutexGuard<'_, LinkState> {
        self.link_state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note_loss(&self) {
        if let Some(open) = &self.open {
            open.control_lost.store(true, Ordering::Release);
        }
    }

    /// Triggers, if the trigger is a software trigger. Returns the camera time, ns, from which on a frame belongs to this view; `None`
    /// without a clock.
    fn trigger(&self) -> Result<Option<u64>, DeviceError> {
        let open = self.device()?;
        let now_ns = open.now_ns().map_err(|e| self.failed("a look at its clock", &e))?;
        if self.settings.trigger == Trigger::Software {
            open.camera.software_trigger().map_err(|e| self.failed("the software trigger", &e))?;
            return Ok(now_ns);
        }
        // Other frames come without a request. The timestamp may lie anywhere in the exposure, so the whole exposure must come after now.
        Ok(now_ns.map(|ns| ns + (self.settings.exposure_us * 1e3) as u64))
    }

    /// Triggers once and waits for the frame, at most until `until`. A frame counts if it was exposed after `since_ns` of the camera's
    /// clock. That is the first trigger of the same grab: the axis rests since then, so a late frame of an earlier trigger of this grab is
    /// right.
    fn attempt(&mut self, until: Instant, since_ns: &mut Option<u64>) -> Result<Attempt, DeviceError> {
        self.device()?;
        let began = Instant::now();
        let late = began + self.settings.frame_timeout();
        let has_clock = self.device()?.clock.is_some();
        let armed = self.armed.as_mut().ok_or(DeviceError::NotArmed)?;
        if since_ns.is_none() {
            armed.drop_outstanding(late);
        }
        self.link_state().asked = Some(Instant::now());
        let triggered = self.trigger();
        self.link_state().asked = None;
        let now_ns = triggered?;
        *since_ns = since_ns.or(now_ns);
        let trigger_ms = began.elapsed().as_secs_f64() * 1e3;
        let until = until.min(Instant::now() + self.settings.frame_timeout());
        let armed = self.armed.as_mut().ok_or(DeviceError::NotArmed)?;
        let mut passed_over = String::new();
        loop {
            let Some(buffer) = armed.pop(until.saturating_duration_since(Instant::now())) else {
                armed.outstanding += u32::from(!has_clock);
                let waited = began.elapsed().as_millis();
                return Ok(Attempt::Nothing(format!("nothing came within {waited} ms{passed_over}")));
            };
            let verdict = accept(&buffer, &self.settings, armed.last_frame_id, *since_ns);
            armed.give_back(buffer);
            match verdict {
                Verdict::Taken { frame, frame_id } => {
                    armed.last_frame_id = Some(frame_id);
                    return Ok(Attempt::Taken(Grabbed { frame, frame_id, attempts: 1, trigger_ms }));
                }
                Verdict::Stale(why) => {
                    tracing::debug!(why, "a frame is ignored");
                    passed_over = format!(", but {why}");
                }
                Verdict::Lost(why) => return Ok(Attempt::Refused(why)),
            }
        }
    }

    /// Closes the device.
    fn close(&mut self) {
        self.counted = self.counters();
        close_in_background(self.armed.take(), self.open.take());
    }
}

/// How often the camera's clock is read for one comparison with this computer's.
const CLOCK_READINGS: u32 = 5;

impl Camera for AravisCamera {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn features(&self) -> std::collections::BTreeMap<String, String> {
        self.open.as_ref().map(|open| open.values.clone()).unwrap_or_default()
    }

    fn check_features(&mut self) -> Result<(), DeviceError> {
        self.held(features::Which::All)
    }

    fn link(&self) -> Link {
        let state = Arc::clone(&self.link_state);
        Link::new(move || {
            let state = state.lock().unwrap_or_else(PoisonError::into_inner);
            state.control_lost.load(Ordering::Acquire) || state.asked.is_some_and(|asked| asked.elapsed() > SLOW_ANSWER)
        })
    }

    fn reopen(&mut self) -> Result<(), DeviceError> {
        if !self.is_lost() {
            return Ok(());
        }
        self.close();
        let (open, identity) = Open::new(&self.settings, Predecessor::NotWaitedFor)?;
        if (&identity, open.hardware_address) != (&self.identity, self.hardware_address) {
            let found = described(&identity, open.hardware_address);
            close_in_background(None, Some(open));
            return Err(DeviceError::OtherCamera { expected: described(&self.identity, self.hardware_address), found });
        }
        self.link_state().control_lost = Arc::clone(&open.control_lost);
        self.open = Some(open);
        Ok(())
    }

    fn arm(&mut self) -> Result<(), DeviceError> {
        if self.armed.is_some() && !self.is_lost() {
            self.disarm()?;
        }
        self.reopen()?;
        self.settle()?;
        self.armed = Some(Armed::start(&self.device()?.camera, &self.settings, stream::BUFFERS).map_err(|e| self.noted(e))?);
        Ok(())
    }

    fn grab(&mut self, deadline: Duration) -> Result<Grabbed, DeviceError> {
        let began = Instant::now();
        let until = began + deadline;
        let mut attempts = 0;
        let mut since_ns = None;
        // Why the last frame was refused. The last trigger may have had no time left for a frame.
        let mut refused = None;
        loop {
            let ignored = self.counters().ignored_packets;
            attempts += 1;
            let last = match self.attempt(until, &mut since_ns)? {
                Attempt::Taken(grabbed) => {
                    self.held(features::Which::OfEveryFrame)?;
                    return Ok(Grabbed { attempts, ..grabbed });
                }
                Attempt::Refused(why) => {
                    refused = Some((attempts, why.clone()));
                    why
                }
                Attempt::Nothing(why) => why,
            };
            tracing::warn!(attempts, why = last, "frame lost");
            // The remaining time must be long enough for a frame. A last short attempt would only hide why the others failed.
            if Instant::now() + self.settings.frame_timeout() / 8 >= until {
                let last = match refused {
                    Some((attempt, why)) if attempt < attempts => format!("{last}; the frame of trigger {attempt} was refused: {why}"),
                    _ => last,
                };
                return Err(DeviceError::NoFrame { waited_ms: began.elapsed().as_millis(), attempts, last });
            }
            if self.counters().ignored_packets > ignored {
                tracing::warn!("the stream ignores packets; it is renewed");
                self.arm()?;
            }
        }
    }

    fn highest_rate_hz(&mut self) -> Result<Option<f64>, DeviceError> {
        free_run::highest_rate_hz(self.device()?).map_err(|e| self.noted(e))
    }

    fn stream(&mut self, plan: &StreamPlan, sink: FrameSink<'_>) -> Result<StreamEnd, DeviceError> {
        self.run_free(plan, sink)
    }

    fn counters(&self) -> StreamCounters {
        let now = self.armed.as_ref().map(Armed::counters).unwrap_or_default();
        let before = self.counted;
        StreamCounters {
            completed: before.completed + now.completed,
            failed: before.failed + now.failed,
            underrun: before.underrun + now.underrun,
            resent_packets: before.resent_packets + now.resent_packets,
            missing_packets: before.missing_packets + now.missing_packets,
            ignored_packets: before.ignored_packets + now.ignored_packets,
        }
    }

    /// The shortest of some exchanges: another program on this computer may have delayed the others.
    fn clock(&mut self) -> Result<Option<ClockReading>, DeviceError> {
        let open = self.device()?;
        let mut shortest: Option<(Duration, ClockReading)> = None;
        for _ in 0..CLOCK_READINGS {
            let began = Instant::now();
            let Some(camera_ns) = open.now_ns().map_err(|e| self.failed("a look at its clock", &e))? else { return Ok(None) };
            let took = began.elapsed();
            if shortest.is_none_or(|(least, _)| took < least) {
                let camera_ns = free_run::without_highest_bit(camera_ns);
                shortest = Some((took, ClockReading { camera_ns, host: began + took / 2, scale: self.settings.time_scale }));
            }
        }
        Ok(shortest.map(|(_, reading)| reading))
    }

    fn disarm(&mut self) -> Result<(), DeviceError> {
        if self.is_lost() {
            self.close();
            return Err(DeviceError::ControlLost);
        }
        self.counted = self.counters();
        let Some(armed) = self.armed.take() else { return Ok(()) };
        let stopped = self.device()?.camera.stop_acquisition().map_err(|e| self.failed("AcquisitionStop", &e));
        drop(armed);
        stopped
    }
}

impl Drop for AravisCamera {
    fn drop(&mut self) {
        if self.is_lost() {
            return self.close();
        }
        let disarmed = self.disarm();
        // The loss of a device may not have been noticed yet.
        let there = self.open.as_ref().is_none_or(Open::answers);
        if let Err(e) = &disarmed {
            tracing::warn!(error = %e, "camera could not be disarmed");
        }
        if disarmed.is_err() || !there {
            self.close();
        }
    }
}

/// The error of a request. Without an answer the camera is lost, because Aravis has repeated the request by itself. A denied request means
/// that the camera has another controller, or has dropped this one. Everything else is a refused value.
fn refused(what: &str, error: &glib::Error) -> DeviceError {
    let why = error.message();
    if error.matches(aravis::DeviceError::Timeout) {
        return DeviceError::CameraSilent { request: what.into(), why: why.into() };
    }
    // Aravis has no error code for it.
    if why.contains("access-denied") {
        return DeviceError::ControlLost;
    }
    DeviceError::Camera { what: what.into(), why: why.into() }
}

/// Closes a camera that does not answer, without waiting for it. Aravis' heartbeat thread reports the loss of control after some seconds.
/// This must not happen while the device is being freed (seen: a segmentation fault), so the device is kept until then.
fn close_in_background(armed: Option<Armed>, open: Option<Open>) {
    let work = move || {
        drop(armed);
        let until = Instant::now() + CLOSE_TIMEOUT;
        while open.as_ref().and_then(Open::gv).is_some_and(|gv| gv.is_controller()) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
        drop(open);
    };
    // If no thread can be started the device is dropped here, which blocks for seconds.
    let _ = std::thread::Builder::new().name("camera-close".into()).spawn(work);
}

/// The kernel limits a receive buffer without an error, and most frames are then lost.
fn warn_of_a_small_receive_buffer(wanted: u32) {
    let limit = std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok().and_then(|text| text.trim().parse::<u64>().ok());
    if let Some(limit) = limit.filter(|limit| *limit < u64::from(wanted)) {
        tracing::warn!(limit, wanted, "net.core.rmem_max is below socket_buffer_bytes; raise it with sysctl, or frames will be lost");
    }
}

#[cfg(test)]
mod tests;
