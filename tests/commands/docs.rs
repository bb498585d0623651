//! The documentation: every command line is one that the program accepts, every link leads somewhere, and Python blocks use names that exist.
//!
//! ```text
//!  README.md, docs/*.md ── tests/docs/read_docs.py ──┬─ mistakes: must be none
//!                                                    └─ command lines, options ── carved::cli::command() parses them
//! ```

use crate::common::{run, stderr};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// What `read_docs.py` found at one place.
#[derive(serde::Deserialize)]
struct Line {
    at: String,
    argv: Vec<String>,
}

#[derive(serde::Deserialize)]
struct DocsReport {
    commands: Vec<Line>,
    spans: Vec<Line>,
    options: Vec<Line>,
    mistakes: Vec<String>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn found() -> DocsReport {
    let output = Command::new("python3").arg(root().join("tests/docs/read_docs.py")).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Why the program would refuse this line. A span of running text may leave out what the command requires, and have `FILE` where a number
/// or a name is expected.
fn refused(line: &Line, is_span: bool) -> Option<String> {
    let error = carved::cli::command().try_get_matches_from(&line.argv).err()?;
    let value = match error.get(ContextKind::InvalidValue) {
        Some(ContextValue::String(value)) => value.as_str(),
        _ => "a value",
    };
    let stands_for_one = value.chars().all(|c| c.is_uppercase() || "/_".contains(c));
    let allowed = match error.kind() {
        ErrorKind::DisplayHelp => true,
        ErrorKind::MissingRequiredArgument | ErrorKind::MissingSubcommand | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => is_span,
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => is_span && stands_for_one,
        _ => false,
    };
    (!allowed).then(|| format!("{}: {}\n{error}", line.at, line.argv.join(" ")))
}

fn long_options(command: &clap::Command) -> BTreeSet<String> {
    let own = command.get_arguments().filter_map(|argument| argument.get_long().map(|long| format!("--{long}")));
    own.chain(command.get_subcommands().flat_map(long_options)).collect()
}

/// Options of other programs that the pages name: the Python nodes, the simulated plate-loader, cargo and Slurm.
const OF_OTHERS: [&str; 10] = [
    "--allow-any-client",
    "--array",
    "--enable_rate_limiting",
    "--features",
    "--folder",
    "--insecure",
    "--mischief",
    "--no-discovery",
    "--requeue",
    "--seed",
];

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn every_command_line_of_the_pages_is_accepted() {
    let found = found();
    // The line `carved unit mm ...` is the heading of an STL file, and `carved COMMAND --help` stands for all commands.
    let is_command = |line: &&Line| !["unit", "COMMAND"].contains(&line.argv[1].as_str());
    let blocks = found.commands.iter().filter_map(|line| refused(line, false));
    let spans = found.spans.iter().filter(is_command).filter_map(|line| refused(line, true));
    let options = long_options(&carved::cli::command());
    let unknown = found.options.iter().filter_map(|line| {
        let option = line.argv[0].split('=').next()?;
        let is_known = options.contains(option) || OF_OTHERS.contains(&option);
        (!is_known).then(|| format!("{}: no command has the option {option}", line.at))
    });
    let wrong: Vec<String> = blocks.chain(spans).chain(unknown).collect();
    assert!(wrong.is_empty(), "{} line(s) of the pages are refused:\n{}", wrong.len(), wrong.join("\n"));
    assert!(found.commands.len() > 40 && found.spans.len() > 100 && found.options.len() > 100, "the pages were not read");
}

#[test]
#[cfg_attr(not(has_python), ignore = "no Python 3 with venv: apt-get install python3-venv")]
fn links_lead_somewhere_and_blocks_of_python_and_toml_can_be_read() {
    let mistakes = found().mistakes;
    assert!(mistakes.is_empty(), "{}", mistakes.join("\n"));
}

/// The plate map of the tutorial, through the real command; its answer is the line that the tutorial shows.
#[test]
fn the_plate_map_of_the_tutorial_is_sound() {
    let page = std::fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let map = page.split("```csv\n").nth(1).unwrap().split("```").next().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("plate.csv");
    std::fs::write(&path, map).unwrap();
    let output = run(&["plate", "check", path.to_str().unwrap()]);
    let answer = String::from_utf8(output.stdout.clone()).unwrap().replace(path.to_str().unwrap(), "plate.csv");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(page.lines().any(|line| line == answer.trim_end()), "docs/tutorial.md does not show {answer:?}");
}

/// The codes with which sources under `folder` refuse requests.
fn codes(folder: &Path, found: &mut BTreeSet<String>) {
    const MADE_BY: [&str; 5] = ["conflict(", "unavailable(", "unprocessable(", "bad_request(", "not_found("];
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            codes(&path, found);
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        for (at, _) in text.match_indices('"') {
            let before = text[..at].trim_end();
            let status = before.strip_suffix(',').map(|status| status.trim_end_matches(|c: char| c.is_ascii_uppercase() || c == '_'));
            if MADE_BY.iter().any(|made_by| before.ends_with(made_by)) || status.is_some_and(|status| status.ends_with("StatusCode::")) {
                found.extend(text[at + 1..].split('"').next().map(str::to_owned));
            }
        }
    }
}

#[test]
fn the_loaders_page_names_every_code_of_a_refusal() {
    let mut made = BTreeSet::new();
    codes(&root().join("src/http"), &mut made);
    assert!(made.len() > 50 && made.contains("unknown_run") && made.contains("run_open"), "{made:?}");
    let page = std::fs::read_to_string(root().join("docs/loader.md")).unwrap();
    let (_, errors) = page.split_once("## Errors").unwrap();
    let missing: Vec<&String> = made.iter().filter(|code| !errors.contains(&format!("`{code}`"))).collect();
    assert!(missing.is_empty(), "not in the table of docs/loader.md: {missing:?}");
}
