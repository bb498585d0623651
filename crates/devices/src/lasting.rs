//! An axis that survives a lost connection. A lost driver is closed, and opened again when the controller is back.
//!
//! ```text
//!            Gone ───────────► no driver (the port is free, so that a replugged adapter gets its name again)
//!  driver ──┤                    │
//!            check: Silent ──►   │ check: opened again? ──► driver, a later epoch; it needs a reference
//! ```
//! The port must be closed at once. While a dead tty is held open its adapter comes back under another name.

use super::{Achieved, Begun, Capabilities, DeviceError, EvenMotion, LinearAxis, Link, Position, RotationAxis, SpecimenInput, StopHandle};
use crate::cancel::CancelToken;
use crate::outputs::Outputs;
use carved_core::units::Steps;

type Open = Box<dyn FnMut() -> Result<Box<dyn RotationAxis>, DeviceError> + Send>;

/// A rotation axis of any make.
pub struct Lasting {
    open: Open,
    axis: Option<Box<dyn RotationAxis>>,
    /// Identity of the axis that was closed last.
    identity: String,
    capabilities: Capabilities,
    /// Each driver counts its epochs from 0. This is the number of epochs of the drivers before.
    epochs_before: u32,
}

impl Lasting {
    /// Opens the axis for the first time.
    ///
    /// # Errors
    /// The driver's error. An axis that a person holds is not an error here: `check` reports it.
    pub fn open(mut open: impl FnMut() -> Result<Box<dyn RotationAxis>, DeviceError> + Send + 'static) -> Result<Self, DeviceError> {
        let axis = open()?;
        let capabilities = axis.capabilities();
        Ok(Self { open: Box::new(open), axis: Some(axis), identity: String::new(), capabilities, epochs_before: 0 })
    }

    fn with<T>(&mut self, work: impl FnOnce(&mut dyn RotationAxis) -> Result<T, DeviceError>) -> Result<T, DeviceError> {
        let Some(axis) = &mut self.axis else { return Err(away()) };
        let result = work(axis.as_mut());
        if matches!(result, Err(DeviceError::Gone { .. })) {
            self.close_port();
        }
        result
    }

    fn close_port(&mut self) {
        if let Some(axis) = self.axis.take() {
            axis.identity().clone_into(&mut self.identity);
            self.epochs_before += 1 + epoch(axis.position());
        }
    }

    fn achieved(&self, inner: Achieved) -> Achieved {
        Achieved { epoch: self.epochs_before + inner.epoch, ..inner }
    }
}

fn away() -> DeviceError {
    DeviceError::Gone { device: "rotation axis", why: "it has not come back yet".into() }
}

fn epoch(position: Position) -> u32 {
    match position {
        Position::Unknown => 0,
        Position::Referenced { epoch, .. } | Position::Suspect { epoch } => epoch,
    }
}

impl RotationAxis for Lasting {
    fn identity(&self) -> &str {
        self.axis.as_ref().map_or(&self.identity, |axis| axis.identity())
    }

    fn capabilities(&self) -> Capabilities {
        self.capabilities
    }

    fn begin_run(&mut self) {
        if let Some(axis) = &mut self.axis {
            axis.begin_run();
        }
    }

    fn announce(&mut self, stops: &[Steps]) -> Result<(), DeviceError> {
        self.with(|axis| axis.announce(stops))
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        let inner = self.with(|axis| axis.reference(cancel))?;
        Ok(self.achieved(inner))
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let inner = self.with(|axis| axis.move_to(target))?;
        Ok(self.achieved(inner))
    }

