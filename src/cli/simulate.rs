//! `carved simulate`: the emulated rig and the daemon on it, over the real doors.
//!
//! ```text
//! hardware-sim: scene or recording ── Grbl firmware on a pty ──> serialport ──┐
//!                                 └── GigE camera on 127.0.0.x ─> Aravis ─────┴──> the same daemon as `serve`
//! ```

use super::daemon::{self, Daemon};
use super::serve;
use crate::cancel::CancelToken;
use crate::config::{CameraDriver, Config, RotationDriver};
use crate::device::DeviceError;
use crate::device::camera::CameraSelect;
use crate::device::sampler::{Expected, Loaded, LoaderGate, Sampler};
use crate::session::{Instrument, Mode, PlannedWell, RunPlan, RunStatus, SessionHandle, SpecimenKind};
use crate::store::{RecordingReader, StoreError};
use crate::units::Steps;
use anyhow::Context;
use hardware_sim::scene::{self, Scene, SceneSettings, Specimen};
use hardware_sim::shaft::ShaftSettings;
use hardware_sim::{Pixels, Replay, Rig, RigSettings, Sight};
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What the emulated rig is configured with; its doors are filled in when they are open.
const CONFIG: &str = include_str!("../../config/simulated.toml");
const CONFIG_NAME: &str = "config/simulated.toml (built in)";

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where the page and the API are served.
    #[arg(long, default_value = "127.0.0.1:8420")]
    listen: SocketAddr,
    /// Where runs are stored.
    #[arg(long, default_value = "carved-data")]
    data: PathBuf,
    /// Serve without running the demo plate.
    #[arg(long)]
    no_demo: bool,
    /// How many times faster than real time the emulated motor and shutter work.
    #[arg(long, default_value_t = 1.0)]
    time_scale: f64,
    /// Wells of every simulated plate that hold nothing.
    #[arg(long, value_delimiter = ',', default_value = "A04")]
    empty: Vec<String>,
    /// Play a recording back through both device doors instead of the scene, and compare the numbers.
    #[arg(long, value_name = "RECORDING")]
    replay: Option<PathBuf>,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    anyhow::ensure!(
        args.time_scale.is_finite() && (0.1..=1000.0).contains(&args.time_scale),
        "--time-scale is {}; from 0.1 to 1000 can be simulated",
        args.time_scale
    );
    let mut config = Config::parse(CONFIG, Path::new(CONFIG_NAME))?;
    config.http.listen = args.listen;
    config.store.data_dir = args.data.clone();
    config.acquisition.settle_ms = (f64::from(config.acquisition.settle_ms) / args.time_scale).ceil() as u32;
    let listener = daemon::bind(args.listen)?;
    let listen = listener.local_addr().context("the address that is served")?;
    config.http.listen = listen;
    let (sight, sampler, job): (Arc<dyn Sight>, Box<dyn Sampler>, Job) = match &args.replay {
        Some(path) => replay(path, &mut config)?,
        None => scene(&args, &config),
    };

    let rig = Rig::start(rig_settings(&config, args.time_scale), sight).context("the emulated rig did not start")?;
    let RotationDriver::Grbl(grbl) = &mut config.rotation;
    grbl.port = rig.serial_path().to_string_lossy().into_owned();
    let CameraDriver::Aravis(camera) = &mut config.camera;
    camera.select = CameraSelect::Address(rig.camera_address());
    let devices = serve::open_rig(&config)?;

    println!("carved simulates an instrument. Page and status: http://{listen}  http://{listen}/v1/status");
    let config = Arc::new(config);
    let gate = LoaderGate::default();
    let folder = args.data;
    Daemon { config, mode: Mode::Simulated, instrument: Instrument { rig: devices, sampler }, gate, listener }
        .run(move |handle| async move { job.run(handle, &folder).await })
    // `rig` is dropped here, after the daemon has let its devices go.
}

fn rig_settings(config: &Config, time_scale: f64) -> RigSettings {
    let [num, den] = config.steps_per_revolution.into();
    let shaft = ShaftSettings { steps_per_revolution: (num, den), ..ShaftSettings::default() };
    RigSettings { shaft, time_scale, ..RigSettings::default() }
}

/// What is done after the start, as a client of the daemon.
enum Job {
    Serve,
    Demo,
    /// The replayed recording's plan, and where its stored numbers are.
    Replay {
        plan: RunPlan,
        recorded: PathBuf,
    },
}

