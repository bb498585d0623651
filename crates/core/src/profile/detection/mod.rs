//! Detects what a frame shows: nothing, one larva or two, a bead, air, debris; how it lies, and whether it is completely in
//! view.
//!
//! ```text
//!   opacity on a grid of 1/48 bore -> pieces -> what each piece looks like ---------> empty, larva, two, bubble, debris, bead
//!                                       │
//!                                       └─ the body: eyes, width along it, ends ----> two, head, dead, clipped
//! ```
//! Each question is a soft threshold on one measured figure, so that an answer near its threshold has a low confidence. The
//! answers are combined as if they were independent. The six kinds sum to 1. Lengths are in bores, so that they hold at any
//! magnification.

mod detector;
mod fish;
mod found;
mod opacity;
mod pieces;
mod probability;

pub(super) use detector::Detector;
pub use found::{Detection, Head, Kind, Likelihoods, Side};
