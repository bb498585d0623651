//! `docs/specimens.md` prints the table of transitions.

#![allow(clippy::unwrap_used)] // a test may panic

use std::path::Path;

#[test]
fn the_page_prints_the_table_of_transitions() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/specimens.md");
    let text = std::fs::read_to_string(&page).unwrap();
    let (begin, end) = ("<!-- transitions -->\n", "<!-- end of transitions -->\n");
    let (before, rest) = text.split_once(begin).unwrap();
    let (printed, after) = rest.split_once(end).unwrap();
    let made = format!("\n{}\n", carved_records::specimens_as_markdown());
    if std::env::var_os("CARVED_UPDATE_SPECIMENS").is_some_and(|value| value == "1") {
        std::fs::write(&page, format!("{before}{begin}{made}{end}{after}")).unwrap();
        return;
    }
    assert!(printed == made, "docs/specimens.md is out of date: CARVED_UPDATE_SPECIMENS=1 cargo test --test specimens_page");
}
