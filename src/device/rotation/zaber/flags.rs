//! Warning flags: what a controller knows to be wrong, as errors.

use super::DEVICE;
use crate::device::DeviceError;
use crate::device::rotation::Reference;

/// The axis did not follow and was stopped.
pub(super) const STALLED: &str = "FS";

/// What a flag says of an axis that was referenced as `reference` says; flags that do not touch the position pass.
pub(super) fn judge(flag: &str, reference: Reference) -> Result<(), DeviceError> {
    let alarm = |meaning| Err(DeviceError::Alarm { device: DEVICE, what: format!("{flag} ({meaning})") });
    let suspect = |meaning| Err(DeviceError::Suspect { why: format!("the controller reports {flag}: {meaning}") });
    match flag {
        STALLED => alarm("the axis stalled and was stopped"),
        "FQ" => alarm("the encoder failed, or counts what no motor can do"),
        "FD" => alarm("the driver was switched off"),
        "FE" => alarm("a limit was met on the way"),
        "WM" => suspect("the axis was displaced while it stood"),
        "WR" => suspect("it has no reference any more; it was restarted"),
        // A place that was taken as it is has not been homed, and need not be.
        "WH" if reference == Reference::Home => suspect("it has not been homed since it was started"),
        "NI" => suspect("a move was interrupted by another command, or by hand"),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flag_that_touches_the_position_is_a_named_error() {
        for flag in ["FS", "FQ", "FD", "FE"] {
            assert!(matches!(judge(flag, Reference::Home), Err(DeviceError::Alarm { what, .. }) if what.starts_with(flag)));
        }
        for flag in ["WM", "WR", "WH", "NI"] {
            assert!(matches!(judge(flag, Reference::Home), Err(DeviceError::Suspect { why }) if why.contains(flag)));
        }
        for harmless in ["--", "WV", "WT", "NC", "ND"] {
            judge(harmless, Reference::Home).unwrap();
        }
        judge("WH", Reference::Here).unwrap();
    }
}
