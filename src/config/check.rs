//! Checks a raw configuration once. All breaches are listed. The checked values need no further checks.

use super::plausible::implausible;
use super::raw::{CalibrationConfig, CameraDriver, Drivers, Raw, RawOptics, RawSecondOptics, SamplerDriver};
use super::references::{self, ReferencesError};
use super::{HttpSettings, NotifySettings};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::{Camera, GlassTube, SecondOptics};
use carved_core::measure::references::References;
use carved_core::profile::{EmptyCapillary, Picture};
use carved_core::range::{OutOfRange, Ranged};
use carved_core::units::StepsPerRevolution;
use carved_devices::acquisition::{AcquisitionSettings, PlanError, RevolutionPlan, SweepPlan};
use carved_devices::rotation::{GrblPin, RotationDriver, TranslationSettings};
use carved_records::{InstrumentIdentity, Method, ViewOrder};
use carved_store::frames;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A checked configuration.
#[derive(Debug, Clone)]
pub struct Config {
    pub http: HttpSettings,
    /// Where notices are sent. `None` if none are sent.
    pub notify: Option<NotifySettings>,
    pub store: StoreConfig,
    pub calibration: CalibrationConfig,
    pub rig_name: String,
    /// Serial number of the instrument. `None` if it is not configured.
    pub serial: Option<String>,
    /// Where the instrument stands. `None` if it is not configured.
    pub location: Option<String>,
    pub steps_per_revolution: StepsPerRevolution,
    /// Every stop is approached from the same side by at least this many motor steps.
    pub backlash_steps: u32,
    pub acquisition: AcquisitionSettings,
    /// The rig's nominal camera.
    pub optics: Camera,
    /// The empty-capillary picture of this camera.
    pub empty_capillary: Option<Arc<RawFrame>>,
    /// Inner diameter of the capillary, um. The scale is compared with it before a specimen is measured. `None` if it is not configured.
    pub bore_um: Option<f64>,
    pub rotation: RotationDriver,
    /// The axis along the capillary. The rotation's controller drives it. `None` without one.
    pub translation: Option<TranslationSettings>,
    pub camera: CameraDriver,
    /// A second camera. It is triggered for each view after the first camera.
    pub second: Option<SecondCamera>,
    pub sampler: SamplerDriver,
    pub methods: BTreeMap<String, Method>,
    /// The reference larvae.
    pub references: Arc<[References]>,
    /// Unlikely values that are allowed. Each entry is a sentence.
    pub doubts: Vec<String>,
}

/// The second camera and its optics.
#[derive(Debug, Clone)]
pub struct SecondCamera {
    pub camera: CameraDriver,
    pub optics: SecondOptics,
}

#[derive(Debug, Clone)]
pub struct StoreConfig {
    pub data_dir: PathBuf,
    /// Maximum disk space of all runs, GB. `None` without a limit.
    pub budget_gb: Option<f64>,
}

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: cannot read the configuration: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// `key` is the path of the key. It is empty if the file is not valid TOML.
    #[error("{}: {key}{source}", path.display())]
    Syntax { path: PathBuf, key: String, source: Box<toml::de::Error> },
    #[error("{}: {} value(s) cannot be used:\n{}", path.display(), breaches.len(), breaches.join("\n"))]
    Breaches { path: PathBuf, breaches: Vec<String> },
}

impl Config {
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = carved_files::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Whether a turn ends with a picture at 360 deg.
    pub fn repeats_first_view(&self) -> bool {
        match &self.rotation {
            RotationDriver::Folder(settings) => settings.repeats_first,
            _ => true,
        }
    }

    /// The identity of the instrument. `uuid` is that of its data folder.
    pub fn identity(&self, uuid: String) -> InstrumentIdentity {
        InstrumentIdentity { name: self.rig_name.clone(), serial: self.serial.clone(), location: self.location.clone(), uuid }
    }

    /// The folder of the rig's calibrations.
    pub fn calibrations(&self) -> PathBuf {
        self.calibration.folder.clone().unwrap_or_else(|| self.store.data_dir.join("calibrations"))
    }

