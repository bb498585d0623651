//! The commands, run as a user runs them.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

#[path = "../common/mod.rs"]
mod common;

mod bad_files;
mod bulk;
mod calibrate_marked;
mod camera_command;
mod config;
mod config_keys;
mod docs;
mod doctor;
mod files;
mod flags;
mod halt;
mod import;
mod import_plate;
mod manual;
mod notices;
mod object_store;
mod output_command;
mod parsers;
mod plate_columns;
mod provenance;
mod reconstruct;
mod reference;
mod references;
mod segment;
mod setup;
mod setup_page;
mod slurm;
mod store;
mod tables;
