//! Tests that cannot run here are ignored or skipped on a developer's machine, and fail in a strict run (`CARVED_STRICT=1`).

fn strict() -> bool {
    std::env::var_os("CARVED_STRICT").is_some_and(|value| value == "1")
}

/// For needs that only a running test can check.
#[allow(dead_code)] // not every test binary has such a test
pub fn cannot_run(reason: &str) {
    assert!(!strict(), "CARVED_STRICT=1, and this test cannot run: {reason}");
    println!("not run: {reason}");
}

/// For needs that the build script checks: for each, whether it is met, and the text that says what is missing and how to get it.
#[allow(dead_code)] // as above
pub fn holds(needs: &[(bool, &str)]) {
    let missing: Vec<&str> = needs.iter().filter(|(met, _)| !met).map(|(_, missing)| *missing).collect();
    assert!(!strict() || missing.is_empty(), "CARVED_STRICT=1, and tests are left out:\n{}", missing.join("\n"));
}
