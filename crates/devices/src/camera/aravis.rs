//! A GigE Vision camera through libaravis.
//!
//! ```text
//! rig worker ── arm ──► new stream, 8 buffers, one acquisition
//!            ── grab ─► drain ─► camera's time ─► TriggerSoftware ─► pop ─► whole, as configured, not older? ─► frame
//!                          ▲                                                  │ no, or nothing came
//!                          └──────────── again, until the deadline ◄──────────┘
//! aravis' own thread ── control-lost ──► a flag, nothing else
//! ```
//! Aravis' objects may move between threads but not be shared: the rig worker, which blocks anyway, owns them all.
//!
//! - A stream drops without a word every frame whose number is at most 100 behind its last one, so each acquisition gets
//!   a stream of its own; a rising count of ignored packets renews it.
//! - `BufferStatus::Success` alone does not mean a whole image: size, geometry and format are looked at too.
//! - A frame that was exposed before its view was asked for shows an older place of the axis. Its stamp by the camera's clock tells
//!   it; where the camera has no clock, frames that are owed are waited for and dropped before the next trigger.
//! - Taking apart a camera that does not answer blocks for seconds, so a thread of its own does it.

mod accept;
mod clock;
mod configure;
mod find;
mod stream;

pub(super) use find::discover;

use super::{AravisSettings, CameraSelect, Trigger};
use crate::{Camera, DeviceError, Grabbed, Link, StreamCounters};
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

/// GigE Vision's register of the time after which a silent controller loses the camera, ms.
const HEARTBEAT: u64 = 0x938;
/// What a predecessor's last heartbeat may be late by.
const HEARTBEAT_SLACK: Duration = Duration::from_millis(500);

/// Longer than Aravis needs to find out that a camera does not answer its heartbeat.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(15);

/// Held while a camera is opened: libaravis 0.8.26 reads a camera's description with a parser that two threads must not
/// enter at once (seen: its nodes freed under it).
static OPENING: Mutex<()> = Mutex::new(());

/// A camera that is open and configured.
pub(super) struct AravisCamera {
    settings: AravisSettings,
    identity: String,
    /// Absent while it is taken apart, and after a loss until it is opened again.
    open: Option<Open>,
    /// What other threads may know.
    link_state: Arc<Mutex<LinkState>>,
    armed: Option<Armed>,
    /// What the streams before the present one counted.
    counted: StreamCounters,
}

/// The device as it was found once.
struct Open {
    camera: aravis::Camera,
    clock: Option<CameraClock>,
    control_lost: Arc<AtomicBool>,
}

/// What tells other threads whether the camera is there.
struct LinkState {
    /// The flag of what is open now.
    control_lost: Arc<AtomicBool>,
    /// Since when a request waits for its answer.
    asked: Option<Instant>,
}

/// A control channel answers within milliseconds. Aravis asks again for some three seconds before it gives up; until then a camera
/// that has been silent for so long is shown as lost.
const SLOW_ANSWER: Duration = Duration::from_secs(1);

/// What became of one trigger.
enum Attempt {
    Taken(Grabbed),
    /// A frame came and was not taken.
    Refused(String),
    /// No frame came.
    Nothing(String),
}

/// Whether a camera that another program controls is waited for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Predecessor {
    /// One that crashed loses the camera when its heartbeat runs out.
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
                // Another client, or a predecessor that crashed, may own the camera: it can then be read, not driven.
                let ours = gv.is_controller() || (predecessor == Predecessor::MayHaveCrashed && inherits(gv));
                if !ours {
                    take_apart(None, Some(Self { camera, clock, control_lost }));
                    return Err(DeviceError::NotController { address: settings.select.to_string() });
                }
                clock = CameraClock::of(gv);
            }
            let flag = Arc::clone(&control_lost);
            device.connect_control_lost(move |_| flag.store(true, Ordering::Release));
        }
        let said = |what: &str, text: Result<glib::GString, glib::Error>| text.map_err(|e| refused(what, &e));
        let identity = format!(
            "{} {} ({})",
            said("the vendor's name", camera.vendor_name())?,
            said("the model's name", camera.model_name())?,
            said("the serial number", camera.device_serial_number())?
        );
        configure::configure(&camera, settings)?;
        if clock.is_none() {
            tracing::warn!(identity, "this camera's clock cannot be read: late frames are told by their numbers alone");
        }
        tracing::info!(identity, select = %settings.select, "camera opened");
        Ok((Self { camera, clock, control_lost }, identity))
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

    /// The camera's time now, where it has a clock.
    fn now_ns(&self) -> Result<Option<u64>, glib::Error> {
        self.clock.zip(self.gv()).map(|(clock, gv)| clock.now_ns(&gv)).transpose()
    }
}

