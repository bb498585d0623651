//! `carved simulate`: the emulated rig with the daemon on it, connected by real serial and network interfaces.
//!
//! ```text
//! hardware-sim: scene or recording ── motor firmware on a pty ─> serialport ──┐
//!                                 └── GigE camera on 127.0.0.x ─> Aravis ─────┴──> the same daemon as `serve`
//! ```

mod cables;
pub mod controller;
mod folder;
mod holds;
mod job;
mod replay;
mod sampler;
mod scenery;
mod second;

use super::daemon::Daemon;
use super::serve;
use crate::config::{CameraDriver, Config, HttpSettings};
use crate::http;
use crate::session::Instrument;
use anyhow::Context;
use cables::Cables;
use carved_devices::acquisition::RevolutionPlan;
use carved_devices::camera::CameraSelect;
use carved_devices::sampler::{LoaderInterlock, Sampler};
use carved_records::{Mode, ViewOrder, is_well};
use carved_store::Claim;
use hardware_sim::{Rig, RigSettings, ShaftSettings, Sight, SlideSettings};
use holds::Holds;
use job::Job;
use sampler::{Outside, Who};
use scenery::{Appearance, SceneSampler, Scenery};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// The configuration of the emulated rig. The addresses of its devices are filled in once they are open.
const CONFIG: &str = include_str!("../../../config/simulated.toml");
const CONFIG_NAME: &str = "config/simulated.toml (built in)";

/// Views of a simulated turn in one sweep.
const SWEEP_VIEWS: u32 = 84;

#[derive(Debug, clap::Args)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct Args {
    /// Address of the page and the API.
    #[arg(long, default_value = "127.0.0.1:8420")]
    listen: SocketAddr,
    /// Folder for the runs.
    #[arg(long, default_value = "carved-data")]
    data: PathBuf,
    /// Serve without running the demo plate.
    #[arg(long)]
    no_demo: bool,
    /// Speed-up of the emulated motor and shutter over real time.
    #[arg(long, default_value_t = 1.0)]
    time_scale: f64,
    /// Wells without a specimen on every simulated plate.
    #[arg(long, value_delimiter = ',', default_value = "A04", value_parser = well)]
    empty: Vec<String>,
    /// Wells with other contents than planned, as in B02=two: two, bubble, debris, clipped, dead.
    #[arg(long, value_delimiter = ',', conflicts_with = "replay")]
    holds: Vec<Holds>,
    /// Disconnect the camera's cable once: seconds after the start, and for how many seconds, as in 60,30.
    #[arg(long, value_name = "AFTER,FOR", value_parser = out_for, conflicts_with = "replay")]
    camera_out: Option<cables::Out>,
    /// Disconnect the cable of the motor controller: seconds after the start, and for how many seconds. May be given several times.
    #[arg(long, value_name = "AFTER,FOR", value_parser = out_for, conflicts_with = "replay")]
    axis_out: Vec<cables::Out>,
    /// The controller that turns the emulated capillary, or `folder`: a vendor's program that turns it and stores pictures.
    #[arg(long, value_enum, default_value_t = controller::Make::Grbl)]
    controller: controller::Make,
    /// Sampler that fills the emulated capillary.
    #[arg(long, value_enum, default_value_t = Who::BuiltIn, conflicts_with = "replay")]
    sampler: Who,
    /// Add a translation of the capillary to the emulated rig: a second axis of the Grbl controller, with limits and a reference.
    #[arg(long, conflicts_with = "replay")]
    translation: bool,
    /// How the emulated frames look: the clean reference scene, or light, walls, dust and larvae as on frames of a real VAST.
    #[arg(long, value_enum, default_value_t = Appearance::Clean, conflicts_with = "replay")]
    frames: Appearance,
    /// Frames of 256 rows around the capillary instead of 1024: a specimen is measured with less work. For tests of other programs.
    #[arg(long, conflicts_with = "replay")]
    small: bool,
    /// Take the views of each turn in one sweep, at 30 frames/s: docs/sweep.md.
    #[arg(long, conflicts_with_all = ["replay", "second_camera"])]
    sweep: bool,
    /// Views of each turn [default: 21, and 84 with --sweep].
    #[arg(long, value_name = "N", conflicts_with = "replay")]
    views: Option<u32>,
    /// Add a second emulated camera for fluorescence.
    #[arg(long, conflicts_with = "replay")]
    second_camera: bool,
    /// Play a recording back through both emulated devices instead of the scene, and compare the numbers.
    #[arg(long, value_name = "RECORDING")]
    replay: Option<PathBuf>,
    #[command(flatten)]
    access: Access,
}

/// Who may read and command the emulated rig: as the keys of `[http]`.
#[derive(Debug, clap::Args)]
struct Access {
    /// File with the token that clients must send.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// File with a token that only reads.
    #[arg(long, value_name = "FILE", requires = "token_file")]
    read_token_file: Option<PathBuf>,
    /// Origin of a page that may read the status, such as <http://10.0.0.5:8420>.
    #[arg(long, value_name = "ORIGIN")]
    wall_origin: Vec<String>,
}

impl Args {
    fn http(&self, settings: &mut HttpSettings) {
        settings.listen = self.listen;
        settings.token_file.clone_from(&self.access.token_file);
        settings.read_token_file.clone_from(&self.access.read_token_file);
        settings.wall_origins.clone_from(&self.access.wall_origin);
    }
}

fn out_for(text: &str) -> Result<[Duration; 2], String> {
    let seconds = |s: &str| s.trim().parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    text.split_once(',')
        .and_then(|(after, lasting)| Some([seconds(after)?, seconds(lasting)?]))
        .ok_or("give two numbers of seconds, as in 60,30".into())
}

