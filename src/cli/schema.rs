//! `carved config schema`.

use crate::config;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Print the reference page (Markdown) instead.
    #[arg(long)]
    markdown: bool,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let schema = config::schema();
    if args.markdown {
        say!("{}", config::reference_page(&schema).trim_end());
    } else {
        say!("{}", serde_json::to_string_pretty(&schema)?);
    }
    Ok(())
}