/// Waits for as long as a controller that crashed can hold the camera; true once it is ours.
fn inherits(gv: &GvDevice) -> bool {
    let Ok((_, heartbeat_ms)) = gv.read_register(HEARTBEAT) else { return false };
    let until = Instant::now() + Duration::from_millis(heartbeat_ms.into()) + HEARTBEAT_SLACK;
    tracing::info!(heartbeat_ms, "the camera is controlled by another program; waiting whether that one is gone");
    while gv.take_control().is_err() {
        if Instant::now() >= until {
            return false;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    true
}

impl AravisCamera {
    pub fn open(settings: AravisSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let (open, identity) = Open::new(&settings, Predecessor::MayHaveCrashed)?;
        warn_of_a_small_receive_buffer(settings.socket_buffer_bytes);
        let link_state = Arc::new(Mutex::new(LinkState { control_lost: Arc::clone(&open.control_lost), asked: None }));
        Ok(Self { settings, identity, open: Some(open), link_state, armed: None, counted: StreamCounters::default() })
    }

    fn device(&self) -> Result<&Open, DeviceError> {
        self.open.as_ref().filter(|open| !open.is_lost()).ok_or(DeviceError::ControlLost)
    }

    /// A request that is not answered means that nobody is there: the control channel repeats it by itself before it gives up. One
    /// that is denied means that the camera has another controller, or has forgotten that it had us.
    fn failed(&self, request: &str, error: &glib::Error) -> DeviceError {
        let silent = error.matches(aravis::DeviceError::Timeout);
        // Aravis has no code of its own for it.
        let denied = error.message().contains("access-denied");
        if silent || denied {
            self.note_loss();
        }
        match (silent, denied) {
            (true, _) => DeviceError::CameraSilent { request: request.into(), why: error.message().into() },
            (_, true) => DeviceError::ControlLost,
            _ => refused(request, error),
        }
    }

    fn link_state(&self) -> std::sync::MutexGuard<'_, LinkState> {
        self.link_state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note_loss(&self) {
        if let Some(open) = &self.open {
            open.control_lost.store(true, Ordering::Release);
        }
    }

    /// Triggers, where that is ours to do; by the camera's clock, a frame since then is of now.
    fn trigger(&self) -> Result<Option<u64>, DeviceError> {
        let open = self.device()?;
        let now_ns = open.now_ns().map_err(|e| self.failed("a look at its clock", &e))?;
        if self.settings.trigger == Trigger::Software {
            open.camera.software_trigger().map_err(|e| self.failed("the software trigger", &e))?;
            return Ok(now_ns);
        }
        // Such frames come by themselves: only one whose whole exposure lies after now is of now, wherever in it the stamp is.
        Ok(now_ns.map(|ns| ns + (self.settings.exposure_us * 1e3) as u64))
    }

    /// Triggers once and waits for the frame, at most until `until`.
    /// A frame counts that was exposed since `since_ns` of the camera's clock: since the first trigger of the same grab, all the while the
    /// axis stands, so that a late frame of an earlier one of them is as good.
    fn attempt(&mut self, until: Instant, since_ns: &mut Option<u64>) -> Result<Attempt, DeviceError> {
        self.device()?;
        let began = Instant::now();
        let late = began + self.settings.frame_timeout();
        let has_clock = self.device()?.clock.is_some();
        let armed = self.armed.as_mut().ok_or(DeviceError::NotArmed)?;
        if since_ns.is_none() {
            armed.drop_what_is_owed(late);
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
                armed.owed += u32::from(!has_clock);
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
                    tracing::debug!(why, "a frame is passed over");
                    passed_over = format!(", but {why}");
                }
                Verdict::Lost(why) => return Ok(Attempt::Refused(why)),
            }
        }
    }

    /// Takes what is left of the device apart; nothing is open after it.
    fn let_go(&mut self) {
        self.counted = self.counters();
        take_apart(self.armed.take(), self.open.take());
    }
}

