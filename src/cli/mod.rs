//! cli

pub mod notify;
