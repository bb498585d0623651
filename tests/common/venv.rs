//! Python packages of others, installed once per target folder.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python that can `import` these modules, with the packages of a requirements file of this repository.
///
/// # Errors
/// Why there is none: Python has no venv, or `PyPI` cannot be reached.
pub fn python(name: &str, import: &str, requirements: &str) -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let python = folder.join("bin/python");
    let run = |program: &Path, args: &[&str]| {
        let output = Command::new(program).args(args).output().map_err(|e| format!("{}: {e}", program.display()))?;
        let said = String::from_utf8_lossy(&output.stderr);
        if output.status.success() { Ok(()) } else { Err(said.lines().last().unwrap_or("no reason was given").to_owned()) }
    };
    let wanted = Path::new(env!("CARGO_MANIFEST_DIR")).join(requirements);
    // Several tests use the same packages, and run at the same time.
    let lock = File::create(folder.with_extension("lock")).and_then(|lock| lock.lock().map(|()| lock));
    let _lock = lock.map_err(|e| format!("{}: {e}", folder.display()))?;
    // Other versions than before are installed again.
    let installed = folder.join("requirements.txt");
    let text = std::fs::read(&wanted).map_err(|e| format!("{}: {e}", wanted.display()))?;
    if std::fs::read(&installed).is_ok_and(|was| was == text) && run(&python, &["-c", &format!("import {import}")]).is_ok() {
        return Ok(python);
    }
    run(Path::new("python3"), &["-m", "venv", &folder.display().to_string()])?;
    run(&python, &["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r", &wanted.display().to_string()])?;
    std::fs::write(&installed, text).map_err(|e| format!("{}: {e}", installed.display()))?;
    Ok(python)
}
