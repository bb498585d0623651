//! From a frame to a profile: the outline of the specimen in one view.
//!
//! ```text
//! RawFrame -> Picture (colour) -> capillary walls -> specimen inside the bore -> sub-pixel edge -> Profile
//! ```

mod background;
mod bayer;
mod blur;
mod body;
mod borders;
mod bubble;
mod chamfer;
mod coarse;
mod columns;
mod compare;
mod detection;
mod edge;
mod empty_capillary;
mod faint;
mod fringe;
mod hybrid;
mod level_set;
mod mask;
mod moving;
mod onset;
mod opacity;
mod outline;
mod path;
mod picture;
mod pieces;
mod plane;
mod quality;
mod region;
mod segment;
mod segmenters;
mod settings;
mod specks;
#[cfg(test)]
mod synthetic;
mod walls;

pub use borders::FinBorders;
#[cfg(test)]
pub(crate) use borders::Window;
pub use columns::{ColumnEdges, Columns};
pub use compare::{Annotation, Comparison, EdgeError, SizesDiffer, TOLERANCE_PX};
pub use detection::{Detection, Head, Kind, Likelihoods, Side};
pub use edge::EdgePoint;
pub use empty_capillary::EmptyCapillary;
pub use mask::{Mask, WrongMaskSize};
pub use moving::{Moving, MovingError, Spot};
pub use outline::Polygon;
pub use picture::Picture;
pub use quality::ProfileQuality;
pub use segment::{Profile, ProfileError, Segmenter, segment};
pub use segmenters::Segmenters;
pub use settings::{EdgeSettings, FringeSettings, LevelSetSettings, Method, Retired, SegmentSettings, WallSettings};
pub use walls::{Line, Wall, Walls};
