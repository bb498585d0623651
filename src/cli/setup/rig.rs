//! The real instrument behind [`Bench`]. Devices are open only while an action needs them.

use super::bench::{Action, Bead, Bench, Controller, Empty, FoundExposure, Listed, Outcome, Request, SWEEP, Turn, Written};
use super::period::orbit;
use super::question::ratio_f64;
use crate::cli::camera::{average, exposure, light as camera_light};
use crate::cli::doctor;
use crate::cli::serve::{self, NO_DEVICES};
use crate::cli::with_causes;
use crate::config::{CameraDriver, Config};
use crate::session::live;
use anyhow::{Context, bail, ensure};
use carved_core::frame::RawFrame;
use carved_core::pipeline::{Pipeline, SegmentedFrame};
use carved_core::profile::{EmptyCapillary, Picture};
use carved_core::units::StepsPerRevolution;
use carved_devices::acquisition::{Next, RevolutionPlan, SweepPlan, revolve};
use carved_devices::cancel::CancelToken;
use carved_devices::outputs::{views_off, views_on};
use carved_devices::rotation::{Port, RotationDriver, entry, identify, protocols, serial_ports};
use carved_devices::{Rig, RotationAxis, StopHandle, camera};
use carved_records::{LedgerEntry, Method, ViewOrder};
use carved_store::{durable, frames};
use rayon::prelude::*;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const BAUD: u32 = 115_200;
/// Frames in the mean of the empty capillary.
const FRAMES: u32 = 8;
/// Views of a turn while its steps are measured.
const VIEWS: u32 = 16;
/// Views in the first part of the turn, so that a turn of few steps is not taken for one of many.
const FINE_VIEWS: u32 = 8;
/// Levels at which a picture is usable although its exposure cannot be found, 0 to 255.
const USABLE_TOP: std::ops::RangeInclusive<f64> = 120.0..=254.0;

/// Stops whatever moves, from any thread, and keeps it from moving again.
#[derive(Clone, Default)]
pub struct Stopper {
    cancel: CancelToken,
    moving: Arc<Mutex<Option<StopHandle>>>,
    is_finished: Arc<AtomicBool>,
}

impl Stopper {
    /// Stops the motors, and every later motion of this set-up.
    pub fn stop(&self) {
        self.cancel.cancel();
        if let Some(handle) = self.moving.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            handle.stop();
        }
    }

    pub fn is_stopped(&self) -> bool {
        self.cancel.is_cancelled()
    }

    /// The configuration is written, so a signal ends the program without an error.
    pub fn finish(&self) {
        self.is_finished.store(true, Ordering::Release);
    }

    pub fn is_finished(&self) -> bool {
        self.is_finished.load(Ordering::Acquire)
    }

    /// Whether devices are open that may move, or a light is on.
    pub fn may_move(&self) -> bool {
        self.moving.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    fn hold(&self, handle: Option<StopHandle>) {
        *self.moving.lock().unwrap_or_else(PoisonError::into_inner) = handle;
    }
}

/// A picture that was taken, as a JPEG file, and how many of how many views were taken then.
pub struct Shown {
    pub jpeg: Arc<Vec<u8>>,
    pub taken: Option<[usize; 2]>,
}

/// Gets every picture. `None`: nobody looks at them.
pub type Show = Option<Box<dyn Fn(Shown) + Send>>;

/// The emulated rig that is used instead of the devices of the computer.
pub struct Emulated {
    pub port: Listed,
    pub camera: Listed,
    /// What the driver must permit at the speed of the rig.
    pub hasten: Box<dyn Fn(&mut RotationDriver) + Send>,
}

/// Time for a rendered picture, ms: on a busy machine it takes seconds.
const RENDERED_MS: u32 = 20_000;

/// The instrument that the draft describes.
pub struct RealBench {
    file: PathBuf,
    stopper: Stopper,
    show: Show,
    emulated: Option<Emulated>,
}

impl RealBench {
    /// `file`: the configuration to be written. It is also the origin of relative paths.
    pub fn new(file: PathBuf, stopper: Stopper, show: Show) -> Self {
        Self { file, stopper, show, emulated: None }
    }

