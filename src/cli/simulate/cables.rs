//! Cables of the emulated rig that are disconnected and connected again at given times.
//!
//! ```text
//!  --camera-out 8,45 --axis-out 20,3 --axis-out 60,3
//!  start ──8──> camera out ──12──> axis out ──3──> axis in ──30──> camera in ──7──> axis out ...
//! ```

use hardware_sim::Rig;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Cable {
    Axis,
    Camera,
}

/// What happens to a cable, and when after the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Change {
    at: Duration,
    cable: Cable,
    out: bool,
}

/// How long after the start a cable is disconnected, and for how long.
pub type Out = [Duration; 2];

/// All changes, in the order of their times.
#[derive(Debug, Default)]
pub struct Cables(Vec<Change>);

impl Cables {
    pub fn new(camera: Option<Out>, axis: &[Out]) -> Self {
        let camera = camera.iter().map(|out| (Cable::Camera, out));
        let axis = axis.iter().map(|out| (Cable::Axis, out));
        let both =
            |(cable, &[at, lasting]): (Cable, &Out)| [Change { at, cable, out: true }, Change { at: at + lasting, cable, out: false }];
        let mut changes: Vec<Change> = camera.chain(axis).flat_map(both).collect();
        changes.sort();
        Self(changes)
    }

    /// Whether the axis is disconnected at some time. Its port then needs a name that stays.
    pub fn concern_axis(&self) -> bool {
        self.0.iter().any(|change| change.cable == Cable::Axis)
    }

    /// Carries the changes out, until the daemon ends.
    pub fn follow(&self, rig: &Rig, ended: &Receiver<()>) {
        let start = Instant::now();
        for Change { at, cable, out } in &self.0 {
            if ended.recv_timeout(at.saturating_sub(start.elapsed())) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            tracing::warn!(out, ?cable, "a cable of the emulated rig");
            match (cable, out) {
                (Cable::Camera, _) => rig.faults().camera().pull_cable(*out),
                (Cable::Axis, true) => rig.faults().unplug_serial(),
                (Cable::Axis, false) => {
                    if let Err(why) = rig.faults().replug_serial() {
                        tracing::error!(%why, "the emulated controller stays disconnected");
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_both_cables_follow_in_the_order_of_their_times() {
        let s = Duration::from_secs;
        let cables = Cables::new(Some([s(8), s(45)]), &[[s(20), s(3)], [s(60), s(3)]]);
        let found: Vec<_> = cables.0.iter().map(|c| (c.at.as_secs(), c.cable == Cable::Axis, c.out)).collect();
        let expected = [(8, false, true), (20, true, true), (23, true, false), (53, false, false), (60, true, true), (63, true, false)];
        assert_eq!(found, expected);
        assert!(cables.concern_axis() && !Cables::new(Some([s(1), s(1)]), &[]).concern_axis());
    }
}