    /// Parses and checks a configuration. `path` names the source in errors. Relative paths in the text start at its folder.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let syntax = |key, source| ConfigError::Syntax { path: path.to_owned(), key, source: Box::new(source) };
        let written = toml::Deserializer::parse(text).map_err(|e| syntax(String::new(), e))?;
        let raw: Raw = serde_path_to_error::deserialize(written).map_err(|e| {
            // A missing table has no path.
            let key = e.path().iter().next().map_or(String::new(), |_| format!("{}: ", e.path()));
            syntax(key, e.into_inner())
        })?;
        let drivers = raw.read_drivers().map_err(|breaches| ConfigError::Breaches { path: path.to_owned(), breaches })?;
        let outside: Vec<OutOfRange> = raw.outside().into_iter().chain(drivers.outside()).collect();
        // Rules for several numbers are only checked if each number is in its range.
        let in_range = |table: &str| !outside.iter().any(|breach| breach.key.starts_with(&format!("{table}.")));
        let o = &raw.optics;
        let optics = nominal_camera(o);
        let mut breaches: Vec<String> = outside.iter().map(|breach| format!("  {breach}")).collect();
        let mut wrong = |key: &str, found: String, expected: &str| breaches.push(format!("  {key} = {found}; expected {expected}"));
        if raw.methods.is_empty() {
            wrong("[methods]", "nothing".into(), "at least one method, as [methods.standard]");
        }
        for (name, method) in &raw.methods {
            if !carved_records::is_plain_name(name) {
                wrong(&format!("methods.{name:?}"), "this name".into(), "1 to 64 letters, digits, '-', '_' or '.'");
            }
            let planned = in_range("rig") && method.outside().is_empty();
            if let Some(Err(e)) = planned.then(|| RevolutionPlan::new(method.asd, raw.rig.steps_per_revolution, method.order)) {
                wrong(&format!("methods.{name}.asd"), method.asd.to_string(), &e.to_string());
            }
        }
        breaches.extend(too_near(&raw.methods, "optics", &optics));
        sweeps(&raw, &drivers, in_range, &mut breaches);
        for (name, method) in &raw.methods {
            let retired = method.segment.retired_keys();
            breaches
                .extend(retired.map(|key| format!("  methods.{name}.segment.{key} is no longer a setting and has no effect; remove it")));
            breaches.extend(method.check().iter().map(|e| format!("  methods.{name}.{e}")));
        }
        let empty_capillary = raw.optics.empty_capillary.as_deref().and_then(|named| {
            let file = path.parent().unwrap_or(Path::new("")).join(named);
            empty_capillary(&file, &raw, drivers.camera.pixel_format())
                .map_err(|e| breaches.push(format!("  optics.empty_capillary = \"{}\": {e}", named.display())))
                .ok()
        });
        let references = configured_references(raw.references.as_deref(), path).unwrap_or_else(|e| {
            breaches.push(format!("  references: {e}"));
            Arc::new([])
        });
        breaches.extend(raw.http.check().iter().map(|e| format!("  {e}")));
        let notify = raw.notify.as_ref().filter(|_| in_range("notify")).map(NotifySettings::receiver);
        breaches.extend(notify.and_then(Result::err).map(|e| format!("  {e}")));
        let translation = raw.translation.as_ref().filter(|_| in_range("translation")).map_or(Ok(()), TranslationSettings::check);
        let is_rotation = ["rotation", "views", "rig"].into_iter().all(&in_range);
        let rotation = if is_rotation { drivers.rotation.check(raw.rig.steps_per_revolution) } else { Ok(()) };
        let sampler = match &drivers.sampler {
            SamplerDriver::Trigger(trigger) if in_range("sampler") => trigger.check(),
            _ => Ok(()),
        };
        for checked in [rotation, translation, sampler] {
            breaches.extend(checked.err().map(|e| format!("  {e}")));
        }
        wires(&raw, &drivers, &mut breaches);
        let implausible = implausible(&raw, &drivers, in_range);
        breaches.extend(implausible.breaches);
        let second = second_camera(drivers.camera_second, raw.optics_second.as_ref(), optics.glass, &mut breaches);
        breaches.extend(second.iter().flat_map(|second| too_near(&raw.methods, "optics_second", &second.optics.camera)));
        let mut wrong = |key: &str, found: String, expected: &str| breaches.push(format!("  {key} = {found}; expected {expected}"));
        let (width, height) = drivers.camera.frame_size();
        if (width, height) != (o.width_px, o.height_px) {
            wrong("[camera] frame", format!("{width} x {height} px"), &format!("the {} x {} px of [optics]", o.width_px, o.height_px));
        }
        if !breaches.is_empty() {
            return Err(ConfigError::Breaches { path: path.to_owned(), breaches });
        }
        Ok(Self {
            http: raw.http,
            notify: raw.notify,
            store: StoreConfig { data_dir: raw.store.data_dir, budget_gb: raw.store.budget_gb },
            calibration: raw.calibration,
            rig_name: raw.rig.name,
            serial: raw.rig.serial,
            location: raw.rig.location,
            steps_per_revolution: raw.rig.steps_per_revolution,
            backlash_steps: raw.rig.backlash_steps,
            acquisition: raw.acquisition,
            optics,
            empty_capillary,
            bore_um: raw.optics.bore_um,
            rotation: drivers.rotation,
            translation: raw.translation,
            camera: drivers.camera,
            second,
            sampler: drivers.sampler,
            methods: raw.methods,
            references,
            doubts: implausible.doubts,
        })
    }
}

