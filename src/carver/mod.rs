//! carver
