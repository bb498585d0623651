//! The geometry of a view: where a point of the world is seen in a frame.
//!
//! ```text
//!          y down                 world (um), right-handed: x along the capillary to the right,
//!          |                      y down, z away from the camera; the capillary turns about x
//!   camera |   z
//!     [>---+--/----------> x      x~ = K [ R_Y(alpha) R_Z(gamma) R_X(omega) X + f (0, cos phi, sin phi) ]
//!          | /
//! ```
//! Pixel centres are at integers, u to the right, v down. Positive omega moves the near wall to larger v. A glass tube about the axis turns each
//! ray by an angle that depends on its distance from the axis: for that ray, omega is larger by this angle.

mod camera;
mod glass;
mod grid;
mod projection;
mod second;
mod turntable;

pub use camera::{Camera, CameraError};
pub use glass::GlassTube;
pub use grid::{BoxUm, GridError, VoxelGrid};
pub use projection::{Lookup, Projection, ProjectionError};
pub use second::SecondOptics;
pub use turntable::{AxisFrame, NoTurn, Turntable};
