//! The raw configuration, as in the file. Each key has its unit in its name.
//!
//! ```text
//! file ─ toml ─> Raw ─ read_drivers ─> Drivers      tables whose keys depend on their `driver`
//!                 └──── outside ─────> numbers out of range, with the full path of their keys
//! ```
//! The documentation of the fields is the reference of the keys. `carved config schema` prints it. `x-level` says who sets a key. A key has
//! the level of its table, unless it has its own.

use super::{HttpSettings, NotifySettings};
use carved_core::frame::PixelFormat;
use carved_core::geometry::GlassTube;
use carved_core::range::{OutOfRange, Range, Ranged, in_schema, outside_in};
use carved_core::ranges;
use carved_core::units::StepsPerRevolution;
use carved_devices::acquisition::AcquisitionSettings;
use carved_devices::camera::AravisSettings;
use carved_devices::rotation::{RotationDriver, TranslationSettings};
use carved_devices::sampler::TriggerSettings;
use carved_devices::views::{FolderSettings, PictureKind};
use carved_records::Method;
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The configuration of an instrument.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Raw {
    /// Files of reference larvae (`carved reference build`), relative to the configuration file. Larvae of known age are compared with
    /// them. If it is left out, the larvae of the paper are used, which are built in.
    #[serde(default)]
    #[schemars(extend("x-level" = "operator"))]
    pub references: Option<Vec<PathBuf>>,
    /// The server of the page and the API.
    #[schemars(extend("x-level" = "operator"))]
    pub http: HttpSettings,
    /// Where notices are sent: a run is held, somebody is needed, or a run has ended. Leave the table out to send none.
    #[serde(default)]
    #[schemars(extend("x-level" = "operator"))]
    pub notify: Option<NotifySettings>,
    /// Where results are stored.
    #[schemars(extend("x-level" = "operator"))]
    pub store: RawStore,
    /// The calibrations of the rig itself, which `carved calibrate beads` and `carved calibrate scale` keep.
    #[serde(default)]
    #[schemars(extend("x-level" = "operator"))]
    pub calibration: CalibrationConfig,
    /// The instrument.
    #[schemars(extend("x-level" = "operator"))]
    pub rig: RawRig,
    /// How the stops of a revolution are executed.
    #[schemars(extend("x-level" = "operator"))]
    pub acquisition: AcquisitionSettings,
    /// The nominal camera of the rig. Each turn calibrates its own camera, starting from this one.
    #[schemars(extend("x-level" = "operator"))]
    pub optics: RawOptics,
    /// Views that another program takes. With this table there is no `[rotation]`, `[translation]`, `[camera]`, `[camera_second]` or
    /// `[sampler]`. Leave it out on a rig that carved drives.
    #[serde(default)]
    #[schemars(with = "Option<ViewsDriver>", extend("x-level" = "operator"))]
    pub views: Option<toml::Table>,
    /// The controller that turns the capillary.
    #[serde(default)]
    #[schemars(with = "Option<RotationDriver>", extend("x-level" = "operator"))]
    pub rotation: Option<toml::Table>,
    /// The axis that moves the capillary along, on the controller of the rotation. Only the driver `grbl` has it. Leave the table out if
    /// there is none.
    #[serde(default)]
    #[schemars(extend("x-level" = "operator"))]
    pub translation: Option<TranslationSettings>,
    /// The camera.
    #[serde(default)]
    #[schemars(with = "Option<CameraDriver>", extend("x-level" = "operator"))]
    pub camera: Option<toml::Table>,
    /// A second camera, such as that of a microscope. It is triggered for each view after the first camera. Its pixel format is `Mono8`.
    /// It needs `[optics_second]`. Leave both tables out if there is none.
    #[serde(default)]
    #[schemars(with = "Option<CameraDriver>", extend("x-level" = "operator"))]
    pub camera_second: Option<toml::Table>,
    /// The nominal second camera. The size of its picture is that of its frames.
    #[serde(default)]
    #[schemars(extend("x-level" = "operator"))]
    pub optics_second: Option<RawSecondOptics>,
    /// Who brings the specimens.
    #[serde(default)]
    #[schemars(with = "Option<SamplerDriver>", extend("x-level" = "operator"))]
    pub sampler: Option<toml::Table>,
    /// The methods by name, as `[methods.standard]`: what is done to a specimen and how it is measured. There must be at least one.
    #[schemars(extend("x-level" = "method"))]
    pub methods: BTreeMap<String, Method>,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub(super) struct RawStore {
    /// Folder of the runs and their index, relative to the working directory of the daemon.
    pub data_dir: PathBuf,
    /// How much of the disk the runs may take. No run starts that could need more. If it is left out, the runs may fill the disk.
    #[serde(default)]
    pub budget_gb: Option<f64>,
}

impl Ranged for RawStore {
    const RANGES: &'static [Range<Self>] = ranges![budget_gb: 1.0, 1e6, "GB";];
}

/// Where the rig's own calibrations are, and how long they are valid.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub struct CalibrationConfig {
    /// Folder of the calibrations, relative to the working directory of the daemon. If it is left out, it is `calibrations` in
    /// `store.data_dir`.
    pub folder: Option<PathBuf>,
    /// Age at which a calibration expires. An older one is reported as expired and is not valid.
    pub max_age_days: f64,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        Self { folder: None, max_age_days: 30.0 }
    }
}

