//! A GigE Vision camera through libaravis.
//!
//! ```text
//! rig worker ── arm ──► new stream, 8 buffers, one acquisition
//!            ── grab ─► drain ─► TriggerSoftware ─► pop ─► whole and as configured? ─► frame
//!                          ▲                                  │ no, or nothing came
//!                          └──────────── again, until the deadline ◄───┘
//! aravis' own thread ── control-lost ──► a flag, nothing else
//! ```
//! Aravis' objects may move between threads but not be shared: the rig worker, which blocks anyway, owns them all.
//!
//! - A stream drops without a word every frame whose number is at most 100 behind its last one, so each acquisition gets
//!   a stream of its own; a rising count of ignored packets renews it.
//! - `BufferStatus::Success` alone does not mean a whole image: size, geometry and format are looked at too.
//! - A frame that comes after its wait has ended shows an older place of the axis. Such frames are owed, and before the
//!   next trigger they are waited for and dropped.
//! - Taking apart a camera that does not answer blocks for seconds, so a thread of its own does it.

use super::{AravisSettings, CameraSelect};
use crate::device::{Camera, DeviceError, Grabbed, StreamCounters};
use crate::frame::{PixelFormat, RawFrame};
use aravis::glib;
use aravis::glib::prelude::Cast;
use aravis::prelude::*;
use aravis::{AcquisitionMode, RangeCheckPolicy};
use aravis::{BufferPayloadType, BufferStatus, GvDevice, GvStream, GvStreamOption, GvStreamPacketResend, GvStreamSocketBuffer};
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Buffers of a stream: one is filled at a time, the others hold late and repeated frames until the next drain.
const BUFFERS: usize = 8;
/// GigE Vision's control port.
const GVCP_PORT: u16 = 3956;

/// Held while a camera is opened: libaravis 0.8.26 reads a camera's description with a parser that two threads must not
/// enter at once (seen: its nodes freed under it).
static OPENING: Mutex<()> = Mutex::new(());

/// A camera that is open and configured.
pub(super) struct AravisCamera {
    settings: AravisSettings,
    identity: String,
    /// Absent only while it is taken apart.
    camera: Option<aravis::Camera>,
    armed: Option<Armed>,
    control_lost: Arc<AtomicBool>,
    /// What the streams before the present one counted.
    counted: StreamCounters,
}

/// One acquisition and its stream.
struct Armed {
    stream: aravis::Stream,
    last_frame_id: Option<u64>,
    /// Triggers whose frames have not come.
    owed: u32,
}

/// What became of one trigger.
enum Attempt {
    Taken { frame: RawFrame, frame_id: u64 },
    Lost(String),
}

