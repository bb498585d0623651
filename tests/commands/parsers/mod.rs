//! Every parser that bytes from outside reach, fed with the corpus and with mutations of it: none may panic.
//!
//! The corpus is in `tests/commands/data/parsers`, one folder per parser. The files `found-...` in it are inputs at which `make fuzz` reached code
//! that no other file reaches.

mod mutate;
mod targets;

use mutate::Mutations;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use targets::TARGETS;

/// Inputs to each parser: the files of its corpus, and as many mutations of each as there is room for.
const INPUTS: usize = 600;

fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/commands/data/parsers").join(name);
    let files = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<_> = files.map(|entry| entry.unwrap().path()).map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
    files.sort();
    assert!(!files.is_empty(), "{} is empty", folder.display());
    files
}

/// What a controller sends comes from outside.
#[test]
fn every_driver_of_a_controller_has_its_parser_here() {
    for entry in carved_devices::rotation::DRIVERS {
        assert!(TARGETS.iter().any(|(name, _)| *name == entry.name), "{} is not in targets.rs", entry.name);
    }
}

#[test]
fn no_parser_panics_on_its_corpus_or_on_mutations_of_it() {
    let mut panics = Vec::new();
    let mut inputs = 0;
    for (name, parse) in TARGETS {
        let files = corpus(name);
        let of_each = INPUTS.div_ceil(files.len());
        for (number, (path, content)) in files.iter().enumerate() {
            let others: Vec<&[u8]> = files.iter().map(|(_, other)| other.as_slice()).collect();
            for (mutation, input) in
                std::iter::once(content.clone()).chain(Mutations::new(number as u64, content, &others)).take(of_each).enumerate()
            {
                inputs += 1;
                if catch_unwind(|| parse(&input)).is_err() {
                    panics.push(format!("{name}: mutation {mutation} of {}: {}", path.display(), input.escape_ascii()));
                }
            }
        }
    }
    println!("figure: {inputs} inputs to {} parsers, {} panics", TARGETS.len(), panics.len());
    assert!(panics.is_empty(), "{}", panics.join("\n"));
}
