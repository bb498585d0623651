//! Frame to profile: the outline of the specimen in one view.
//!
//! ```text
//! RawFrame -> Picture (colour) -> capillary walls -> specimen inside the bore -> sub-pixel edge -> Profile
//! ```

mod background;
mod bayer;
mod body;
mod detection;
mod edge;
mod foreground;
mod mask;
mod opacity;
mod picture;
mod pieces;
mod plane;
mod quality;
mod segment;
mod settings;
mod walls;

pub use detection::{Detection, Head, Kind, Likelihoods, Side};
pub use edge::{EdgePoint, Polygon};
pub use mask::{Mask, WrongMaskSize};
pub use picture::Picture;
pub use quality::ProfileQuality;
pub use segment::{Profile, ProfileError, segment};
pub use settings::{EdgeSettings, Method, SegmentSettings, WallSettings};
pub use walls::{Line, Wall, Walls};
