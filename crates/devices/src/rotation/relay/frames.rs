//! Frames of the relay: a length of four bytes, little endian, and that number of ASCII characters. It may be 0.
//!
//! An answer that begins with `err` comes from the relay itself: it cannot ask VAST, and says what a person does.
//!
//! An answer does not name its request. So no bytes may be left over when a request is sent. After any failure the connection must
//! be replaced, because a late answer on it would count for another request.

use super::DEVICE;
use crate::DeviceError;
use crate::rotation::link::Link;
use std::time::{Duration, Instant};

/// The longest answer is a folder's name.
const LONGEST: u32 = 512;

/// Sends a request and waits for its answer.
pub(super) fn ask(link: &mut Link, request: &str, wait: Duration) -> Result<String, DeviceError> {
    if !link.is_silent()? {
        return Err(unexpected(format!("silence before {request:?}"), "an answer to nothing".into()));
    }
    let mut frame = (request.len() as u32).to_le_bytes().to_vec();
    frame.extend_from_slice(request.as_bytes());
    link.send(&frame)?;
    let until = Instant::now() + wait;
    let head = link.exact(until)?.ok_or_else(|| link.silent(request, wait.as_millis()))?;
    let length = length(head, request)?;
    let bytes = link.bytes(length, until)?.ok_or_else(|| link.silent(request, wait.as_millis()))?;
    text(&bytes, request)
}

fn unexpected(expected: String, found: String) -> DeviceError {
    DeviceError::Unexpected { device: DEVICE, expected, found }
}

/// The length of an answer, from its first bytes.
pub(in crate::rotation) fn length(head: [u8; 4], request: &str) -> Result<usize, DeviceError> {
    let length = u32::from_le_bytes(head);
    if length > LONGEST {
        return Err(unexpected(format!("an answer of at most {LONGEST} bytes to {request:?}"), format!("one of {length} bytes")));
    }
    Ok(length as usize)
}

/// The text of an answer.
pub(in crate::rotation) fn text(bytes: &[u8], request: &str) -> Result<String, DeviceError> {
    if !bytes.iter().all(|b| *b == b' ' || b.is_ascii_graphic()) {
        return Err(unexpected(format!("an answer in ASCII to {request:?}"), bytes.escape_ascii().to_string()));
    }
    let text: String = bytes.iter().copied().map(char::from).collect();
    if text.to_ascii_lowercase().starts_with("err") {
        let what = format!("the relay on VAST's computer answers {text:?} to {request:?}");
        return Err(DeviceError::VastProgram { device: DEVICE, what, way_out: "Do there what it says" });
    }
    Ok(text)
}
