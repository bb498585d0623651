//! The log, then the command.

use carved::cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    cli::log::init();
    cli::main()
}
