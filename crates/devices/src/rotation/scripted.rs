//! A scripted controller on a pty: each step is the bytes that the driver must send and the bytes of the answer.

use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind, Read, Write};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Much longer than any dialogue takes, so that a broken driver fails and does not hang.
const PATIENCE: Duration = Duration::from_secs(20);

/// The bytes that the driver must send, and the answer to them.
pub type Step = (Vec<u8>, Vec<u8>);

pub struct Scripted {
    name: String,
    // Keeps the pty open until the driver has opened it.
    slave: TTYPort,
    reached: Receiver<usize>,
    thread: JoinHandle<Result<(), String>>,
}

impl Scripted {
    pub fn play(script: Vec<Step>) -> Self {
        let (mut master, slave) = TTYPort::pair().unwrap();
        master.set_timeout(Duration::from_millis(50)).unwrap();
        let (reach, reached) = channel();
        let name = slave.name().unwrap();
        let thread = std::thread::spawn(move || {
            for (number, (expected, reply)) in script.into_iter().enumerate() {
                let said = hear(&mut master, expected.len()).map_err(|e| format!("step {number}: {e}, expected {}", show(&expected)))?;
                if said != expected {
                    return Err(format!("step {number}: expected {}, heard {}", show(&expected), show(&said)));
                }
                master.write_all(&reply).map_err(|e| e.to_string())?;
                // The test may not wait for steps.
                let _ = reach.send(number);
            }
            match master.read(&mut [0; 64]) {
                Ok(n) if n > 0 => Err("more was said than the script has".into()),
                _ => Ok(()),
            }
        });
        Self { name, slave, reached, thread }
    }

    pub fn port(&self) -> String {
        self.name.clone()
    }

    pub fn await_step(&self, number: usize) {
        while self.reached.recv_timeout(PATIENCE).unwrap() < number {}
    }

    /// Ends the dialogue: the driver must have followed the script to its end.
    pub fn followed<T>(self, driver: T) {
        self.thread.join().unwrap().unwrap();
        drop((driver, self.slave));
    }
}

fn show(bytes: &[u8]) -> String {
    if bytes.is_ascii() && bytes.iter().all(|b| *b >= b'\n') { bytes.escape_ascii().to_string() } else { format!("{bytes:02x?}") }
}

fn hear(master: &mut TTYPort, bytes: usize) -> Result<Vec<u8>, String> {
    let until = Instant::now() + PATIENCE;
    let mut heard = vec![0; bytes];
    let mut have = 0;
    while have < bytes {
        if Instant::now() > until {
            return Err(format!("heard only {}", show(&heard[..have])));
        }
        match master.read(&mut heard[have..]) {
            Ok(n) => have += n,
            Err(e) if e.kind() == ErrorKind::TimedOut => {}
            Err(e) => return Err(e.to_string()),
        }
    }
    Ok(heard)
}