impl Job {
    async fn run(self, handle: SessionHandle, data: &Path) -> anyhow::Result<()> {
        let (prefix, plan) = match &self {
            Self::Serve => return Ok(()),
            Self::Demo => ("demo", demo_plan()),
            Self::Replay { plan, .. } => ("replay", plan.clone()),
        };
        let id = format!("{prefix}-{}", jiff::Timestamp::now().strftime("%Y%m%dT%H%M%S"));
        let well = plan.plate_map[0].well.clone();
        handle.put_run(id.clone(), plan).await?;
        let run = finished(&handle, &id).await;
        let Some(run) = run else { return Ok(()) };
        if let Self::Replay { recorded, .. } = &self {
            let replayed = data.join("runs").join(&id).join(&well).join("measurement.json");
            println!("{}", compare(recorded, &replayed)?);
        } else {
            print!("{}", table(&run, &data.join("runs").join(&id)));
        }
        println!("Serving on. Ctrl-C ends it.");
        Ok(())
    }
}

/// Waits for the end of a run; nothing where another run has taken its place.
async fn finished(handle: &SessionHandle, id: &str) -> Option<RunStatus> {
    let mut revision = 0;
    loop {
        let status = handle.status_after(revision).await;
        revision = status.revision;
        let run = status.run.filter(|r| r.id == id)?;
        if run.outcome.is_some() {
            return Some(run);
        }
    }
}

fn demo_plan() -> RunPlan {
    let well = |well: &str, specimen, dpf| PlannedWell { well: well.into(), specimen, dpf };
    RunPlan {
        plate_barcode: "DEMO".into(),
        method: "standard".into(),
        operator: "demo".into(),
        external_id: None,
        plate_map: vec![
            well("A01", SpecimenKind::Larva, Some(3.0)),
            well("A02", SpecimenKind::Larva, Some(5.0)),
            well("A03", SpecimenKind::Bead, None),
            well("A04", SpecimenKind::Larva, Some(4.0)),
        ],
    }
}

/// The demo's numbers beside the phantoms' truth.
fn table(run: &RunStatus, folder: &Path) -> String {
    let mut text = format!("Run {} has ended: {:?}. Numbers of a simulation:\n", run.id, run.outcome);
    text += "well  specimen   outcome    volume um^3   ideal hull    difference  area um^2\n";
    for w in &run.results {
        let hull = RecordingReader::open(&folder.join(&w.well))
            .ok()
            .and_then(|r| r.recording().truth.as_ref().and_then(|t| t.get("hull_volume_um3")).and_then(serde_json::Value::as_f64));
        let number = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.4e}"));
        let difference = w.volume_um3.zip(hull).map_or_else(|| "-".into(), |(v, h)| format!("{:+.2} %", (v / h - 1.0) * 100.0));
        let kind = match (w.specimen, w.dpf) {
            (SpecimenKind::Bead, _) => "bead".to_owned(),
            (SpecimenKind::Larva, Some(dpf)) => format!("{dpf} dpf"),
            (SpecimenKind::Larva, None) => "larva".to_owned(),
        };
        let outcome = match (&w.outcome, &w.reason) {
            (Some(o), Some(reason)) => format!("{o:?}: {reason}"),
            (Some(o), None) => format!("{o:?}"),
            (None, _) => "-".into(),
        };
        text += &format!(
            "{:<5} {kind:<10} {outcome:<10} {:<13} {:<13} {difference:<11} {}\n",
            w.well,
            number(w.volume_um3),
            number(hull),
            number(w.area_um2)
        );
    }
    text
}

fn compare(recorded: &Path, replayed: &Path) -> anyhow::Result<String> {
    let read = |path: &Path| std::fs::read(path).map_err(|source| StoreError::Io { what: "read", path: path.to_owned(), source });
    let same = read(recorded)? == read(replayed)?;
    let verdict = if same { "identical, bit for bit" } else { "NOT the same" };
    Ok(format!("Replayed numbers are {verdict}: {} and {}", recorded.display(), replayed.display()))
}

fn scene(args: &Args, config: &Config) -> (Arc<dyn Sight>, Box<dyn Sampler>, Job) {
    let scene = Arc::new(Scene::new(scene_settings(config)));
    let sampler = SceneSampler { scene: scene.clone(), empty: args.empty.iter().cloned().collect() };
    (scene, Box::new(sampler), if args.no_demo { Job::Serve } else { Job::Demo })
}

/// The scene is seen by the camera that the configuration describes.
fn scene_settings(config: &Config) -> SceneSettings {
    let c = &config.optics;
    let camera = scene::Camera {
        f_um: c.f,
        kx_px_per_um: c.kx,
        ky_px_per_um: c.ky,
        ux_px: c.ux,
        uy_px: c.uy,
        skew: c.s,
        alpha_rad: c.alpha,
        gamma_rad: c.gamma,
        phi_rad: c.phi,
        width: c.width,
        height: c.height,
    };
    SceneSettings { camera, ..SceneSettings::default() }
}

