//! `carved output`: switches a digital output of the controller by hand, such as a light or a valve.
//!
//! An output that is on has an owner: this command holds it on, and switches it off at its end. A controller that is opened again is reset
//! first, which switches everything off.

use super::serve::open_axis;
use super::signals::Signals;
use crate::config::Config;
use anyhow::Context;
use std::path::PathBuf;
use std::time::Duration;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the output in `[rotation.outputs]`
    name: String,
    #[arg(value_enum)]
    state: Level,
    /// The instrument's configuration (TOML). Stop its daemon first: a port has one owner
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Switch it off again after this time. Without it the output stays on until Ctrl-C
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    lasting: Option<Duration>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Level {
    On,
    Off,
}

/// Longest time that can be given, s: a day.
const MOST_S: f64 = 86_400.0;

fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse().ok().filter(|s: &f64| *s > 0.0 && *s <= MOST_S);
    number.map(Duration::from_secs_f64).ok_or_else(|| format!("give a number of seconds above 0, at most {MOST_S}"))
}

/// Switches the output, and holds it where it is on.
///
/// # Errors
/// An output that the configuration does not have, and a controller that does not answer or refuses.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let config = Config::load(&args.config)?;
    let known: Vec<String> = config.rotation.outputs().into_iter().map(|output| output.name).collect();
    anyhow::ensure!(
        known.contains(&args.name),
        "{}: there is no output {:?}; {}",
        args.config.display(),
        args.name,
        if known.is_empty() { "it has no table [rotation.outputs.NAME]".into() } else { format!("it has: {}", known.join(", ")) }
    );
    // Signals are caught before anything is switched on.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("cannot start the runtime")?;
    let mut signals = runtime.block_on(async { Signals::listen() })?;
    let mut axis = open_axis(&config)?;
    let outputs = axis.outputs().context("this controller has no outputs")?;
    if args.state == Level::Off {
        outputs.switch(&args.name, false)?;
        say!("{} is off", args.name);
        return Ok(());
    }
    outputs.switch(&args.name, true)?;
    let until = args.lasting.map_or("until Ctrl-C".to_owned(), |lasting| format!("for {} s", lasting.as_secs_f64()));
    announce!("{} is on, {until}", args.name);
    runtime.block_on(async {
        match args.lasting {
            // Whether time or a signal ended it does not matter.
            Some(lasting) => drop(tokio::time::timeout(lasting, signals.next()).await),
            None => drop(signals.next().await),
        }
    });
    outputs.switch(&args.name, false)?;
    announce!("{} is off", args.name);
    Ok(())
}