impl Ranged for CalibrationConfig {
    const RANGES: &'static [Range<Self>] = ranges![max_age_days: 0.01, 3650.0, "days";];
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub(super) struct RawRig {
    /// Name of the instrument. It is written into every record, and it is the label `instrument` of every metric.
    pub name: String,
    /// Serial number of the instrument. It is written into every record.
    #[serde(default)]
    pub serial: Option<String>,
    /// Where the instrument stands, such as a building and a room. It is written into every record.
    #[serde(default)]
    pub location: Option<String>,
    /// Motor steps of one turn of the capillary as an exact ratio `[steps, turns]` (microsteps times gear): `[500, 1]` is 0.72 deg per
    /// step.
    pub steps_per_revolution: StepsPerRevolution,
    /// Play between the motor and the capillary. Every stop is approached from the same side by at least this many motor steps. With 0
    /// the axis moves straight to its stops.
    #[serde(default)]
    pub backlash_steps: u32,
}

impl Ranged for RawRig {
    const RANGES: &'static [Range<Self>] = ranges![
        steps_per_revolution: 1.0, u32::MAX as f64, "(ratio of steps and turns)";
        backlash_steps: 0.0, 1e6, "steps";
    ];
}

/// Range of the inner diameter of a capillary for larvae, um. A larva is 300 um thick. A value in mm is below the range.
const BORE_UM: [f64; 2] = [100.0, 5000.0];
/// Range of the distance of a camera, um. A telecentric lens has a large distance.
const DISTANCE_UM: [f64; 2] = [1.0, 1e9];
/// Range of the scale of a camera, px/um: a pixel covers 10 nm to 10 mm.
const SCALE: [f64; 2] = [1e-4, 100.0];
/// Maximum coordinate of the principal point, px. It may be outside of the picture.
const PRINCIPAL_MOST_PX: f64 = 1e5;

