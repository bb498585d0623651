//! `carved notify`: notices to people who are not at the instrument.

use crate::api::Status;
use crate::config::Config;
use crate::notify::{Agent, EventName, Notice};
use crate::session::Driver;
use anyhow::Context;
use carved_records::Mode;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Send a notice to the receiver of a configuration, and say what it answered.
    Test(Test),
}

#[derive(Debug, clap::Args)]
pub struct Test {
    /// The instrument's configuration (TOML), with a table [notify].
    #[arg(long)]
    config: PathBuf,
}

pub fn run(Command::Test(args): &Command) -> anyhow::Result<()> {
    let config = Config::load(&args.config)?;
    let settings = config.notify.as_ref();
    let settings = settings.with_context(|| format!("{} has no table [notify], so no notice is sent", args.config.display()))?;
    let agent = Agent::new(settings.receiver()?)?;
    let uuid = carved_store::instrument_uuid(&config.store.data_dir)?.unwrap_or_default();
    let status = Status {
        instrument: config.identity(uuid),
        doing: "This is a test. Nothing is wrong, and nothing is to be done.".into(),
        ..Driver::first_status(Mode::Hardware, super::daemon::random_id()?)
    };
    let began = Instant::now();
    let notice = Notice::new(EventName::Test, &status, false, 1);
    let answer = agent.deliver(&notice, agent.timeout());
    let answer = answer.with_context(|| format!("the notice did not reach {}", agent.shown()))?;
    say!("{} took the notice ({answer}, {:.1} s). Look whether it has arrived.", agent.shown(), began.elapsed().as_secs_f64());
    Ok(())
}