impl Config {
    /// The sweep of a method; `None` for a method with stops.
    pub fn sweep(&self, method: &Method) -> Option<Result<SweepPlan, PlanError>> {
        sweep_of(method, self.steps_per_revolution)
    }
}

fn sweep_of(method: &Method, steps_per_revolution: StepsPerRevolution) -> Option<Result<SweepPlan, PlanError>> {
    (method.order == ViewOrder::Sweep).then(|| SweepPlan::new(method.asd, steps_per_revolution, method.sweep.rate_hz(method.asd)))
}

/// Checks the methods with a sweep against the camera's exposure and against the second camera.
fn sweeps(raw: &Raw, drivers: &Drivers, in_range: impl Fn(&str) -> bool, breaches: &mut Vec<String>) {
    if let CameraDriver::Aravis(camera) = &drivers.camera
        && ["rig", "optics", "camera", "methods"].into_iter().all(in_range)
    {
        breaches.extend(raw.methods.iter().filter_map(|(name, method)| blurred_sweep(name, method, raw, camera.exposure_us)));
    }
    if drivers.camera_second.is_some() {
        let swept = raw.methods.iter().filter(|(_, method)| method.order == ViewOrder::Sweep);
        breaches.extend(swept.map(|(name, _)| {
            format!("  methods.{name}.order = \"sweep\"; expected an order with stops: [camera_second] is triggered while the axis stands")
        }));
    }
}

/// Why the pictures of a sweep cannot be used, if so.
fn blurred_sweep(name: &str, method: &Method, raw: &Raw, exposure_us: f64) -> Option<String> {
    let plan = sweep_of(method, raw.rig.steps_per_revolution)?.ok()?;
    let radius_um = raw.optics.bore_um.map_or(GlassTube::THIN.bore_radius_um, |bore_um| bore_um / 2.0);
    let way_px = plan.speed_um_per_s(radius_um) * exposure_us * 1e-6 * raw.optics.ky_px_per_um;
    let limit_px = method.sweep.blur_px;
    (way_px > limit_px).then(|| {
        format!(
            "  methods.{name}.sweep: the wall of the capillary moves {way_px:.2} px during an exposure of {exposure_us:.0} us at {:.1} frames/s and \
             {} views; expected at most sweep.blur_px = {limit_px}: shorten the exposure, take more views, or lower the frame rate",
            plan.frame_rate_hz(),
            plan.asd()
        )
    })
}

/// The camera of `[optics]`.
fn nominal_camera(o: &RawOptics) -> Camera {
    Camera {
        f: o.distance_um,
        kx: o.kx_px_per_um,
        ky: o.ky_px_per_um,
        ux: o.ux_px,
        uy: o.uy_px,
        s: 0.0,
        alpha: o.alpha_deg.to_radians(),
        gamma: o.gamma_deg.to_radians(),
        phi: std::f64::consts::FRAC_PI_2,
        width: o.width_px,
        height: o.height_px,
        glass: o.glass(),
    }
}

/// The methods whose box contains the camera. An invalid camera is reported elsewhere.
fn too_near(methods: &BTreeMap<String, Method>, table: &str, camera: &Camera) -> Vec<String> {
    let is_camera = camera.check().is_ok();
    let near = methods.iter().filter(|_| is_camera).filter_map(|(name, method)| Some((name, method.clears(camera).err()?)));
    near.map(|(name, e)| format!("  with method {name:?}: {table}.{e}")).collect()
}

