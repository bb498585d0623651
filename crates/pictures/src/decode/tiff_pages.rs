//! The pages of a TIFF. `image` reads the first one only, be it a thumbnail.
//!
//! ```text
//!  header ── page ── thumbnail ── page ── ..     a page is read from a header that names it as the first
//! ```

use super::{DecodeError, Formats, coded, entropy, is_on_its_side};
use image::ImageFormat;
use image::metadata::Orientation;
use std::collections::HashSet;
use std::io::{BufRead, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use tiff::TiffError;
use tiff::decoder::Decoder;
use tiff::tags::Tag;

/// A turn has some hundred views. Each page is read on its own.
const MOST_PAGES: usize = 10_000;

/// What `NewSubfileType` says of a page that is none of the pictures: a smaller copy, or a mask.
const REDUCED_OR_MASK: u32 = 0b101;
/// What the older `SubfileType` says of a smaller copy.
const OLD_REDUCED: u32 = 2;

/// `PhotometricInterpretation`, and its value for palettes.
const PHOTOMETRIC: u16 = 262;
const PALETTE: u32 = 3;
/// `Compression` by JPEG.
const JPEG: u32 = 7;

/// Pictures that lie behind a page and that nothing tells of, at least. Fewer bytes may be anything.
const LEAST_BEHIND: usize = 2;

/// One page.
#[derive(Debug, Clone)]
pub(super) struct Page {
    /// The header of a file whose first page it is.
    header: Vec<u8>,
    is_reduced: bool,
    pub kind: Kind,
    /// Before it is turned, px.
    pub size: (u32, u32),
    pub orientation: Orientation,
    /// Where the pieces of its pixels begin, and their lengths.
    pieces: (Vec<u64>, Vec<u64>),
    /// Width and height of a piece, px.
    pub piece: (u32, u32),
    /// The pieces are JPEGs. These are the tables that they share.
    jpeg: Option<Vec<u8>>,
    /// How the pieces are coded: the tag `Compression`.
    coding: u32,
    /// Bytes of a row of a piece.
    row_bytes: u64,
    /// Bytes that its pixels lie behind those that its directory names: Fiji stores the pictures of a stack behind each other under one directory.
    shift: u64,
}

/// Who reads the pixels.
#[derive(Debug, Clone)]
pub(super) enum Kind {
    /// `image`.
    Plain,
    /// Numbers of a palette: red, green and blue of each, and where the file says that it has one.
    Palette { colours: Vec<u16>, said_at: usize },
    /// Floating point numbers.
    Float,
    /// Pieces that are JPEGs in brightness and colour difference.
    Jpegs,
    /// Nobody. It is what the words say.
    Unread(String),
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
        let (mut starts, mut lengths) = (list(Tag::StripOffsets)?, list(Tag::StripByteCounts)?);
        if starts.is_empty() {
            (starts, lengths) = (list(Tag::TileOffsets)?, list(Tag::TileByteCounts)?);
        }
        let mut first = |tag| Ok::<_, DecodeError>(list(tag)?.first().copied().and_then(|value| u32::try_from(value).ok()));
        let size = (first(Tag::ImageWidth)?.unwrap_or(0), first(Tag::ImageLength)?.unwrap_or(0));
        let strip = (size.0, first(Tag::RowsPerStrip)?.unwrap_or(size.1).min(size.1));
        let piece = (first(Tag::TileWidth)?.unwrap_or(strip.0), first(Tag::TileLength)?.unwrap_or(strip.1));
        let is_planar = first(Tag::PlanarConfiguration)? == Some(2);
        let orientation = first(Tag::Orientation)?.and_then(|value| Orientation::from_exif(u8::try_from(value).ok()?));
        let coding = first(Tag::Compression)?.unwrap_or(coded::NONE);
        let is_jpeg = coding == JPEG;
        let colours_of_palette: Vec<u16> = list(Tag::ColorMap)?.into_iter().filter_map(|value| u16::try_from(value).ok()).collect();
        let kind = match (colours, format, bits) {
            (Some(PALETTE), _, 8) if samples == 1 && colours_of_palette.len() == 3 << 8 => match place_of(bytes, at.0, PHOTOMETRIC) {
                Some(said_at) => Kind::Palette { colours: colours_of_palette, said_at },
                None => Kind::Unread("a picture with a palette".into()),
            },
            (Some(PALETTE), ..) => Kind::Unread(format!("a picture with a palette of {bits} bits")),
            (Some(6), _, 8) if is_jpeg && !is_planar => Kind::Jpegs,
            (Some(6), ..) => Kind::Unread("a picture in YCbCr without JPEG compression".into()),
            (Some(0 | 1), 3, 32 | 64) if samples == 1 => Kind::Float,
            (_, 3, _) => Kind::Unread(format!("a picture of {samples} x {bits} bit floating point numbers")),
            (_, 2, _) => Kind::Unread("a picture of signed numbers".into()),
            (_, _, 1 | 8 | 16) => Kind::Plain,
            _ => Kind::Unread(format!("a picture of {bits} bits per value")),
        };
        let tables =
            if is_jpeg { tags.find_tag(Tag::JPEGTables).map_err(of_tiff)?.map(tiff::decoder::ifd::Value::into_u8_vec) } else { None };
        let jpeg = is_jpeg.then(|| tables.transpose().map(Option::unwrap_or_default)).transpose().map_err(of_tiff)?;
        if said.is_none() {
            let text = tags.find_tag(Tag::ImageDescription).map(|text| text.and_then(|text| text.into_string().ok()));
            said = Some((text.unwrap_or_else(|_| description_not_in_utf8(bytes)), samples));
        }
        let orientation = orientation.unwrap_or(Orientation::NoTransforms);
        let row_bytes = (u64::from(piece.0) * u64::from(if is_planar { 1 } else { samples })).saturating_mul(bits).div_ceil(8);
        pages.push(Page {
            header: header(bytes, at.0),
            is_reduced,
            kind,
            size,
            orientation,
            pieces: (starts, lengths),
            piece,
            jpeg,
            coding,
            row_bytes,
            shift: 0,
        });
    }
    let is_alone = pages.len() == 1;
    if pages.iter().any(|page| !page.is_reduced) {
        pages.retain(|page| !page.is_reduced);
    }
    let (text, samples) = said.unwrap_or_default();
    let stack = text.as_deref().map(|text| Stack::parse(text, samples)).unwrap_or_default();
    if is_alone && let Some(page) = pages.pop() {
        pages = page.with_those_behind(&stack, bytes)?;
    }
    stack.check(pages.len())?;
    Ok(pages)
}

