//! The pages of a TIFF. `image` reads the first one only, be it a thumbnail.
//!
//! ```text
//!  header ── page ── thumbnail ── page ── ..     a page is read from a header that names it as the first
//! ```

use super::{DecodeError, Formats};
use image::ImageFormat;
use std::collections::HashSet;
use std::io::{BufRead, Cursor, Read, Seek, SeekFrom};
use tiff::TiffError;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

/// A turn has some hundred views. Each page is read on its own.
const MOST_PAGES: usize = 10_000;

/// What `NewSubfileType` says of a page that is none of the pictures: a smaller copy, or a mask.
const REDUCED_OR_MASK: u32 = 0b101;
/// What the older `SubfileType` says of a smaller copy.
const OLD_REDUCED: u32 = 2;

/// One page.
#[derive(Debug)]
pub(super) struct Page {
    /// The header of a file whose first page it is.
    header: Vec<u8>,
    is_reduced: bool,
    /// What `image` would not read, or would read wrongly.
    unread: Option<String>,
    /// Where the pieces of its pixels begin, and their lengths.
    pieces: (Vec<u64>, Vec<u64>),
}

/// The pages of a file, without thumbnails unless there is nothing else.
pub(super) fn of(bytes: &[u8], formats: Formats) -> Result<Vec<Page>, DecodeError> {
    let of_tiff = |error| of_tiff(error, formats);
    let unreadable = |why: String| DecodeError::Unreadable { expected: formats.words, why };
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(of_tiff)?;
    let mut next = decoder.ifd_pointer();
    let (mut pages, mut seen) = (Vec::new(), HashSet::new());
    let mut said = None;
    while let Some(at) = next {
        if !seen.insert(at.0) || pages.len() == MOST_PAGES {
            return Err(unreadable(format!("its pages lead in a circle, or are more than {MOST_PAGES}")));
        }
        let directory = decoder.read_directory(at).map_err(of_tiff)?;
        next = directory.next();
        let mut tags = decoder.read_directory_tags(&directory);
        let mut number = |tag| tags.find_tag_unsigned::<u32>(tag).map_err(of_tiff);
        let kind = number(Tag::NewSubfileType)?.unwrap_or(0);
        let is_reduced = kind & REDUCED_OR_MASK != 0 || number(Tag::SubfileType)? == Some(OLD_REDUCED);
        let colours = number(Tag::PhotometricInterpretation)?;
        let samples = number(Tag::SamplesPerPixel)?.unwrap_or(1);
        let mut list = |tag| Ok::<_, DecodeError>(tags.find_tag_unsigned_vec::<u64>(tag).map_err(of_tiff)?.unwrap_or_default());
        let bits = list(Tag::BitsPerSample)?.first().copied().unwrap_or(1);
        let format = list(Tag::SampleFormat)?.first().copied().unwrap_or(1);
        let unread = match (colours, format, bits) {
            (Some(3), ..) => Some("a picture with a palette".into()),
            (Some(6), ..) => Some("a picture in YCbCr, as in TIFF with JPEG compression,".into()),
            (_, 3, _) => Some(format!("a picture of {bits} bit floating point numbers")),
            (_, 2, _) => Some("a picture of signed numbers".into()),
            (_, _, 1 | 8 | 16) => None,
            _ => Some(format!("a picture of {bits} bits per value")),
        };
        let (mut starts, mut lengths) = (list(Tag::StripOffsets)?, list(Tag::StripByteCounts)?);
        if starts.is_empty() {
            (starts, lengths) = (list(Tag::TileOffsets)?, list(Tag::TileByteCounts)?);
        }
        if said.is_none() {
            said = Some((tags.find_tag(Tag::ImageDescription).map_err(of_tiff)?.and_then(|text| text.into_string().ok()), samples));
        }
        pages.push(Page { header: header(bytes, at.0), is_reduced, unread, pieces: (starts, lengths) });
    }
    if pages.iter().any(|page| !page.is_reduced) {
        pages.retain(|page| !page.is_reduced);
    }
    if let Some((Some(text), samples)) = said {
        is_as_said(&text, samples, pages.len())?;
    }
    Ok(pages)
}