/// psi as a rig's data sheet has it; angles in degrees, lengths in um, image positions in px.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub(super) struct RawOptics {
    /// Distance of the projection centre from the axis of the capillary. It determines only the perspective: a larger distance gives
    /// less of it.
    pub distance_um: f64,
    /// Scale along the capillary, at its axis.
    pub kx_px_per_um: f64,
    /// Scale across the capillary, at its axis. It differs from `kx_px_per_um` where the glass refracts.
    pub ky_px_per_um: f64,
    /// Column of the principal point. Centres of pixels are at integers, and the first column is 0.
    pub ux_px: f64,
    /// Row of the principal point, which is the row of the axis. Centres of pixels are at integers, and the first row is 0.
    pub uy_px: f64,
    /// Tilt of the capillary towards the camera. A positive angle brings its +x end nearer.
    #[serde(default)]
    pub alpha_deg: f64,
    /// Roll of the capillary in the picture. A positive angle lowers its +x end.
    #[serde(default)]
    pub gamma_deg: f64,
    /// Width of the picture. It must be that of `[camera]`.
    pub width_px: u32,
    /// Height of the picture. It must be that of `[camera]`.
    pub height_px: u32,
    /// A frame of the empty capillary, as this camera takes it, relative to the configuration file: `frames/detect.png` of a well that
    /// was skipped as empty. Frames are compared with it, so that dust and scratches are not taken for the specimen.
    #[serde(default)]
    pub empty_capillary: Option<PathBuf>,
    /// Inner diameter of the capillary. The scale is compared with it before a specimen is measured: a bore that looks more than 20 %
    /// wider or narrower holds the run. If it is left out, the bore is compared only with the method's `box_um` and with `empty_capillary`,
    /// and the rays in the glass are those of a bore of 600 um. A measured specimen whose views show a bore below 62 % or above 160 % of that
    /// of the glass has the flag `scale_off_bore`.
    #[serde(default)]
    pub bore_um: Option<f64>,
    /// Thickness of the wall of the capillary. The glass turns the rays within the bore, the more the nearer they pass to the wall. A turn
    /// shows the radius of the outer face (`calibration.glass`). With 0 in water, no ray is turned.
    #[serde(default = "thin_wall_um")]
    #[schemars(extend("x-level" = "expert"))]
    pub wall_um: f64,
    /// Refractive index of the medium in the capillary: 1.333 for water.
    #[serde(default = "water")]
    #[schemars(extend("x-level" = "expert"))]
    pub index_inside: f64,
    /// Refractive index of the capillary's glass: 1.474 for borosilicate glass.
    #[serde(default = "borosilicate")]
    #[schemars(extend("x-level" = "expert"))]
    pub index_glass: f64,
    /// Refractive index of the medium around the capillary: 1.333 for water, 1 for air. `ky_px_per_um` is larger than `kx_px_per_um` by
    /// `index_inside` over this.
    #[serde(default = "water")]
    #[schemars(extend("x-level" = "expert"))]
    pub index_outside: f64,
}

fn thin_wall_um() -> f64 {
    GlassTube::THIN.outer_radius_um - GlassTube::THIN.bore_radius_um
}

fn water() -> f64 {
    GlassTube::THIN.inside
}

fn borosilicate() -> f64 {
    GlassTube::THIN.glass
}

impl RawOptics {
    /// The tube of the capillary. `None` where it turns no ray, and where a value is out of its range, which is reported elsewhere.
    pub fn glass(&self) -> Option<GlassTube> {
        let bore_radius_um = self.bore_um.map_or(GlassTube::THIN.bore_radius_um, |bore_um| bore_um / 2.0);
        let tube = GlassTube {
            bore_radius_um,
            outer_radius_um: bore_radius_um + self.wall_um,
            inside: self.index_inside,
            glass: self.index_glass,
            outside: self.index_outside,
        };
        let indices = [self.index_inside, self.index_glass, self.index_outside];
        let is_tube = bore_radius_um > 0.0 && self.wall_um >= 0.0 && indices.into_iter().all(|index| index >= 1.0);
        (is_tube && !tube.is_clear()).then_some(tube)
    }
}

impl Ranged for RawOptics {
    const RANGES: &'static [Range<Self>] = ranges![
        distance_um: DISTANCE_UM[0], DISTANCE_UM[1], "um";
        kx_px_per_um: SCALE[0], SCALE[1], "px/um";
        ky_px_per_um: SCALE[0], SCALE[1], "px/um";
        ux_px: -PRINCIPAL_MOST_PX, PRINCIPAL_MOST_PX, "px";
        uy_px: -PRINCIPAL_MOST_PX, PRINCIPAL_MOST_PX, "px";
        alpha_deg: -90.0, 90.0, "deg";
        gamma_deg: -180.0, 180.0, "deg";
        width_px: 1.0, 65_535.0, "px";
        height_px: 1.0, 65_535.0, "px";
        bore_um: BORE_UM[0], BORE_UM[1], "um";
        wall_um: 0.0, 2000.0, "um";
        index_inside: 1.0, 2.0, "(index)";
        index_glass: 1.0, 2.0, "(index)";
        index_outside: 1.0, 2.0, "(index)";
    ];
}