/// The description of Fiji in a file whose description has other letters than UTF-8, as a micro sign of one byte.
fn description_not_in_utf8(bytes: &[u8]) -> Option<String> {
    const BEGIN: &[u8] = b"ImageJ=";
    let at = bytes.windows(BEGIN.len()).position(|window| window == BEGIN)?;
    let text = bytes.get(at..)?.split(|byte| *byte == 0).next()?;
    Some(String::from_utf8_lossy(text).into_owned())
}

/// What Fiji, OME and tifffile say in the first page of the pictures.
#[derive(Debug, Default)]
struct Stack {
    /// Number of pictures.
    pictures: Option<usize>,
    /// Channels of each view.
    channels: usize,
}

impl Stack {
    fn parse(text: &str, samples: u32) -> Self {
        let number = |begin: &str| -> Option<usize> {
            let rest = &text[text.find(begin)? + begin.len()..];
            rest[..rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len())].parse().ok()
        };
        if text.starts_with("ImageJ=") {
            return Self { pictures: number("\nimages="), channels: number("\nchannels=").unwrap_or(1) };
        }
        if text.contains("<OME") {
            let channels = number("SizeC=\"").unwrap_or(1) / samples.max(1) as usize;
            // Its pictures may be in other files too.
            return Self { pictures: None, channels };
        }
        // tifffile says the shape of the array: `{"shape": [12, 200, 1024]}`.
        let pictures = number("{\"shape\": [").filter(|_| samples == 1 && text.matches(',').count() >= 2);
        Self { pictures, channels: 1 }
    }

    fn check(&self, pages: usize) -> Result<(), DecodeError> {
        if let Some(pictures) = self.pictures.filter(|pictures| *pictures > pages) {
            return Err(DecodeError::Stack { pictures, pages });
        }
        if self.channels > 1 && pages > 1 {
            let channels = self.channels;
            return Err(DecodeError::Kind { why: format!("a stack of {pages} pages that are {channels} channels of each view") });
        }
        Ok(())
    }
}

