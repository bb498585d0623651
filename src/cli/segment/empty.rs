//! `--reference`: the picture of the empty capillary, read once and held beside every picture.

use super::input::{self, Input, Kind};
use anyhow::Context;
use carved_core::profile::{EmptyCapillary, Picture, SegmentSettings};
use std::path::Path;

pub(super) struct Empty {
    pub reference: EmptyCapillary,
    /// Of the file's bytes.
    pub sha256: String,
    kind: Kind,
}

/// A picture that is not as the empty capillary's is.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("the picture is {found}, --reference {expected}: take the empty capillary with the same camera settings")]
pub(super) struct OtherKind {
    found: Kind,
    expected: Kind,
}

impl Empty {
    pub fn read(file: &Path, settings: &SegmentSettings, bayer: bool) -> anyhow::Result<Self> {
        let name = || format!("--reference {}", file.display());
        let input = input::read(file, bayer).with_context(name)?;
        let reference = EmptyCapillary::new(Picture::from_frame(&input.frame), &settings.walls).with_context(name)?;
        Ok(Self { reference, sha256: input.sha256.clone(), kind: input.kind() })
    }

    pub fn is_of_the_kind_of(&self, input: &Input) -> Result<(), OtherKind> {
        let found = input.kind();
        if found == self.kind { Ok(()) } else { Err(OtherKind { found, expected: self.kind }) }
    }
}
