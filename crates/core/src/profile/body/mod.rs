//! The body of the specimen: what is dark, compact and connected in the bore, on blocks of the bore.
//!
//! ```text
//!   blocks (coarse) ── bubbles ── level set ── specks left out ── faint parts ──> hybrid: one region of the picture
//! ```

pub(super) mod bubble;
pub(super) mod coarse;
pub(super) mod faint;
pub(super) mod hybrid;
pub(super) mod level_set;
pub(super) mod specks;