impl AravisCamera {
    pub fn open(settings: AravisSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let opening = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        let camera = find(&settings.select)?;
        drop(opening);
        let control_lost = Arc::new(AtomicBool::new(false));
        if let Some(device) = camera.device() {
            // Another client, or a predecessor that crashed, may own the camera: it can then be read, not driven.
            if device.downcast_ref::<GvDevice>().is_some_and(|gv| !gv.is_controller()) {
                return Err(DeviceError::NotController { address: settings.select.to_string() });
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
        configure(&camera, &settings)?;
        warn_of_a_small_receive_buffer(settings.socket_buffer_bytes);
        tracing::info!(identity, select = %settings.select, "camera opened");
        Ok(Self { settings, identity, camera: Some(camera), armed: None, control_lost, counted: StreamCounters::default() })
    }

    fn camera(&self) -> Result<&aravis::Camera, DeviceError> {
        self.camera.as_ref().ok_or(DeviceError::ControlLost)
    }

    fn unless_lost(&self) -> Result<(), DeviceError> {
        if self.control_lost.load(Ordering::Acquire) { Err(DeviceError::ControlLost) } else { Ok(()) }
    }

    /// Triggers once and waits for the frame, at most until `until`.
    fn attempt(&mut self, until: Instant) -> Result<Attempt, DeviceError> {
        self.unless_lost()?;
        let late = Instant::now() + self.settings.frame_timeout();
        self.armed.as_mut().ok_or(DeviceError::NotArmed)?.drop_what_is_owed(late);
        if let Err(e) = self.camera()?.software_trigger() {
            if !e.matches(aravis::DeviceError::Timeout) {
                return Err(refused("TriggerSoftware", &e));
            }
            // The control channel repeats a request by itself; once it gives up nobody is there.
            self.control_lost.store(true, Ordering::Release);
            return Err(DeviceError::Gone { device: "camera", why: format!("no answer to the software trigger: {}", e.message()) });
        }
        let wait = until.saturating_duration_since(Instant::now()).min(self.settings.frame_timeout());
        let armed = self.armed.as_mut().ok_or(DeviceError::NotArmed)?;
        let Some(buffer) = armed.pop(wait) else {
            armed.owed += 1;
            return Ok(Attempt::Lost(format!("nothing came within {} ms", wait.as_millis())));
        };
        let verdict = accept(&buffer, &self.settings, armed.last_frame_id);
        armed.stream.push_buffer(buffer);
        if let Attempt::Taken { frame_id, .. } = verdict {
            armed.last_frame_id = Some(frame_id);
        }
        Ok(verdict)
    }
}

impl Camera for AravisCamera {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn arm(&mut self) -> Result<(), DeviceError> {
        if self.armed.is_some() {
            self.disarm()?;
        }
        self.unless_lost()?;
        if let Some(gv) = self.camera()?.device().as_ref().and_then(|d| d.downcast_ref::<GvDevice>()) {
            let packets = if self.settings.packet_socket { GvStreamOption::NONE } else { GvStreamOption::PACKET_SOCKET_DISABLED };
            gv.set_stream_options(packets);
        }
        let stream = self.camera()?.create_stream().map_err(|e| refused("a stream", &e))?;
        if let Some(gv) = stream.downcast_ref::<GvStream>() {
            gv.set_socket_buffer(GvStreamSocketBuffer::Fixed);
            // Checked with the settings: it fits.
            gv.set_socket_buffer_size(self.settings.socket_buffer_bytes as i32);
            gv.set_packet_resend(if self.settings.resend { GvStreamPacketResend::Always } else { GvStreamPacketResend::Never });
        }
        for _ in 0..BUFFERS {
            stream.push_buffer(aravis::Buffer::new_allocate(self.settings.frame_bytes()));
        }
        self.camera()?.start_acquisition().map_err(|e| refused("AcquisitionStart", &e))?;
        self.armed = Some(Armed { stream, last_frame_id: None, owed: 0 });
        Ok(())
    }

    fn grab(&mut self, deadline: Duration) -> Result<Grabbed, DeviceError> {
        let began = Instant::now();
        let until = began + deadline;
        let mut attempts = 0;
        loop {
            let ignored = self.counters().ignored_packets;
            attempts += 1;
            let last = match self.attempt(until)? {
                Attempt::Taken { frame, frame_id } => return Ok(Grabbed { frame, frame_id, attempts }),
                Attempt::Lost(why) => why,
            };
            tracing::warn!(attempts, why = last, "frame lost");
            if Instant::now() >= until {
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
        self.counted = self.counters();
        let Some(armed) = self.armed.take() else { return Ok(()) };
        if self.control_lost.load(Ordering::Acquire) {
            take_apart(armed);
            return Err(DeviceError::ControlLost);
        }
        let stopped = self.camera()?.stop_acquisition().map_err(|e| refused("AcquisitionStop", &e));
        drop(armed);
        stopped
    }
}

impl Drop for AravisCamera {
    fn drop(&mut self) {
        let lost = self.control_lost.load(Ordering::Acquire);
        if !lost && let Err(e) = self.disarm() {
            tracing::warn!(error = %e, "camera could not be disarmed");
        }
        if lost {
            take_apart((self.armed.take(), self.camera.take()));
        }
    }
}

impl Armed {
    fn pop(&self, wait: Duration) -> Option<aravis::Buffer> {
        self.stream.timeout_pop_buffer(wait.as_micros() as u64)
    }

    /// Waits for the frames of earlier triggers and forgets them, then empties the queue.
    fn drop_what_is_owed(&mut self, until: Instant) {
        while self.owed > 0
            && let Some(late) = self.pop(until.saturating_duration_since(Instant::now()))
        {
            self.owed -= 1;
            self.stream.push_buffer(late);
        }
        self.owed = 0;
        while let Some(stale) = self.stream.try_pop_buffer() {
            self.stream.push_buffer(stale);
        }
    }

    fn counters(&self) -> StreamCounters {
        let (completed, failed, underrun) = self.stream.statistics();
        let (resent_packets, missing_packets) = self.stream.downcast_ref::<GvStream>().map(GvStream::statistics).unwrap_or_default();
        let ignored_packets = self.stream.info_uint64_by_name("n_ignored_packets");
        StreamCounters { completed, failed, underrun, resent_packets, missing_packets, ignored_packets }
    }
}

/// The acceptance rule: complete, an image, of the configured geometry, format and size, and not the last one again.
fn accept(buffer: &aravis::Buffer, settings: &AravisSettings, last_frame_id: Option<u64>) -> Attempt {
    let status = buffer.status();
    if status != BufferStatus::Success {
        return Attempt::Lost(format!("the frame is not whole ({status:?})"));
    }
    let payload = buffer.payload_type();
    if payload != BufferPayloadType::Image {
        return Attempt::Lost(format!("not an image ({payload:?})"));
    }
    let (x, y, width, height) = buffer.image_region();
    let format = buffer.image_pixel_format();
    let expected = [settings.width, settings.height, settings.offset_x, settings.offset_y].map(i64::from);
    let found = [width, height, x, y].map(i64::from);
    if found != expected || format != on_the_wire(settings.pixel_format) {
        return Attempt::Lost(format!(
            "expected {} of width, height, x, y {expected:?}, got format {:#010x} of {found:?}",
            settings.pixel_format.name(),
            format.raw()
        ));
    }
    let frame_id = buffer.frame_id();
    if last_frame_id == Some(frame_id) {
        return Attempt::Lost(format!("frame {frame_id} came again"));
    }
    match RawFrame::new(settings.width, settings.height, settings.pixel_format, buffer.image_data()) {
        Ok(frame) => Attempt::Taken { frame, frame_id },
        Err(e) => Attempt::Lost(e.to_string()),
    }
}

fn on_the_wire(format: PixelFormat) -> aravis::PixelFormat {
    match format {
        PixelFormat::Mono8 => aravis::PixelFormat::MONO_8,
        PixelFormat::BayerRG8 => aravis::PixelFormat::BAYER_RG_8,
        PixelFormat::RGB8Packed => aravis::PixelFormat::RGB_8_PACKED,
    }
}

fn refused(what: &str, error: &glib::Error) -> DeviceError {
    DeviceError::Camera { what: what.into(), why: error.message().into() }
}

/// Sets everything the configuration names and reads back what decides over a frame's layout.
fn configure(camera: &aravis::Camera, settings: &AravisSettings) -> Result<(), DeviceError> {
    // Without it a value out of range is accepted and ignored.
    camera.set_range_check_policy(RangeCheckPolicy::Enable);
    if let Some(device) = camera.device() {
        for (name, value) in &settings.features {
            let what = || format!("{name} = {value}");
            device.set_features_from_string(&format!("{name}={value}")).map_err(|e| refused(&what(), &e))?;
        }
    }
    let format = settings.pixel_format.name();
    camera.set_pixel_format_from_string(format).map_err(|e| refused(&format!("PixelFormat = {format}"), &e))?;
    // The offsets first make room for the size, whatever the region was.
    for (name, value) in [
        ("OffsetX", 0),
        ("OffsetY", 0),
        ("Width", settings.width),
        ("Height", settings.height),
        ("OffsetX", settings.offset_x),
        ("OffsetY", settings.offset_y),
    ] {
        camera.set_integer(name, value.into()).map_err(|e| refused(&format!("{name} = {value}"), &e))?;
    }
    let exposure = settings.exposure_us;
    camera.set_exposure_time(exposure).map_err(|e| refused(&format!("exposure = {exposure} us"), &e))?;
    if let Some(gain) = settings.gain_raw {
        camera.set_integer("GainRaw", gain).map_err(|e| refused(&format!("GainRaw = {gain}"), &e))?;
    }
    let packet = settings.packet_size;
    camera.gv_set_packet_size(packet as i32).map_err(|e| refused(&format!("packet size = {packet}"), &e))?;
    camera.set_acquisition_mode(AcquisitionMode::Continuous).map_err(|e| refused("AcquisitionMode = Continuous", &e))?;
    // Last: setting a frame rate among the features would have switched the triggers off.
    camera.set_trigger("Software").map_err(|e| refused("TriggerSource = Software", &e))?;

    let payload = camera.payload().map_err(|e| refused("PayloadSize", &e))? as usize;
    let expected = settings.frame_bytes();
    if payload != expected {
        let why = format!("{} x {} {format} has {expected} bytes, the camera sends {payload}", settings.width, settings.height);
        return Err(DeviceError::Camera { what: "PayloadSize".into(), why });
    }
    Ok(())
}

fn find(select: &CameraSelect) -> Result<aravis::Camera, DeviceError> {
    let not_found = |why: String| DeviceError::Open {
        device: "camera",
        address: select.to_string(),
        why,
        remedy: "Check its power and cable; `arv-tool-0.8` lists the cameras that answer",
    };
    let opened = match select {
        CameraSelect::Address(address) => {
            let device = device_at(*address).map_err(not_found)?;
            aravis::Camera::with_device(&device)
        }
        CameraSelect::Id(id) => aravis::Camera::new(Some(id)),
        CameraSelect::Serial(serial) => {
            let id = id_of_serial(serial).ok_or_else(|| not_found("no camera with this serial number answers".into()))?;
            aravis::Camera::new(Some(&id))
        }
    };
    opened.map_err(|e| not_found(e.message().into()))
}

/// Opens the device at an address without any discovery, through the interface that leads there.
fn device_at(address: Ipv4Addr) -> Result<GvDevice, String> {
    // Connecting a datagram socket sends nothing; it makes the kernel choose the way.
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(|e| e.to_string())?;
    socket.connect((address, GVCP_PORT)).map_err(|e| e.to_string())?;
    let here = socket.local_addr().map_err(|e| e.to_string())?.ip();
    let inet = |text: String| gio::InetAddress::from_string(&text).ok_or(format!("{text} is not an address"));
    GvDevice::new(&inet(here.to_string())?, &inet(address.to_string())?).map_err(|e| e.message().to_owned())
}

/// The id under which Aravis knows the camera with a serial number.
#[allow(unsafe_code)]
fn id_of_serial(serial: &str) -> Option<String> {
    let text = |pointer: *const std::ffi::c_char| {
        // SAFETY: the list functions return null or a NUL-terminated string that lives until the next update of the
        // list; it is copied before anything else is called.
        (!pointer.is_null()).then(|| unsafe { std::ffi::CStr::from_ptr(pointer) }.to_string_lossy().into_owned())
    };
    // SAFETY: takes no argument; the library locks its list.
    unsafe { aravis_sys::arv_update_device_list() };
    // SAFETY: as above.
    let devices = unsafe { aravis_sys::arv_get_n_devices() };
    (0..devices).find_map(|index| {
        // SAFETY: any index is allowed, one beyond the list gives null.
        let found = text(unsafe { aravis_sys::arv_get_device_serial_nbr(index) })?;
        // SAFETY: as above.
        (found == serial).then(|| text(unsafe { aravis_sys::arv_get_device_id(index) })).flatten()
    })
}

/// Lets go of objects whose device does not answer, without waiting for it.
fn take_apart(objects: impl Send + 'static) {
    let name = "camera-take-apart".to_owned();
    // Without a thread they are dropped here, only slower.
    let _ = std::thread::Builder::new().name(name).spawn(move || drop(objects));
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
