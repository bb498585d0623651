//! The devices of one instrument, owned as one.

use super::{Camera, RotationAxis};

/// Everything a revolution needs. It is moved into the blocking worker and handed back at the join, so that two
/// threads can never drive one motor; what must be reachable meanwhile is the axis' [`super::StopHandle`].
pub struct Rig {
    pub rotation: Box<dyn RotationAxis>,
    pub camera: Box<dyn Camera>,
}
