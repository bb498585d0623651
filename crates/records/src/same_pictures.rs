//! Whether two wells have the same picture. Imported and live runs ask in the same way.
//!
//! ```text
//!  SHA-256 of the pixels ───────────────── stored as it is
//!  the outline of a larva in each view ─── stored in another format, or with more noise
//! ```

use crate::{Ledger, LedgerEntry};
use carved_core::pipeline::ViewRecord;
use carved_core::quality::CoarseOutline;
use std::collections::BTreeMap;

/// The pictures of the wells of a run: the SHA-256 of their pixels, and the outlines of larvae in them. No camera takes the same noise twice, and no
/// larva comes to the same place twice.
#[derive(Debug, Clone, Default)]
pub struct PicturesOfWells {
    first: BTreeMap<String, String>,
    outlines: BTreeMap<String, Vec<CoarseOutline>>,
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

    /// Takes the outlines in the views of a well that was measured, instead of those that it had. Returns the first other well with which it has
    /// pictures in common, in whatever format: as many as [`Self::COMMON`], or all of its outlines.
    pub fn take_outlines(&mut self, views: &[ViewRecord], well: &str) -> Option<SamePictures> {
        let own: Vec<CoarseOutline> = views.iter().filter_map(|view| view.outline.clone()).collect();
        let is_common = |others: &[CoarseOutline]| {
            let common = own.iter().filter(|outline| others.iter().any(|other| outline.is_same(other))).count();
            common > 0 && common >= Self::COMMON.min(own.len()).min(others.len())
        };
        let earlier = self.outlines.iter().find(|(name, others)| *name != well && is_common(others)).map(|(name, _)| name.clone());
        self.outlines.insert(well.to_owned(), own);
        earlier.map(|earlier| SamePictures { earlier, well: well.to_owned() })
    }

    /// Views of two wells that show the same outlines, from which on their pictures are the same. A single view may agree by chance.
    const COMMON: usize = 2;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The views of a larva, whose edges lie so much lower.
    fn views(lower_px: f64, views: u32) -> Vec<ViewRecord> {
        let edges_px = |view| (0..40).map(|i| [100.0, 140.0].map(|v| v + lower_px + 9.0 * f64::from(view) + f64::from(i % 7))).collect();
        let outline = |view| Some(CoarseOutline { first: 3, edges_px: edges_px(view) });
        (0..views).map(|index| ViewRecord { index, outline: outline(index), ..ViewRecord::default() }).collect()
    }

    #[test]
    fn a_larva_of_an_earlier_well_is_known_in_another_format() {
        let mut pictures = PicturesOfWells::default();
        let said = |found: Option<SamePictures>| found.map(|same| same.to_string());
        assert_eq!(said(pictures.take_outlines(&views(0.0, 5), "A01")), None);
        assert_eq!(said(pictures.take_outlines(&views(3.0, 5), "A02")), None, "another larva");
        assert_eq!(said(pictures.take_outlines(&views(0.2, 5), "A01")), None, "the well was measured again");
        assert_eq!(said(pictures.take_outlines(&views(0.3, 4), "A03")).as_deref(), Some("wells A01 and A03 have the same pictures"));
        // One view may agree by chance, and records of earlier versions have no outlines.
        let [mut few, mut none] = [views(0.3, 5), views(0.3, 5)];
        few[1..].iter_mut().zip(views(33.5, 5)).for_each(|(view, other)| view.outline = other.outline);
        for view in &mut none {
            view.outline = None;
        }
        assert_eq!((said(pictures.take_outlines(&few, "A04")), said(pictures.take_outlines(&none, "A05"))), (None, None));
        assert_eq!(said(pictures.take_outlines(&none, "A06")), None);
    }
}
