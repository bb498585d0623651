//! The duration of the parts of a step: turns of 21 and of 84 views through a real driver and the real camera on the emulated rig, in real
//! time: `cargo bench --bench revolution [-- grbl|tmcl|zaber]`.
//!
//! ```text
//! step ├─ move ──────────────────┤ settle ├ trigger ├ exposure ├ wire ├ rest ┤
//!      ├ trapezoid ┤ ours        │ given  │ ours    │ given    │ given│ ours │
//! ```
//! The given parts are the trapezoid of the configured speed and acceleration, the settling time and exposure as configured, and the wire:
//! a frame's packets at the camera's bytes per second. All other time is ours, including that of the emulated devices. They show a single
//! picture that was rendered before.

use anyhow::Context;
use carved::config::{CameraDriver, Config};
use carved_devices::acquisition::{AcquisitionSettings, Next, RevolutionPlan, revolve};
use carved_devices::camera::{self, CameraSelect};
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Grbl, Port, RotationDriver, Tmcl, Zaber};
use carved_devices::{Rig as Devices, RotationAxis};
use carved_records::{LedgerEntry, ViewOrder};
use hardware_sim::motion::MotionProfile;
use hardware_sim::{Controller, Exposure, PixelFormat, Pixels, Rig, RigSettings, ShaftSettings, Sight, TestCard, grbl, tmcl, zaber};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const MAKES: [(&str, &str); 3] = [
    ("grbl", include_str!("../config/simulated.toml")),
    ("tmcl", include_str!("../config/vast-tmcl.toml")),
    ("zaber", include_str!("../config/vast-zaber.toml")),
];
const VIEWS: [u32; 2] = [21, 84];
/// The emulated camera's `StreamBytesPerSecond`.
const BYTES_PER_S: f64 = 115.0e6;
/// Headers of a packet, bytes: IP, UDP and stream.
const HEADERS: f64 = 36.0;

/// The same picture at every angle.
struct Still(Pixels);

impl Sight for Still {
    fn size(&self) -> (u32, u32) {
        (self.0.width, self.0.height)
    }

    fn look(&self, _: &Exposure, _: PixelFormat) -> Pixels {
        self.0.clone()
    }
}

/// Durations of the parts of a step, ms.
struct Step {
    whole: f64,
    given_move: f64,
    entry: LedgerEntry,
}

fn main() -> anyhow::Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    println!("ms per step, median and 95 %; \"ours\" is what is beyond trapezoid, rest, exposure and wire");
    println!("make  views |     move (trapezoid) |        rest |     trigger | exposure, wire |    frame | hash, light |        ours");
    for (make, config) in MAKES.iter().filter(|(make, _)| wanted.is_empty() || wanted.iter().any(|w| w == make)) {
        let config = Config::parse(config, Path::new(make))?;
        for views in VIEWS {
            turn(make, &config, views).with_context(|| format!("{make}, {views} views"))?;
        }
    }
    Ok(())
}

