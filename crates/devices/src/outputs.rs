//! Digital outputs of the controller that turns the capillary: a light, a valve.
//!
//! ```text
//!              switch(on) ── confirmed ──► On ── switch(off) ── confirmed ──► Off
//!   Unknown ──┤                                                                │
//!      ▲       └─ refused, or no answer ──► Unknown, with the reason           │
//!      └────────── reset, restart, unplug, alarm, doubt about the position ────┘
//! ```
//! A state is what the controller has confirmed. [`views_on`] switches the outputs of the views on before the first frame, and
//! [`views_off`] switches them off after the last one. Outputs are switched also while a stop is latched, because nothing moves.

use crate::cancel::CancelToken;
use crate::{DeviceError, RotationAxis};
use carved_core::range::{OutOfRange, Ranged};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// When an output is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum OutputUse {
    /// On from before the frame on which a specimen is detected until after the last frame of its turn. Also on for each frame of
    /// `carved camera` and of the check of a plan. Off at any other time.
    Views,
    /// Only by command. carved does not switch it by itself.
    Manual,
}

/// The outputs of this controller, one table each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(
    feature = "schema",
    schemars(
        bound = "P: schemars::JsonSchema, OutputSettings<P>: carved_core::range::Ranged",
        transform = carved_core::range::in_schema::<OutputSettings<P>>
    )
)]
#[serde(deny_unknown_fields)]
pub struct OutputSettings<P> {
    /// The output of the controller.
    pub pin: P,
    /// When it is on.
    pub on: OutputUse,
    /// Time from the switching to the first frame, ms: a lamp needs it to become steady.
    #[serde(default)]
    pub settle_ms: u32,
}

/// Longest time that a lamp is given to become steady, ms.
pub(crate) const SETTLE_MOST_MS: f64 = 60_000.0;

/// The outputs of a driver by name.
pub type OutputTable<P> = BTreeMap<String, OutputSettings<P>>;

/// What the controller has confirmed of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputState {
    /// It was switched on.
    On,
    /// It was switched off.
    Off,
    /// It was not switched since the controller was started, reset or lost, or the last switching failed.
    Unknown,
}

/// An output and what is known of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputStatus {
    /// Its name in the configuration.
    pub name: String,
    /// When it is on.
    pub on: OutputUse,
    /// Time from the switching to the first frame.
    pub settle: Duration,
    /// What the controller has confirmed.
    pub state: OutputState,
    /// Why the last switching failed; `None` if it did not.
    pub trouble: Option<String>,
}

/// The outputs of a controller.
pub trait Outputs {
    /// Every configured output. Nothing is asked of the controller.
    fn statuses(&self) -> Vec<OutputStatus>;
    /// Switches an output and returns once the controller has confirmed it, also while a stop is latched.
    ///
    /// # Errors
    /// [`DeviceError::Output`] if the controller refuses or reports another state, and the controller's fault. The state is then unknown.
    fn switch(&mut self, name: &str, on: bool) -> Result<(), DeviceError>;
}

/// The outputs of a table, none of which was switched yet.
pub fn unknown<P>(table: &OutputTable<P>) -> Vec<OutputStatus> {
    let status = |(name, output): (&String, &OutputSettings<P>)| OutputStatus {
        name: name.clone(),
        on: output.on,
        settle: Duration::from_millis(output.settle_ms.into()),
        state: OutputState::Unknown,
        trouble: None,
    };
    table.iter().map(status).collect()
}

/// Switches the outputs of the views on, and waits until the slowest of them is steady. Without such outputs it does nothing.
///
/// # Errors
/// The first output that was not switched on, or [`DeviceError::Stopped`] if `cancel` was cancelled. Outputs that are on stay on.
pub fn views_on(rotation: &mut dyn RotationAxis, cancel: &CancelToken) -> Result<(), DeviceError> {
    let Some(outputs) = rotation.outputs() else { return Ok(()) };
    let mut settle = Duration::ZERO;
    for output in of_views(outputs) {
        if cancel.is_cancelled() {
            return Err(DeviceError::Stopped);
        }
        outputs.switch(&output.name, true)?;
        settle = settle.max(output.settle);
    }
    if cancel.rest(settle) { Err(DeviceError::Stopped) } else { Ok(()) }
}

/// Switches the outputs of the views off that are not known to be off. A failure is logged and stays in the status of its output.
pub fn views_off(rotation: &mut dyn RotationAxis) {
    let Some(outputs) = rotation.outputs() else { return };
    for output in of_views(outputs).into_iter().filter(|output| output.state != OutputState::Off) {
        if let Err(error) = outputs.switch(&output.name, false)
            && output.trouble.is_none()
        {
            tracing::warn!(%error, output = output.name, "an output was not switched off");
        }
    }
}

