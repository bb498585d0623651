//! The devices of one instrument, owned as one.

use super::{Camera, RotationAxis};

/// Everything that a revolution needs. It is moved into the blocking worker, which returns it at its end, so that two threads never
/// drive one motor. Other threads keep the axis' [`super::StopHandle`].
pub struct Rig {
    /// Turns the capillary.
    pub rotation: Box<dyn RotationAxis>,
    /// Looks at the capillary.
    pub camera: Box<dyn Camera>,
}
