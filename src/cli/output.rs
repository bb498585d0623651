//! What commands print. Whoever reads it may go before the end, as `head` does.
//!
//! ```text
//! say!       a command's answer, standard output   reader gone: the command ends, through its destructors, with PIPE_CLOSED
//! announce!  a daemon's words, standard output     reader gone: nothing; the daemon goes on
//! note!      remarks, standard error               reader gone: nothing; the answer counts
//! ```

use std::fmt;
use std::io::{self, Write};

/// Exit code of a command whose output nobody reads any more: what a shell makes of a program that SIGPIPE ended, 128 + 13. Not 0: a
/// script with `pipefail` must not take work that was cut off for done.
pub const PIPE_CLOSED: u8 = 141;

/// Standard output was closed by its reader.
#[derive(Debug, thiserror::Error)]
#[error("nobody reads the output any more")]
pub struct PipeClosed;

/// Writes to standard output.
///
/// # Errors
/// [`PipeClosed`], or why it cannot be written.
pub fn say(text: fmt::Arguments) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    out.write_fmt(text).and_then(|()| out.flush()).map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => PipeClosed.into(),
        _ => anyhow::Error::new(error).context("standard output cannot be written"),
    })
}

/// Writes to standard output where somebody reads it.
pub fn announce(text: fmt::Arguments) {
    let mut out = io::stdout().lock();
    let _nobody_reads_it = out.write_fmt(text).and_then(|()| out.flush());
}

/// Writes to standard error where somebody reads it.
pub fn note(text: fmt::Arguments) {
    let _nobody_reads_it = io::stderr().lock().write_fmt(text);
}

/// Prints a line of a command's answer; the command ends where it cannot.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::output::say(format_args!("{}\n", format_args!($($text)*)))? };
}

/// Prints a line of a daemon.
macro_rules! announce {
    ($($text:tt)*) => { $crate::cli::output::announce(format_args!("{}\n", format_args!($($text)*))) };
}

/// Prints a remark on standard error.
macro_rules! note {
    ($($text:tt)*) => { $crate::cli::output::note(format_args!("{}\n", format_args!($($text)*))) };
}