    /// Uses this rig, and nothing of the computer.
    #[cfg(feature = "simulate")]
    pub fn emulate(&mut self, rig: Emulated) {
        self.emulated = Some(rig);
    }

    fn ports(&self) -> Vec<Listed> {
        self.emulated.as_ref().map_or_else(ports, |rig| vec![rig.port.clone()])
    }

    fn cameras(&self) -> Vec<Listed> {
        self.emulated.as_ref().map_or_else(cameras, |rig| vec![rig.camera.clone()])
    }

    /// The configuration of the draft. An emulated rig gets the time that it needs, which is not written.
    fn config(&self, draft: &str) -> anyhow::Result<Config> {
        let mut config = Config::parse(draft, &self.file)?;
        if let Some(rig) = &self.emulated {
            if let CameraDriver::Aravis(camera) = &mut config.camera {
                camera.frame_timeout_ms = RENDERED_MS;
            }
            config.acquisition.grab_deadline_ms = 3 * RENDERED_MS;
            (rig.hasten)(&mut config.rotation);
        }
        Ok(config)
    }

    fn beside(&self, name: &str) -> PathBuf {
        self.file.with_file_name(name)
    }

    fn show(&self, frame: &RawFrame, taken: Option<[usize; 2]>) {
        if let Some(show) = &self.show
            && let Some(jpeg) = live::jpeg(&Picture::from_frame(frame))
        {
            show(Shown { jpeg, taken });
        }
    }

