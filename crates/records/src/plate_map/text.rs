//! Decodes a text file: UTF-8 with or without a byte-order mark, with any line endings.

use super::Mistake;

/// The text with `\n` as its only line ending.
pub fn decode(bytes: &[u8]) -> Result<String, Mistake> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(Mistake::in_line(1, "", "this is UTF-16 (\"Unicode Text\" in Excel); save it as \"CSV UTF-8\""));
    }
    if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(&[0xd0, 0xcf, 0x11, 0xe0]) {
        return Err(Mistake::in_line(1, "", "this is a workbook as Excel keeps it; save its sheet as \"CSV UTF-8\""));
    }
    if bytes.contains(&0) {
        return Err(Mistake::in_line(1, "", "this is a picture or another file that is no text; choose the CSV file of the plate map"));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|why| {
        let before = &bytes[..why.valid_up_to()];
        let found = bytes.get(why.valid_up_to()).copied().unwrap_or_default();
        let detail = format!("the byte 0x{found:02x} is no UTF-8 (in older files from Excel an accent or a µ); save it as \"CSV UTF-8\"");
        Mistake::in_line(line_of(before), "", detail)
    })?;
    Ok(text.replace("\r\n", "\n").replace('\r', "\n"))
}

/// Number of the line that follows this text, from 1.
fn line_of(before: &[u8]) -> u64 {
    let ends = before.iter().enumerate().filter(|&(i, &b)| b == b'\n' || b == b'\r' && before.get(i + 1) != Some(&b'\n'));
    1 + ends.count() as u64
}
