//! One emulated rig: a shaft, the firmware that turns it, the camera that looks at it.

use crate::bridge;
use crate::clock::RigClock;
use crate::gige::{CameraFaults, GigeCamera};
use crate::grbl;
use crate::motor_faults::MotorFaults;
use crate::relay::{self, Relay};
use crate::sampler::{SamplerSettings, VendorSampler};
use crate::serial::{Button, Firmware, SerialFaults, SerialPort};
use crate::shaft::{Shaft, ShaftSettings};
use crate::sight::{PixelFormat, Sight};
use crate::slide::{OnSlide, Slide, SlideSettings};
use crate::tmcl;
use crate::truth::ExposureRecord;
use crate::zaber;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

/// Which loopback address the camera takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CameraAddress {
    Fixed(Ipv4Addr),
    /// The first of 127.0.0.2 to 127.0.0.254 on which no other camera listens.
    #[default]
    FirstFree,
}

/// Which controller turns the shaft.
#[derive(Debug, Clone, PartialEq)]
pub enum Controller {
    Grbl(grbl::Settings),
    Bridge(bridge::Settings),
    GrblHal(grbl::Settings),
    /// A pair of motors on one Trinamic module.
    Tmcl(tmcl::Settings),
    Zaber(zaber::Settings),
}

impl Default for Controller {
    fn default() -> Self {
        Self::Grbl(grbl::Settings::default())
    }
}

impl Controller {
    fn firmware(
        self,
        shaft: Arc<Shaft>,
        slide: Option<Arc<Slide>>,
        sampler: Option<Arc<VendorSampler>>,
        faults: Arc<SerialFaults>,
        motors: &Arc<MotorFaults>,
    ) -> Box<dyn Firmware> {
        let grbl = |shaft, settings, dialect| grbl::Firmware::new(shaft, slide, faults, settings, dialect).with_sampler(sampler);
        match self {
            Self::Bridge(settings) => Box::new(bridge::Firmware::new(shaft, settings)),
            Self::Grbl(settings) => Box::new(grbl(shaft, settings, grbl::Dialect::Grbl)),
            Self::GrblHal(settings) => Box::new(grbl(shaft, settings, grbl::Dialect::GrblHal)),
            Self::Tmcl(settings) => Box::new(tmcl::Firmware::new(&shaft, motors, settings)),
            Self::Zaber(settings) => Box::new(zaber::Firmware::new(shaft, Arc::clone(motors), settings)),
        }
    }
}

/// What the rig is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct RigSettings {
    pub shaft: ShaftSettings,
    /// 1 is real time, 10 ten times as fast.
    pub time_scale: f64,
    pub camera: CameraAddress,
    /// What the camera sends until a host chooses otherwise.
    pub pixel_format: PixelFormat,
    /// Exposure at which frames are as bright as what the camera looks at, us; none makes them so at any exposure.
    pub nominal_exposure_us: Option<f32>,
    pub controller: Controller,
    /// What moves the capillary along, on the Y axis of a Grbl controller; none where nothing does.
    pub slide: Option<SlideSettings>,
    /// The vendor's sampler, on the probe input and the flood output of a Grbl controller; none where somebody else fills the capillary.
    pub sampler: Option<SamplerSettings>,
    /// A relay that turns the shaft as well, over TCP.
    pub relay: Option<relay::Settings>,
    /// A path that points to the serial port, whatever its device name; none gives the device name itself.
    pub serial_link: Option<PathBuf>,
}