    /// Switches the light on, on a rig with one. It is off again once the result is dropped.
    fn light(&self, config: &Config) -> anyhow::Result<Lit<'_>> {
        let axis = camera_light(config, &self.stopper.cancel)?;
        // A signal must not end the program while the light is on.
        self.stopper.hold(axis.as_ref().map(|axis| axis.stop_handle()));
        Ok(Lit { _at_rest: AtRest(self), _axis: axis })
    }

    fn outcome(&self, request: &Request) -> anyhow::Result<Outcome> {
        let config = self.config(request.draft)?;
        Ok(match request.action {
            Action::ListPorts => Outcome::Ports(self.ports()),
            Action::Identify => Outcome::Controller(controller(request.controller)?),
            Action::ListCameras => Outcome::Cameras(self.cameras()),
            Action::Expose => Outcome::Exposure(self.exposure(&config)?),
            Action::LookAtEmpty => Outcome::Empty(self.empty(&config)?),
            Action::Home => {
                self.with_rig(&config, |_| Ok(()))?;
                Outcome::Home
            }
            Action::Turn => Outcome::Turn(self.turn(&config)?),
            Action::Measure => Outcome::Bead(self.measure(&config)?),
            Action::Write => Outcome::Written(self.write(request)?),
        })
    }

    fn exposure(&self, config: &Config) -> anyhow::Result<FoundExposure> {
        let settings = config.camera.aravis().context(NO_DEVICES)?;
        let _light = self.light(config)?;
        let (_, frames) = average::take(settings, 1, &self.stopper.cancel)?;
        let first = frames.first().context("the camera gave no frame")?;
        self.show(first, None);
        match exposure::find(settings.clone(), exposure::TARGET, &self.stopper.cancel) {
            Ok(found) => Ok(FoundExposure { exposure_us: found.exposure_us, top: found.top, follows: true }),
            Err(error) => {
                let top = exposure::top(first);
                ensure!(USABLE_TOP.contains(&top), "{}", with_causes(&error));
                Ok(FoundExposure { exposure_us: settings.exposure_us, top, follows: false })
            }
        }
    }

    fn empty(&self, config: &Config) -> anyhow::Result<Empty> {
        let settings = config.camera.aravis().context(NO_DEVICES)?;
        let lit = self.light(config)?;
        let (_, taken) = average::take(settings, FRAMES, &self.stopper.cancel)?;
        drop(lit);
        let frame = average::mean(&taken)?;
        let picture = Picture::from_frame(&frame);
        self.show(&frame, None);
        let method = method(config)?;
        let walls = EmptyCapillary::new(picture, &method.segment.walls)
            .context("No walls of a capillary are seen. Bring the capillary into the picture, along its rows, and look at focus and light")?
            .walls();
        let looked = Pipeline::new(method.pipeline(&config.optics, false)?)?.look(&frame)?;
        if let Ok(profile) = &looked.profile {
            let reason = profile.detection.skip_reason();
            ensure!(reason == Some("empty"), "The capillary is not empty. Flush it, and confirm again");
        }
        let file = format!("empty-{}.png", jiff::Timestamp::now().strftime("%Y-%m-%dT%H-%M-%SZ"));
        durable::write(&self.beside(&file), &frames::encode(&frame)?)?;
        let middle = config.optics.ux;
        Ok(Empty { bore_px: walls.bore_px(middle), middle_px: walls.middle_v(middle), tilt_deg: walls.tilt_deg(), file })
    }

    /// Opens the rig, homes it, switches its light on, lets `work` use it, and leaves it at rest and dark.
    fn with_rig<T>(&self, config: &Config, work: impl FnOnce(&mut Rig) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let mut rig = serve::open_rig(config)?;
        let _at_rest = AtRest(self);
        self.stopper.hold(Some(rig.rotation.stop_handle()));
        rig.camera.arm()?;
        rig.rotation.reference(&self.stopper.cancel)?;
        let done = match views_on(rig.rotation.as_mut(), &self.stopper.cancel) {
            Ok(()) => work(&mut rig),
            Err(error) => Err(error.into()),
        };
        views_off(rig.rotation.as_mut());
        // The camera's error is not the one to report.
        let _ended = rig.camera.disarm();
        ensure!(!self.stopper.is_stopped(), "stopped");
        done
    }

    /// The views of plans, one after the other.
    fn views(&self, rig: &mut Rig, config: &Config, plans: &[&RevolutionPlan]) -> anyhow::Result<Vec<(LedgerEntry, RawFrame)>> {
        let all = plans.iter().map(|plan| plan.stops().len()).sum();
        let mut views = Vec::with_capacity(all);
        for plan in plans {
            revolve(rig, plan, &config.acquisition, &self.stopper.cancel, |entry, frame| {
                self.show(&frame, Some([views.len() + 1, all]));
                views.push((entry, frame));
                Ok(Next::View)
            })?;
        }
        Ok(views)
    }

    fn turn(&self, config: &Config) -> anyhow::Result<Turn> {
        let per_turn = config.steps_per_revolution;
        let [num, den] = <[u32; 2]>::from(per_turn);
        let part = |num: u64, den: u64, views: u32| -> anyhow::Result<RevolutionPlan> {
            let ratio = StepsPerRevolution::new(u32::try_from(num)?, u32::try_from(den)?)?;
            Ok(RevolutionPlan::new(views, ratio, ViewOrder::Sequential)?)
        };
        let fine = part(num.into(), u64::from(den) * 8, FINE_VIEWS)?;
        let two_turns = part(u64::from(num) * 2, den.into(), 2 * VIEWS)?;
        let all = self.with_rig(config, |rig| self.views(rig, config, &[&fine, &two_turns]))?;
        let pipeline = pipeline(config)?;
        let looked = look(&pipeline, all.iter().map(|(_, frame)| frame))?;
        let row = |seen: &SegmentedFrame| seen.profile.as_ref().ok().filter(|p| p.mask.area_px() > 0).and_then(|p| p.mask.centroid());
        let places: Vec<[f64; 2]> =
            all.iter().zip(&looked).filter_map(|((entry, _), seen)| Some([entry.achieved_steps.0 as f64, row(seen)?[1]])).collect();
        let commanded_steps = ratio_f64(per_turn);
        Ok(Turn { commanded_steps, orbit: orbit(&places, commanded_steps), seen: [places.len(), all.len()] })
    }

    fn measure(&self, config: &Config) -> anyhow::Result<Bead> {
        let method = method(config)?;
        let plan = RevolutionPlan::new(method.asd, config.steps_per_revolution, ViewOrder::Sequential)?;
        let sweep = SweepPlan::new(SWEEP.0, config.steps_per_revolution, SWEEP.1)?;
        let (views, can_sweep) = self.with_rig(config, |rig| {
            let views = self.views(rig, config, &[&plan])?;
            Ok((views, sweep.check(rig.rotation.as_ref(), rig.camera.as_mut()).is_ok()))
        })?;
        let mut pipeline = pipeline(config)?;
        let looked = look(&pipeline, views.iter().map(|(_, frame)| frame))?;
        for ((entry, _), seen) in views.iter().zip(&looked) {
            if entry.closure {
                pipeline.observe_closure(seen);
            } else {
                pipeline.observe(entry.view, entry.omega, seen)?;
            }
        }
        let (_, record) = pipeline.finish().context("The bead cannot be measured. It must be in the middle of the picture, and alone")?;
        let m = &record.measurement;
        let psi = record.calibration.as_ref().map_or(&config.optics, |c| &c.psi);
        Ok(Bead {
            diameter_um: m.diameter_um.context("No sphere fits: is it a bead?")?,
            aspect: m.aspect_ratio.context("No sphere fits: is it a bead?")?,
            volume_um3: m.volume_um3,
            closure_iou: record.closure.as_ref().map(|c| c.iou),
            closure_px: record.closure.as_ref().map(|c| c.shift_px),
            uy_px: psi.uy,
            gamma_deg: psi.gamma.to_degrees(),
            blur_px: record.blur_px().map(|blur| [blur, method.segment.edge.blur_px]),
            flags: record.flags,
            can_sweep,
        })
    }

    fn write(&self, request: &Request) -> anyhow::Result<Written> {
        let exists = self.file.exists();
        ensure!(!exists || request.replaces, "{} exists already", self.file.display());
        let backup = exists.then(|| PathBuf::from(format!("{}.bak", self.file.display())));
        if let Some(backup) = &backup {
            ensure!(!backup.exists(), "{} exists already, and older files are not overwritten: rename it", backup.display());
        }
        let now = jiff::Timestamp::now().strftime("%Y-%m-%d");
        let head = format!(
            "# Written by carved setup on {now}. Every key, with its unit, default, range and meaning: docs/configuration.md, or\n\
             # `carved config schema`. `carved config check FILE` lists everything that is wrong with a file.\n\n"
        );
        let text = format!("{head}{}", request.draft);
        // Nothing that the daemon would refuse replaces a file, and at every moment there is one.
        Config::parse(&text, &self.file)?;
        if let Some(backup) = &backup {
            let earlier = std::fs::read(&self.file).with_context(|| self.file.display().to_string())?;
            durable::write(backup, &earlier)?;
        }
        durable::write(&self.file, text.as_bytes())?;
        let doubts = Config::load(&self.file)?.doubts;
        Ok(Written { file: self.file.display().to_string(), backup: backup.map(|b| b.display().to_string()), doubts })
    }
}

