//! The programs that have a device open, as far as this user may see them.

use std::path::Path;

/// Programs that have the port open, as `name (process 123)`. A pseudo-terminal is always held by the program behind it.
pub fn of(port: &str) -> Vec<String> {
    let Ok(device) = std::fs::canonicalize(port) else { return Vec::new() };
    if device.starts_with("/dev/pts") {
        return Vec::new();
    }
    let Ok(processes) = std::fs::read_dir("/proc") else { return Vec::new() };
    processes
        .flatten()
        .map(|entry| entry.path())
        .filter(|process| has_open(process, &device))
        .filter_map(|process| name(&process))
        .collect()
}

fn has_open(process: &Path, device: &Path) -> bool {
    let Ok(open) = std::fs::read_dir(process.join("fd")) else { return false };
    open.flatten().any(|fd| std::fs::read_link(fd.path()).is_ok_and(|target| target == device))
}

fn name(process: &Path) -> Option<String> {
    let number: u32 = process.file_name()?.to_str()?.parse().ok()?;
    let name = std::fs::read_to_string(process.join("comm")).unwrap_or_default();
    Some(format!("{} (process {number})", name.trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_a_file_open_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path().to_str().unwrap();
        let me = format!("(process {})", std::process::id());
        assert!(of(path).iter().any(|holder| holder.ends_with(&me)), "{:?}", of(path));
        let path = path.to_owned();
        let kept = file.into_temp_path();
        assert!(of(&path).is_empty());
        drop(kept);
    }
}
