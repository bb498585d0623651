//! Tests that cannot run here: ignored or passed over on a developer's machine, failed in a strict run (`CARVED_STRICT=1`).

fn strict() -> bool {
    std::env::var_os("CARVED_STRICT").is_some_and(|value| value == "1")
}

/// For what only a running test can find out.
#[allow(dead_code)] // not every test binary has such a test
pub fn cannot_run(reason: &str) {
    assert!(!strict(), "CARVED_STRICT=1, and this test cannot run: {reason}");
    println!("not run: {reason}");
}

/// For what the build script has found: whether each need is met, and what is missing with the way out.
#[allow(dead_code)] // as above
pub fn holds(needs: &[(bool, &str)]) {
    let missing: Vec<&str> = needs.iter().filter(|(met, _)| !met).map(|(_, missing)| *missing).collect();
    assert!(!strict() || missing.is_empty(), "CARVED_STRICT=1, and tests are left out:\n{}", missing.join("\n"));
}
