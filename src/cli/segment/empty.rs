//! `--reference`: the empty-capillary picture, read once and compared with every picture.

use super::input::{self, Input, Kind};
use anyhow::Context;
use carved_core::frame::PixelFormat;
use carved_core::profile::{EmptyCapillary, Picture, SegmentSettings};
use std::path::Path;

pub(super) struct Empty {
    pub reference: EmptyCapillary,
    /// SHA-256 of the file.
    pub sha256: String,
    kind: Kind,
}

/// A picture whose format differs from that of the empty-capillary picture.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("the picture is {found}, --reference {expected}: take the empty capillary with the same camera settings")]
pub(super) struct OtherKind {
    found: Kind,
    expected: Kind,
}

impl Empty {
    pub fn read(file: &Path, settings: &SegmentSettings, mosaic: Option<PixelFormat>) -> anyhow::Result<Self> {
        let name = || format!("--reference {}", file.display());
        let input = input::read(file, mosaic).with_context(name)?;
        let reference = EmptyCapillary::new(Picture::from_frame(&input.frame), &settings.walls).with_context(name)?;
        Ok(Self { reference, sha256: input.sha256.clone(), kind: input.kind() })
    }

    pub fn check_kind_of(&self, input: &Input) -> Result<(), OtherKind> {
        let found = input.kind();
        if found == self.kind { Ok(()) } else { Err(OtherKind { found, expected: self.kind }) }
    }
}
