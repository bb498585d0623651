//! The configuration as it is written: every key with its unit in its name.

use crate::http::HttpSettings;
use carved_core::frame::PixelFormat;
use carved_core::units::StepsPerRevolution;
use carved_devices::DeviceError;
use carved_devices::acquisition::AcquisitionSettings;
use carved_devices::camera::AravisSettings;
use carved_devices::rotation::{GrblSettings, RelaySettings, TmclSettings, TranslationSettings, VastBridgeSettings, ZaberSettings};
use carved_devices::sampler::TriggerSettings;
use carved_records::Method;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Raw {
    /// Files of reference larvae, relative to the configuration file; the paper's where left out.
    #[serde(default)]
    pub references: Option<Vec<PathBuf>>,
    pub http: HttpSettings,
    pub store: RawStore,
    #[serde(default)]
    pub calibration: CalibrationConfig,
    pub rig: RawRig,
    pub acquisition: AcquisitionSettings,
    pub optics: RawOptics,
    pub rotation: RotationDriver,
    /// The axis along the capillary, where the rotation's controller drives it.
    #[serde(default)]
    pub translation: Option<TranslationSettings>,
    pub camera: CameraDriver,
    /// A second camera, the microscope's; both tables or none.
    #[serde(default)]
    pub camera_second: Option<CameraDriver>,
    #[serde(default)]
    pub optics_second: Option<RawSecondOptics>,
    pub sampler: SamplerDriver,
    pub methods: BTreeMap<String, Method>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawStore {
    pub data_dir: PathBuf,
    /// What the runs may take of the disk; left out, all of it.
    #[serde(default)]
    pub budget_gb: Option<f64>,
}

/// Where the rig's own calibrations are, and how long they count.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationConfig {
    /// `calibrations` in the data folder where left out.
    pub folder: Option<PathBuf>,
    pub max_age_days: f64,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        Self { folder: None, max_age_days: 30.0 }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRig {
    pub name: String,
    pub steps_per_revolution: StepsPerRevolution,
    /// Play between motor and capillary, motor steps: every stop is approached from the same side by at least this much.
    #[serde(default)]
    pub backlash_steps: u32,
}

/// psi as a rig's data sheet has it; angles in degrees, lengths in um, image positions in px.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawOptics {
    pub distance_um: f64,
    pub kx_px_per_um: f64,
    pub ky_px_per_um: f64,
    pub ux_px: f64,
    pub uy_px: f64,
    #[serde(default)]
    pub alpha_deg: f64,
    #[serde(default)]
    pub gamma_deg: f64,
    pub width_px: u32,
    pub height_px: u32,
    /// A frame of the empty capillary, as this camera takes it; relative to the configuration file.
    #[serde(default)]
    pub empty_capillary: Option<PathBuf>,
    /// Inner diameter of the capillary, um.
    #[serde(default)]
    pub bore_um: Option<f64>,
}

/// The second camera's, in the same words.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSecondOptics {
    /// How far around the capillary it looks from, seen from the first: what the first sees at an angle of the axis it sees when
    /// the axis stands this much before it.
    pub around_deg: f64,
    pub distance_um: f64,
    pub kx_px_per_um: f64,
    pub ky_px_per_um: f64,
    pub ux_px: f64,
    pub uy_px: f64,
    #[serde(default)]
    pub alpha_deg: f64,
    #[serde(default)]
    pub gamma_deg: f64,
}

/// Which controller turns the capillary.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "driver", rename_all = "snake_case")]
pub enum RotationDriver {
    Grbl(GrblSettings),
    VastBridge(VastBridgeSettings),
    Relay(RelaySettings),
    Tmcl(TmclSettings),
    Zaber(ZaberSettings),
}

impl RotationDriver {
    /// # Errors
    /// The first setting that no such controller can have.
    pub(super) fn check(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError> {
        match self {
            Self::Grbl(settings) => settings.check(),
            Self::VastBridge(settings) => settings.check(per_revolution),
            Self::Relay(settings) => settings.check(),
            Self::Tmcl(settings) => settings.check(),
            Self::Zaber(settings) => settings.check(),
        }
    }
}

/// Which door the camera is behind.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "driver", rename_all = "snake_case")]
pub enum CameraDriver {
    Aravis(AravisSettings),
}

/// Who puts specimens into the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(tag = "driver", rename_all = "snake_case", deny_unknown_fields)]
pub enum SamplerDriver {
    /// The plate-loader does and says so: `PUT /v1/runs/{id}/wells/{well}`.
    Loader {},
    /// A sampler of its own does, and says so by a wire to the motion controller.
    Trigger(TriggerSettings),
}

impl CameraDriver {
    pub fn pixel_format(&self) -> PixelFormat {
        let Self::Aravis(settings) = self;
        settings.pixel_format
    }

    pub(super) fn frame_size(&self) -> (u32, u32) {
        let Self::Aravis(settings) = self;
        (settings.width, settings.height)
    }
}