/// Checks what else the rotation's controller drives, and what another program does not support.
fn wires(raw: &Raw, drivers: &Drivers, breaches: &mut Vec<String>) {
    if let RotationDriver::Folder(_) = &drivers.rotation {
        breaches.extend(raw.methods.iter().flat_map(|(name, method)| of_another_program(name, method)));
        return;
    }
    let translation = raw.translation.as_ref();
    let mut wrong = |key: &str, found: String, expected: &str| breaches.push(format!("  {key} = {found}; expected {expected}"));
    match (translation, &drivers.rotation) {
        (Some(_), driver) if !matches!(driver, RotationDriver::Grbl(_)) => {
            wrong("[translation]", "a table".into(), "none: of the drivers of [rotation] only \"grbl\" moves the capillary along");
        }
        (Some(translation), RotationDriver::Grbl(grbl)) if translation.axis == grbl.axis => {
            wrong("translation.axis", format!("{:?}", translation.axis), "another axis than that of [rotation]");
        }
        _ => {}
    }
    if let (SamplerDriver::Trigger(trigger), RotationDriver::Grbl(grbl)) = (&drivers.sampler, &drivers.rotation)
        && trigger.done_output
        && let Some((name, _)) = grbl.outputs.iter().find(|(_, output)| output.pin == GrblPin::FloodCoolant)
    {
        let key = format!("rotation.outputs.{name}.pin");
        wrong(
            &key,
            "\"flood_coolant\"".into(),
            "another pin: the sampler's wire \"the specimen is done\" has this one (sampler.done_output)",
        );
    }
    if matches!(drivers.sampler, SamplerDriver::Trigger(_)) && !matches!(drivers.rotation, RotationDriver::Grbl(_)) {
        wrong("sampler.driver", "\"trigger\"".into(), "\"loader\": of the drivers of [rotation] only \"grbl\" has the wire");
    }
}

/// Settings of a method that a program outside of carved does not support.
fn of_another_program(name: &str, method: &Method) -> Vec<String> {
    let mut breaches = Vec::new();
    if method.order != ViewOrder::Sequential {
        breaches
            .push(format!("  methods.{name}.order = \"{}\"; expected \"sequential\": [views] come in the order of the turn", method.order));
    }
    if method.early_stop.enabled {
        breaches.push(format!("  methods.{name}.early_stop.enabled = true; expected false: carved cannot end a turn of another program"));
    }
    breaches
}

/// The second camera. Both of its tables are needed, or none.
fn second_camera(
    camera: Option<CameraDriver>,
    optics: Option<&RawSecondOptics>,
    glass: Option<GlassTube>,
    breaches: &mut Vec<String>,
) -> Option<SecondCamera> {
    let (camera, o) = match (camera, optics) {
        (None, None) => return None,
        (Some(camera), Some(optics)) => (camera, optics),
        _ => {
            breaches.push("  [camera_second], [optics_second]: one of the two; expected both, or neither".into());
            return None;
        }
    };
    let settings = camera.aravis()?;
    if settings.pixel_format != PixelFormat::Mono8 {
        breaches
            .push(format!("  camera_second.pixel_format = {}; expected Mono8: light is summed, not colours", settings.pixel_format.name()));
    }
    let optics = Camera {
        f: o.distance_um,
        kx: o.kx_px_per_um,
        ky: o.ky_px_per_um,
        ux: o.ux_px,
        uy: o.uy_px,
        s: 0.0,
        alpha: o.alpha_deg.to_radians(),
        gamma: o.gamma_deg.to_radians(),
        phi: std::f64::consts::FRAC_PI_2,
        width: settings.width,
        height: settings.height,
        glass,
    };
    Some(SecondCamera { camera, optics: SecondOptics { camera: optics, around: o.around_deg.to_radians() } })
}

/// The named reference files, relative to the folder of `path`. If none are named: the references of the paper.
fn configured_references(named: Option<&[PathBuf]>, path: &Path) -> Result<Arc<[References]>, ReferencesError> {
    let beside = path.parent().unwrap_or(Path::new(""));
    named.map_or_else(references::embedded, |files| files.iter().map(|file| references::load(&beside.join(file))).collect())
}

/// Reads the empty-capillary picture, and checks that every method finds the walls in it.
fn empty_capillary(file: &Path, raw: &Raw, format: PixelFormat) -> Result<Arc<RawFrame>, String> {
    const WAY_OUT: &str = "put the `frames/detect.png` of a well there that was skipped as empty, or leave the key out";
    let frame = frames::decode(file, format).map_err(|e| format!("{e}; {WAY_OUT}"))?;
    let (found, expected) = ((frame.width(), frame.height()), (raw.optics.width_px, raw.optics.height_px));
    if found != expected {
        return Err(format!("{} x {} px; expected the {} x {} px of [optics]; {WAY_OUT}", found.0, found.1, expected.0, expected.1));
    }
    let picture = Picture::from_frame(&frame);
    for (name, method) in &raw.methods {
        EmptyCapillary::new(picture.clone(), &method.segment.walls).map_err(|e| format!("with method {name:?}: {e}; {WAY_OUT}"))?;
    }
    Ok(Arc::new(frame))
}