    fn even_motion(&self) -> Option<EvenMotion> {
        self.axis.as_ref()?.even_motion()
    }

    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let inner = self.with(|axis| axis.move_evenly(target, steps_per_s, begun))?;
        Ok(self.achieved(inner))
    }

    fn let_go(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        self.with(|axis| axis.let_go(cancel))
    }

    fn linear(&mut self) -> Option<&mut dyn LinearAxis> {
        self.axis.as_mut()?.linear()
    }

    fn specimen_input(&mut self) -> Option<&mut dyn SpecimenInput> {
        self.axis.as_mut()?.specimen_input()
    }

    fn outputs(&mut self) -> Option<&mut dyn Outputs> {
        self.axis.as_mut()?.outputs()
    }

    /// Opens a lost axis again, and closes one that does not answer.
    fn check(&mut self) -> Result<(), DeviceError> {
        if self.axis.is_none() {
            let axis = (self.open)()?;
            self.capabilities = axis.capabilities();
            self.axis = Some(axis);
        }
        // A driver also opens an axis that a person holds. Only its check tells.
        let result = self.with(|axis| axis.check());
        if matches!(result, Err(DeviceError::Silent { .. })) {
            self.close_port();
        }
        result
    }

    fn position(&self) -> Position {
        match self.axis.as_ref().map(|axis| axis.position()) {
            Some(Position::Referenced { steps, epoch }) => Position::Referenced { steps, epoch: self.epochs_before + epoch },
            Some(Position::Suspect { epoch }) => Position::Suspect { epoch: self.epochs_before + epoch },
            Some(Position::Unknown) => Position::Unknown,
            None => Position::Suspect { epoch: self.epochs_before },
        }
    }

    /// The handle of the axis that is open now. An axis is opened again by a check only, so its user asks for the handle after each check.
    fn stop_handle(&self) -> StopHandle {
        self.axis.as_ref().map_or_else(|| StopHandle::new(|| ()).with_link(Link::new(|| true)), |axis| axis.stop_handle())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{AxisLog, FakeAxis};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Mutex};

    /// A controller at a port, and the axes that were opened there.
    #[derive(Default)]
    struct Bench {
        unplugged: AtomicBool,
        held: AtomicBool,
        opened: Mutex<Vec<AxisLog>>,
    }

    impl Bench {
        /// The axis can be opened while a person holds it.
        fn open(self: &Arc<Self>) -> Result<Box<dyn RotationAxis>, DeviceError> {
            match self.answer() {
                Ok(()) | Err(DeviceError::Intervention { .. }) => {}
                Err(error) => return Err(error),
            }
            let bench = Arc::clone(self);
            let axis = FakeAxis::new().answering(move || bench.answer());
            self.opened.lock().unwrap().push(axis.log());
            Ok(Box::new(axis))
        }

        fn answer(&self) -> Result<(), DeviceError> {
            if self.unplugged.load(Ordering::SeqCst) {
                Err(DeviceError::Gone { device: "fake", why: "unplugged".into() })
            } else if self.held.load(Ordering::SeqCst) {
                Err(DeviceError::Intervention { device: "fake", what: "feed hold".into(), way_out: "Press cycle start" })
            } else {
                Ok(())
            }
        }

        /// How many axes were opened, and how many of them were closed.
        fn opened_and_closed(&self) -> (usize, usize) {
            let opened = self.opened.lock().unwrap();
            (opened.len(), opened.iter().filter(|log| log.is_closed()).count())
        }
    }

    #[test]
    fn a_lost_axis_lets_its_port_go_and_comes_back_in_a_later_epoch() {
        let bench = Arc::new(Bench::default());
        let shared = Arc::clone(&bench);
        let mut axis = Lasting::open(move || shared.open()).unwrap();
        let cancel = CancelToken::new();
        assert_eq!(axis.reference(&cancel).unwrap().epoch, 1);
        axis.check().unwrap();
        bench.unplugged.store(true, Ordering::SeqCst);
        assert!(matches!(axis.move_to(Steps(1)), Err(DeviceError::Gone { .. })));
        assert_eq!(bench.opened_and_closed(), (1, 1), "the port is free");
        assert!(matches!(axis.position(), Position::Suspect { epoch: 2 }));
        assert!(axis.check().is_err() && axis.move_to(Steps(1)).is_err());
        bench.unplugged.store(false, Ordering::SeqCst);
        assert!(axis.move_to(Steps(1)).is_err(), "nobody has opened it yet");
        axis.check().unwrap();
        assert_eq!(bench.opened_and_closed(), (2, 1));
        assert_eq!(axis.position(), Position::Unknown);
        assert_eq!(axis.reference(&cancel).unwrap().epoch, 3, "views from before and after never share an epoch");
    }

    #[test]
    fn an_axis_that_comes_back_while_a_person_holds_it_reports_that_and_keeps_its_port() {
        let bench = Arc::new(Bench::default());
        let shared = Arc::clone(&bench);
        let mut axis = Lasting::open(move || shared.open()).unwrap();
        bench.unplugged.store(true, Ordering::SeqCst);
        assert!(matches!(axis.check(), Err(DeviceError::Gone { .. })));
        assert_eq!(axis.identity(), "fake axis", "known while it is lost");
        bench.unplugged.store(false, Ordering::SeqCst);
        bench.held.store(true, Ordering::SeqCst);
        for _ in 0..2 {
            assert!(matches!(axis.check(), Err(DeviceError::Intervention { .. })));
        }
        bench.held.store(false, Ordering::SeqCst);
        axis.check().unwrap();
        assert_eq!(bench.opened_and_closed(), (2, 1));
    }
}
