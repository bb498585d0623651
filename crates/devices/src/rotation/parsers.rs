//! The parsers of what controllers send, for tests that feed them bytes of any kind. Each returns what was read, as text.

use super::tmcl::frame::{BYTES, Reply, Version};
use super::{bridge, grbl, relay, zaber};

fn lines<T: std::fmt::Debug>(bytes: &[u8], parse: impl Fn(&str) -> T) -> String {
    String::from_utf8_lossy(bytes).split('\n').map(|line| format!("{:?}\n", parse(line))).collect()
}

/// Lines of Grbl and grblHAL.
pub fn grbl(bytes: &[u8]) -> String {
    lines(bytes, grbl::report::Line::parse)
}

/// Datagrams of TMCL.
pub fn tmcl(bytes: &[u8]) -> String {
    let (datagrams, _) = bytes.as_chunks::<BYTES>();
    let version = |datagram| Version::in_answer(datagram).map(Version::firmware);
    datagrams.iter().map(|datagram| format!("{:?} {:?}\n", Reply::decode(*datagram), version(*datagram))).collect()
}

/// Lines of the Zaber ASCII protocol.
pub fn zaber(bytes: &[u8]) -> String {
    lines(bytes, zaber::packet::Line::parse)
}

/// Lines of the VAST trigger bridge.
pub fn bridge(bytes: &[u8]) -> String {
    lines(bytes, bridge::message::of)
}

/// Answers of the VAST relay, one after the other.
pub fn relay(mut bytes: &[u8]) -> String {
    let mut read = String::new();
    while let Some((head, rest)) = bytes.split_first_chunk()
        && let Ok(length) = relay::frames::length(*head, "busy")
        && let Some((answer, rest)) = rest.split_at_checked(length)
    {
        bytes = rest;
        let moves = relay::frames::text(answer, "busy").and_then(|text| relay::moves(&text));
        read += &format!("{moves:?}\n");
    }
    read
}
