//! The driver on a bench: its commands, its store and its status are the real ones; what a worker tells and when it ends, the test says.

mod at_rest;
pub(super) mod bench;
mod full_disk;
mod kept;
mod life;
mod loader;
mod recovery;
mod replayed;
mod restart;
mod shown;
mod words;
