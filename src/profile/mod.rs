//! Frame to profile: the outline of the specimen in one view.
//!
//! ```text
//! RawFrame -> Picture (colour) -> capillary walls -> specimen inside the bore -> sub-pixel edge -> Profile
//! ```

mod bayer;
mod mask;
mod picture;

pub use mask::{Mask, WrongMaskSize};
pub use picture::Picture;