/// Fiji and OME say in the first page what the pages are. Fiji stores a large stack as one page and the rest behind it.
fn is_as_said(text: &str, samples: u32, pages: usize) -> Result<(), DecodeError> {
    let number = |begin: &str| -> Option<usize> {
        let rest = &text[text.find(begin)? + begin.len()..];
        rest[..rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len())].parse().ok()
    };
    let (images, channels) = if text.starts_with("ImageJ=") {
        (number("\nimages="), number("\nchannels=").unwrap_or(1))
    } else if text.contains("<OME") {
        (None, number("SizeC=\"").unwrap_or(1) / samples.max(1) as usize)
    } else {
        return Ok(());
    };
    if let Some(images) = images.filter(|images| *images > pages) {
        return Err(DecodeError::Kind { why: format!("a stack of {images} pictures that are stored as {pages} page(s)") });
    }
    if channels > 1 && pages > 1 {
        return Err(DecodeError::Kind { why: format!("a stack of {pages} pages that are {channels} channels of each view") });
    }
    Ok(())
}

/// The header with another first page.
fn header(bytes: &[u8], page: u64) -> Vec<u8> {
    let is_little = bytes.starts_with(b"II");
    let is_big = bytes.get(2..4).is_some_and(|magic| magic.contains(&0x2b));
    let offset = match (is_big, is_little) {
        (true, true) => page.to_le_bytes().to_vec(),
        (true, false) => page.to_be_bytes().to_vec(),
        (false, true) => (page as u32).to_le_bytes().to_vec(),
        (false, false) => (page as u32).to_be_bytes().to_vec(),
    };
    let before = if is_big { 8 } else { 4 };
    [bytes.get(..before).unwrap_or_default(), &offset].concat()
}

impl Page {
    /// Refuses what `image` reads wrongly or not at all, and pixels that lie beyond the end of the file.
    pub fn check(&self, bytes: &[u8]) -> Result<(), DecodeError> {
        if let Some(why) = &self.unread {
            return Err(DecodeError::Kind { why: why.clone() });
        }
        let ends = self.pieces.0.iter().zip(&self.pieces.1).map(|(start, length)| start.saturating_add(*length));
        let missing = ends.max().unwrap_or(0).saturating_sub(bytes.len() as u64);
        if missing > 0 {
            let why = format!("its last {missing} bytes are missing");
            return Err(DecodeError::Incomplete { format: ImageFormat::Tiff, why });
        }
        Ok(())
    }

    /// The file as if this page were its first.
    pub fn reader<'a>(&self, bytes: &'a [u8]) -> impl BufRead + Seek + 'a {
        FromPage { header: self.header.clone(), bytes, at: 0 }
    }
}

struct FromPage<'a> {
    header: Vec<u8>,
    bytes: &'a [u8],
    at: u64,
}

impl Read for FromPage<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let length = self.fill_buf()?.read(out)?;
        self.consume(length);
        Ok(length)
    }
}

impl BufRead for FromPage<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        let at = usize::try_from(self.at).unwrap_or(usize::MAX);
        Ok(self.header.get(at..).filter(|rest| !rest.is_empty()).or(self.bytes.get(at..)).unwrap_or_default())
    }

    fn consume(&mut self, length: usize) {
        self.at += length as u64;
    }
}

impl Seek for FromPage<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let mut cursor = Cursor::new(self.bytes);
        cursor.set_position(self.at);
        self.at = cursor.seek(to)?;
        Ok(self.at)
    }
}

fn of_tiff(error: TiffError, formats: Formats) -> DecodeError {
    match error {
        TiffError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            DecodeError::Incomplete { format: ImageFormat::Tiff, why: "the file ends before its directory of pages".into() }
        }
        TiffError::UnsupportedError(why) => DecodeError::Kind { why: format!("this kind of TIFF ({why})") },
        error => DecodeError::Unreadable { expected: formats.words, why: error.to_string() },
    }
}