fn turn(make: &str, config: &Config, views: u32) -> anyhow::Result<()> {
    let CameraDriver::Aravis(mut camera) = config.camera.clone() else { anyhow::bail!("{make} has no camera") };
    let card = TestCard::new(camera.width, camera.height);
    let picture = card.look(&Exposure { angle_rad: 0.0, number: 0 }, PixelFormat::BayerRG8);
    let [steps, turns] = <[u32; 2]>::from(config.steps_per_revolution);
    let shaft = ShaftSettings { steps_per_revolution: (steps, turns), ..ShaftSettings::default() };
    let controller = match &config.rotation {
        RotationDriver::Tmcl(_) => Controller::Tmcl(tmcl::Settings::default()),
        RotationDriver::Zaber(_) => Controller::Zaber(zaber::Settings::default()),
        _ => Controller::Grbl(grbl::Settings::default()),
    };
    let emulated = Rig::start(RigSettings { controller, shaft, ..RigSettings::default() }, Arc::new(Still(picture)))?;
    camera.select = CameraSelect::Address(emulated.camera_address());
    let packets = f64::from(camera.width * camera.height) / (f64::from(camera.packet_size) - HEADERS);
    let wire_ms = packets.ceil() * f64::from(camera.packet_size) / BYTES_PER_S * 1e3;
    let exposure_ms = camera.exposure_us * 1e-3;
    let rotation = open(&config.rotation, &emulated)?;
    let mut rig = Devices { rotation, camera: camera::open(camera)? };
    rig.camera.arm()?;
    let cancel = CancelToken::new();
    rig.rotation.reference(&cancel)?;

    let plan = RevolutionPlan::new(views, config.steps_per_revolution, ViewOrder::Sequential)?;
    let settings: &AcquisitionSettings = &config.acquisition;
    let mut steps = Vec::new();
    let (mut began, mut from) = (Instant::now(), 0);
    revolve(&mut rig, &plan, settings, &cancel, |entry, _| {
        let given_move = trapezoid_ms(&config.rotation, entry.commanded_steps.0 - from);
        from = entry.commanded_steps.0;
        let now = Instant::now();
        steps.push(Step { whole: (now - began).as_secs_f64() * 1e3, given_move, entry });
        began = now;
        Ok(Next::View)
    })?;
    // The axis does not move to the first view.
    let steps = &steps[1..];
    let of = |time: &dyn Fn(&Step) -> f64| percentiles(steps.iter().map(time).collect());
    let settle_ms = f64::from(settings.settle_ms);
    println!(
        "{make:5} {views:5} | {} ({:5.1}) | {} | {} | {exposure_ms:6.1} {wire_ms:7.1} | {} | {} | {}",
        of(&|s| s.entry.moved_ms),
        steps.iter().map(|s| s.given_move).sum::<f64>() / steps.len() as f64,
        of(&|s| s.entry.settle_ms),
        of(&|s| s.entry.trigger_ms),
        of(&|s| s.entry.grab_ms - s.entry.trigger_ms),
        of(&|s| s.whole - s.entry.moved_ms - s.entry.settle_ms - s.entry.grab_ms),
        of(&|s| s.whole - s.given_move - settle_ms - exposure_ms - wire_ms),
    );
    Ok(())
}

fn open(driver: &RotationDriver, emulated: &Rig) -> anyhow::Result<Box<dyn RotationAxis>> {
    let port = Port::Path(emulated.serial_path().to_string_lossy().into_owned());
    Ok(match driver.clone() {
        RotationDriver::Grbl(mut settings) => {
            settings.port = port;
            Box::new(Grbl::open(settings)?)
        }
        RotationDriver::Tmcl(mut settings) => {
            settings.port = port;
            Box::new(Tmcl::open(settings)?)
        }
        RotationDriver::Zaber(mut settings) => {
            settings.port = port;
            Box::new(Zaber::open(settings)?)
        }
        _ => {
            anyhow::bail!("a stock VAST has a pace of its own")
        }
    })
}

/// Duration of a move of the motor with the configured speed and acceleration, ms.
fn trapezoid_ms(driver: &RotationDriver, steps: i64) -> f64 {
    let way = steps.unsigned_abs() as f64;
    let profile = match driver {
        RotationDriver::Grbl(settings) => {
            let per_unit = f64::from(settings.steps_per_unit[0]) / f64::from(settings.steps_per_unit[1]);
            MotionProfile::trapezoid(way / per_unit, settings.max_rate_units_per_min / 60.0, settings.acceleration_units_per_s2)
        }
        RotationDriver::Tmcl(settings) => {
            MotionProfile::trapezoid(way, f64::from(settings.max_speed), f64::from(settings.max_acceleration))
        }
        // In the units of the protocol.
        RotationDriver::Zaber(settings) => {
            MotionProfile::trapezoid(way, f64::from(settings.maxspeed) / 1.6384, f64::from(settings.accel) * 1e4 / 1.6384)
        }
        _ => return 0.0,
    };
    profile.duration_s() * 1e3
}

fn percentiles(mut times: Vec<f64>) -> String {
    times.sort_by(f64::total_cmp);
    let at = |part: f64| times[((times.len() - 1) as f64 * part).round() as usize];
    format!("{:5.1} {:5.1}", at(0.5), at(0.95))
}