fn well(name: &str) -> Result<String, String> {
    if is_well(name) { Ok(name.to_owned()) } else { Err("wells are A01 to AF48; the demo plate has A01 to A04".into()) }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    anyhow::ensure!(
        args.time_scale.is_finite() && (0.1..=1000.0).contains(&args.time_scale),
        "--time-scale is {}; from 0.1 to 1000 can be simulated",
        args.time_scale
    );
    if args.controller == controller::Make::Folder {
        return folder::run(&args);
    }
    let mut config = Config::parse(CONFIG, Path::new(CONFIG_NAME))?;
    args.http(&mut config.http);
    config.store.data_dir.clone_from(&args.data);
    config.acquisition.settle_ms = (f64::from(config.acquisition.settle_ms) / args.time_scale).ceil() as u32;
    args.controller.configure(&mut config, args.time_scale)?;
    args.sampler.configure(&mut config, args.time_scale);
    if args.translation {
        controller::with_translation(&mut config)?;
    }
    if args.small {
        with_small_frames(&mut config)?;
    }
    for method in config.methods.values_mut() {
        if args.sweep {
            (method.order, method.asd) = (ViewOrder::Sweep, SWEEP_VIEWS);
        }
        method.asd = args.views.unwrap_or(method.asd);
        RevolutionPlan::new(method.asd, config.steps_per_revolution, method.order).context("--views")?;
    }
    let listener = http::bind(&config.http)?;
    let listen = listener.local_addr().context("the address that is served")?;
    config.http.listen = listen;
    let claim = Claim::on(&config.store.data_dir)?;
    let Before { sight, content, job } = match &args.replay {
        Some(path) => replay::of_recording(path, &mut config)?,
        None => scenery::of_phantoms(&args, &config),
    };

    let cables = Cables::new(args.camera_out, &args.axis_out);
    // A port that is connected again may get another device name. The link keeps its name.
    let serial_link = cables.concern_axis().then(|| config.store.data_dir.join("emulated-axis"));
    let settings = RigSettings { serial_link, ..rig_settings(&config, &args)? };
    let machine = settings.controller.clone();
    let mut rig = Rig::start(settings, sight).context("the emulated rig did not start")?;
    controller::connect(&mut config.rotation, &rig)?;
    let CameraDriver::Aravis(camera) = &mut config.camera else { anyhow::bail!(serve::NO_DEVICES) };
    camera.select = CameraSelect::Address(rig.camera_address());
    camera.time_scale = args.time_scale;
    if let (true, Content::Scene(scenery)) = (args.second_camera, &content) {
        config.second = Some(second::beside(&mut rig, scenery.scene())?);
    }
    let interlock = LoaderInterlock::default();
    let (devices, daemons) = serve::with_sampler(serve::open_rig(&config)?, config.sampler, &interlock)?;
    let second = serve::open_second(&config)?;
    let sampler: Box<dyn Sampler> = match (content, args.sampler) {
        (Content::Recording, _) => Box::new(replay::ReplaySampler),
        (Content::Scene(scenery), Who::BuiltIn) => Box::new(SceneSampler(scenery)),
        (Content::Scene(scenery), _) => Box::new(Outside { daemons, scenery, machine: rig.sampler().cloned() }),
    };
    let sampler = controller::taken_up_by(&machine, sampler);

    let config = Arc::new(config);
    let folder = args.data;
    let daemon = Daemon {
        claim,
        config,
        mode: Mode::Simulated,
        instrument: Instrument { rig: devices, second, sampler },
        interlock,
        listener,
        greeting: "carved simulates an instrument. Page:".into(),
    };
    // `rig` is dropped after the daemon has released its devices.
    std::thread::scope(|scope| {
        let (running, ended) = std::sync::mpsc::channel::<()>();
        let (rig, cables) = (&rig, &cables);
        scope.spawn(move || cables.follow(rig, &ended));
        let served = daemon.run(move |handle| async move { job.run(handle, &folder).await });
        drop(running);
        served.map(|_| ())
    })
}

/// Rows of a small frame: the capillary, which is 110 px high, with some rows beside it.
const SMALL_ROWS: u32 = 256;

/// The rows in the middle of the sensor. The axis, which is in the middle of the frame, stays there.
fn with_small_frames(config: &mut Config) -> anyhow::Result<()> {
    let CameraDriver::Aravis(camera) = &mut config.camera else { anyhow::bail!(serve::NO_DEVICES) };
    let optics = &mut config.optics;
    optics.uy -= (f64::from(optics.height) - f64::from(SMALL_ROWS)) / 2.0;
    (optics.height, camera.height) = (SMALL_ROWS, SMALL_ROWS);
    Ok(())
}

/// The contents of the emulated camera's picture, who changes them, and the work after the start.
struct Before {
    sight: Arc<dyn Sight>,
    content: Content,
    job: Job,
}

/// What the camera sees.
enum Content {
    Scene(Scenery),
    /// The same recording is in the capillary during the whole run.
    Recording,
}

fn rig_settings(config: &Config, args: &Args) -> anyhow::Result<RigSettings> {
    let [num, den] = config.steps_per_revolution.into();
    let shaft = ShaftSettings { steps_per_revolution: (num, den), ..ShaftSettings::default() };
    Ok(RigSettings {
        shaft,
        time_scale: args.time_scale,
        controller: controller::emulated(config)?,
        slide: config.translation.is_some().then(SlideSettings::default),
        sampler: args.sampler.emulated(args.time_scale),
        relay: controller::relay(&config.rotation),
        ..RigSettings::default()
    })
}
