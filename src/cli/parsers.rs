//! The parsers of the commands' files, for tests that feed them bytes of any kind.

use super::{import, reconstruct, segment};

/// The lists of angles that `carved import --angles` reads.
pub fn angles(bytes: &[u8]) -> anyhow::Result<()> {
    let pictures: Vec<String> = (0..4).map(|n| format!("v{n}.png")).collect();
    import::angles::parse(std::str::from_utf8(bytes)?, &pictures, None).map(|_| ())
}

/// The cameras that `carved reconstruct --cameras` reads.
pub fn cameras(bytes: &[u8]) -> anyhow::Result<()> {
    reconstruct::cameras::parse(std::str::from_utf8(bytes)?).map(|_| ())
}

/// The shapes of FishInspector.
pub fn shapes(bytes: &[u8]) -> anyhow::Result<()> {
    segment::shapes::read(bytes, [40, 20])?;
    Ok(())
}

/// Pictures at the door of `carved import` and `carved segment`.
pub fn picture(bytes: &[u8]) -> anyhow::Result<()> {
    segment::input::decode(bytes, false).map(|_| ())
}
