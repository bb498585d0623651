//! A sweep through the real drivers and the real camera, compared with the true angle at each exposure.

use crate::common::{controllers, until};
use crate::motion_zaber;
use carved_core::frame::PixelFormat;
use carved_core::units::{Sense, StepsPerRevolution};
use carved_devices::acquisition::{AcquisitionError, AcquisitionSettings, SinkClosed, SweepPlan, sweep};
use carved_devices::camera::{self, AravisSettings, CameraSelect};
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::{Grbl, GrblSettings, Reference, Tmcl, Zaber};
use carved_devices::{DeviceError, Rig, RotationAxis};
use carved_records::{Ledger, LedgerEntry};
use hardware_sim::serial::Button;
use hardware_sim::{Controller, TestCard};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::sync::Arc;

const WIDTH: u32 = 256;
const HEIGHT: u32 = 64;
const ASD: u32 = 84;
const RATE_HZ: f64 = 30.0;

/// An emulated rig in real time, with the devices that carved has opened and referenced on it.
struct Bench {
    // Closed before the camera goes away.
    devices: Rig,
    emulated: hardware_sim::Rig,
    steps: u32,
    /// The true angle at step 0.
    zero_rad: f64,
}

impl Bench {
    fn new(controller: Controller, steps: u32, open: impl FnOnce(&hardware_sim::Rig) -> Box<dyn RotationAxis>) -> Self {
        let shaft = hardware_sim::ShaftSettings { steps_per_revolution: (steps, 1), ..hardware_sim::ShaftSettings::default() };
        let settings = hardware_sim::RigSettings { controller, shaft, ..hardware_sim::RigSettings::default() };
        let emulated = hardware_sim::Rig::start(settings, Arc::new(TestCard::new(WIDTH, HEIGHT))).unwrap();
        let mut rotation = open(&emulated);
        rotation.reference(&CancelToken::new()).unwrap();
        let select = CameraSelect::Address(emulated.camera_address());
        let settings = AravisSettings { packet_size: 8228, ..AravisSettings::new(select, PixelFormat::BayerRG8, WIDTH, HEIGHT, 4000.0) };
        let mut camera = camera::open(settings).unwrap();
        camera.arm().unwrap();
        let zero_rad = emulated.shaft().angle_rad();
        Self { devices: Rig { rotation, camera }, emulated, steps, zero_rad }
    }

    fn grbl() -> Self {
        Self::new(Controller::default(), 500, |rig| {
            let settings = controllers::grbl(controllers::serial_port(rig), Reference::Home);
            Box::new(Grbl::open(GrblSettings { homing_timeout_ms: 20_000, ..settings }).unwrap())
        })
    }

    /// A sweep, and again if a busy computer has lost too much of it.
    fn complete(&mut self, mut seen: impl FnMut(&hardware_sim::Rig, &LedgerEntry)) -> Ledger {
        for _ in 0..5 {
            match self.sweep(&mut seen) {
                Ok(ledger) => return ledger,
                Err(AcquisitionError::Sweep(error)) if error.is_of_frames() => println!("{error}"),
                Err(error) => panic!("{error}"),
            }
            self.devices.rotation.reference(&CancelToken::new()).unwrap();
            self.zero_rad = self.emulated.shaft().angle_rad();
        }
        panic!("five sweeps were not complete")
    }

    fn sweep(&mut self, mut seen: impl FnMut(&hardware_sim::Rig, &LedgerEntry)) -> Result<Ledger, AcquisitionError> {
        let plan = SweepPlan::new(ASD, StepsPerRevolution::new(self.steps, 1).unwrap(), RATE_HZ).unwrap();
        let settings = AcquisitionSettings { settle_ms: 50, grab_deadline_ms: 10_000, sense: Sense::Positive };
        plan.check(self.devices.rotation.as_ref(), self.devices.camera.as_mut()).unwrap();
        let emulated = &self.emulated;
        sweep(&mut self.devices, &plan, &settings, &CancelToken::new(), |entry, _| {
            seen(emulated, &entry);
            Ok::<(), SinkClosed>(())
        })
    }

    /// Each view has the frame of an exposure, and the angle of the ledger is the true one of this exposure, but for one error that all
    /// views share.
    fn holds(&self, ledger: &Ledger) {
        let exposures = self.emulated.exposures();
        let mut off = Vec::new();
        for entry in ledger.entries() {
            let hash = |bytes: &[u8]| {
                bytes.iter().fold(String::new(), |mut text, byte| {
                    write!(text, "{byte:02x}").unwrap();
                    text
                })
            };
            let exposed = exposures.iter().rev().find(|e| e.sent && hash(&e.sha256) == entry.sha256);
            let exposed = exposed.unwrap_or_else(|| panic!("view {} was never exposed", entry.view));
            assert_eq!(entry.swept.unwrap().camera_ns, exposed.camera_ns);
            off.push(exposed.angle_rad - self.zero_rad - entry.omega);
        }
        let (least, most) = off.iter().fold((f64::MAX, f64::MIN), |(least, most), off| (least.min(*off), most.max(*off)));
        assert!(most - least < 1e-5, "the angles between the views are off by {} deg", (most - least).to_degrees());
        // A start that may lie anywhere in its interval is at most 1.73 standard deviations from the middle.
        let sd = ledger.entries()[0].swept.unwrap().omega_sd;
        assert!(least.abs() < 2.0 * sd, "all angles are off by {least} rad, and {sd} rad are stated");
    }

