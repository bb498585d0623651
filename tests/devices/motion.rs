//! One revolution through a real driver and the real camera, compared with the true exposures.

pub use crate::common::{PATIENCE, until};

use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::units::{Sense, Steps, StepsPerRevolution};
use carved_devices::acquisition::{AcquisitionSettings, Next, RevolutionPlan, revolve};
use carved_devices::camera::{self, AravisSettings, CameraSelect};
use carved_devices::cancel::CancelToken;
use carved_devices::{Position, Rig, RotationAxis};
use carved_records::{Ledger, ViewOrder};
use hardware_sim::{Exposure, ExposureRecord, RigSettings, Sight, TestCard};
use std::f64::consts::TAU;
use std::sync::Arc;

const WIDTH: u32 = 256;
const HEIGHT: u32 = 256;
pub const STEPS: f64 = 500.0;
/// Speed-up of the emulated machine.
pub const SCALE: f64 = 5.0;
/// The emulated machine's 360 deg/s, as the host measures them.
pub const SPEED_DEG_PER_S: f64 = 360.0 * SCALE;

fn card() -> TestCard {
    TestCard::new(WIDTH, HEIGHT)
}

pub fn rig(settings: RigSettings) -> hardware_sim::Rig {
    hardware_sim::Rig::start(RigSettings { time_scale: SCALE, ..settings }, Arc::new(card())).unwrap()
}

pub fn per_revolution() -> StepsPerRevolution {
    StepsPerRevolution::new(500, 1).unwrap()
}

pub fn plan(order: ViewOrder) -> RevolutionPlan {
    RevolutionPlan::new(12, per_revolution(), order).unwrap()
}

pub fn targets(order: ViewOrder) -> Vec<Steps> {
    plan(order).targets()
}

/// A rig of this axis and an armed camera.
pub fn with_camera(emulated: &hardware_sim::Rig, rotation: Box<dyn RotationAxis>) -> Rig {
    let select = CameraSelect::Address(emulated.camera_address());
    let settings = AravisSettings { packet_size: 8228, ..AravisSettings::new(select, PixelFormat::BayerRG8, WIDTH, HEIGHT, 4000.0) };
    let mut camera = camera::open(settings).unwrap();
    camera.arm().unwrap();
    Rig { rotation, camera }
}

/// Takes all views of a plan; `zero_rad` is the true angle at step 0.
pub fn turn(emulated: &hardware_sim::Rig, devices: &mut Rig, order: ViewOrder) -> Ledger {
    let zero_rad = emulated.shaft().angle_rad();
    let settings = AcquisitionSettings { settle_ms: 5, grab_deadline_ms: 10_000, sense: Sense::Positive };
    let mut frames = Vec::new();
    let ledger = revolve(devices, &plan(order), &settings, &CancelToken::new(), |_, frame| {
        frames.push(frame);
        Ok(Next::View)
    })
    .unwrap();
    assert_eq!((ledger.carved().count(), frames.len()), (12, 13));
    holds(emulated, &ledger, &frames, zero_rad);
    ledger
}

/// Each frame equals, pixel by pixel, what the scene shows at its exposure, and was exposed at the angle in the ledger.
fn holds(emulated: &hardware_sim::Rig, ledger: &Ledger, frames: &[RawFrame], zero_rad: f64) {
    let exposures = emulated.exposures();
    for (entry, frame) in ledger.entries().iter().zip(frames) {
        let of_this_view = |e: &&ExposureRecord| e.sent && e.frame_id == entry.frame_id;
        let exposed = exposures.iter().rev().find(of_this_view).unwrap_or_else(|| panic!("view {} was never exposed", entry.view));
        let picture = card().look(&Exposure { angle_rad: exposed.angle_rad, number: exposed.number }, hardware_sim::PixelFormat::BayerRG8);
        assert!(frame.bytes() == picture.bytes, "view {} is not the picture of its exposure", entry.view);
        // Machine and shaft count whole steps, so that only rounding of f64 remains.
        let off_turns = (exposed.angle_rad - zero_rad - entry.omega) / TAU;
        // A whole turn more or less shows the same view: a VAST may go back from 342,72 deg to 0,00 deg.
        let off_steps = (off_turns - off_turns.round()) * STEPS;
        assert!(off_steps.abs() < 1e-6, "view {}: exposed {off_steps} steps from where the ledger says", entry.view);
        assert_eq!(entry.commanded_steps, entry.achieved_steps);
    }
}

pub fn true_steps(emulated: &hardware_sim::Rig) -> f64 {
    emulated.shaft().angle_rad() * STEPS / TAU
}

pub fn is_suspect(axis: &dyn RotationAxis) -> bool {
    matches!(axis.position(), Position::Suspect { .. })
}
