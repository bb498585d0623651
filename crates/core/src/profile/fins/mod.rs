//! The faint borders of fins beside the body.

pub(super) mod borders;
pub(super) mod fringe;
