//! Reading of files that a user names, only if they are regular files. Reading a pipe may wait for ever, and opening a serial port
//! may reset the device behind it. Below a folder of the instrument's own, links are not followed either: one to a folder above it has no
//! end, and what it leads to belongs to somebody else.

mod tree;

pub use tree::Tree;

use nix::fcntl::OFlag;
use std::fs::{File, FileType, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Component, Path};

/// Opens a regular file for reading, without waiting.
///
/// # Errors
/// The path does not exist, or is not a regular file.
pub fn open(path: &Path) -> io::Result<File> {
    // Checked before it is opened, because opening a device may act on it, and after, because the path may have changed meanwhile.
    check(std::fs::metadata(path)?.file_type())?;
    let file = OpenOptions::new().read(true).custom_flags(OFlag::O_NONBLOCK.bits()).open(path)?;
    check(file.metadata()?.file_type())?;
    Ok(file)
}

/// Opens a regular file for reading, and follows no link below `folder`.
///
/// # Errors
/// As [`open`]; `name` leads out of the folder, or a part of it is a link.
pub fn open_below(folder: &Path, name: &Path) -> io::Result<File> {
    let mut path = folder.to_owned();
    let mut parts = name.components().peekable();
    while let Some(part) = parts.next() {
        if !matches!(part, Component::Normal(_)) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "it leads out of its folder"));
        }
        path.push(part);
        let found = path.symlink_metadata()?.file_type();
        if parts.peek().is_none() || !found.is_dir() {
            check(found)?;
        }
    }
    let file = OpenOptions::new().read(true).custom_flags((OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW).bits()).open(&path)?;
    check(file.metadata()?.file_type())?;
    Ok(file)
}

/// Opens a file of the instrument's own, which nobody else makes a link, a pipe or a device. `how` says what for; without the file it may
/// create one.
///
/// # Errors
/// There is something else than a regular file, or it cannot be opened or created.
pub fn open_own(path: &Path, how: &mut OpenOptions) -> io::Result<File> {
    match path.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        found => check(found?.file_type())?,
    }
    let file = how.custom_flags((OFlag::O_NONBLOCK | OFlag::O_NOFOLLOW).bits()).open(path)?;
    check(file.metadata()?.file_type())?;
    Ok(file)
}

/// The bytes of a regular file below a folder, as [`open_below`] opens it.
///
/// # Errors
/// As [`open_below`], or the file cannot be read.
pub fn read_below(folder: &Path, name: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_below(folder, name)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Opens a file of the instrument's own for reading.
///
/// # Errors
/// As [`open_own`], or there is none.
pub fn open_own_to_read(path: &Path) -> io::Result<File> {
    open_own(path, OpenOptions::new().read(true))
}

/// The bytes of a file of the instrument's own.
///
/// # Errors
/// As [`open_own_to_read`], or the file cannot be read.
pub fn read_own(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_own_to_read(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The bytes of a regular file.
///
/// # Errors
/// As [`open`], or the file cannot be read.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a regular file.
///
/// # Errors
/// As [`read`], or the bytes are not UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Checks that a type is that of a regular file.
///
/// # Errors
/// It is another type, which the error names.
pub fn check(found: FileType) -> io::Result<()> {
    if found.is_file() {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {}; a regular file is expected", kind(found))))
}

/// What a type is, for a person.
pub fn kind(found: FileType) -> &'static str {
    match found {
        found if found.is_file() => "a file",
        found if found.is_symlink() => "a link",
        found if found.is_dir() => "a folder",
        found if found.is_fifo() => "a pipe",
        found if found.is_socket() => "a socket",
        _ => "a device",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_opened_and_none_is_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "text").unwrap();
        std::os::unix::fs::symlink(&file, dir.path().join("link")).unwrap();
        assert_eq!(read_to_string(&dir.path().join("link")).unwrap(), "text");
        let pipe = dir.path().join("pipe");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(dir.path().join("socket")).unwrap();
        std::os::unix::fs::symlink(&pipe, dir.path().join("to_pipe")).unwrap();
        for (path, what) in [
            (pipe.as_path(), "a pipe"),
            (&dir.path().join("to_pipe"), "a pipe"),
            (&dir.path().join("socket"), "a socket"),
            (dir.path(), "a folder"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            let error = read(path).unwrap_err().to_string();
            assert!(error.contains(what), "{}: {error}", path.display());
        }
        assert_eq!(open(&dir.path().join("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn no_link_is_followed_below_a_folder_and_nothing_is_created_through_one() {
        let dir = tempfile::tempdir().unwrap();
        let (own, other) = (dir.path().join("own"), dir.path().join("other"));
        std::fs::create_dir_all(own.join("A01")).unwrap();
        std::fs::create_dir(&other).unwrap();
        std::fs::write(own.join("A01/file"), "own").unwrap();
        std::fs::write(other.join("file"), "other").unwrap();
        std::os::unix::fs::symlink(&other, own.join("folder")).unwrap();
        std::os::unix::fs::symlink(other.join("file"), own.join("link")).unwrap();
        std::os::unix::fs::symlink(other.join("new"), own.join("dangling")).unwrap();
        nix::unistd::mkfifo(&own.join("pipe"), nix::sys::stat::Mode::S_IRWXU).unwrap();
        assert_eq!(read_below(&own, Path::new("A01/file")).unwrap(), b"own");
        for (name, what) in [
            ("link", "a link"),
            ("folder/file", "a link"),
            ("dangling", "a link"),
            ("pipe", "a pipe"),
            ("A01", "a folder"),
            ("../other/file", "leads out"),
            ("/etc/hostname", "leads out"),
        ] {
            let error = read_below(&own, Path::new(name)).unwrap_err().to_string();
            assert!(error.contains(what), "{name}: {error}");
        }
        for (name, what) in [("link", "a link"), ("pipe", "a pipe"), ("A01", "a folder")] {
            let error = read_own(&own.join(name)).unwrap_err().to_string();
            assert!(error.contains(what), "{name}: {error}");
        }
        // The folder itself may be reached through a link: the data folder may be on another disk.
        std::os::unix::fs::symlink(&own, dir.path().join("to_own")).unwrap();
        assert_eq!(read_below(&dir.path().join("to_own"), Path::new("A01/file")).unwrap(), b"own");

        let create = |name: &str| open_own(&own.join(name), OpenOptions::new().write(true).create(true)).map(drop);
        create("new").unwrap();
        create("new").unwrap();
        for (name, what) in [("link", "a link"), ("dangling", "a link"), ("pipe", "a pipe"), ("A01", "a folder")] {
            let error = create(name).unwrap_err().to_string();
            assert!(error.contains(what), "{name}: {error}");
        }
        assert!(!other.join("new").exists());
    }
}
