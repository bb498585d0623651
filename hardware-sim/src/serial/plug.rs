//! One end of the serial cable: a pty, and a watch that notices hosts that open it.

use nix::fcntl::{OFlag, open};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::inotify::{AddWatchFlags, InitFlags, Inotify};
use nix::sys::stat::Mode;
use nix::sys::termios::{FlushArg, SetArg, cfmakeraw, tcflush, tcgetattr, tcsetattr};
use std::os::fd::{AsRawFd, OwnedFd};
use std::path::{Path, PathBuf};

nix::ioctl_none_bad!(
    /// Releases the exclusive lock of a terminal.
    tiocnxcl,
    nix::libc::TIOCNXCL
);

/// A pty whose slave end stays open, and a watch that notices when others open and close it.
pub(super) struct Plug {
    pub master: PtyMaster,
    slave: OwnedFd,
    pub watch: Inotify,
    pub path: PathBuf,
    /// Somebody else has the slave open.
    pub has_host: bool,
}

impl Plug {
    pub fn open() -> nix::Result<Self> {
        let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = PathBuf::from(ptsname_r(&master)?);
        let slave = open(&path, OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC, Mode::empty())?;
        let mut termios = tcgetattr(&slave)?;
        cfmakeraw(&mut termios);
        tcsetattr(&slave, SetArg::TCSANOW, &termios)?;
        let watch = Inotify::init(InitFlags::IN_CLOEXEC | InitFlags::IN_NONBLOCK)?;
        watch.add_watch(&path, AddWatchFlags::IN_OPEN | AddWatchFlags::IN_CLOSE)?;
        Ok(Self { master, slave, watch, path, has_host: false })
    }

    /// Notices opens and closes. Returns `true` if a host has opened the port.
    pub fn visitors(&mut self) -> bool {
        let (mut opened, mut closed) = (false, false);
        for event in self.watch.read_events().unwrap_or_default() {
            opened |= event.mask.contains(AddWatchFlags::IN_OPEN);
            closed |= event.mask.intersects(AddWatchFlags::IN_CLOSE);
        }
        // The kernel makes one event of equal ones in a row, so they are no count.
        self.has_host = if closed { self.is_open_elsewhere() } else { self.has_host || opened };
        if !self.has_host {
            // At its last close a real port drops unread bytes and its exclusive lock. This port is still open, so both are done here.
            let _ = tcflush(&self.slave, FlushArg::TCIFLUSH);
            // SAFETY: TIOCNXCL takes no argument and touches no memory of this process. The descriptor is open.
            #[allow(unsafe_code)]
            let _ = unsafe { tiocnxcl(self.slave.as_raw_fd()) };
        }
        opened
    }

    /// Whether anybody but this plug has the slave open, by the open files of all processes that can be seen.
    fn is_open_elsewhere(&self) -> bool {
        let entries = |folder: PathBuf| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        // Not `self`, which is one of them.
        let is_process = |path: &PathBuf| path.file_name().is_some_and(|name| name.as_encoded_bytes().iter().all(u8::is_ascii_digit));
        let own = PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), self.slave.as_raw_fd()));
        let mut open = entries("/proc".into()).filter(is_process).flat_map(|process| entries(process.join("fd")));
        open.any(|fd| fd != own && std::fs::read_link(&fd).is_ok_and(|file| file == self.path))
    }
}

/// Makes `link` point to `target`, atomically for readers.
pub(super) fn point(link: &Path, target: &Path) -> std::io::Result<()> {
    let fresh = link.with_extension("new");
    let _ = std::fs::remove_file(&fresh);
    std::os::unix::fs::symlink(target, &fresh)?;
    std::fs::rename(&fresh, link)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A daemon that has lost its port looks for it by its name, which another port may have by now.
    #[test]
    fn a_host_is_still_there_when_another_one_that_opened_at_the_same_time_has_left() {
        let mut plug = Plug::open().unwrap();
        let host = || std::fs::OpenOptions::new().read(true).write(true).open(&plug.path).unwrap();
        let (stays, leaves) = (host(), host());
        drop(leaves);
        assert!(plug.visitors() && plug.has_host);
        drop(stays);
        assert!(!plug.visitors() && !plug.has_host);
    }
}