fn of_views(outputs: &dyn Outputs) -> Vec<OutputStatus> {
    outputs.statuses().into_iter().filter(|output| output.on == OutputUse::Views).collect()
}

/// Checks the names and pins of a table.
///
/// # Errors
/// A name with other characters than lower-case letters, digits and `_`, or two outputs at one pin.
pub(crate) fn check<P: Copy + Ord + Serialize>(device: &'static str, table: &OutputTable<P>) -> Result<(), DeviceError> {
    let bad = |name: String, found: String, rule: &str| Err(DeviceError::Setting { device, name, found, rule: rule.into() });
    let mut taken = BTreeSet::new();
    for (name, output) in table {
        let is_plain = !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
        if !is_plain {
            return bad("outputs".into(), format!("{name:?}"), "a name has lower-case letters, digits and _");
        }
        if !taken.insert(output.pin) {
            let pin = serde_json::to_string(&output.pin).unwrap_or_default();
            return bad(format!("outputs.{name}.pin"), pin, "another output has this pin; each pin switches one thing");
        }
    }
    Ok(())
}

/// Numbers of a table that are out of range.
pub(crate) fn outside<P>(table: &OutputTable<P>) -> Vec<OutOfRange>
where
    OutputSettings<P>: Ranged,
{
    let of = |(name, output): (&String, &OutputSettings<P>)| {
        output.outside().into_iter().map(|breach| breach.below(name).below("outputs")).collect::<Vec<_>>()
    };
    table.iter().flat_map(of).collect()
}

/// The outputs of a driver with what is known of them.
pub(crate) struct Bank<P> {
    outputs: Vec<(P, OutputStatus)>,
    /// Names of the outputs that were switched on, confirmed or not, and not confirmed as off since.
    may_be_on: BTreeSet<String>,
}

impl<P: Copy + PartialEq> Bank<P> {
    pub fn new(table: &OutputTable<P>) -> Self {
        Self { outputs: table.values().map(|output| output.pin).zip(unknown(table)).collect(), may_be_on: BTreeSet::new() }
    }

    pub fn is_empty(&self) -> bool {
        self.outputs.is_empty()
    }

    pub fn statuses(&self) -> Vec<OutputStatus> {
        self.outputs.iter().map(|(_, status)| status.clone()).collect()
    }

    /// Whether the output at a pin was confirmed as on.
    pub fn is_on(&self, pin: P) -> bool {
        self.outputs.iter().any(|(at, status)| *at == pin && status.state == OutputState::On)
    }

    /// The pins of the outputs that were confirmed as on.
    pub fn pins_on(&self) -> Vec<P> {
        self.outputs.iter().filter(|(_, status)| status.state == OutputState::On).map(|(pin, _)| *pin).collect()
    }

    /// Outputs of the views that may be on.
    pub fn left_on(&self) -> Vec<String> {
        let left = |status: &OutputStatus| status.on == OutputUse::Views && self.may_be_on.contains(&status.name);
        self.outputs.iter().filter(|(_, status)| left(status)).map(|(_, status)| status.name.clone()).collect()
    }

    /// The controller may have switched everything off.
    pub fn forget(&mut self) {
        self.outputs.iter_mut().for_each(|(_, status)| status.state = OutputState::Unknown);
    }

    /// The pin of an output.
    ///
    /// # Errors
    /// There is no output of this name.
    pub fn pin(&self, device: &'static str, name: &str) -> Result<P, DeviceError> {
        let found = self.outputs.iter().find(|(_, status)| status.name == name).map(|(pin, _)| *pin);
        found.ok_or_else(|| {
            let names: Vec<&str> = self.outputs.iter().map(|(_, status)| status.name.as_str()).collect();
            let rule = format!("the configuration has these outputs: {}", names.join(", "));
            DeviceError::Setting { device, name: "outputs".into(), found: format!("{name:?}"), rule }
        })
    }

    /// Notes how a switching ended. A refusal becomes [`DeviceError::Output`].
    pub fn note(&mut self, device: &'static str, name: &str, on: bool, switched: Result<(), DeviceError>) -> Result<(), DeviceError> {
        let switched = switched.map_err(|error| match error {
            DeviceError::Unexpected { expected, found, .. } => {
                DeviceError::Output { device, name: name.into(), on, why: format!("expected {expected}, got {found}") }
            }
            other => other,
        });
        if on {
            self.may_be_on.insert(name.to_owned());
        } else if switched.is_ok() {
            self.may_be_on.remove(name);
        }
        for (_, status) in self.outputs.iter_mut().filter(|(_, status)| status.name == name) {
            status.state = match (&switched, on) {
                (Ok(()), true) => OutputState::On,
                (Ok(()), false) => OutputState::Off,
                (Err(_), _) => OutputState::Unknown,
            };
            status.trouble = switched.as_ref().err().map(ToString::to_string);
        }
        switched
    }
}
