//! A camera that shows the pictures of the first well again in the second: a buffer that is not filled any more, or a server that plays a
//! recording. Axis and trigger work.
#![cfg(feature = "aravis")]

use crate::common::bench::{Bench, larva};
use hardware_sim::scene::{Exposure, Scene};
use hardware_sim::{PixelFormat, Pixels, Sight};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

struct Stuck {
    scene: Arc<Scene>,
    /// The newest picture of each angle, in ten-thousandths of a turn.
    seen: Mutex<BTreeMap<i64, Pixels>>,
    repeats: AtomicBool,
}

impl Sight for Stuck {
    fn size(&self) -> (u32, u32) {
        self.scene.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let angle = (exposure.angle_rad.rem_euclid(TAU) / TAU * 10_000.0).round() as i64 % 10_000;
        let mut seen = self.seen.lock().unwrap();
        if self.repeats.load(Ordering::SeqCst)
            && let Some(nearest) = seen.iter().min_by_key(|(at, _)| (**at - angle).abs()).map(|(_, pixels)| pixels)
        {
            return nearest.clone();
        }
        let pixels = self.scene.look(exposure, format);
        seen.insert(angle, pixels.clone());
        pixels
    }
}

#[test]
fn a_second_well_of_a_live_camera_that_shows_the_pictures_of_the_first_fails_and_the_first_stays() {
    let mut sight = None;
    let bench = Bench::seen_by(|scene| {
        let stuck = Arc::new(Stuck { scene: scene.clone(), seen: Mutex::default(), repeats: AtomicBool::new(false) });
        sight = Some(stuck.clone());
        stuck
    });
    let daemon = bench.serve(&[("asd = 21", "asd = 13".into())], "");
    bench.measured(&daemon, "alone", "standard", &[larva("A01")]);
    // Another run may show the same larva again, but no camera takes the same noise twice.
    let both = bench.measured(&daemon, "both", "standard", &[larva("A01"), larva("A02")]);
    let outcomes = |status: &serde_json::Value| [0, 1].map(|k| status["run"]["results"][k]["outcome"].clone());
    assert_eq!(outcomes(&both), ["succeeded", "succeeded"], "a camera that takes pictures: {both}");

    sight.unwrap().repeats.store(true, Ordering::SeqCst);
    let status = bench.measured(&daemon, "stuck", "standard", &[larva("A01"), larva("A02")]);
    assert_eq!(outcomes(&status), ["succeeded", "failed"], "{status}");
    let reason = status["run"]["results"][1]["reason"].as_str().unwrap();
    assert!(reason.contains("wells A01 and A02 have the same pictures"), "{reason}");
    assert!(status["run"]["results"][1]["volume_um3"].is_null(), "{status}");
}
