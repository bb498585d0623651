//! Files of PNG and PGM that hold several pictures, of which the decoders read the first one.

use super::DecodeError;
use image::ImageFormat;

const PNG_SIGNATURE: usize = 8;

/// Refuses an animated PNG, and a PGM or PPM with further pictures behind the first one.
pub(super) fn check(bytes: &[u8], format: ImageFormat) -> Result<(), DecodeError> {
    let several = match format {
        ImageFormat::Png => frames_of_png(bytes).filter(|frames| *frames > 1).map(|frames| format!("an animated PNG of {frames} pictures")),
        ImageFormat::Pnm => has_another_pnm(bytes).then(|| "a PGM or PPM file with several pictures".to_owned()),
        _ => None,
    };
    several.map_or(Ok(()), |what| Err(DecodeError::Several { what }))
}

/// The number of pictures that an animated PNG says before its pixels.
fn frames_of_png(bytes: &[u8]) -> Option<u32> {
    let number = |at: usize| Some(u32::from_be_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?));
    let mut at = PNG_SIGNATURE;
    loop {
        let (length, name) = (number(at)?, bytes.get(at.checked_add(4)?..at.checked_add(8)?)?);
        match name {
            b"acTL" => return number(at + 8),
            b"IDAT" | b"IEND" => return None,
            _ => at = at.checked_add(usize::try_from(length).ok()?)?.checked_add(12)?,
        }
    }
}

/// Whether the bytes behind the pixels of a binary PGM, PPM or PAM begin as another one.
fn has_another_pnm(bytes: &[u8]) -> bool {
    let magic = bytes.get(..2).unwrap_or_default();
    let header = match magic {
        b"P5" => header_of_pgm(bytes, 1),
        b"P6" => header_of_pgm(bytes, 3),
        b"P7" => header_of_pam(bytes),
        _ => None,
    };
    let behind = header.and_then(|(length, pixels)| bytes.get(length.checked_add(usize::try_from(pixels).ok()?)?..));
    behind.is_some_and(|behind| behind.trim_ascii_start().starts_with(magic))
}

/// Bytes of the header, and of the pixels, whose numbers go up to `most`.
fn lengths(header: usize, [width, height, most]: [u64; 3], channels: u64) -> (usize, u64) {
    (header, width.saturating_mul(height).saturating_mul(channels).saturating_mul(if most > 255 { 2 } else { 1 }))
}

/// Width, height and largest value behind the magic number, and one space.
fn header_of_pgm(bytes: &[u8], channels: u64) -> Option<(usize, u64)> {
    let (mut at, mut numbers) = (2, [0_u64; 3]);
    for number in &mut numbers {
        while let Some(&byte) = bytes.get(at).filter(|byte| **byte == b'#' || byte.is_ascii_whitespace()) {
            at += if byte == b'#' { bytes.get(at..)?.iter().position(|byte| *byte == b'\n')? } else { 1 };
        }
        while let Some(digit) = bytes.get(at).filter(|byte| byte.is_ascii_digit()) {
            *number = number.saturating_mul(10).saturating_add(u64::from(digit - b'0'));
            at += 1;
        }
    }
    Some(lengths(at + 1, numbers, channels))
}

/// Lines of a name and a value, the last of which is `ENDHDR`.
fn header_of_pam(bytes: &[u8]) -> Option<(usize, u64)> {
    const END: &[u8] = b"ENDHDR\n";
    let length = bytes.windows(END.len()).position(|window| window == END)? + END.len();
    let text = std::str::from_utf8(bytes.get(..length)?).ok()?;
    let number = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<u64>().ok());
    Some(lengths(length, [number("WIDTH")?, number("HEIGHT")?, number("MAXVAL")?], number("DEPTH")?))
}