/// Where a page has the value of a tag with one short number.
fn place_of(bytes: &[u8], page: u64, tag: u16) -> Option<usize> {
    let is_little = bytes.starts_with(b"II");
    let short = |at: usize| {
        let pair: [u8; 2] = bytes.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if is_little { u16::from_le_bytes(pair) } else { u16::from_be_bytes(pair) })
    };
    let page = usize::try_from(page).ok()?;
    let is_big = bytes.get(2..4)?.contains(&0x2b);
    // The number of entries has 2 or 8 bytes, an entry 12 or 20, and its value stands behind tag, kind and count.
    let (number, first, entry, value) = if is_big { (if is_little { 0 } else { 6 }, 8, 20, 12) } else { (0, 2, 12, 8) };
    let entries = usize::from(short(page.checked_add(number)?)?);
    let at = (0..entries).map(|entry_at| page + first + entry * entry_at).find(|at| short(*at) == Some(tag))?;
    short(at + value).map(|_| at + value)
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
    /// This page of a file that has no other, and the pictures whose pixels lie behind its own, as many as `stack` says.
    ///
    /// # Errors
    /// It does not say how many, and further pictures lie there.
    fn with_those_behind(self, stack: &Stack, bytes: &[u8]) -> Result<Vec<Self>, DecodeError> {
        let starts = &self.pieces.0;
        let length = self.length();
        let (Some(first), Some(whole)) = (starts.iter().min().copied(), usize::try_from(length).ok().filter(|length| *length > 0)) else {
            return Ok(vec![self]);
        };
        let at = |(start, length): (&u64, &u64)| start.saturating_add(*length);
        let end = starts.iter().zip(&self.pieces.1).map(at).max().unwrap_or(0);
        let is_one_block = self.coding == coded::NONE && self.piece.0 == self.size.0 && end.saturating_sub(first) == length;
        let behind = if is_one_block { bytes.len().saturating_sub(usize::try_from(end).unwrap_or(usize::MAX)) / whole } else { 0 };
        match stack.pictures {
            Some(pictures) if (2..=MOST_PAGES.min(behind + 1)).contains(&pictures) => {
                Ok((0..pictures as u64).map(|at| Self { shift: at * length, ..self.clone() }).collect())
            }
            // A copy in another size or other data may lie there too.
            None if behind >= LEAST_BEHIND => Err(DecodeError::Stack { pictures: behind + 1, pages: 1 }),
            _ => Ok(vec![self]),
        }
    }

    /// Bytes of its pixels where its pieces are as wide as it is and not coded.
    fn length(&self) -> u64 {
        self.row_bytes.saturating_mul(u64::from(self.size.1))
    }

    /// Refuses what nobody reads, pixels that lie beyond the end of the file, and JPEGs that are not whole.
    pub fn check(&self, bytes: &[u8]) -> Result<(), DecodeError> {
        if let Kind::Unread(why) = &self.kind {
            return Err(DecodeError::Kind { why: why.clone() });
        }
        let ends = self.pieces.0.iter().zip(&self.pieces.1).map(|(start, length)| start.saturating_add(*length));
        let missing = ends.max().unwrap_or(0).saturating_sub(bytes.len() as u64);
        if missing > 0 {
            let why = format!("its last {missing} bytes are missing");
            return Err(DecodeError::Incomplete { format: ImageFormat::Tiff, why });
        }
        self.jpegs(bytes).iter().try_for_each(|jpeg| entropy::check(jpeg))
    }

    /// Its pieces as files of their own, where they are JPEGs.
    pub fn jpegs(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let Some(tables) = &self.jpeg else { return Vec::new() };
        // The tables end with the marker of an end, and the piece begins with that of a start.
        let shared = tables.len().checked_sub(2).and_then(|end| tables.get(..end)).filter(|shared| !shared.is_empty());
        let range =
            |(start, length): (&u64, &u64)| bytes.get(usize::try_from(*start).ok()?..usize::try_from(start.checked_add(*length)?).ok()?);
        let whole = |piece: &[u8]| match shared {
            Some(shared) => [shared, piece.get(2..).unwrap_or_default()].concat(),
            None => piece.to_vec(),
        };
        self.pieces.0.iter().zip(&self.pieces.1).map(|piece| whole(range(piece).unwrap_or_default())).collect()
    }

    /// Width and height, turned as its orientation tag says, px.
    pub fn turned_size(&self) -> (u32, u32) {
        let (width, height) = self.size;
        if is_on_its_side(self.orientation) { (height, width) } else { (width, height) }
    }

    /// The file as if this page were its first.
    pub fn reader<'a>(&self, bytes: &'a [u8]) -> impl BufRead + Seek + 'a {
        let first = self.pieces.0.iter().min().copied().unwrap_or(0);
        let moved = first..first.saturating_add(if self.shift > 0 { self.length() } else { 0 });
        FromPage { header: self.header.clone(), bytes, at: 0, moved, shift: self.shift }
    }

    /// Refuses pieces whose codes do not give the pixels of a piece. The decoder reads as many pixels as it needs, and looks at nothing behind them.
    pub fn check_codes(&self, bytes: &[u8]) -> Result<(), DecodeError> {
        let (rows, down) = (u64::from(self.size.1), u64::from(self.piece.1.max(1)));
        let across = u64::from(self.size.0.div_ceil(self.piece.0.max(1)).max(1));
        let of_plane = (rows.div_ceil(down) * across).max(1);
        for (at, (start, length)) in (0..).zip(self.pieces.0.iter().zip(&self.pieces.1)) {
            let range = usize::try_from(*start).ok().zip(usize::try_from(start.saturating_add(*length)).ok());
            let piece = range.and_then(|(start, end)| bytes.get(start..end)).unwrap_or_default();
            // The last strip may have the rows that are left, or all of them.
            let left = (rows - (at % of_plane / across * down).min(rows)).min(down);
            let expected = [left, down].map(|rows| self.row_bytes.saturating_mul(rows));
            coded::check(self.coding, piece, expected).map_err(|why| DecodeError::Damaged {
                piece: at + 1,
                of: self.pieces.0.len(),
                why,
            })?;
        }
        Ok(())
    }
}

