//! The outline, refined to a part of a pixel: where the darkness begins, at the blur of the frame.

pub(super) mod blur;
pub(super) mod finder;
pub(super) mod onset;
