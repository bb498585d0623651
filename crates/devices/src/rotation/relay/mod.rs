//! Driver for a VAST BioImager behind a relay: a Windows program that gives access to VAST's own library.
//!
//! ```text
//!  carved ── TCP ── scripts/vast_pipe_relay.py ── named pipe ── VastNavigateServer ── VAST's library
//!
//!  reference ──► (a new connection after any fault)  busy? 0        this position is step 0
//!  move_to   ──► busy? 0 ── rot,<difference> ── answer ── busy? 1 ... busy? 0      not before half the turn's time
//! ```
//! The requests and answers are those of the public `VastNavigateServer` of UT Southwestern and of its Python client. Every request gets
//! one answer. The answer to `boot`, `rot` and to anything unknown is empty. `busy` is empty too until VAST has been started, which
//! takes most of a minute after `boot`.
//!
//! The rotation accepts differences and does not report its position, so the driver keeps the count. If the answer to a difference
//! is missing, VAST may have turned or not. The difference is never sent again, and the position is suspect. The protocol cannot
//! stop a turn. A stop ends the requests, and VAST finishes its turn.

mod entry;
pub(super) mod frames;
mod settings;

pub(super) use entry::ENTRY;
pub use settings::RelaySettings;

use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use carved_core::units::{Steps, StepsPerRevolution};
use std::time::{Duration, Instant};

const DEVICE: &str = "rotation axis (VAST relay)";
/// Pause between two `busy` requests while VAST turns.
const LOOK_AGAIN: Duration = Duration::from_millis(10);
/// The same while it starts, which takes most of a minute. The relay's program shows every request in its window.
const STARTED_LOOK: Duration = Duration::from_millis(250);

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
    /// Connects, and starts VAST if `boot` is configured. Otherwise nothing moves, and a VAST that is not started is not an error here.
    ///
    /// # Errors
    /// A bad setting, a relay that cannot be reached or does not answer, or a VAST that does not start.
    pub fn open(settings: RelaySettings, per_revolution: StepsPerRevolution) -> Result<Self, DeviceError> {
        settings.check()?;
        let link = Link::tcp(DEVICE, &settings.address, Stop::default())?;
        let identity = format!("VAST relay at {}", settings.address);
        let knowledge = Knowledge::none_of("rotation axis");
        let mut relay = Self { link, settings, per_revolution, identity, knowledge, broken: false };
        match relay.have_started() {
            Ok(()) | Err(DeviceError::VastProgram { .. }) => {}
            Err(error) => return Err(error),
        }
        tracing::info!(identity = relay.identity, "rotation axis opened");
        Ok(relay)
    }

    fn ask(&mut self, request: &str) -> Result<String, DeviceError> {
        let answer = frames::ask(&mut self.link, request, self.settings.answer_timeout());
        self.broken |= answer.is_err();
        answer
    }

    /// Whether VAST moves. `None` if VAST is not started.
    fn activity(&mut self) -> Result<Option<bool>, DeviceError> {
        let answer = self.ask("busy")?;
        moves(&answer).inspect_err(|_| self.broken = true)
    }

    fn is_busy(&mut self) -> Result<bool, DeviceError> {
        self.activity()?.ok_or_else(not_started)
    }

    /// Starts VAST if it is not started and `boot` is configured.
    fn have_started(&mut self) -> Result<(), DeviceError> {
        if self.activity()?.is_some() {
            return Ok(());
        }
        if !self.settings.boot {
            return Err(not_started());
        }
        tracing::info!(relay = self.identity, "VAST is being started");
        let since = Instant::now();
        self.ask("boot")?;
        // The answer comes at once. Only an answer to `busy` shows that VAST has started.
        while self.activity()?.is_none() {
            let waited = since.elapsed();
            if waited > self.settings.boot_timeout() {
                return Err(DeviceError::Late { device: DEVICE, what: "VAST did not start (boot)", waited_ms: waited.as_millis() });
            }
            std::thread::sleep(STARTED_LOOK.min(self.settings.boot_timeout()));
        }
        Ok(())
    }

    fn reconnect(&mut self) -> Result<(), DeviceError> {
        self.link.go_on_through(Link::tcp(DEVICE, &self.settings.address, Stop::default())?);
        self.broken = false;
        Ok(())
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
            self.reconnect()?;
        }
        self.have_started()?;
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

/// Whether VAST moves, by its answer to `busy`. `None` if VAST is not started.
pub(super) fn moves(answer: &str) -> Result<Option<bool>, DeviceError> {
    if answer.is_empty() {
        return Ok(None);
    }
    let busy: Option<i64> = answer.trim().parse().ok();
    let expected = || "a number in answer to \"busy\"".into();
    busy.map(|busy| Some(busy != 0)).ok_or_else(|| DeviceError::Unexpected { device: DEVICE, expected: expected(), found: answer.into() })
}

fn not_started() -> DeviceError {
    DeviceError::VastProgram {
        device: DEVICE,
        what: "VAST is not started: the answer to \"busy\" is empty".into(),
        way_out: "Press the launch button of VastNavigateServer on VAST's computer, and wait until VAST's own window is open",
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

    /// After a stop nothing is sent. Only the connection is checked then.
    fn check(&mut self) -> Result<(), DeviceError> {
        if self.link.is_stopped() {
            return self.link.still_there();
        }
        if self.broken {
            self.reconnect()?;
        }
        self.is_busy().map(|_busy| ())
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        let link = stopper.link();
        StopHandle::new(move || stopper.stop()).with_link(link)
    }
}
