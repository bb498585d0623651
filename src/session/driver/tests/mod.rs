//! The driver on a bench. Its commands, its store and its status are real. The test decides what the worker reports and when it ends.

mod at_rest;
pub(super) mod bench;
mod full_disk;
mod kept;
mod life;
mod loader;
mod people;
mod queue;
mod rebuilt;
mod recovery;
mod replayed;
mod restart;
mod shown;
mod way_on;
mod words;
