//! Whether the codes of a piece of a TIFF give what they must.
//!
//! ```text
//!  Deflate     its check sum (Adler-32), and the number of bytes
//!  LZW         the number of bytes up to the code for the end
//!  PackBits    the number of bytes
//! ```
//! A wrong bit in LZW or `PackBits` that leaves the number of bytes as it is, and any in pixels without compression, cannot be known.

use std::io::{Read, sink};

/// `Compression`: none.
pub(super) const NONE: u32 = 1;
const LZW: u32 = 5;
const DEFLATE: u32 = 8;
const PACK_BITS: u32 = 32_773;
const OLD_DEFLATE: u32 = 32_946;

/// Codes of LZW as TIFF has them begin with this byte or are of another kind, which is refused elsewhere.
const LZW_CLEAR: u8 = 0x80;

/// Checks the codes of a piece against the bytes that it may have.
///
/// # Errors
/// What is wrong, in words.
pub(super) fn check(coding: u32, piece: &[u8], expected: [u64; 2]) -> Result<(), String> {
    let most = expected[0].max(expected[1]);
    let found = match coding {
        DEFLATE | OLD_DEFLATE => {
            // More than a piece has is not read.
            let decoder = flate2::read::ZlibDecoder::new(piece);
            std::io::copy(&mut decoder.take(most + 1), &mut sink()).map_err(|_| "its check sum or its codes are wrong".to_owned())?
        }
        LZW if piece.first() == Some(&LZW_CLEAR) => lzw(piece, most)?,
        PACK_BITS => pack_bits(piece),
        _ => return Ok(()),
    };
    if expected.contains(&found) {
        return Ok(());
    }
    let found = if found > most { format!("more than {most}") } else { found.to_string() };
    Err(format!("its codes give {found} bytes, expected {}", expected[0]))
}

/// The number of bytes before the code for the end, or before the end of the piece: some programs write no such code.
fn lzw(piece: &[u8], most: u64) -> Result<u64, String> {
    let mut decoder = weezl::decode::Decoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8);
    let (mut rest, mut found, mut out) = (piece, 0, vec![0; 1 << 16]);
    loop {
        let step = decoder.decode_bytes(rest, &mut out);
        rest = rest.get(step.consumed_in..).unwrap_or_default();
        found += step.consumed_out as u64;
        match step.status {
            Ok(weezl::LzwStatus::Done | weezl::LzwStatus::NoProgress) => return Ok(found),
            Ok(weezl::LzwStatus::Ok) if found > most => return Ok(found),
            Ok(weezl::LzwStatus::Ok) => {}
            Err(_) => return Err("its codes are wrong".into()),
        }
    }
}

/// The number of bytes that the runs of a piece give.
fn pack_bits(piece: &[u8]) -> u64 {
    let (mut at, mut found) = (0, 0);
    while let Some(&head) = piece.get(at) {
        let (taken, given) = match head {
            0..=127 => (2 + usize::from(head), 1 + u64::from(head)),
            128 => (1, 0),
            129.. => (2, 257 - u64::from(head)),
        };
        // A run that the piece does not have to its end.
        found += if at + taken <= piece.len() { given } else { 0 };
        at += taken;
    }
    found
}
