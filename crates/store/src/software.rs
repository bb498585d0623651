//! Which program wrote a file.

use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// The commit where none is known.
pub const UNKNOWN: &str = "unknown";

/// The sources that this program was built from. `None` until [`Software::built_from`] was called.
static BUILD: OnceLock<(String, Option<bool>)> = OnceLock::new();

/// Which program wrote a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Software {
    pub name: String,
    pub version: String,
    /// The commit of the sources that the program was built from. `unknown` where neither a checkout nor `CARVED_COMMIT` named it, and
    /// in files of builds that did not write it.
    #[serde(default = "unknown")]
    pub commit: String,
    /// Whether the sources differed from the commit. `None` where this is not known.
    #[serde(default)]
    pub dirty: Option<bool>,
}

fn unknown() -> String {
    UNKNOWN.to_owned()
}

impl Software {
    /// This program.
    pub fn this() -> Self {
        let (commit, dirty) = BUILD.get().cloned().unwrap_or_else(|| (unknown(), None));
        Self { name: "carved".into(), version: env!("CARGO_PKG_VERSION").into(), commit, dirty }
    }

    /// States the sources of this program, before it writes the first file. The build script of the program knows them, and this crate
    /// must not be compiled again for each commit. Only the first call counts.
    pub fn built_from(commit: &str, dirty: Option<bool>) {
        let _already_known = BUILD.set((commit.to_owned(), dirty));
    }

    /// Version and commit, as a person reads them: `0.1.0 (commit 3f2a91c04b1e)`.
    pub fn words(&self) -> String {
        let short = self.commit.get(..12).unwrap_or(&self.commit);
        match self.dirty {
            _ if self.commit == UNKNOWN => format!("{} (commit unknown)", self.version),
            Some(true) => format!("{} (commit {short}, with changes that were not committed)", self.version),
            _ => format!("{} (commit {short})", self.version),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_earlier_builds_have_an_unknown_commit() {
        let old: Software = serde_json::from_str(r#"{"name": "carved", "version": "0.1.0"}"#).unwrap();
        assert_eq!((old.commit.as_str(), old.dirty), (UNKNOWN, None));
        assert_eq!(old.words(), "0.1.0 (commit unknown)");
        let text = r#"{"name":"carved","version":"0.2.0","commit":"3f2a91c04b1e7788","dirty":true}"#;
        let new: Software = serde_json::from_str(text).unwrap();
        assert_eq!(new.words(), "0.2.0 (commit 3f2a91c04b1e, with changes that were not committed)");
        assert_eq!(serde_json::to_string(&new).unwrap(), text);
        assert_eq!(Software { dirty: Some(false), ..new }.words(), "0.2.0 (commit 3f2a91c04b1e)");
    }
}