/// Grbl's `$27`, units.
const HOMING_PULL_OFF: u16 = 27;

/// Fills the emulated capillary by the plate map.
struct SceneSampler {
    scene: Arc<Scene>,
    empty: BTreeSet<String>,
}

/// Diameter of the simulated beads, um.
const BEAD_UM: f64 = 500.0;

/// Larvae of a plate differ, and the same well gives the same larva each time.
fn seed_of(well: &str) -> u64 {
    well.bytes().fold(7, |seed, b| seed * 31 + u64::from(b))
}

impl Sampler for SceneSampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn load(&mut self, expected: Expected<'_>, _cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let refused = |e: &dyn std::fmt::Display| DeviceError::Sampler { well: expected.well.to_owned(), why: e.to_string() };
        let specimen = if self.empty.contains(expected.well) {
            None
        } else if expected.bead {
            Some(Specimen::bead(BEAD_UM).map_err(|e| refused(&e))?)
        } else {
            // There are phantoms of 3, 4 and 5 dpf: the nearest stands for any other age.
            let dpf = expected.dpf.unwrap_or(4.0).round().clamp(3.0, 5.0) as u8;
            Some(Specimen::larva(dpf, seed_of(expected.well)).map_err(|e| refused(&e))?)
        };
        let truth = specimen.as_ref().map(|s| serde_json::to_value(s.truth())).transpose().map_err(|e| refused(&e))?;
        self.scene.load(specimen).map_err(|e| refused(&e))?;
        Ok(Some(Loaded { truth }))
    }

    fn eject(&mut self, well: &str) -> Result<(), DeviceError> {
        self.scene.load(None).map_err(|e| DeviceError::Sampler { well: well.to_owned(), why: e.to_string() })
    }
}

/// A recording is in the capillary for the whole of the run.
struct ReplaySampler;

impl Sampler for ReplaySampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn load(&mut self, _expected: Expected<'_>, _cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        Ok(Some(Loaded::default()))
    }

    fn eject(&mut self, _well: &str) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// The recording's rig and method take the place of the configured ones, its frames that of the scene.
fn replay(path: &Path, config: &mut Config) -> anyhow::Result<(Arc<dyn Sight>, Box<dyn Sampler>, Job)> {
    let reader = RecordingReader::open(path)?;
    reader.require_finished()?;
    let recording = reader.recording();
    config.optics = recording.rig.camera.clone();
    config.steps_per_revolution = recording.rig.steps_per_revolution;
    config.acquisition.sense = recording.rig.sense;
    config.methods.insert(recording.method_name.clone(), recording.method.clone());
    let CameraDriver::Aravis(camera) = &mut config.camera;
    camera.pixel_format = recording.rig.pixel_format;
    (camera.width, camera.height) = (recording.rig.camera.width, recording.rig.camera.height);
    // The rig counts its angles from the reference switch, and homing leaves the axis one pull-off before it.
    let RotationDriver::Grbl(grbl) = &config.rotation;
    let [per_unit, units] = grbl.steps_per_unit.map(f64::from);
    let reference = Steps(-(f64::from(rig_settings(config, 1.0).firmware.get(HOMING_PULL_OFF)) * per_unit / units).round() as i64);
    let frames = recording
        .ledger
        .entries()
        .iter()
        .map(|entry| {
            let frame = reader.frame(entry)?;
            let angle_rad = recording.rig.steps_per_revolution.angle(entry.achieved_steps + reference);
            anyhow::Ok((angle_rad, pixels(&frame)))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let plan = RunPlan {
        plate_barcode: format!("REPLAY-{}", recording.specimen.well),
        method: recording.method_name.clone(),
        operator: "replay".into(),
        external_id: None,
        plate_map: vec![recording.specimen.clone()],
    };
    let job = Job::Replay { plan, recorded: reader.folder().join("measurement.json") };
    let [num, den] = config.steps_per_revolution.into();
    let sight = Replay::new(frames, (num, den)).with_context(|| reader.folder().display().to_string())?;
    Ok((Arc::new(sight), Box::new(ReplaySampler), job))
}

fn pixels(frame: &crate::frame::RawFrame) -> Pixels {
    use crate::frame::PixelFormat;
    let format = match frame.format() {
        PixelFormat::Mono8 => hardware_sim::PixelFormat::Mono8,
        PixelFormat::BayerRG8 => hardware_sim::PixelFormat::BayerRG8,
        PixelFormat::RGB8Packed => hardware_sim::PixelFormat::RGB8Packed,
    };
    Pixels { width: frame.width(), height: frame.height(), format, bytes: frame.bytes().to_vec() }
}