struct FromPage<'a> {
    header: Vec<u8>,
    bytes: &'a [u8],
    at: u64,
    /// In place of these bytes those are read that lie so many bytes behind them.
    moved: Range<u64>,
    shift: u64,
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
        let place = |at: u64| usize::try_from(at).unwrap_or(usize::MAX).min(self.bytes.len());
        let Range { start, end } = self.moved;
        let [from, to] = if self.moved.contains(&self.at) {
            [self.at.saturating_add(self.shift), end.saturating_add(self.shift)]
        } else {
            [self.at, if self.at < start && start < end { start } else { u64::MAX }]
        };
        let header = usize::try_from(self.at).ok().and_then(|at| self.header.get(at..)).filter(|rest| !rest.is_empty());
        Ok(header.or(self.bytes.get(place(from)..place(to))).unwrap_or_default())
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

pub(super) fn of_tiff(error: TiffError, formats: Formats) -> DecodeError {
    match error {
        TiffError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            DecodeError::Incomplete { format: ImageFormat::Tiff, why: "the file ends before its directory of pages".into() }
        }
        TiffError::UnsupportedError(why) => DecodeError::Kind { why: format!("this kind of TIFF ({why})") },
        error => DecodeError::Unreadable { expected: formats.words, why: error.to_string() },
    }
}
