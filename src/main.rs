//! Arguments, then the command.

use clap::Parser;

fn main() -> std::process::ExitCode {
    match carved::cli::Cli::parse().run() {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("carved: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
