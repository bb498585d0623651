//! The driver of the toy: `who`, `zero` and `go STEPS`, each with one line as its answer.

use super::settings::ToySettings;
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::rotation::Port;
use carved_devices::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use serialport::{SerialPort, TTYPort};
use std::io::{BufRead, BufReader, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const DEVICE: &str = "rotation axis (toy)";

pub struct Toy {
    port: BufReader<TTYPort>,
    identity: String,
    position: Position,
    is_stopped: Arc<AtomicBool>,
}

impl Toy {
    pub fn open(settings: &ToySettings) -> Result<Self, DeviceError> {
        let Port::Path(path) = &settings.port else { panic!("the toy has no USB adapter") };
        let timeout = Duration::from_millis(settings.answer_timeout_ms.into());
        let port = serialport::new(path, settings.baud).timeout(timeout).open_native().unwrap();
        port.clear(serialport::ClearBuffer::All).unwrap();
        let is_stopped = Arc::new(AtomicBool::new(false));
        let mut toy = Self { port: BufReader::new(port), identity: String::new(), position: Position::Unknown, is_stopped };
        toy.identity = toy.ask("who")?;
        Ok(toy)
    }

    fn ask(&mut self, question: &str) -> Result<String, DeviceError> {
        let gone = |error: std::io::Error| DeviceError::Gone { device: DEVICE, why: error.to_string() };
        self.port.get_mut().write_all(format!("{question}\n").as_bytes()).map_err(gone)?;
        let mut line = String::new();
        self.port.read_line(&mut line).map_err(gone)?;
        Ok(line.trim().to_owned())
    }

    /// Asks for a motion and takes its answer, or makes the position suspect.
    fn turn(&mut self, request: &str, to: Steps, epoch: u32) -> Result<Achieved, DeviceError> {
        let found = self.ask(request);
        self.position = match &found {
            Ok(at) if *at == to.0.to_string() => Position::Referenced { steps: to, epoch },
            _ => Position::Suspect { epoch: epoch + 1 },
        };
        match (self.position, found?) {
            (Position::Referenced { steps, epoch }, _) => Ok(Achieved { steps, epoch }),
            (_, found) => Err(DeviceError::Unexpected { device: DEVICE, expected: to.0.to_string(), found }),
        }
    }
}

impl RotationAxis for Toy {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            has_position: true,
            has_encoder: false,
            has_stall: false,
            can_stop: true,
            absolute: true,
            trigger_only: false,
            outside: false,
        }
    }

    fn reference(&mut self, _: &CancelToken) -> Result<Achieved, DeviceError> {
        self.is_stopped.store(false, Ordering::Relaxed);
        let epoch = match self.position {
            Position::Unknown => 1,
            Position::Referenced { epoch, .. } | Position::Suspect { epoch } => epoch + 1,
        };
        self.turn("zero", Steps(0), epoch)
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        if self.is_stopped.load(Ordering::Relaxed) {
            return Err(DeviceError::Stopped);
        }
        match self.position {
            Position::Unknown => Err(DeviceError::NotReferenced),
            Position::Suspect { .. } => Err(DeviceError::Suspect { why: "a move failed".into() }),
            Position::Referenced { epoch, .. } => self.turn(&format!("go {}", target.0), target, epoch),
        }
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        self.ask("who").map(drop)
    }

    fn position(&self) -> Position {
        self.position
    }

    /// The toy moves at once, so nothing is under way that could be stopped.
    fn stop_handle(&self) -> StopHandle {
        let is_stopped = Arc::clone(&self.is_stopped);
        StopHandle::new(move || is_stopped.store(true, Ordering::Relaxed))
    }
}
