//! Tracing, then the command.

use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let filter = EnvFilter::try_from_env("CARVED_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        // The subscriber would tell standard error that standard error cannot be written, and panic in the thread that drives the motors.
        .log_internal_errors(false)
        .init();
    carved::cli::main()
}