/// The second camera's, in the same words.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_schema::<Self>)]
pub(super) struct RawSecondOptics {
    /// Angle around the capillary from the first camera to this one. What the first camera sees at an angle of the axis, this one sees
    /// when the axis stands this much before it.
    pub around_deg: f64,
    /// Distance of the projection centre from the axis of the capillary.
    pub distance_um: f64,
    /// Scale along the capillary, at its axis.
    pub kx_px_per_um: f64,
    /// Scale across the capillary, at its axis.
    pub ky_px_per_um: f64,
    /// Column of the principal point.
    pub ux_px: f64,
    /// Row of the principal point.
    pub uy_px: f64,
    /// Tilt of the capillary towards the camera. A positive angle brings its +x end nearer.
    #[serde(default)]
    pub alpha_deg: f64,
    /// Roll of the capillary in the picture. A positive angle lowers its +x end.
    #[serde(default)]
    pub gamma_deg: f64,
}

impl Ranged for RawSecondOptics {
    const RANGES: &'static [Range<Self>] = ranges![
        around_deg: -360.0, 360.0, "deg";
        distance_um: DISTANCE_UM[0], DISTANCE_UM[1], "um";
        kx_px_per_um: SCALE[0], SCALE[1], "px/um";
        ky_px_per_um: SCALE[0], SCALE[1], "px/um";
        ux_px: -PRINCIPAL_MOST_PX, PRINCIPAL_MOST_PX, "px";
        uy_px: -PRINCIPAL_MOST_PX, PRINCIPAL_MOST_PX, "px";
        alpha_deg: -90.0, 90.0, "deg";
        gamma_deg: -180.0, 180.0, "deg";
    ];
}

impl Raw {
    /// Every number that is out of its range, with the full path of its key. Does not include [`Drivers`] and the methods.
    pub fn outside(&self) -> Vec<OutOfRange> {
        outside_in("http", &self.http)
            .chain(self.notify.iter().flat_map(|settings| outside_in("notify", settings)))
            .chain(outside_in("store", &self.store))
            .chain(outside_in("calibration", &self.calibration))
            .chain(outside_in("rig", &self.rig))
            .chain(outside_in("acquisition", &self.acquisition))
            .chain(outside_in("optics", &self.optics))
            .chain(self.translation.iter().flat_map(|settings| outside_in("translation", settings)))
            .chain(self.optics_second.iter().flat_map(|settings| outside_in("optics_second", settings)))
            .collect()
    }

    /// Reads the tables whose keys depend on their `driver`.
    ///
    /// # Errors
    /// All tables that cannot be read, with the full path of the key.
    pub fn read_drivers(&self) -> Result<Drivers, Vec<String>> {
        if let Some(views) = &self.views {
            return self.read_views(views);
        }
        let rotation = required("rotation", self.rotation.as_ref());
        let camera = required("camera", self.camera.as_ref());
        let second = self.camera_second.as_ref().map(|table| read_driver("camera_second", table)).transpose();
        let sampler = required("sampler", self.sampler.as_ref());
        match (rotation, camera, second, sampler) {
            (Ok(rotation), Ok(camera), Ok(camera_second), Ok(sampler)) => Ok(Drivers { rotation, camera, camera_second, sampler }),
            (rotation, camera, second, sampler) => {
                Err([rotation.err(), camera.err(), second.err(), sampler.err()].into_iter().flatten().collect())
            }
        }
    }

    /// The drivers of a rig on which another program takes the views.
    fn read_views(&self, views: &toml::Table) -> Result<Drivers, Vec<String>> {
        let beside = [
            ("rotation", self.rotation.is_some()),
            ("translation", self.translation.is_some()),
            ("camera", self.camera.is_some()),
            ("camera_second", self.camera_second.is_some()),
            ("sampler", self.sampler.is_some()),
        ];
        let unused = beside.iter().filter(|(_, is_there)| *is_there);
        let mut breaches: Vec<String> = unused
            .map(|(name, _)| format!("  [{name}] is there beside [views]; expected one of both: [views] reads pictures of another program"))
            .collect();
        match read_driver("views", views) {
            Ok(ViewsDriver::Folder(settings)) if breaches.is_empty() => {
                let kind = PictureKind { width: self.optics.width_px, height: self.optics.height_px, format: settings.pixel_format };
                Ok(Drivers {
                    rotation: RotationDriver::Folder(settings),
                    camera: CameraDriver::Folder(kind),
                    camera_second: None,
                    sampler: SamplerDriver::Folder {},
                })
            }
            read => {
                breaches.extend(read.err());
                Err(breaches)
            }
        }
    }
}

