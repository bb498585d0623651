//! The output of commands. Its reader may close it early, as `head` does.
//!
//! ```text
//! say!       a command's answer, standard output   reader gone: the command ends, through its destructors, with PIPE_CLOSED
//! announce!  a daemon's message, standard output   reader gone: ignored; the daemon continues
//! note!      remarks, standard error               reader gone: ignored; the answer matters
//! ```

use std::fmt;
use std::io::{self, Write};

/// Exit code of a command whose output has no reader any more: 128 + 13, with which a shell reports a program that SIGPIPE ended. It is not
/// 0, because a script with `pipefail` must not take interrupted work for finished work.
pub const PIPE_CLOSED: u8 = 141;

/// Standard output was closed by its reader.
#[derive(Debug, thiserror::Error)]
#[error("nobody reads the output any more")]
pub struct PipeClosed;

/// Writes to standard output.
///
/// # Errors
/// [`PipeClosed`], or the reason why writing failed.
pub fn say(text: fmt::Arguments) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    out.write_fmt(text).and_then(|()| out.flush()).map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => PipeClosed.into(),
        _ => anyhow::Error::new(error).context("standard output cannot be written"),
    })
}

/// Writes to standard output, and ignores errors.
pub fn announce(text: fmt::Arguments) {
    let mut out = io::stdout().lock();
    let _nobody_reads_it = out.write_fmt(text).and_then(|()| out.flush());
}

/// Writes to standard error, and ignores errors.
pub fn note(text: fmt::Arguments) {
    let _nobody_reads_it = io::stderr().lock().write_fmt(text);
}

/// Prints a line of a command's answer. An error ends the command.
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
