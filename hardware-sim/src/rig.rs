//! One emulated rig: a shaft, the firmware that turns it, and the camera that sees it.

use crate::bridge;
use crate::clock::RigClock;
use crate::gige::{CameraFaults, GigeCamera};
use crate::grbl;
use crate::motor_faults::MotorFaults;
use crate::outputs::{Lit, OutputPin, Outputs};
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

/// The loopback address of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CameraAddress {
    Fixed(Ipv4Addr),
    /// The first of 127.0.0.2 to 127.0.0.254 on which no other camera listens.
    #[default]
    FirstFree,
}

/// The controller that turns the shaft.
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
        outputs: &Arc<Outputs>,
    ) -> Box<dyn Firmware> {
        let outputs = Arc::clone(outputs);
        let wired = |outputs| {
            move |shaft, settings, dialect| {
                grbl::Firmware::new(shaft, slide, faults, settings, dialect).with_sampler(sampler).with_outputs(outputs)
            }
        };
        match self {
            Self::Bridge(settings) => Box::new(bridge::Firmware::new(shaft, settings)),
            Self::Grbl(settings) => Box::new(wired(outputs)(shaft, settings, grbl::Dialect::Grbl)),
            Self::GrblHal(settings) => Box::new(wired(outputs)(shaft, settings, grbl::Dialect::GrblHal)),
            Self::Tmcl(settings) => Box::new(tmcl::Firmware::new(&shaft, motors, outputs, settings)),
            Self::Zaber(settings) => Box::new(zaber::Firmware::new(shaft, Arc::clone(motors), outputs, settings)),
        }
    }
}

/// What the rig is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct RigSettings {
    pub shaft: ShaftSettings,
    /// Rig seconds per real second. 1 is real time.
    pub time_scale: f64,
    pub camera: CameraAddress,
    /// The format that the camera sends until a host chooses another one.
    pub pixel_format: PixelFormat,
    /// Exposure time at which frames have the brightness of the image source, us. `None`: the brightness does not depend on the
    /// exposure time.
    pub nominal_exposure_us: Option<f32>,
    pub controller: Controller,
    /// The slide on the Y axis of a Grbl controller. `None`: the capillary cannot be moved along.
    pub slide: Option<SlideSettings>,
    /// The vendor's sampler at the probe input and the flood output of a Grbl controller. `None`: something else fills the capillary.
    pub sampler: Option<SamplerSettings>,
    /// The output of the controller that switches the light of the camera. `None`: the light is always on.
    pub light: Option<OutputPin>,
    /// A relay that also turns the shaft.
    pub relay: Option<relay::Settings>,
    /// A symbolic link to the serial port, while the cable is plugged in. `None`: [`Rig::serial_path`] is the device name.
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
            light: None,
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

/// A running rig. When it is dropped, it shuts everything down and joins all threads.
pub struct Rig {
    clock: RigClock,
    shaft: Arc<Shaft>,
    slide: Option<Arc<Slide>>,
    sampler: Option<Arc<VendorSampler>>,
    port: SerialPort,
    relay: Option<Relay>,
    motors: Arc<MotorFaults>,
    outputs: Arc<Outputs>,
    camera: GigeCamera,
    second: Option<GigeCamera>,
}

/// All faults that tests can cause in a rig.
#[derive(Clone, Copy)]
pub struct Faults<'a> {
    rig: &'a Rig,
}

