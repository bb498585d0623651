//! An emulated rig with Grbl firmware, specimens loaded by the test, and a daemon that takes it for an instrument.

use super::{Daemon, configured, patient, port, small_frames, small_scene, until};
use hardware_sim::grbl::Settings;
use hardware_sim::scene::Scene;
use hardware_sim::{Controller, Rig, RigSettings, SamplerSettings, ShaftSettings, Sight};
use std::path::PathBuf;
use std::sync::Arc;

/// An instrument with its specimens and its daemon. The daemon is dropped first, so that it releases the devices before they end.
pub struct Instrument {
    pub daemon: Daemon,
    pub rig: Rig,
    pub scene: Arc<Scene>,
    pub config: PathBuf,
    pub data: PathBuf,
    pub dir: tempfile::TempDir,
}

/// Speed and method with which an instrument is started.
pub struct Rate {
    pub time_scale: f64,
    /// Acceleration of the axis, units/s^2.
    pub acceleration: f32,
    pub asd: u32,
    pub order: &'static str,
    /// The keys of the method's `early_stop`.
    pub early_stop: &'static str,
    pub power_on_steps: i64,
}

/// Fast, for specimens that are measured completely.
pub const QUICK: Rate = Rate { time_scale: 10.0, acceleration: 20.0, asd: 21, order: "sequential", early_stop: "", power_on_steps: 137 };
/// Three views, 167 steps apart. At 0.25 units/s^2 and 100 steps per unit a move takes 2 sqrt(1.67 / 0.25) = 5 s. What happens in the first
/// tenth of a move therefore has seconds to take effect before its middle. The reference is near.
pub const SLOW: Rate = Rate { time_scale: 1.0, acceleration: 0.25, asd: 3, power_on_steps: 480, ..QUICK };
/// The way to the reference takes several seconds.
pub const SLOW_REFERENCE: Rate = Rate { power_on_steps: 250, ..SLOW };

impl Instrument {
    /// `policy` has the keys of the method's policy. `seen` returns what the camera sees: the scene or a sight in front of it.
    pub fn start(rate: &Rate, policy: &str, seen: impl FnOnce(Arc<Scene>) -> Arc<dyn Sight>) -> Self {
        Self::filled_by(None, rate, policy, &[], seen)
    }

    /// As `start`, with further changes to the configuration and, if given, a sampler that reports by a wire what it has loaded.
    pub fn filled_by(
        sampler: Option<SamplerSettings>,
        rate: &Rate,
        policy: &str,
        more: &[(&str, String)],
        seen: impl FnOnce(Arc<Scene>) -> Arc<dyn Sight>,
    ) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let scene = small_scene();
        let mut firmware = Settings::default();
        firmware.set(120, rate.acceleration).unwrap();
        let shaft = ShaftSettings { power_on_steps: rate.power_on_steps, ..ShaftSettings::default() };
        let serial_link = Some(dir.path().join("motor"));
        let controller = Controller::Grbl(firmware);
        let settings = RigSettings { time_scale: rate.time_scale, controller, shaft, serial_link, sampler, ..RigSettings::default() };
        let rig = Rig::start(settings, seen(scene.clone())).unwrap();
        let changes = [
            port(&rig),
            ("settle_ms = 50", format!("settle_ms = {:.0}", 50.0 / rate.time_scale)),
            ("acceleration_units_per_s2 = 20.0", format!("acceleration_units_per_s2 = {:?}", rate.acceleration)),
            ("asd = 21", format!("asd = {}\npolicy = {{ {policy} }}\nearly_stop = {{ {} }}", rate.asd, rate.early_stop)),
            ("order = \"sequential\"", format!("order = {:?}", rate.order)),
            // A budget for a few wells. A whole plate with 500 views per well would not fit.
            ("[store]", "[store]\nbudget_gb = 10".into()),
        ];
        let (config, data) = configured("vast-grbl.toml", dir.path(), &rig, &[&changes[..], &small_frames(), &patient(), more].concat());
        Self { daemon: Daemon::serve(&config, &data), rig, scene, config, data, dir }
    }

    /// Ends the daemon by a signal and starts it again on the same rig.
    pub fn restarted(self, signal: &str) -> Self {
        let Self { daemon, rig, scene, config, data, dir } = self;
        daemon.signal(signal);
        daemon.ended();
        Self { daemon: Daemon::serve(&config, &data), rig, scene, config, data, dir }
    }
}

/// Waits until the shaft stands, and returns its angle, rad. A daemon that has stopped the motor may answer, or be gone, before the bytes
/// of the stop have come through the pty.
pub fn standing(rig: &Rig) -> f64 {
    let mut angle = rig.shaft().angle_rad();
    until("the shaft to stand", || {
        let before = std::mem::replace(&mut angle, rig.shaft().angle_rad());
        before.to_bits() == angle.to_bits()
    });
    angle
}
