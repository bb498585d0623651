//! The second camera of the emulated rig, for fluorescence, and its configuration.

use crate::cli::emulated;
use crate::config::{CameraDriver, SecondCamera};
use anyhow::Context;
use carved_core::frame::PixelFormat;
use carved_core::geometry::SecondOptics;
use carved_devices::camera::{AravisSettings, CameraSelect};
use hardware_sim::Rig;
use hardware_sim::scene::{Fluorescent, FluorescentSettings, Scene};
use std::sync::Arc;

/// Long enough for faint light, us. The brightness of the emulated camera does not depend on it.
const EXPOSURE_US: f64 = 8000.0;

/// Puts the second camera beside the first one, on the same shaft.
pub fn beside(rig: &mut Rig, scene: &Arc<Scene>) -> anyhow::Result<SecondCamera> {
    let settings = FluorescentSettings::default();
    let optics = SecondOptics { camera: emulated::camera(&settings.camera), around: settings.around_rad };
    let (width, height) = (settings.camera.width, settings.camera.height);
    let address =
        rig.add_camera(Arc::new(Fluorescent::new(scene.clone(), settings))).context("the second emulated camera did not start")?;
    let select = CameraSelect::Address(address);
    let camera = CameraDriver::Aravis(AravisSettings::new(select, PixelFormat::Mono8, width, height, EXPOSURE_US));
    Ok(SecondCamera { camera, optics })
}
