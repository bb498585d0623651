//! Rotation axes.
