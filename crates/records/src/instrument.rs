//! Which instrument a record comes from.

use serde::{Deserialize, Serialize};

/// Identity of an instrument. Files of versions that did not write it do not have it.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema, utoipa::ToSchema))]
pub struct InstrumentIdentity {
    /// `[rig] name` of the configuration.
    pub name: String,
    /// `[rig] serial` of the configuration. `null` if it is not configured.
    pub serial: Option<String>,
    /// `[rig] location` of the configuration. `null` if it is not configured.
    pub location: Option<String>,
    /// Made once per data folder. It stays the same when the other fields change.
    pub uuid: String,
}
