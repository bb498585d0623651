//! The geometry of a view: where a point of the world is seen in a frame.
//!
//! ```text
//!          y down                 world (um), right-handed: x along the capillary to the right,
//!          |                      y down, z away from the camera; the capillary turns about x
//!   camera |   z
//!     [>---+--/----------> x      x~ = K [ R_Y(alpha) R_Z(gamma) R_X(omega) X + f (0, cos phi, sin phi) ]
//!          | /
//! ```
//! Pixel centres are at integers, u to the right, v down. Positive omega moves the near wall to larger v.

mod camera;
mod grid;
mod projection;
mod second;
mod turntable;

pub use camera::{Camera, CameraError};
pub use grid::{BoxUm, GridError, VoxelGrid};
pub use projection::{Projection, ProjectionError};
pub use second::SecondOptics;
pub use turntable::{AxisFrame, NoTurn, Turntable};
