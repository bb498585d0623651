//! Ranges of settings, and the message about a setting that is out of its range.

use std::ops::RangeInclusive;

/// A setting that is out of its range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{key} = {found}; expected {least} to {most} {unit}")]
pub struct OutOfRange {
    /// Key of the setting, relative to the table that was checked.
    pub key: &'static str,
    /// The value that was given.
    pub found: f64,
    /// The smallest allowed value.
    pub least: f64,
    /// The largest allowed value.
    pub most: f64,
    /// Unit of the three values.
    pub unit: &'static str,
}

/// One setting: its key, its value, its range, and the unit of both.
pub type Setting = (&'static str, f64, RangeInclusive<f64>, &'static str);

/// The settings that are out of their range. A value that is not a number is in no range.
pub fn outside(settings: impl IntoIterator<Item = Setting>) -> Vec<OutOfRange> {
    settings
        .into_iter()
        .filter(|(_, found, range, _)| !range.contains(found))
        .map(|(key, found, range, unit)| OutOfRange { key, found, least: *range.start(), most: *range.end(), unit })
        .collect()
}