impl Rig {
    /// Starts a rig whose camera sees `sight`.
    // The rig keeps the image source.
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
        let outputs = Arc::new(Outputs::default());
        let sight: Arc<dyn Sight> = match settings.light {
            Some(light) => Arc::new(Lit { sight, outputs: Arc::clone(&outputs), light }),
            None => sight,
        };
        let camera = start_camera(&settings, clock, &shaft, &sight)?;
        let link = settings.serial_link;
        let controller = settings.controller;
        let motors = Arc::new(MotorFaults::default());
        let firmware = |faults| controller.firmware(Arc::clone(&shaft), slide.clone(), sampler.clone(), faults, &motors, &outputs);
        let port = SerialPort::start(clock, firmware, link.clone()).map_err(|why| RigError::Serial { link, why })?;
        let relay = settings.relay.map(|relay| Relay::start(clock, Arc::clone(&shaft), relay)).transpose().map_err(RigError::Relay)?;
        Ok(Self { clock, shaft, slide, sampler, port, relay, motors, outputs, camera, second: None })
    }

    /// Adds a second camera that sees the same shaft. Returns its address.
    #[allow(clippy::needless_pass_by_value)]
    pub fn add_camera(&mut self, sight: Arc<dyn Sight>) -> Result<Ipv4Addr, RigError> {
        let settings = RigSettings { pixel_format: PixelFormat::Mono8, ..RigSettings::default() };
        let camera = start_camera(&settings, self.clock, &self.shaft, &sight)?;
        let address = camera.address();
        self.second = Some(camera);
        Ok(address)
    }

    /// The true exposures of the second camera, oldest first.
    pub fn second_exposures(&self) -> Vec<ExposureRecord> {
        self.second.as_ref().map(|camera| camera.truth().all()).unwrap_or_default()
    }

    /// The path of the motor controller's serial port.
    pub fn serial_path(&self) -> PathBuf {
        self.port.path()
    }

    /// The address of the relay. `None` if the rig has no relay, or one behind a pipe.
    pub fn relay_address(&self) -> Option<SocketAddr> {
        self.relay.as_ref().and_then(Relay::address)
    }

    pub fn camera_address(&self) -> Ipv4Addr {
        self.camera.address()
    }

    pub fn camera(&self) -> &GigeCamera {
        &self.camera
    }

    pub fn camera_serial(&self) -> &str {
        self.camera.serial()
    }

    /// The true shaft.
    pub fn shaft(&self) -> &Shaft {
        &self.shaft
    }

    /// The true slide. `None` if the rig has no slide.
    pub fn slide(&self) -> Option<&Slide> {
        self.slide.as_deref()
    }

    /// The vendor's sampler, with its own faults. `None` if the rig has no sampler.
    pub fn sampler(&self) -> Option<&Arc<VendorSampler>> {
        self.sampler.as_ref()
    }

    /// The digital outputs of the controller, with their faults.
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// Sends a pulse on the trigger line of the camera.
    pub fn pulse_camera_line(&self) {
        self.camera.pulse_line();
    }

    /// The true exposures of the camera, oldest first.
    pub fn exposures(&self) -> Vec<ExposureRecord> {
        self.camera.truth().all()
    }

    /// The faults of this rig.
    pub fn faults(&self) -> Faults<'_> {
        Faults { rig: self }
    }
}

impl<'a> Faults<'a> {
    /// Faults of the serial line.
    pub fn serial(&self) -> &'a SerialFaults {
        self.rig.port.faults()
    }

    /// Faults of the camera.
    pub fn camera(&self) -> &'a CameraFaults {
        self.rig.camera.faults()
    }

    /// Faults of the second camera. `None` if there is no second camera.
    pub fn second_camera(&self) -> Option<&'a CameraFaults> {
        self.rig.second.as_ref().map(GigeCamera::faults)
    }

    /// Faults of the motors that a controller can detect (TMCL and Zaber).
    pub fn motors(&self) -> &'a MotorFaults {
        &self.rig.motors
    }

    /// The motor does not execute the next `steps` steps.
    pub fn lose_steps(&self, steps: u32) {
        self.rig.shaft.lose_steps(steps);
    }

    /// Restarts the motor controller without an alarm, also during a move.
    pub fn reboot_controller(&self) {
        self.rig.port.reboot();
    }

    /// The motor controller now receives bytes that no host has sent.
    pub fn serial_noise(&self, bytes: &[u8]) {
        self.rig.port.noise(bytes);
    }

    /// Presses or releases a button at the motor controller (Grbl and grblHAL).
    pub fn button(&self, button: Button, pressed: bool) {
        self.rig.port.button(button, pressed);
    }

    /// Unplugs the serial cable. When this returns, the port does not exist any more.
    pub fn unplug_serial(&self) {
        self.rig.port.unplug();
    }

    /// Plugs the serial cable in again. The device name may have changed: see [`Rig::serial_path`].
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
