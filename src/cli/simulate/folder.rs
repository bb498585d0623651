//! `carved simulate --controller folder`: the daemon beside an emulated vendor's program that stores pictures.
//!
//! ```text
//!  a run begins ──► vendor's program, a thread: its wells, in their order ──► folder ──► the daemon's [views]
//! ```

use super::Args;
use super::job::Job;
use super::scenery::{self, Scenery};
use crate::cli::daemon::Daemon;
use crate::cli::serve;
use crate::config::Config;
use crate::http;
use crate::session::Instrument;
use anyhow::Context;
use carved_devices::cancel::CancelToken;
use carved_devices::forward_sampler;
use carved_devices::rotation::RotationDriver;
use carved_devices::sampler::{Expected, Loaded, LoaderInterlock, NextWell, Sampler, Upcoming};
use carved_devices::{DeviceError, RotationAxis};
use carved_records::Mode;
use carved_store::Claim;
use hardware_sim::vast_program::{Manner, VastProgram, VastProgramSettings};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

const CONFIG: &str = include_str!("../../../config/vast-folder.toml");
const CONFIG_NAME: &str = "config/vast-folder.toml (built in)";

/// From one view to the next, and between the pieces of a picture, in real time.
const STEP: Duration = Duration::from_millis(1500);
const PAUSE: Duration = Duration::from_millis(300);

pub fn run(args: &Args) -> anyhow::Result<()> {
    anyhow::ensure!(
        args.replay.is_none()
            && !(args.translation || args.second_camera || args.small)
            && args.camera_out.is_none()
            && args.axis_out.is_empty(),
        "--controller folder has no devices; expected neither --replay, --translation, --second-camera, --small, --camera-out nor --axis-out"
    );
    let mut config = Config::parse(CONFIG, Path::new(CONFIG_NAME))?;
    args.http(&mut config.http);
    config.store.data_dir.clone_from(&args.data);
    let listener = http::bind(&config.http)?;
    config.http.listen = listener.local_addr().context("the address that is served")?;
    let claim = Claim::on(&config.store.data_dir)?;
    let pictures = std::path::absolute(args.data.join("pictures"))?;
    std::fs::create_dir_all(&pictures).with_context(|| format!("{}: cannot be made", pictures.display()))?;
    let scale = |time: Duration| time.div_f64(args.time_scale);
    let RotationDriver::Folder(views) = &mut config.rotation else { anyhow::bail!("{CONFIG_NAME} has no [views]") };
    views.folder = pictures.join("{run}").display().to_string();
    views.poll_ms = (f64::from(views.poll_ms) / args.time_scale).clamp(10.0, 500.0) as u32;
    views.quiet_ms = (f64::from(views.quiet_ms) / args.time_scale).ceil() as u32;
    let scenery = scenery::scenery(args, &config);
    let vendor = VastProgramSettings {
        folder: pictures.clone(),
        views: config.methods.values().next().map_or(12, |method| method.asd),
        repeats_first: config.repeats_first_view(),
        step: scale(STEP),
        pause: scale(PAUSE),
        manners: Manner::ALL.to_vec(),
    };
    let interlock = LoaderInterlock::default();
    let (rig, daemons) = serve::open(&config, &interlock)?;
    let sampler = BesideVendor { daemons, scenery, settings: vendor, pictures, at_work: None };
    let instrument = Instrument { rig, second: None, sampler: Box::new(sampler) };
    let greeting = "carved simulates a VAST whose own program stores the pictures. Page:".into();
    let job = if args.no_demo { Job::Serve } else { Job::Demo };
    let folder = args.data.clone();
    Daemon { claim, config: Arc::new(config), mode: Mode::Simulated, instrument, interlock, listener, greeting }
        .run(move |handle| async move { job.run(handle, &folder).await })
        .map(|_| ())
}

/// The daemon's sampler, and a vendor's program that begins when a run waits for pictures.
struct BesideVendor {
    daemons: Box<dyn Sampler>,
    scenery: Scenery,
    settings: VastProgramSettings,
    pictures: PathBuf,
    at_work: Option<AtWork>,
}

/// The thread of the vendor's program. It ends when this is dropped.
struct AtWork {
    run: String,
    end: CancelToken,
    thread: Option<JoinHandle<()>>,
}

impl Drop for AtWork {
    fn drop(&mut self) {
        self.end.cancel();
        if let Some(Err(_)) = self.thread.take().map(JoinHandle::join) {
            tracing::error!("the emulated vendor's program has panicked");
        }
    }
}

impl BesideVendor {
    /// The program begins once per run. Wells that it has stored already are not taken again.
    fn begin(&mut self, upcoming: &Upcoming<'_>) {
        if self.at_work.as_ref().is_some_and(|at_work| at_work.run == upcoming.run) {
            return;
        }
        // The earlier program has ended before the scene changes.
        self.at_work = None;
        let folder = self.pictures.join(upcoming.run);
        let last = format!("1_{}.tiff", self.settings.views);
        let wells = upcoming.wells.iter().filter(|expected| !folder.join(format!("W_{}_{last}", expected.well)).exists());
        let wells: Vec<(String, bool, Option<f64>)> = wells.map(|w| (w.well.to_owned(), w.bead, w.dpf)).collect();
        let mut program = VastProgram::new(self.scenery.scene().clone(), VastProgramSettings { folder, ..self.settings.clone() });
        let (scenery, end) = (self.scenery.clone(), CancelToken::new());
        let token = end.clone();
        let thread = std::thread::spawn(move || {
            for (well, bead, dpf) in wells {
                let expected = Expected { well: &well, bead, dpf, asked_before: false };
                let turned = scenery
                    .contents(expected)
                    .map_err(anyhow::Error::from)
                    .and_then(|(contents, _)| Ok(program.turn(&well, contents, None, &|time| token.rest(time))?));
                if let Err(error) = turned {
                    tracing::error!(%error, well, "the emulated vendor's program has failed");
                    return;
                }
            }
        });
        self.at_work = Some(AtWork { run: upcoming.run.to_owned(), end, thread: Some(thread) });
    }
}

impl Sampler for BesideVendor {
    forward_sampler!(daemons: waits_for_loader, brings_again, begin_run, look, has_sensor, sees_specimen, wash, eject);

    fn next_well(&mut self, upcoming: &Upcoming<'_>, is_ended: &dyn Fn() -> bool) -> Result<NextWell, DeviceError> {
        self.begin(upcoming);
        self.daemons.next_well(upcoming, is_ended)
    }

    fn load(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (_, truth) = self.scenery.contents(expected)?;
        Ok(self.daemons.load(axis, expected, cancel)?.map(|_| truth))
    }

    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        let (_, truth) = self.scenery.contents(expected)?;
        Ok(self.daemons.go_on(axis, expected, cancel)?.map(|_| truth))
    }
}