/// Reads a table that every rig without `[views]` needs.
fn required<T: DeserializeOwned>(name: &str, table: Option<&toml::Table>) -> Result<T, String> {
    let table = table.ok_or_else(|| {
        format!("  [{name}] is missing; expected a table with a driver (or [views], where another program takes the pictures)")
    })?;
    read_driver(name, table)
}

/// The tables with a `driver`.
#[derive(Debug)]
pub(super) struct Drivers {
    pub rotation: RotationDriver,
    pub camera: CameraDriver,
    pub camera_second: Option<CameraDriver>,
    pub sampler: SamplerDriver,
}

impl Drivers {
    /// Every number that is out of its range, with the full path of its key.
    pub fn outside(&self) -> Vec<OutOfRange> {
        let camera = self.camera.aravis().into_iter().flat_map(|camera| outside_in("camera", camera));
        let second = self.camera_second.iter().filter_map(CameraDriver::aravis).flat_map(|second| outside_in("camera_second", second));
        let sampler = match &self.sampler {
            SamplerDriver::Loader {} | SamplerDriver::Folder {} => Vec::new(),
            SamplerDriver::Trigger(settings) => settings.outside(),
        };
        let sampler = sampler.into_iter().map(|breach| breach.below("sampler"));
        self.rotation.outside().into_iter().chain(camera).chain(second).chain(sampler).collect()
    }
}

/// Converts the table into `{ grbl = { keys } }` first. For a tagged table, serde would buffer the keys and lose the path of an error.
fn read_driver<T: DeserializeOwned>(name: &str, table: &toml::Table) -> Result<T, String> {
    let mut keys = table.clone();
    let driver = match keys.remove("driver") {
        Some(toml::Value::String(driver)) => driver,
        Some(other) => return Err(format!("  {name}.driver = {other}; expected a name in quotation marks")),
        None => return Err(format!("  {name}.driver is missing; expected the name of a driver")),
    };
    let tagged = toml::Table::from_iter([(driver.clone(), toml::Value::Table(keys))]);
    serde_path_to_error::deserialize(toml::Value::Table(tagged)).map_err(|error| {
        // Without a path, the driver's name itself is unknown.
        let path = error.path().to_string();
        let key = path.strip_prefix(&driver).unwrap_or(".driver");
        format!("  {name}{key}: {}", error.inner().message())
    })
}

/// Where the views of another program come from.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(tag = "driver")]
pub(super) enum ViewsDriver {
    /// A folder into which the other program stores a picture per view.
    Folder(FolderSettings),
}

/// Which camera, and how it is reached.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(tag = "driver")]
pub enum CameraDriver {
    /// A GigE Vision camera.
    Aravis(AravisSettings),
    /// That of another program, by `[views]`.
    #[serde(skip)]
    Folder(PictureKind),
}

/// Who puts specimens into the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[schemars(tag = "driver")]
pub enum SamplerDriver {
    /// The plate-loader does, and says so by `PUT /v1/runs/{id}/wells/{well}`.
    Loader {},
    /// A sampler of its own does, and says so by a wire to the probe input of the Grbl controller of the rotation.
    Trigger(TriggerSettings),
    /// Another program decides which specimen comes next, by `[views]`.
    #[serde(skip)]
    Folder {},
}

impl CameraDriver {
    pub fn pixel_format(&self) -> PixelFormat {
        match self {
            Self::Aravis(settings) => settings.pixel_format,
            Self::Folder(kind) => kind.format,
        }
    }

    pub(super) fn frame_size(&self) -> (u32, u32) {
        match self {
            Self::Aravis(settings) => (settings.width, settings.height),
            Self::Folder(kind) => (kind.width, kind.height),
        }
    }

    /// The settings of the camera. `None` if another program has the camera.
    pub fn aravis(&self) -> Option<&AravisSettings> {
        match self {
            Self::Aravis(settings) => Some(settings),
            Self::Folder(_) => None,
        }
    }
}
