//! The status shows only data of the current specimen and of its current attempt.

use super::super::checks;
use super::bench::{Arm, Bench, instrument, on_this_thread, scratch, started, started_with};
use crate::session::Live;
use crate::session::search::DevicesFound;
use crate::session::worker::{Progress, RunEnd};
use carved_devices::testing::FakeAxis;
use carved_devices::{DeviceError, Link};
use carved_records::{Light, LiveEstimate, Phase};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

impl Bench {
    /// Reports a view of a well. Returns `false` if the run is cancelled.
    fn view(&mut self, well: &str, index: u32) -> bool {
        self.view_with(well, index, Some(Live::default()))
    }

    fn view_with(&mut self, well: &str, index: u32, live: Option<Live>) -> bool {
        self.report(Progress::View {
            well: well.into(),
            index,
            closure: false,
            achieved_steps: 100 + i64::from(index),
            hull_volume_um3: Some(3e8),
            estimate: LiveEstimate { volume_um3: Some(2e8), volume_sd_um3: Some(1e6), volume_views: Some(7), converged: Some(false) },
            wait: None,
            light: Some(Light { background: 190.0, saturated: 0.0, focus: 0.01 }),
            live,
        })
    }

    fn turns(&mut self, well: &str, views: u32) {
        for phase in [Phase::Load, Phase::Position, Phase::Detect, Phase::Revolve] {
            self.phase(well, phase, phase != Phase::Load);
        }
        (0..views).for_each(|index| assert!(self.view(well, index)));
    }

    fn shown(&self) -> (String, u32, usize, Option<f64>) {
        let shown = self.status().specimen.unwrap();
        (shown.well, shown.view, shown.hull_volumes_um3.len(), shown.volume_um3)
    }
}

/// Tried again without another load: counter, curve and estimates start again.
#[test]
fn a_turn_that_is_tried_again_is_counted_from_its_first_view_on() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.turns("A01", 12);
        assert_eq!(b.status().specimen.unwrap().estimates.len(), 1, "the same estimate after each view");
        assert!(b.handle.live().shown.is_some());
        b.report(Progress::TriedAgain { well: "A01".into(), attempt: 1, why: "it moved".into() });
        assert!(b.handle.live().shown.is_none(), "the model of the attempt before is not that of this one");
        for phase in [Phase::Position, Phase::Detect, Phase::Revolve] {
            b.phase("A01", phase, true);
            assert_eq!(b.shown(), ("A01".into(), 0, 0, None));
            assert!(b.status().specimen.unwrap().estimates.is_empty());
        }
        assert!(b.view("A01", 0));
        assert_eq!(b.shown(), ("A01".into(), 1, 1, Some(2e8)));
    });
}

/// Of views that come faster than they can be drawn not every one is drawn.
#[test]
fn a_view_that_is_not_drawn_is_counted_and_leaves_the_pictures_of_the_last_one() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.turns("A01", 3);
        let pictures = |b: &Bench| b.handle.live().shown.map(|shown| (shown.well, shown.views));
        assert_eq!(pictures(&b), Some(("A01".into(), 3)));
        assert!(b.view_with("A01", 3, None));
        assert_eq!((b.shown().1, pictures(&b)), (4, Some(("A01".into(), 3))));
        assert!(b.view("A01", 4));
        assert_eq!(pictures(&b), Some(("A01".into(), 5)));
    });
}

/// A slow thread was given up. Its late progress arrives while the next specimen is inside.
#[test]
fn a_view_that_comes_late_is_not_shown_as_the_next_specimens() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01", "A02"]);
        b.turns("A01", 3);
        assert_eq!(b.shown(), ("A01".into(), 3, 3, Some(2e8)));
        b.turns("A02", 1);
        let (before, axis) = (b.shown(), b.status().hardware.rotation.position_steps);
        assert!(b.view("A01", 7));
        assert_eq!((b.shown(), b.status().hardware.rotation.position_steps), (before, axis));
        assert_eq!(b.handle.live().shown.unwrap().well, "A02");
        assert!(b.view("A02", 1));
        assert_eq!(b.shown(), ("A02".into(), 2, 2, Some(2e8)));
    });
}

/// The worker waits for a loader or computes, and has not noticed it yet.
#[test]
fn an_axis_that_hangs_up_is_shown_before_the_worker_ends() {
    on_this_thread(async {
        let (dir, pulled) = (scratch(), Arc::new(AtomicBool::new(false)));
        let cable = Arc::clone(&pulled);
        let axis = FakeAxis::new().linked(Link::new(move || cable.load(Ordering::SeqCst)));
        let mut b = started_with(dir.path(), instrument(axis, Arm::default()), &["A01"]);
        b.turns("A01", 1);
        b.d.show_rotation();
        assert!(b.status().hardware.rotation.connected);
        pulled.store(true, Ordering::SeqCst);
        b.d.show_rotation();
        assert!(!b.status().hardware.rotation.connected && b.works());
    });
}

/// Interrupted in its turn and begun again once the camera is back: views and volumes of the first attempt do not count.
#[test]
fn a_specimen_that_is_begun_anew_is_shown_from_its_first_view_on() {
    on_this_thread(async {
        let dir = scratch();
        let mut b = started(dir.path(), false, &["A01"]);
        b.turns("A01", 5);
        b.ends(RunEnd::Failed(DeviceError::ControlLost.into())).await;
        checks::searched(&mut b.d, DevicesFound { rotation: Ok(()), camera: Ok(()), outputs: Vec::new() });
        assert!(b.works(), "{:?}", b.status().state);
        b.report(Progress::Ready);
        b.turns("A01", 2);
        assert_eq!(b.shown(), ("A01".into(), 2, 2, Some(2e8)));
        b.turns("A01", 0);
        assert_eq!(b.shown(), ("A01".into(), 0, 0, None));
    });
}
