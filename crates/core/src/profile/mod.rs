//! From a frame to a profile: the outline of the specimen in one view.
//!
//! ```text
//! RawFrame ── raster::picture ──> bore: walls, empty bore ──> body ──> fins ──> edge ──> Profile
//!                                                               │                 └────> columns
//!                                                               └──> detection: what the frame shows
//! ```
//! `segment` goes this way with one frame. `compare` compares outlines with annotations; `moving` compares the walls of several frames.

mod body;
mod bore;
mod compare;
mod detection;
mod edge;
mod error;
mod fins;
mod moving;
mod quality;
mod raster;
mod segment;
mod segmenters;
mod settings;
#[cfg(test)]
mod synthetic;

pub use bore::empty_capillary::EmptyCapillary;
pub use bore::walls::{Line, Wall, Walls};
pub use compare::{Annotation, Comparison, EdgeError, SizesDiffer, TOLERANCE_PX};
pub use detection::{Detection, Head, Kind, Likelihoods, Side};
pub use edge::finder::EdgePoint;
pub use error::ProfileError;
pub use fins::borders::FinBorders;
#[cfg(test)]
pub(crate) use fins::borders::Window;
pub use moving::{Moving, MovingError, Spot};
pub use quality::ProfileQuality;
pub use raster::columns::{ColumnEdges, Columns};
pub use raster::damage::Damage;
pub use raster::mask::{Mask, WrongMaskSize};
pub use raster::outline::Polygon;
pub use raster::picture::Picture;
pub use segment::{Profile, Segmenter, segment};
pub use segmenters::Segmenters;
pub use settings::{EdgeSettings, FringeSettings, LevelSetSettings, Method, Retired, SegmentSettings, WallSettings};
