//! libFuzzer on the parsers of carved.
//!
//! ```text
//! tests/commands/parsers/targets.rs ──┬─► the test `no_parser_panics`: blind mutations of the corpus, in `make test`
//!                                     └─► this program: mutations that reach new code, `make fuzz`
//! tests/commands/data/parsers/NAME ───┘   the corpus
//! ```
//! One program has all targets, because each program links the whole daemon. `CARVED_FUZZ_TARGET` names the target, `--list` lists all.
//! `fuzz/run` looks first whether the program finds a planted panic: without coverage it would run and find nothing.

#![no_main]

#[path = "../../tests/commands/parsers/targets.rs"]
mod targets;

use libfuzzer_sys::fuzz_target;
use std::sync::OnceLock;
use targets::TARGETS;

static TARGET: OnceLock<fn(&[u8])> = OnceLock::new();

/// The target of the self-test: it panics at one text of eight bytes, which only a search that is guided by coverage finds soon.
const PLANTED: &str = "planted";

#[expect(clippy::manual_assert, reason = "each comparison is a branch of its own, as in a parser")]
fn planted(bytes: &[u8]) {
    if bytes.starts_with(b"[VER") && bytes.get(4..8) == Some(b":9.9") {
        panic!("the planted panic");
    }
}

/// The target that the environment names. Ends the program without one.
fn chosen() -> fn(&[u8]) {
    if std::env::args().any(|argument| argument == "--list") {
        TARGETS.iter().for_each(|(name, _)| println!("{name}"));
        std::process::exit(0);
    }
    let name = std::env::var("CARVED_FUZZ_TARGET").unwrap_or_default();
    if name == PLANTED {
        return planted;
    }
    let Some((_, parse)) = TARGETS.iter().find(|(target, _)| *target == name) else {
        eprintln!("carved-fuzz: CARVED_FUZZ_TARGET is {name:?}; expected one of those that --list lists");
        std::process::exit(2);
    };
    *parse
}

fuzz_target!(
    init: {
        TARGET.get_or_init(chosen);
    },
    |bytes: &[u8]| {
        if let Some(parse) = TARGET.get() {
            parse(bytes);
        }
    }
);
