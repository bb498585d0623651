//! The emulated toy, at the other end of a pty.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::thread::JoinHandle;

pub struct Emulated {
    path: String,
    shaft: Arc<AtomicI64>,
    is_over: Arc<AtomicBool>,
    /// The end of the line that programs open. While it is open, so is the pty.
    line: File,
    thread: Option<JoinHandle<()>>,
}

impl Emulated {
    pub fn start() -> Self {
        let pty = nix::pty::openpty(None, None).unwrap();
        let path = nix::unistd::ttyname(&pty.slave).unwrap().to_str().unwrap().to_owned();
        let mut raw = nix::sys::termios::tcgetattr(&pty.slave).unwrap();
        nix::sys::termios::cfmakeraw(&mut raw);
        nix::sys::termios::tcsetattr(&pty.slave, nix::sys::termios::SetArg::TCSANOW, &raw).unwrap();
        let (shaft, is_over) = (Arc::new(AtomicI64::new(7)), Arc::new(AtomicBool::new(false)));
        let (turned, over) = (Arc::clone(&shaft), Arc::clone(&is_over));
        let thread = std::thread::spawn(move || {
            let mut lines = BufReader::new(File::from(pty.master));
            let mut request = Vec::new();
            while lines.read_until(b'\n', &mut request).is_ok() && !over.load(Ordering::Relaxed) {
                let asked = String::from_utf8_lossy(&request).trim().to_owned();
                request.clear();
                let answer = match asked.split_once(' ') {
                    None if asked == "who" => "Toy 1".to_owned(),
                    None if asked == "zero" => {
                        turned.store(0, Ordering::Relaxed);
                        "0".to_owned()
                    }
                    Some(("go", steps)) if steps.parse::<i64>().is_ok() => {
                        turned.store(steps.parse().unwrap(), Ordering::Relaxed);
                        steps.to_owned()
                    }
                    // The question of another protocol.
                    _ => continue,
                };
                lines.get_mut().write_all(format!("{answer}\n").as_bytes()).unwrap();
            }
        });
        Self { path, shaft, is_over, line: File::from(pty.slave), thread: Some(thread) }
    }

    pub fn path(&self) -> &str {
        &self.path
    }

    /// Where the shaft stands, in steps.
    pub fn shaft(&self) -> i64 {
        self.shaft.load(Ordering::Relaxed)
    }
}

impl Drop for Emulated {
    /// Pulls the cable.
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        // The thread waits for a line.
        self.line.write_all(b"\n").unwrap();
        self.thread.take().unwrap().join().unwrap();
    }
}
