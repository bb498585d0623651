//! Arguments, tracing, dispatch.

use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let filter = EnvFilter::try_from_env("CARVED_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt().with_env_filter(filter).with_ansi(std::io::stderr().is_terminal()).with_writer(std::io::stderr).init();
    match carved::cli::main() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("carved: {}", carved::cli::told(&error));
            ExitCode::FAILURE
        }
    }
}
