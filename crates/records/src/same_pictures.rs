//! Whether two wells have the same picture. Imported and live runs ask in the same way.

use crate::{Ledger, LedgerEntry};
use std::collections::BTreeMap;

/// The pictures of the wells of a run, by the SHA-256 of their pixels. No camera takes the same noise twice.
#[derive(Debug, Clone, Default)]
pub struct PicturesOfWells {
    first: BTreeMap<String, String>,
}

impl PicturesOfWells {
    /// Takes a picture of a well. Returns the well that has it already, if it is another one.
    pub fn take(&mut self, entry: &LedgerEntry, well: &str) -> Option<SamePictures> {
        let earlier = self.first.entry(entry.sha256.clone()).or_insert_with(|| well.to_owned());
        (earlier != well).then(|| SamePictures { earlier: earlier.clone(), well: well.to_owned() })
    }

    /// Takes all pictures of a well that count. Returns the last other well that has one of them.
    pub fn take_all(&mut self, ledger: &Ledger, well: &str) -> Option<SamePictures> {
        ledger.counted().filter_map(|entry| self.take(entry, well)).last()
    }
}

/// Two wells with a picture in common. Nothing says which of them it shows.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("wells {earlier} and {well} have the same pictures")]
pub struct SamePictures {
    /// The well that was taken first.
    pub earlier: String,
    /// The other one.
    pub well: String,
}