impl Default for RigSettings {
    fn default() -> Self {
        Self {
            shaft: ShaftSettings::default(),
            time_scale: 1.0,
            camera: CameraAddress::default(),
            pixel_format: PixelFormat::BayerRG8,
            nominal_exposure_us: None,
            controller: Controller::default(),
            slide: None,
            sampler: None,
            relay: None,
            serial_link: None,
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum RigError {
    #[error("time scale {0} is not a positive number; 1 is real time, 10 ten times as fast")]
    TimeScale(f64),
    #[error("{steps}/{revolutions} steps per revolution is no ratio of positive numbers, such as 500/1")]
    StepsPerRevolution { steps: u32, revolutions: u32 },
    #[error("another camera already listens on {0}, UDP port 3956; stop the other emulated rig or choose another 127.0.0.x")]
    AddressInUse(Ipv4Addr),
    #[error("every address from 127.0.0.2 to 127.0.0.254 has a camera already; stop some emulated rigs")]
    NoFreeAddress,
    #[error("cannot listen on {address}, UDP port 3956: {why}; choose an address of this machine, such as 127.0.0.2")]
    Camera { address: Ipv4Addr, why: std::io::Error },
    #[error("cannot make an emulated serial port{}: {why}", link.as_ref().map(|l| format!(" at {}", l.display())).unwrap_or_default())]
    Serial { link: Option<PathBuf>, why: std::io::Error },
    #[error("cannot start an emulated relay on 127.0.0.1: {0}")]
    Relay(std::io::Error),
}

/// A running rig; everything is shut down and joined when it is dropped.
pub struct Rig {
    clock: RigClock,
    shaft: Arc<Shaft>,
    slide: Option<Arc<Slide>>,
    sampler: Option<Arc<VendorSampler>>,
    port: SerialPort,
    relay: Option<Relay>,
    motors: Arc<MotorFaults>,
    camera: GigeCamera,
    second: Option<GigeCamera>,
}

/// Every knob of a rig that makes something go wrong.
#[derive(Clone, Copy)]
pub struct Faults<'a> {
    rig: &'a Rig,
}

impl Rig {
    // The rig keeps what it looks at.
    #[allow(clippy::needless_pass_by_value)]
    pub fn start(settings: RigSettings, sight: Arc<dyn Sight>) -> Result<Self, RigError> {
        if !(settings.time_scale.is_finite() && settings.time_scale > 0.0) {
            return Err(RigError::TimeScale(settings.time_scale));
        }
        let (steps, revolutions) = settings.shaft.steps_per_revolution;
        if steps == 0 || revolutions == 0 {
            return Err(RigError::StepsPerRevolution { steps, revolutions });
        }
        let clock = RigClock::new(settings.time_scale);
        let shaft = Shaft::new(clock, settings.shaft);
        let shaft = Arc::new(if matches!(settings.controller, Controller::Tmcl(_)) { shaft.paired() } else { shaft });
        let slide = settings.slide.map(|settings| Arc::new(Slide::new(clock, settings)));
        let sampler = settings.sampler.map(|settings| Arc::new(VendorSampler::new(clock, settings)));
        let sight: Arc<dyn Sight> = match &slide {
            Some(slide) => Arc::new(OnSlide { sight, slide: Arc::clone(slide) }),
            None => sight,
        };
        let camera = start_camera(&settings, clock, &shaft, &sight)?;
        let link = settings.serial_link;
        let controller = settings.controller;
        let motors = Arc::new(MotorFaults::default());
        let firmware = |faults| controller.firmware(Arc::clone(&shaft), slide.clone(), sampler.clone(), faults, &motors);
        let port = SerialPort::start(clock, firmware, link.clone()).map_err(|why| RigError::Serial { link, why })?;
        let relay = settings.relay.map(|relay| Relay::start(clock, Arc::clone(&shaft), relay)).transpose().map_err(RigError::Relay)?;
        Ok(Self { clock, shaft, slide, sampler, port, relay, motors, camera, second: None })
    }

    /// Puts a second camera beside the first, on the same shaft, and says where.
    #[allow(clippy::needless_pass_by_value)]
    pub fn add_camera(&mut self, sight: Arc<dyn Sight>) -> Result<Ipv4Addr, RigError> {
        let settings = RigSettings { pixel_format: PixelFormat::Mono8, ..RigSettings::default() };
        let camera = start_camera(&settings, self.clock, &self.shaft, &sight)?;
        let address = camera.address();
        self.second = Some(camera);
        Ok(address)
    }

    /// What the second camera really exposed, oldest first.
    pub fn second_exposures(&self) -> Vec<ExposureRecord> {
        self.second.as_ref().map(|camera| camera.truth().all()).unwrap_or_default()
    }

    /// What a host opens as the motor controller's port.
    pub fn serial_path(&self) -> PathBuf {
        self.port.path()
    }

    /// What a host connects to as the relay; none where the rig has none.
    pub fn relay_address(&self) -> Option<SocketAddr> {
        self.relay.as_ref().map(Relay::address)
    }

    pub fn camera_address(&self) -> Ipv4Addr {
        self.camera.address()
    }

    pub fn camera_serial(&self) -> &str {
        self.camera.serial()
    }

    /// The true shaft.
    pub fn shaft(&self) -> &Shaft {
        &self.shaft
    }

    /// The true slide, where there is one.
    pub fn slide(&self) -> Option<&Slide> {
        self.slide.as_deref()
    }

    /// The vendor's sampler, where there is one; its faults are its own.
    pub fn sampler(&self) -> Option<&Arc<VendorSampler>> {
        self.sampler.as_ref()
    }

    /// A pulse on the camera's trigger line.
    pub fn pulse_camera_line(&self) {
        self.camera.pulse_line();
    }

    /// What was really exposed, oldest first.
    pub fn exposures(&self) -> Vec<ExposureRecord> {
        self.camera.truth().all()
    }

    pub fn faults(&self) -> Faults<'_> {
        Faults { rig: self }
    }
}

impl<'a> Faults<'a> {
    /// What the firmware sends.
    pub fn serial(&self) -> &'a SerialFaults {
        self.rig.port.faults()
    }