impl Bench for RealBench {
    fn perform(&mut self, request: &Request) -> Result<Outcome, String> {
        self.outcome(request).map_err(|error| with_causes(&error))
    }

    fn check(&self, draft: &str) -> Result<Vec<String>, String> {
        Config::parse(draft, &self.file).map(|config| config.doubts).map_err(|error| with_causes(&error.into()))
    }

    fn exists(&self) -> bool {
        self.file.exists()
    }
}

/// Ends any motion when it is dropped, also in a panic.
struct AtRest<'a>(&'a RealBench);

impl Drop for AtRest<'_> {
    fn drop(&mut self) {
        let handle = self.0.stopper.moving.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(handle) = handle {
            handle.end_motion();
        }
    }
}

/// A light that is on.
struct Lit<'a> {
    // The order matters: nothing moves when the controller is closed, which switches the light off.
    _at_rest: AtRest<'a>,
    _axis: Option<Box<dyn RotationAxis>>,
}

fn method(config: &Config) -> anyhow::Result<&Method> {
    config.methods.values().next().context("the shipped configuration has no method")
}

fn pipeline(config: &Config) -> anyhow::Result<Pipeline> {
    Ok(Pipeline::new(method(config)?.pipeline(&config.optics, true)?.compared_with(config.empty_capillary.as_deref())?)?)
}

fn look<'a>(pipeline: &Pipeline, frames: impl Iterator<Item = &'a RawFrame>) -> anyhow::Result<Vec<SegmentedFrame>> {
    frames.collect::<Vec<_>>().into_par_iter().map(|frame| Ok(pipeline.look(frame)?)).collect()
}

