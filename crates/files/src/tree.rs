//! All that is below a folder.
//!
//! ```text
//!  RUN/ ── A01/ ── frames/0.png   files
//!   │       └───── frames         folders
//!   └── l1 -> ..                  other: not followed, named
//! ```

use super::check;
use std::io;
use std::path::{Path, PathBuf};

/// Most folders within each other. A run has 4, and a Zarr of it has 10 more.
const DEEPEST: usize = 32;
/// Most entries. A plate of 1536 wells with 84 views and masks each has 0.3 million.
const MOST: usize = 4_000_000;

/// What is below a folder, by names relative to it, sorted. No link is followed.
#[derive(Debug, Default)]
pub struct Tree {
    /// Regular files.
    pub files: Vec<PathBuf>,
    /// Folders. One comes before those in it.
    pub folders: Vec<PathBuf>,
    /// What is neither, each with the reason.
    other: Vec<(PathBuf, io::Error)>,
}

impl Tree {
    /// Lists a folder, which may be reached through a link.
    ///
    /// # Errors
    /// A folder cannot be listed, or there are too many of them within each other, or too many files.
    pub fn of(folder: &Path) -> io::Result<Self> {
        Self::bounded(folder, DEEPEST, MOST)
    }

    fn bounded(folder: &Path, deepest: usize, most: usize) -> io::Result<Self> {
        let mut found = Self::default();
        let (mut waiting, mut entries) = (vec![PathBuf::new()], 0);
        while let Some(under) = waiting.pop() {
            for entry in std::fs::read_dir(folder.join(&under)).map_err(|error| at(&under, &error))? {
                let entry = entry.map_err(|error| at(&under, &error))?;
                let name = under.join(entry.file_name());
                entries += 1;
                if entries > most {
                    return Err(io::Error::other(format!("it has more than {most} files and folders")));
                }
                let kind = entry.file_type().map_err(|error| at(&name, &error))?;
                if kind.is_dir() {
                    if name.components().count() > deepest {
                        return Err(io::Error::other(format!("{}: more than {deepest} folders within each other", name.display())));
                    }
                    waiting.push(name.clone());
                    found.folders.push(name);
                } else if let Err(error) = check(kind) {
                    found.other.push((name, error));
                } else {
                    found.files.push(name);
                }
            }
        }
        found.files.sort();
        found.folders.sort();
        found.other.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(found)
    }

    /// The names of what is neither a regular file nor a folder.
    pub fn others(&self) -> impl Iterator<Item = &Path> {
        self.other.iter().map(|(name, _)| name.as_path())
    }

    /// The same, if everything is a regular file or a folder.
    ///
    /// # Errors
    /// The first that is something else, by name.
    pub fn regular(mut self) -> io::Result<Self> {
        if self.other.is_empty() {
            return Ok(self);
        }
        let (name, error) = self.other.swap_remove(0);
        let more = if self.other.is_empty() { String::new() } else { format!(" (and {} more)", self.other.len()) };
        Err(io::Error::new(error.kind(), format!("{}: {error}{more}. Nothing is followed out of the folder: remove it", name.display())))
    }
}

fn at(name: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", name.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_tree_has_an_end_whatever_links_are_in_it() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("A01/frames")).unwrap();
        std::fs::write(dir.path().join("A01/frames/0.png"), "x").unwrap();
        std::fs::write(dir.path().join("run.json"), "x").unwrap();
        let regular = Tree::of(dir.path()).and_then(Tree::regular).unwrap();
        assert_eq!(regular.files, ["A01/frames/0.png", "run.json"].map(PathBuf::from));
        assert_eq!(regular.folders, ["A01", "A01/frames"].map(PathBuf::from));
        for name in ["l1", "A01/l2"] {
            symlink("..", dir.path().join(name)).unwrap();
        }
        symlink("run.json", dir.path().join("to_file")).unwrap();
        nix::unistd::mkfifo(&dir.path().join("A01/pipe"), nix::sys::stat::Mode::S_IRWXU).unwrap();
        let tree = Tree::of(dir.path()).unwrap();
        assert_eq!((&tree.files, &tree.folders), (&regular.files, &regular.folders));
        assert_eq!(tree.others().collect::<Vec<_>>(), ["A01/l2", "A01/pipe", "l1", "to_file"].map(Path::new));
        let error = tree.regular().unwrap_err().to_string();
        assert!(error.starts_with("A01/l2: it is a link") && error.contains("3 more"), "{error}");
    }

    #[test]
    fn a_tree_that_is_too_deep_or_too_large_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("1/2/3")).unwrap();
        assert_eq!(Tree::bounded(dir.path(), 3, 3).unwrap().folders.len(), 3);
        assert!(Tree::bounded(dir.path(), 2, 3).unwrap_err().to_string().contains("1/2/3: more than 2"));
        assert!(Tree::bounded(dir.path(), 3, 2).unwrap_err().to_string().contains("more than 2 files"));
    }
}