    /// What the camera sends.
    pub fn camera(&self) -> &'a CameraFaults {
        self.rig.camera.faults()
    }

    /// What the second camera sends. `None` where there is none.
    pub fn second_camera(&self) -> Option<&'a CameraFaults> {
        self.rig.second.as_ref().map(GigeCamera::faults)
    }

    /// What happens at the motors, where the controller's firmware can do something about it (TMCL, Zaber).
    pub fn motors(&self) -> &'a MotorFaults {
        &self.rig.motors
    }

    /// The motor will not follow the next `steps` steps.
    pub fn lose_steps(&self, steps: u32) {
        self.rig.shaft.lose_steps(steps);
    }

    /// The motor controller restarts, in the middle of a move or not, without an alarm.
    pub fn reboot_controller(&self) {
        self.rig.port.reboot();
    }

    /// Bytes that nobody sent reach the motor controller now.
    pub fn serial_noise(&self, bytes: &[u8]) {
        self.rig.port.noise(bytes);
    }

    /// A hand presses a button at the motor controller, or lets it go (Grbl, grblHAL).
    pub fn button(&self, button: Button, pressed: bool) {
        self.rig.port.button(button, pressed);
    }

    /// Pulls the serial cable; the port is gone when this returns.
    pub fn unplug_serial(&self) {
        self.rig.port.unplug();
    }

    /// Plugs it in again; [`Rig::serial_path`] tells under which name.
    pub fn replug_serial(&self) -> std::io::Result<()> {
        self.rig.port.replug()
    }
}

fn start_camera(settings: &RigSettings, clock: RigClock, shaft: &Arc<Shaft>, sight: &Arc<dyn Sight>) -> Result<GigeCamera, RigError> {
    let try_on = |address| {
        let seen = (settings.pixel_format, settings.nominal_exposure_us, Arc::clone(sight));
        GigeCamera::start(address, seen, clock, Arc::clone(shaft)).map_err(|why| match why.kind() {
            ErrorKind::AddrInUse => RigError::AddressInUse(address),
            _ => RigError::Camera { address, why },
        })
    };
    match settings.camera {
        CameraAddress::Fixed(address) => try_on(address),
        CameraAddress::FirstFree => (2..=254)
            .map(|last| try_on(Ipv4Addr::new(127, 0, 0, last)))
            .find(|outcome| !matches!(outcome, Err(RigError::AddressInUse(_))))
            .unwrap_or(Err(RigError::NoFreeAddress)),
    }
}
