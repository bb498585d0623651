//! What a setting may be, and how it is said when it is something else.

use std::ops::RangeInclusive;

/// A setting beside its range, with the way out.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{key} = {found}; expected {least} to {most} {unit}")]
pub struct OutOfRange {
    /// The setting's name below the table that was checked.
    pub key: &'static str,
    pub found: f64,
    pub least: f64,
    pub most: f64,
    pub unit: &'static str,
}

/// One setting: its key, its value, what that may be, and the unit of both.
pub type Setting = (&'static str, f64, RangeInclusive<f64>, &'static str);

/// Those settings that are not within their range; what is no number is in none.
pub fn outside(settings: impl IntoIterator<Item = Setting>) -> Vec<OutOfRange> {
    settings
        .into_iter()
        .filter(|(_, found, range, _)| !range.contains(found))
        .map(|(key, found, range, unit)| OutOfRange { key, found, least: *range.start(), most: *range.end(), unit })
        .collect()
}
