//! The file of the mesh. An existing file is replaced only on request.

use anyhow::{Context, bail};
use carved_store::durable;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub(super) enum Destination {
    /// The first free name of this pattern.
    Free {
        folder: PathBuf,
        stem: String,
    },
    New(PathBuf),
    Replace(PathBuf),
}

impl Destination {
    /// Refuses early whatever `write` would refuse after the computation.
    pub fn choose(out: Option<&Path>, views: &Path, force: bool) -> anyhow::Result<Self> {
        let Some(out) = out else {
            let stem = views.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
            return Ok(Self::Free { folder: PathBuf::new(), stem: stem.unwrap_or_else(|| "model".into()) });
        };
        if let Some(ending) = out.extension().filter(|e| !e.eq_ignore_ascii_case("ply")) {
            bail!("--out {}: found the ending .{}; PLY is written, expected .ply", out.display(), ending.display());
        }
        let folder = durable::folder_of(out);
        if !folder.is_dir() {
            bail!("--out {}: found no folder {}, expected one to write into", out.display(), folder.display());
        }
        if out.is_dir() {
            bail!("--out {}: found a folder, expected the name of a file", out.display());
        }
        match (out.exists(), force) {
            (true, false) => bail!("--out {}: the file is there already; give --force to replace it", out.display()),
            (_, true) => Ok(Self::Replace(out.into())),
            (false, false) => Ok(Self::New(out.into())),
        }
    }

    /// Writes the complete file or nothing. Returns its path.
    pub fn write(self, bytes: &[u8]) -> anyhow::Result<PathBuf> {
        match self {
            Self::New(path) => create(&path, bytes).with_context(|| path.display().to_string()).map(|()| path),
            Self::Replace(path) => replace(&path, bytes).with_context(|| path.display().to_string()).map(|()| path),
            Self::Free { folder, stem } => {
                for n in 1..10_000 {
                    let path = folder.join(if n == 1 { format!("{stem}.ply") } else { format!("{stem}-{n}.ply") });
                    match create(&path, bytes) {
                        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                        done => return done.with_context(|| path.display().to_string()).map(|()| path),
                    }
                }
                bail!("{stem}.ply: 10 000 names are taken; give --out")
            }
        }
    }
}

fn create(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = std::fs::File::create_new(path)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).inspect_err(|_| {
        // A partial file is worse than none. The first error is the one to report.
        std::fs::remove_file(path).ok();
    })
}

/// Keeps the old file until the new one is complete.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    create(&part, bytes)?;
    std::fs::rename(&part, path).inspect_err(|_| {
        std::fs::remove_file(&part).ok();
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_free_name_is_found_and_what_is_there_stays() {
        let dir = tempfile::tempdir().unwrap();
        let free = || Destination::Free { folder: dir.path().into(), stem: "larva".into() };
        let first = free().write(b"one").unwrap();
        let second = free().write(b"two").unwrap();
        assert_eq!((first.file_name().unwrap(), second.file_name().unwrap()), ("larva.ply".as_ref(), "larva-2.ply".as_ref()));
        assert_eq!(std::fs::read(first).unwrap(), b"one");
    }

    #[test]
    fn a_named_file_is_replaced_only_by_force() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("bead.ply");
        let choose = |force| Destination::choose(Some(&out), dir.path(), force);
        choose(false).unwrap().write(b"old").unwrap();
        assert!(choose(false).unwrap_err().to_string().contains("--force"));
        choose(true).unwrap().write(b"new").unwrap();
        assert_eq!(std::fs::read(&out).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no part is left");
        assert!(Destination::choose(Some(&dir.path().join("none/x.ply")), dir.path(), false).is_err());
        assert!(Destination::choose(Some(dir.path()), dir.path(), true).is_err());
    }

    #[test]
    fn a_name_that_promises_another_format_is_refused() {
        let choose = |name: &str| Destination::choose(Some(Path::new(name)), Path::new("views"), false);
        assert_eq!(choose("q.obj").unwrap_err().to_string(), "--out q.obj: found the ending .obj; PLY is written, expected .ply");
        assert!(choose("q.PLY").is_ok() && choose("q").is_ok());
    }
}
