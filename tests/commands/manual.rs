//! `carved manual`: what the package installs of it.

use crate::common::{run, stderr};
use std::fs;

#[test]
fn every_command_has_a_page_and_completions_except_the_hidden_one() {
    let dir = tempfile::tempdir().unwrap();
    let output = run(&["manual", "--out", dir.path().to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    for (page, says) in [("carved.1", "CARVED_LOG"), ("carved-run-start.1", "plate"), ("carved-halt.1", "config")] {
        assert!(fs::read_to_string(dir.path().join("man1").join(page)).unwrap().contains(says), "{page}");
    }
    assert!(!dir.path().join("man1/carved-manual.1").exists());
    let page = |name: &str| fs::read_to_string(dir.path().join("man1").join(name)).unwrap();
    assert!(page("carved-serve.1").contains(" \\-\\-config <CONFIG>\n"), "{}", page("carved-serve.1"));
    for name in ["carved-run.1", "carved-run-start.1", "carved-run-watch.1"] {
        assert!(page(name).contains("\n.SH \"EXIT STATUS\"\n0 done"), "{}", page(name));
    }
    assert!(page("carved.1").contains("\n.SH ENVIRONMENT\n  CARVED_LOG"), "{}", page("carved.1"));
    for file in ["carved.bash", "_carved", "carved.fish"] {
        let text = fs::read_to_string(dir.path().join("completions").join(file)).unwrap();
        assert!(text.contains("rocrate") && !text.contains("manual --out") && !text.contains("carved__subcmd__manual"), "{file}");
    }
}
