//! The HTTP server over real sockets. The tests play the driver at the other end of the session.
//!
//! Every answer in these tests is compared with the served contract: a status code that the contract does not declare for the route fails
//! the test.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

mod access;
mod client;
mod commands;
mod contract;
#[path = "../common/gates.rs"]
mod gates;
mod lease;
mod limits;
mod openapi_file;
mod plate_maps;
mod reading;
mod replays;
mod results;
mod rig;
#[path = "../common/strict.rs"]
mod strict;
mod wire;