impl Camera for AravisCamera {
    fn identity(&self) -> &str {
        &self.identity
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
        self.let_go();
        let (open, identity) = Open::new(&self.settings, Predecessor::NotWaitedFor)?;
        if identity != self.identity {
            take_apart(None, Some(open));
            let why = format!("{identity} answers now; put the first one back, or start carved again");
            return Err(DeviceError::Camera { what: format!("expected {}", self.identity), why });
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
        self.armed = Some(Armed::start(&self.device()?.camera, &self.settings)?);
        Ok(())
    }

    fn grab(&mut self, deadline: Duration) -> Result<Grabbed, DeviceError> {
        let began = Instant::now();
        let until = began + deadline;
        let mut attempts = 0;
        let mut since_ns = None;
        // Of the last frame that came: the last trigger may have had no time left for one.
        let mut refused = None;
        loop {
            let ignored = self.counters().ignored_packets;
            attempts += 1;
            let last = match self.attempt(until, &mut since_ns)? {
                Attempt::Taken(grabbed) => return Ok(Grabbed { attempts, ..grabbed }),
                Attempt::Refused(why) => {
                    refused = Some((attempts, why.clone()));
                    why
                }
                Attempt::Nothing(why) => why,
            };
            tracing::warn!(attempts, why = last, "frame lost");
            // What is left must do for a frame: a last look of a moment would only hide why the others failed.
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

    fn disarm(&mut self) -> Result<(), DeviceError> {
        if self.is_lost() {
            self.let_go();
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
            return self.let_go();
        }
        let disarmed = self.disarm();
        // A device that went away without a word is as lost as one that is known to be.
        let there = self.open.as_ref().is_none_or(Open::answers);
        if let Err(e) = &disarmed {
            tracing::warn!(error = %e, "camera could not be disarmed");
        }
        if disarmed.is_err() || !there {
            self.let_go();
        }
    }
}

fn refused(what: &str, error: &glib::Error) -> DeviceError {
    DeviceError::Camera { what: what.into(), why: error.message().into() }
}

/// Lets go of a camera that does not answer, without waiting for it. Its heartbeat's thread tells that control is lost after some
/// seconds, and must not do so while the device is being freed (seen: a segmentation fault): the device is kept until it has.
fn take_apart(armed: Option<Armed>, open: Option<Open>) {
    let work = move || {
        drop(armed);
        let until = Instant::now() + CLOSE_TIMEOUT;
        while open.as_ref().and_then(Open::gv).is_some_and(|gv| gv.is_controller()) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
        drop(open);
    };
    // Without a thread they are dropped by the attempt to make one, only slower.
    let _ = std::thread::Builder::new().name("camera-take-apart".into()).spawn(work);
}

/// The kernel cuts a receive buffer to its limit without an error, and most frames are then lost.
fn warn_of_a_small_receive_buffer(wanted: u32) {
    let limit = std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok().and_then(|text| text.trim().parse::<u64>().ok());
    if let Some(limit) = limit.filter(|limit| *limit < u64::from(wanted)) {
        tracing::warn!(limit, wanted, "net.core.rmem_max is below socket_buffer_bytes; raise it with sysctl, or frames will be lost");
    }
}

#[cfg(test)]
mod tests;
