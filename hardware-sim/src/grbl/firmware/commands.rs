//! The `$` commands, as they are written.
//!
//! ```text
//!   any time:                 $   $G   $X   $J=   $C (to leave the check mode)
//!   in Idle and Alarm only:   $$  $#  $I  $N  $C  $SLP  $H  $HX  $HY  $x=val
//! ```

use super::homing::HomingAxes;
use crate::grbl::words;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Command<'a> {
    Help,
    Modes,
    Unlock,
    Home(HomingAxes),
    /// Enters the check mode, or leaves it.
    Check,
    /// The line after `$J=`.
    Jog(&'a [u8]),
    Settings,
    Offsets,
    Version,
    StartupLines,
    Sleep,
    /// Anything else must be a setting. [`setting`] reads it.
    Setting(&'a [u8]),
}

impl<'a> Command<'a> {
    /// Reads a command from the line after its `$`.
    pub fn read(line: &'a [u8]) -> Self {
        match line {
            [] => Self::Help,
            b"G" => Self::Modes,
            b"X" => Self::Unlock,
            b"H" => Self::Home(HomingAxes::All),
            b"HX" => Self::Home(HomingAxes::Shaft),
            b"HY" => Self::Home(HomingAxes::Slide),
            b"C" => Self::Check,
            [b'J', b'=', line @ ..] => Self::Jog(line),
            b"$" => Self::Settings,
            b"#" => Self::Offsets,
            b"I" => Self::Version,
            b"N" => Self::StartupLines,
            b"SLP" => Self::Sleep,
            setting => Self::Setting(setting),
        }
    }
}

/// Number and value of `x=val`. The error is Grbl's number.
pub(super) fn setting(text: &[u8]) -> Result<(u16, f32), u8> {
    let (number, used) = words::number(text).ok_or(3)?;
    let [b'=', value @ ..] = &text[used..] else { return Err(3) };
    let (value, used) = words::number(value).filter(|(_, n)| *n == value.len()).ok_or(2)?;
    if used == 0 || number.fract() != 0.0 || !(0.0..=255.0).contains(&number) {
        return Err(3);
    }
    Ok((number as u16, value))
}
