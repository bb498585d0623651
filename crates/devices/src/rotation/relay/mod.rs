//! Driver for a VAST BioImager behind a relay: a Windows program that gives access to VAST's own library over TCP.
//!
//! ```text
//!  reference ──► (a new connection after any fault)  busy? 0        this position is step 0
//!  move_to   ──► busy? 0 ── rot,<difference> ── answer ── busy? 1 ... busy? 0      not before half the turn's time
//! ```
//! The rotation accepts differences and does not report its position, so the driver keeps the count. If the answer to a difference
//! is missing, VAST may have turned or not. The difference is never sent again, and the position is suspect. The protocol cannot
//! stop a turn. A stop ends the requests, and VAST finishes its turn.

mod frames;
mod settings;

pub use settings::RelaySettings;

use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use carved_core::units::{Steps, StepsPerRevolution};
use std::time::{Duration, Instant};

const DEVICE: &str = "rotation axis (VAST relay)";
/// Pause between two `busy` requests.
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// The rotation of a VAST that accepts differences.
pub struct Relay {
    link: Link,
    settings: RelaySettings,
    per_revolution: StepsPerRevolution,
    identity: String,
    knowledge: Knowledge,
    /// The connection cannot be used any more.
    broken: bool,
}

impl Relay {
    /// Connects and asks whether VAST answers. Nothing moves, unless `boot` is configured.
    ///
    /// # Errors
    /// A bad setting, or a relay that cannot be reached or does not answer.
    pub fn open(settings: RelaySettings, per_revolution: StepsPerRevolution) -> Result<Self, DeviceError> {
        settings.check()?;
        let link = Link::tcp(DEVICE, &settings.address, Stop::default())?;
        let identity = format!("VAST relay at {}", settings.address);
        let knowledge = Knowledge::none_of("rotation axis");
        let mut relay = Self { link, settings, per_revolution, identity, knowledge, broken: false };
        if relay.settings.boot {
            frames::ask(&mut relay.link, "boot", relay.settings.boot_timeout())?;
        }
        relay.is_busy()?;
        tracing::info!(identity = relay.identity, "rotation axis opened");
        Ok(relay)
    }

    fn ask(&mut self, request: &str) -> Result<String, DeviceError> {
        let answer = frames::ask(&mut self.link, request, self.settings.answer_timeout());
        self.broken |= answer.is_err();
        answer
    }

    fn is_busy(&mut self) -> Result<bool, DeviceError> {
        let answer = self.ask("busy")?;
        let busy: Option<i64> = answer.trim().parse().ok();
        busy.map(|busy| busy != 0).ok_or_else(|| {
            self.broken = true;
            DeviceError::Unexpected { device: DEVICE, expected: "a number in answer to \"busy\"".into(), found: answer }
        })
    }

    /// Waits until VAST rests, at most until `latest` after `since`. A rest before `soonest` does not count.
    fn rest(&mut self, since: Instant, soonest: Duration, latest: Duration) -> Result<(), DeviceError> {
        // Asked also before `soonest`, so that a stop takes effect at the next request.
        while self.is_busy()? || since.elapsed() < soonest {
            if since.elapsed() > latest {
                return Err(DeviceError::Late {
                    device: DEVICE,
                    what: "VAST did not come to rest (busy 0)",
                    waited_ms: latest.as_millis(),
                });
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        Ok(())
    }

    fn take_place(&mut self) -> Result<(), DeviceError> {
        if self.broken {
            self.link.go_on_through(Link::tcp(DEVICE, &self.settings.address, Stop::default())?);
            self.broken = false;
        }
        // A turn from before a stop or a fault may still last.
        let longest = self.settings.pace().longest(360.0);
        self.rest(Instant::now(), Duration::ZERO, longest)
    }

    fn turn(&mut self, by: Steps) -> Result<(), DeviceError> {
        if by == Steps(0) {
            return Ok(());
        }
        if self.is_busy()? {
            return Err(DeviceError::Suspect { why: "VAST moves without a request of carved".into() });
        }
        let deg = self.per_revolution.angle(by).to_degrees();
        let pace = self.settings.pace();
        let since = Instant::now();
        self.ask(&format!("rot,{}", by.0))?;
        self.rest(since, pace.shortest(deg), pace.longest(deg))
    }

    fn unless_doubtful(&mut self, outcome: Result<(), DeviceError>) -> Result<(), DeviceError> {
        if let Err(error) = &outcome {
            self.knowledge.doubt(error);
        }
        outcome
    }
}

impl RotationAxis for Relay {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            has_position: false,
            has_encoder: false,
            has_stall: false,
            can_stop: false,
            absolute: false,
            trigger_only: false,
            outside: false,
        }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.link.release(cancel)?;
        let taken = self.take_place();
        self.unless_doubtful(taken)?;
        Ok(self.knowledge.begin_epoch())
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let from = self.knowledge.known_steps()?;
        let turned = self.turn(Steps(target.0 - from.0));
        self.unless_doubtful(turned)?;
        Ok(self.knowledge.arrived(target))
    }

    /// After a stop nothing is sent, and the next reference replaces a failed connection. In both cases only the connection is checked.
    fn check(&mut self) -> Result<(), DeviceError> {
        self.link.still_there()?;
        if self.broken || self.link.is_stopped() {
            return Ok(());
        }
        self.is_busy().map(|_busy| ())
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        StopHandle::new(move || stopper.stop())
    }
}
