//! Files that are made from a table of the program. With `CARVED_UPDATE_TABLES=1` a test writes them, otherwise it compares.

use std::path::{Path, PathBuf};

fn path(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(file)
}

/// A file that is made as a whole.
pub fn whole(file: &str, made: &str) {
    if std::env::var_os("CARVED_UPDATE_TABLES").is_some_and(|value| value == "1") {
        std::fs::write(path(file), made).unwrap();
    }
    let found = std::fs::read_to_string(path(file)).unwrap_or_default();
    assert!(found == made, "{file} is out of date: make contract");
}

/// The part of a page between the comments `<!-- NAME -->` and `<!-- end of NAME -->`.
pub fn part(file: &str, name: &str, made: &str) {
    let text = std::fs::read_to_string(path(file)).unwrap();
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->\n"));
    let (before, rest) = text.split_once(&begin).unwrap_or_else(|| panic!("{file} has no part {name}"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("the part {name} of {file} has no end"));
    whole(file, &format!("{before}{begin}{made}{end}{after}"));
}
