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
    pub clients: u32,
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
        Ok(Self { master, slave, watch, path, clients: 0 })
    }

    /// Counts opens and closes. Returns `true` if a host has opened the port.
    pub fn visitors(&mut self) -> bool {
        let mut opened = false;
        for event in self.watch.read_events().unwrap_or_default() {
            if event.mask.contains(AddWatchFlags::IN_OPEN) {
                self.clients += 1;
                opened = true;
            } else if event.mask.intersects(AddWatchFlags::IN_CLOSE) {
                self.clients = self.clients.saturating_sub(1);
            }
        }
        if self.clients == 0 {
            // At its last close a real port drops unread bytes and its exclusive lock. This port is still open, so both are done here.
            let _ = tcflush(&self.slave, FlushArg::TCIFLUSH);
            // SAFETY: TIOCNXCL takes no argument and touches no memory of this process. The descriptor is open.
            #[allow(unsafe_code)]
            let _ = unsafe { tiocnxcl(self.slave.as_raw_fd()) };
        }
        opened
    }
}

/// Makes `link` point to `target`, atomically for readers.
pub(super) fn point(link: &Path, target: &Path) -> std::io::Result<()> {
    let fresh = link.with_extension("new");
    let _ = std::fs::remove_file(&fresh);
    std::os::unix::fs::symlink(target, &fresh)?;
    std::fs::rename(&fresh, link)
}