    /// The axis stands, and refuses to move before its next reference.
    fn has_stopped(&mut self) {
        until("the shaft to stand", || !self.emulated.shaft().is_turning());
        assert!(self.devices.rotation.move_to(carved_core::units::Steps(3)).is_err());
    }
}

#[test]
fn the_angles_of_a_sweep_are_those_of_the_shaft() {
    let zaber = |rig: &hardware_sim::Rig| Box::new(Zaber::open(motion_zaber::settings(rig)).unwrap()) as Box<dyn RotationAxis>;
    let tmcl = |rig: &hardware_sim::Rig| {
        Box::new(Tmcl::open(crate::motion_tmcl::settings_at(controllers::serial_port(rig))).unwrap()) as Box<dyn RotationAxis>
    };
    for mut bench in [
        Bench::grbl(),
        Bench::new(Controller::Zaber(hardware_sim::zaber::Settings::default()), 6400, zaber),
        Bench::new(Controller::Tmcl(hardware_sim::tmcl::Settings::default()), 6400, tmcl),
    ] {
        let ledger = bench.complete(|_, _| ());
        bench.holds(&ledger);
        let (first, closure) = (&ledger.entries()[0], ledger.closure().unwrap());
        // A controller that takes whole numbers for its speed turns a little slower or faster. The angle of the closure view says so.
        assert!((closure.omega - first.omega - TAU).abs() < 0.002 * TAU, "{} rad", closure.omega - first.omega);
        // The axis can make the next turn without another reference.
        bench.devices.rotation.move_to(carved_core::units::Steps(0)).unwrap();
    }
}

#[test]
fn frames_that_do_not_come_are_missing_views_and_the_others_keep_their_angles() {
    let mut bench = Bench::grbl();
    let ledger = bench.complete(|emulated, entry| {
        if entry.view == 20 {
            emulated.faults().camera().drop_frames(3);
        }
    });
    bench.holds(&ledger);
    let views: Vec<u32> = ledger.entries().iter().map(|e| e.view).collect();
    // A frame or two may be under way when the fault begins.
    let gap = views.windows(2).find(|pair| pair[0] >= 20 && pair[1] > pair[0] + 1).unwrap();
    assert!(gap[1] >= gap[0] + 4, "{views:?}");
}

#[test]
fn a_stop_a_feed_hold_and_a_pulled_cable_end_a_sweep_and_the_axis_stands() {
    let mut stopped = Bench::grbl();
    let handle = stopped.devices.rotation.stop_handle();
    let ended = stopped.sweep(|_, entry| {
        if entry.view == 10 {
            handle.stop();
        }
    });
    assert!(matches!(ended, Err(AcquisitionError::Device { source: DeviceError::Stopped, .. })), "{ended:?}");
    stopped.has_stopped();

    let mut held = Bench::grbl();
    let ended = held.sweep(|emulated, entry| {
        if entry.view == 10 {
            emulated.faults().button(Button::FeedHold, true);
        }
    });
    assert!(matches!(ended, Err(AcquisitionError::Device { source: DeviceError::Intervention { .. }, .. })), "{ended:?}");
    held.has_stopped();

    let mut pulled = Bench::grbl();
    let ended = pulled.sweep(|emulated, entry| {
        if entry.view == 10 {
            emulated.faults().unplug_serial();
        }
    });
    assert!(matches!(ended, Err(AcquisitionError::Device { source: DeviceError::Gone { .. }, .. })), "{ended:?}");
}

/// A person holds the axis and lets it go on: the views after that have other angles, so the sweep is not one. The hold itself is the cause.
#[test]
fn an_axis_that_was_held_and_went_on_has_not_swept() {
    let mut bench = Bench::grbl();
    let ended = bench.sweep(|emulated, entry| match entry.view {
        10 => emulated.faults().button(Button::FeedHold, true),
        // A second later.
        40 => {
            emulated.faults().button(Button::FeedHold, false);
            emulated.faults().button(Button::CycleStart, true);
        }
        _ => {}
    });
    assert!(matches!(ended, Err(AcquisitionError::Device { source: DeviceError::Intervention { .. }, .. })), "{ended:?}");
}
