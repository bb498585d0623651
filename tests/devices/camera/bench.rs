//! An emulated camera whose every frame carries its number, the driver at the other end, and the checks that the two agree.

pub use crate::common::{PATIENCE, until};

use carved_core::frame::PixelFormat;
use carved_devices::camera::{self, AravisSettings, CameraSelect};
use carved_devices::cancel::CancelToken;
use carved_devices::{Camera, DeviceError, Grabbed};
use hardware_sim::{Exposure, Pixels, Rig, RigSettings, Sight};
use sha2::{Digest, Sha256};
use std::sync::Arc;
use std::time::Duration;

pub const WIDTH: u32 = 256;
pub const HEIGHT: u32 = 64;
/// Rig seconds per second.
pub const TIME_SCALE: f64 = 10.0;
/// Deadline for one frame in these tests, as in a run.
pub const DEADLINE: Duration = Duration::from_secs(3);

/// A sight without two equal frames: the number of the exposure, followed by noise derived from it.
struct Numbered;

impl Sight for Numbered {
    fn size(&self) -> (u32, u32) {
        (WIDTH, HEIGHT)
    }

    fn look(&self, exposure: &Exposure, format: hardware_sim::PixelFormat) -> Pixels {
        let mut pixels = Pixels::filled(WIDTH, HEIGHT, format, 0);
        for (i, byte) in pixels.bytes.iter_mut().enumerate() {
            *byte = (((exposure.number + 1) * (i as u64 + 17)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8;
        }
        pixels.bytes[..8].copy_from_slice(&exposure.number.to_be_bytes());
        pixels
    }
}

/// The grey pixels that the sensor saw at an exposure.
pub fn seen(number: u64) -> Vec<u8> {
    Numbered.look(&Exposure { angle_rad: 0.0, number }, hardware_sim::PixelFormat::Mono8).bytes
}

/// The camera is dropped first. A driver waits ten seconds for the answers of a camera that is gone.
pub struct Bench {
    pub camera: Box<dyn Camera>,
    pub rig: Rig,
}

pub fn rig() -> Rig {
    Rig::start(RigSettings { time_scale: TIME_SCALE, ..RigSettings::default() }, Arc::new(Numbered)).unwrap()
}

pub fn settings(rig: &Rig) -> AravisSettings {
    let select = CameraSelect::Address(rig.camera_address());
    AravisSettings { time_scale: TIME_SCALE, ..AravisSettings::new(select, PixelFormat::Mono8, WIDTH, HEIGHT, 1000.0) }
}

impl Bench {
    pub fn armed() -> Self {
        Self::armed_with(|s| s)
    }

    pub fn armed_with(change: impl FnOnce(AravisSettings) -> AravisSettings) -> Self {
        let rig = rig();
        let mut camera = camera::open(change(settings(&rig))).unwrap();
        camera.arm().unwrap();
        Self { camera, rig }
    }

    pub fn faults(&self) -> &hardware_sim::gige::CameraFaults {
        self.rig.faults().camera()
    }

    /// Takes a frame as a run does, and compares it with the exposure.
    pub fn take(&mut self) -> Grabbed {
        self.try_take().unwrap()
    }

    pub fn try_take(&mut self) -> Result<Grabbed, DeviceError> {
        let before = self.rig.exposures().len() as u64;
        let grabbed = carved_devices::acquisition::grab(self.camera.as_mut(), DEADLINE, &CancelToken::new())?;
        self.hold(&grabbed, before);
        Ok(grabbed)
    }

    /// The frame has the bytes of its exposure, and the exposure began after the request.
    pub fn hold(&self, grabbed: &Grabbed, exposures_before: u64) {
        let bytes = grabbed.frame.bytes();
        let number = u64::from_be_bytes(*bytes.first_chunk().unwrap());
        let exposures = self.rig.exposures();
        let exposed = exposures.iter().find(|e| e.number == number).unwrap_or_else(|| panic!("exposure {number} never was"));
        assert_eq!(Sha256::digest(bytes)[..], exposed.sha256, "frame {} is not what exposure {number} saw", grabbed.frame_id);
        assert!(number >= exposures_before, "exposure {number} was over when the frame was asked for, after {exposures_before}");
    }
}

/// Undoes the cable fault, so that the driver can close the camera.
impl Drop for Bench {
    fn drop(&mut self) {
        self.faults().pull_cable(false);
    }
}