fn ports() -> Vec<Listed> {
    serial_ports().into_iter().map(|port| Listed { label: doctor::heading(&port), name: port.port_name }).collect()
}

fn cameras() -> Vec<Listed> {
    let listed = |found: camera::Listed| {
        let word = |text: Option<String>| text.unwrap_or_default();
        let label = format!("{} {}, serial number {}", word(found.vendor), word(found.model), word(found.serial));
        Some(Listed { name: found.address?, label: label.trim().to_owned() })
    };
    camera::discover().into_iter().filter_map(listed).collect()
}

/// Whether a connection to `HOST:PORT` can be made.
fn answers(address: &str) -> std::io::Result<()> {
    let mut last = std::io::Error::from(std::io::ErrorKind::AddrNotAvailable);
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(_) => return Ok(()),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Time for a connection to a relay.
const CONNECT: Duration = Duration::from_secs(3);

/// Asks what answers on a port, or takes an address of a relay.
fn controller(named: &str) -> anyhow::Result<Controller> {
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let is_relay = !named.starts_with('/') && named.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    if is_relay {
        answers(named).with_context(|| {
            format!(
                "Nobody listens at {named}. Start scripts/vast_pipe_relay.py on VAST's computer, and check the address and the firewall"
            )
        })?;
        let keys = vec![("address".into(), quoted(named))];
        return Ok(Controller {
            driver: "relay".into(),
            name: format!("relay at {named}, by its port alone; the first motion shows whether it is one"),
            keys,
            homes: None,
            remark: None,
        });
    }
    let holders = doctor::holders::of(named);
    ensure!(holders.is_empty(), "{named} is held by {}: end that program, then choose the port again", holders.join(", "));
    let answer = identify(&Port::Path(named.into()), BAUD)?.with_context(|| {
        format!(
            "Nobody answers at {named} with {BAUD} baud: no {}. Check the port and the controller's power. For another rate, and to see all \
             ports, use carved doctor --baud",
            protocols()
        )
    })?;
    if let Some(refusal) = answer.refusal {
        bail!("{named} is {}: {refusal}", answer.name);
    }
    if let Some(Err(why)) = entry(answer.driver).map(|entry| entry.setup.as_ref()) {
        bail!("{named} is {}: {why}", answer.name);
    }
    let homes = answer.keys.iter().find(|key| key.name == "reference").map(|key| key.value == "\"home\"");
    let port = ("port".to_owned(), quoted(named));
    let keys = std::iter::once(port).chain(answer.keys.into_iter().map(|key| (key.name.to_owned(), key.value))).collect();
    Ok(Controller { driver: answer.driver.to_owned(), name: answer.name, keys, homes, remark: answer.remark })
}

/// Reads a stored state. `None` if there is none.
pub fn stored<T: serde::de::DeserializeOwned>(file: &Path) -> anyhow::Result<Option<T>> {
    if !file.exists() {
        return Ok(None);
    }
    Ok(Some(durable::read_json(file, "what carved setup leaves")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_configuration_is_kept_and_no_backup_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("rig.toml");
        let text = include_str!("../../../config/vast-grbl.toml");
        let mut bench = RealBench::new(file.clone(), Stopper::default(), None);
        let mut write = |replaces| bench.perform(&Request { action: Action::Write, draft: text, controller: "", replaces });
        let Outcome::Written(written) = write(false).unwrap() else { panic!("nothing was written") };
        assert_eq!(written.backup, None);
        std::fs::write(&file, "the older one").unwrap();
        assert!(write(false).unwrap_err().contains("exists already"));
        let Outcome::Written(written) = write(true).unwrap() else { panic!("nothing was written") };
        let backup = PathBuf::from(written.backup.unwrap());
        assert_eq!(backup, folder.path().join("rig.toml.bak"));
        assert_eq!(std::fs::read_to_string(&backup).unwrap(), "the older one");
        assert!(std::fs::read_to_string(&file).unwrap().contains("Written by carved setup"));
        // A second backup would replace the first one.
        let refused = write(true).unwrap_err();
        assert!(refused.contains("rig.toml.bak") && refused.contains("rename it"), "{refused}");
        assert!(std::fs::read_to_string(&file).unwrap().contains("Written by carved setup"));
    }
}
