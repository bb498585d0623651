//! The log on standard error: what it holds, by the variable `CARVED_LOG`.

use std::env::VarError;
use std::io::IsTerminal;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// The variable that says what the log holds.
const LOG: &str = "CARVED_LOG";
const DEFAULT: &str = "info";

/// Starts the log. Call it once.
pub fn init() {
    let (filter, warning) = filter(std::env::var(LOG));
    let lines = tracing_subscriber::fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        // The subscriber would tell standard error that standard error cannot be written, and panic in the thread that drives the motors.
        .log_internal_errors(false);
    // It would write addresses and headers, in which receivers of notices have their secrets.
    let filter = filter.with_targets(["ureq", "ureq_proto"].map(|client| (client, LevelFilter::WARN)));
    tracing_subscriber::registry().with(filter).with(lines).init();
    if let Some(warning) = warning {
        tracing::warn!("{warning}");
    }
}

/// What the log holds, and a warning where the variable's value is none of what it may be.
fn filter(value: Result<String, VarError>) -> (Targets, Option<String>) {
    let value = match value {
        Ok(value) => value,
        Err(VarError::NotPresent) => DEFAULT.to_owned(),
        Err(VarError::NotUnicode(value)) => value.to_string_lossy().into_owned(),
    };
    let value = if value.trim().is_empty() { DEFAULT } else { value.trim() };
    match value.parse::<Targets>() {
        Ok(filter) if value.split(',').all(is_meant) => (filter, None),
        _ => {
            let warning = format!(
                "{LOG} is {value:?}; expected error, warn, info, debug, trace or off, or levels by part, as in \
                 info,carved_devices=debug. The log is at {DEFAULT}"
            );
            (Targets::new().with_default(LevelFilter::INFO), Some(warning))
        }
    }
}

/// A word without a level names a part of the program, of which all is told. A misspelt level would be such a word.
fn is_meant(directive: &str) -> bool {
    let word = directive.trim();
    word.find('=').is_some_and(|at| at > 0)
        || word.parse::<LevelFilter>().is_ok()
        || word.starts_with("carved")
        || word.starts_with("hardware_sim")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_value_is_named_with_what_is_used_instead() {
        let of = |value: &str| filter(Ok(value.into()));
        for sound in ["info", "WARN", "off", "carved", "info,carved_devices=debug", "hyper=trace", "", " "] {
            assert_eq!(of(sound).1, None, "{sound:?}");
        }
        for wrong in ["debgu", "info,carved_devices=loud", "verbose,carved=info", "=", "carved_devices=info=2"] {
            let (filter, warning) = of(wrong);
            let warning = warning.unwrap_or_default();
            assert!(warning.contains(&format!("{wrong:?}")) && warning.contains("at info"), "{wrong:?}: {warning:?}");
            assert_eq!(filter.to_string(), "info", "{wrong:?}");
        }
        assert_eq!(filter(Err(VarError::NotPresent)).1, None);
    }
}
