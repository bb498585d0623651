//! The HTTP edge over real sockets, with a driver of the tests' own at the session's other end.
//!
//! Every answer that any of these tests gets is held against the served contract: a status that it does not declare for
//! the route fails the test.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

mod access;
mod client;
mod commands;
mod contract;
mod lease;
mod limits;
mod openapi_file;
mod plate_maps;
mod reading;
mod results;
mod rig;
mod wire;
