//! Plays a recording back instead of the scene: the emulated axis turns, and the emulated camera sends the recorded frame for its angle.

use super::{Before, Content, Job};
use crate::cli::measure;
use crate::config::{CameraDriver, Config};
use anyhow::Context;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::units::Steps;
use carved_devices::acquisition::RevolutionPlan;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::RotationDriver;
use carved_devices::sampler::{Expected, Loaded, Sampler};
use carved_devices::{DeviceError, RotationAxis};
use carved_records::{RunPlan, ViewOrder};
use carved_store::{MEASUREMENT, MeasurementFile, Recording, RecordingReader, durable};
use hardware_sim::{Pixels, Replay};
use std::path::Path;
use std::sync::Arc;

/// Grbl's `$27`, units.
const HOMING_PULL_OFF: u16 = 27;

/// Replaces the configured rig, method and reference larvae by those of the recording, and the scene by its frames.
pub fn of_recording(path: &Path, config: &mut Config) -> anyhow::Result<Before> {
    let reader = RecordingReader::open(path)?;
    reader.require_finished()?;
    let recording = reader.recording();
    anyhow::ensure!(
        recording.ended_after_views.is_none() && recording.missing_views.is_empty(),
        "{}: views of its turn are missing, and a replay needs every view; `carved measure` measures it",
        reader.folder().display()
    );
    stands_as_planned(recording).with_context(|| reader.folder().display().to_string())?;
    let stored = reader.folder().join(MEASUREMENT);
    let (recorded, name) = if let Some(bytes) = reader.files().read(MEASUREMENT)? {
        let file: MeasurementFile = durable::parse_json(&stored, &bytes, "a measurement of this version")?;
        (file.record, stored.display().to_string())
    } else {
        (measure::compute(&reader, &recording.method)?.1.record, format!("`carved measure` of {}", reader.folder().display()))
    };
    config.optics = recording.rig.camera.clone();
    config.empty_capillary = reader.empty_capillary()?.map(Arc::new);
    config.references = reader.references()?.into();
    config.steps_per_revolution = recording.rig.steps_per_revolution;
    config.acquisition.sense = recording.rig.sense;
    config.methods.insert(recording.method_name.clone(), recording.method.clone());
    let CameraDriver::Aravis(camera) = &mut config.camera else { anyhow::bail!(crate::cli::serve::NO_DEVICES) };
    camera.pixel_format = recording.rig.pixel_format;
    (camera.width, camera.height) = (recording.rig.camera.width, recording.rig.camera.height);
    anyhow::ensure!(
        !matches!(config.rotation, RotationDriver::Relay(_)),
        "--replay needs an axis that finds its zero again; a relay takes it where it stands: choose another --controller"
    );
    let reference = reference(&config.rotation);
    let frames = recording
        .ledger
        .counted()
        .map(|entry| {
            let frame = reader.frame(entry)?;
            let angle_rad = recording.rig.steps_per_revolution.angle(entry.achieved_steps + reference);
            anyhow::Ok((angle_rad, pixels(&frame)))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let plate = format!("REPLAY-{}", recording.specimen.well);
    let plan = RunPlan::new(&plate, &recording.method_name, "replay", vec![recording.specimen.clone()]);
    let job = Job::Replay { plan: Box::new(plan), recorded: Box::new(recorded), name };
    let [num, den] = config.steps_per_revolution.into();
    let sight = Replay::new(frames, (num, den)).with_context(|| reader.folder().display().to_string())?;
    Ok(Before { sight: Arc::new(sight), content: Content::Recording, job })
}

/// The position of the axis after homing. The rig counts its angles from the reference switch, and Grbl stops one pull-off before it.
fn reference(rotation: &RotationDriver) -> Steps {
    let RotationDriver::Grbl(grbl) = rotation else { return Steps(0) };
    let [per_unit, units] = grbl.steps_per_unit.map(f64::from);
    Steps(-(f64::from(hardware_sim::grbl::Settings::default().get(HOMING_PULL_OFF)) * per_unit / units).round() as i64)
}

/// Checks that the recording has an even turn from step 0. The emulated axis makes such a turn, so only frames of its stops can be shown.
fn stands_as_planned(recording: &Recording) -> anyhow::Result<()> {
    anyhow::ensure!(
        recording.method.order != ViewOrder::Sweep,
        "its views were taken in a sweep, and a replay has stops: `carved measure` measures it"
    );
    let plan = RevolutionPlan::new(recording.method.asd, recording.rig.steps_per_revolution, recording.method.order)?;
    for entry in recording.ledger.counted() {
        let stop = plan.stops().iter().find(|s| s.view == entry.view).context("a view that its method does not have")?;
        anyhow::ensure!(
            stop.target == entry.commanded_steps,
            "view {} was taken at {}, an even turn has it at {}: only an even turn can be replayed; `carved measure` measures any",
            entry.view,
            entry.commanded_steps,
            stop.target
        );
    }
    Ok(())
}

fn pixels(frame: &RawFrame) -> Pixels {
    let format = match frame.format() {
        PixelFormat::Mono8 => hardware_sim::PixelFormat::Mono8,
        PixelFormat::BayerRG8 => hardware_sim::PixelFormat::BayerRG8,
        PixelFormat::BayerGR8 => hardware_sim::PixelFormat::BayerGR8,
        PixelFormat::BayerGB8 => hardware_sim::PixelFormat::BayerGB8,
        PixelFormat::BayerBG8 => hardware_sim::PixelFormat::BayerBG8,
        PixelFormat::RGB8Packed => hardware_sim::PixelFormat::RGB8Packed,
    };
    Pixels { width: frame.width(), height: frame.height(), format, bytes: frame.bytes().to_vec() }
}

/// The same recording is in the capillary during the whole run.
pub struct ReplaySampler;

impl Sampler for ReplaySampler {
    fn waits_for_loader(&self) -> bool {
        false
    }

    fn brings_again(&self) -> bool {
        true
    }

    fn begin_run(&mut self) {}

    fn look(&mut self, _axis: &mut dyn RotationAxis) -> Result<(), DeviceError> {
        Ok(())
    }

    fn sees_specimen(&self) -> Option<bool> {
        None
    }

    fn load(
        &mut self,
        _axis: &mut dyn RotationAxis,
        _expected: Expected<'_>,
        _cancel: &CancelToken,
    ) -> Result<Option<Loaded>, DeviceError> {
        Ok(Some(Loaded::default()))
    }

    fn go_on(&mut self, axis: &mut dyn RotationAxis, expected: Expected<'_>, cancel: &CancelToken) -> Result<Option<Loaded>, DeviceError> {
        self.load(axis, expected, cancel)
    }

    fn eject(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
    fn wash(&mut self, _axis: &mut dyn RotationAxis, _well: &str, _cancel: &CancelToken) -> Result<(), DeviceError> {
        Ok(())
    }
}
