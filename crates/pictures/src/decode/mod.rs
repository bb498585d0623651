//! The one reader of picture files.
//!
//! ```text
//!  bytes ── format ──┬─ TIFF ── pages without thumbnails ── one page ─┐
//!                    ├─ JPEG ── all its codes are there ──────────────┼─ turned as its orientation tag says ── pixels
//!                    └─ PNG, BMP, PGM ────────────────────────────────┘
//! ```
//! A picture of a foreign program can make a decoder panic or ask for all memory. Here a panic is an error of that picture, memory is
//! bounded, and a picture that is not whole is refused: a decoder fills up what is missing, and the outline of that is wrong without a sign.

mod coded;
mod entropy;
mod jpeg;
mod several;
#[cfg(test)]
mod tests;
mod tiff_kinds;
mod tiff_pages;
mod unwritten;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use std::cell::Cell;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::Once;
use tiff_pages::Page;

/// Larger files are not read into memory. A frame of the largest cameras has 150 MB.
const MOST_BYTES: u64 = 512 << 20;
/// The same of a turn in one file.
const MOST_BYTES_OF_TURN: u64 = 4 << 30;
/// A decoder may ask for so many bytes.
const MOST_ALLOCATED: u64 = 512 << 20;

/// Where the header of a PNG says what its pixels are, and what it says of a palette.
const PNG_COLOURS: usize = 25;
const PNG_PALETTE: u8 = 3;

/// The formats that a place reads.
#[derive(Debug, Clone, Copy)]
pub struct Formats {
    list: &'static [ImageFormat],
    words: &'static str,
}

/// Pictures of a camera.
pub const FRAMES: Formats = Formats {
    list: &[ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff, ImageFormat::Bmp, ImageFormat::Pnm],
    words: "PNG, JPEG, TIFF or BMP",
};
/// Silhouettes.
pub const SILHOUETTES: Formats = Formats { list: &[ImageFormat::Png, ImageFormat::Pnm], words: "PNG or PGM" };
/// What carved writes itself.
pub const PNG: Formats = Formats { list: &[ImageFormat::Png], words: "PNG" };

/// Why a file gives no picture.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The file cannot be read.
    #[error("cannot be read")]
    File(#[from] std::io::Error),
    /// The file has more bytes than a picture.
    #[error("the file has {} MB; expected a picture of {} MB at most", found >> 20, most >> 20)]
    Long {
        /// Bytes.
        found: u64,
        /// Bytes that are read at most.
        most: u64,
    },
    /// It is no picture of a known format.
    #[error("found no picture, expected {expected}")]
    NoPicture {
        /// The formats that are read here.
        expected: &'static str,
    },
    /// It is a picture of another format.
    #[error("found an image of format {found:?}, expected {expected}")]
    Format {
        /// Its format.
        found: ImageFormat,
        /// The formats that are read here.
        expected: &'static str,
    },
    /// Its end is missing.
    #[error("the {format:?} picture is incomplete: {why}; copy it again, or save it again")]
    Incomplete {
        /// Its format.
        format: ImageFormat,
        /// What is missing.
        why: String,
    },
    /// A kind of its format that is not read.
    #[error(
        "{why} is not read; save it as a PNG or TIFF of 8 or 16 bits, grey or RGB, without compression (in Fiji: Image > Type, then File > Save As)"
    )]
    Kind {
        /// What was found.
        why: String,
    },
    /// The codes of its pixels contradict themselves.
    #[error("the TIFF is damaged: in piece {piece} of {of} (strips or tiles), {why}; copy it again, or save it again")]
    Damaged {
        /// From 1.
        piece: u64,
        /// Number of pieces.
        of: usize,
        /// What is wrong.
        why: String,
    },
    /// Several pictures under one page, which are not all there or of which nothing tells how many they are.
    #[error(
        "a stack of {pictures} pictures that are stored as {pages} page(s) is not read; save it as OME-TIFF, or each picture as a file (in Fiji: File > \
         Save As > Image Sequence)"
    )]
    Stack {
        /// Pictures.
        pictures: usize,
        /// Pages without thumbnails.
        pages: usize,
    },
    /// It holds pictures of which only the first one would be read.
    #[error("{what} is not read; save each picture as a file of its own, as PNG or TIFF")]
    Several {
        /// What it is.
        what: String,
    },
    /// It has several pages where one picture is expected.
    #[error(
        "the file has {pages} pages, expected one picture; a turn in one file is read by `carved import FILE`, for anything else save each page \
         as a file (in Fiji: File > Save As > Image Sequence)"
    )]
    Pages {
        /// Pages without thumbnails.
        pages: usize,
    },
    /// The page is not there.
    #[error("page {page} was asked for, and the file has {pages}")]
    NoPage {
        /// From 1.
        page: usize,
        /// Pages without thumbnails.
        pages: usize,
    },
    /// Its header states more pixels than any camera takes.
    #[error("the picture is {width} x {height} px, which are {} MB; {} MB at most are decoded: save it again from the camera's program", found >> 20, most >> 20)]
    Large {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// Bytes of its pixels.
        found: u64,
        /// Bytes that are decoded at most.
        most: u64,
    },
    /// Its bytes contradict its format.
    #[error("not a readable {expected}: {why}")]
    Unreadable {
        /// The formats that are read here.
        expected: &'static str,
        /// The decoder's words.
        why: String,
    },
    /// The decoder ended with a panic.
    #[error("the decoder of its format failed on this file ({why}); save it again with another program, as PNG or as TIFF without tiles")]
    Panicked {
        /// The panic's words.
        why: String,
    },
}

/// The bytes of a picture file.
///
/// # Errors
/// It is no regular file, cannot be read, or is too long.
pub fn read(path: &Path) -> Result<Vec<u8>, DecodeError> {
    read_at_most(path, MOST_BYTES)
}

/// The bytes of a file that holds a whole turn.
///
/// # Errors
/// As [`read`].
pub fn read_turn(path: &Path) -> Result<Vec<u8>, DecodeError> {
    read_at_most(path, MOST_BYTES_OF_TURN)
}

fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, DecodeError> {
    let found = std::fs::metadata(path)?.len();
    if found > most {
        return Err(DecodeError::Long { found, most });
    }
    Ok(carved_files::read(path)?)
}

/// The only picture in the bytes of a file.
///
/// # Errors
/// It is no complete picture of one of the formats, or has several pages.
pub fn decode(bytes: &[u8], formats: Formats) -> Result<DynamicImage, DecodeError> {
    isolated(|| {
        let (format, page) = only_page_of(bytes, formats)?;
        picture(bytes, format, page.as_ref(), formats)
    })
}

/// A page of a file, from 0. Files of other formats than TIFF have one.
///
/// # Errors
/// As [`decode`], or it has no such page.
pub fn decode_page(bytes: &[u8], page: usize, formats: Formats) -> Result<DynamicImage, DecodeError> {
    isolated(|| {
        let (format, pages) = pages_of(bytes, formats)?;
        if page >= pages.len().max(1) {
            return Err(DecodeError::NoPage { page: page + 1, pages: pages.len().max(1) });
        }
        picture(bytes, format, pages.get(page), formats)
    })
}

/// The number of pages, without thumbnails.
///
/// # Errors
/// It is no picture of one of the formats.
pub fn pages(bytes: &[u8], formats: Formats) -> Result<usize, DecodeError> {
    isolated(|| Ok(pages_of(bytes, formats)?.1.len().max(1)))
}

/// Width and height of the only picture as its header says, turned as its orientation tag says, px.
///
/// # Errors
/// As [`decode`], as far as the header shows it.
pub fn size(bytes: &[u8], formats: Formats) -> Result<(u32, u32), DecodeError> {
    isolated(|| {
        let (format, page) = only_page_of(bytes, formats)?;
        if let Some(page) = &page {
            return page.check(bytes).map(|()| page.turned_size());
        }
        let mut decoder = decoder(bytes, format, None, formats)?;
        let (width, height) = decoder.dimensions();
        let orientation = decoder.orientation().map_err(|error| of_image(error, format, formats))?;
        Ok(if is_on_its_side(orientation) { (height, width) } else { (width, height) })
    })
}

fn is_on_its_side(orientation: Orientation) -> bool {
    matches!(orientation, Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH)
}

thread_local! {
    static IS_ISOLATED: Cell<bool> = const { Cell::new(false) };
}

/// Turns a panic into an error. The panic hook stays silent: the error has the words, and a backtrace would look like a crash.
fn isolated<T>(work: impl FnOnce() -> Result<T, DecodeError>) -> Result<T, DecodeError> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let hook = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_ISOLATED.get() {
                hook(panic);
            }
        }));
    });
    let before = IS_ISOLATED.replace(true);
    let done = catch_unwind(AssertUnwindSafe(work));
    IS_ISOLATED.set(before);
    done.unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
        let why = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        Err(DecodeError::Panicked { why })
    })
}

/// The format, and the pages of a TIFF.
fn pages_of(bytes: &[u8], formats: Formats) -> Result<(ImageFormat, Vec<Page>), DecodeError> {
    // `image` does not know the signature of BigTIFF.
    let is_big = bytes.starts_with(b"II\x2b\0") || bytes.starts_with(b"MM\0\x2b");
    let found = if is_big { Some(ImageFormat::Tiff) } else { image::guess_format(bytes).ok() };
    match found {
        None => Err(DecodeError::NoPicture { expected: formats.words }),
        Some(found) if !formats.list.contains(&found) => Err(DecodeError::Format { found, expected: formats.words }),
        Some(ImageFormat::Tiff) => Ok((ImageFormat::Tiff, tiff_pages::of(bytes, formats)?)),
        Some(format) => {
            several::check(bytes, format)?;
            Ok((format, Vec::new()))
        }
    }
}

fn only_page_of(bytes: &[u8], formats: Formats) -> Result<(ImageFormat, Option<Page>), DecodeError> {
    let (format, mut pages) = pages_of(bytes, formats)?;
    if pages.len() > 1 {
        return Err(DecodeError::Pages { pages: pages.len() });
    }
    Ok((format, pages.pop()))
}

fn picture(bytes: &[u8], format: ImageFormat, page: Option<&Page>, formats: Formats) -> Result<DynamicImage, DecodeError> {
    if format == ImageFormat::Jpeg {
        return jpeg::decode(bytes, formats);
    }
    if let Some(page) = page {
        page.check(bytes)?;
        page.check_codes(bytes)?;
        if let Some(mut image) = tiff_kinds::read(page, bytes, formats)? {
            image.apply_orientation(page.orientation);
            return Ok(image);
        }
    }
    let mut decoder = decoder(bytes, format, page, formats)?;
    let of_image = |error| of_image(error, format, formats);
    let orientation = decoder.orientation().map_err(of_image)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(of_image)?;
    check_byte_order(&image)?;
    unwritten::check(&image, format)?;
    if format == ImageFormat::Png && bytes.get(PNG_COLOURS) == Some(&PNG_PALETTE) {
        image = tiff_kinds::of_palette(&image.into_rgb8())?;
    }
    image.apply_orientation(orientation);
    Ok(image)
}

fn decoder<'a>(
    bytes: &'a [u8],
    format: ImageFormat,
    page: Option<&Page>,
    formats: Formats,
) -> Result<Box<dyn ImageDecoder + 'a>, DecodeError> {
    let of_image = |error| of_image(error, format, formats);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_ALLOCATED);
    if let Some(page) = page {
        let mut decoder = image::codecs::tiff::TiffDecoder::new(page.reader(bytes)).map_err(of_image)?;
        decoder.set_limits(limits).map_err(of_image)?;
        return of_usual_size(Box::new(decoder));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    of_usual_size(Box::new(reader.into_decoder().map_err(of_image)?))
}

/// The limits of a decoder do not concern the pixels that it returns. Memory for more of them than there is ends the process.
fn of_usual_size<'a>(decoder: Box<dyn ImageDecoder + 'a>) -> Result<Box<dyn ImageDecoder + 'a>, DecodeError> {
    let ((width, height), found) = (decoder.dimensions(), decoder.total_bytes());
    if found > MOST_ALLOCATED {
        return Err(DecodeError::Large { width, height, found, most: MOST_ALLOCATED });
    }
    Ok(decoder)
}

/// Refuses pixels of 16 bits whose bytes were exchanged: neighbours are alike in a picture, and with the bytes exchanged they are not.
fn check_byte_order(image: &DynamicImage) -> Result<(), DecodeError> {
    const FAR_LESS: f64 = 4.0;
    let (samples, channels) = match image {
        DynamicImage::ImageLuma16(image) => (image.as_raw(), 1),
        DynamicImage::ImageLumaA16(image) => (image.as_raw(), 2),
        DynamicImage::ImageRgb16(image) => (image.as_raw(), 3),
        DynamicImage::ImageRgba16(image) => (image.as_raw(), 4),
        _ => return Ok(()),
    };
    // The mean step from pixel to pixel, as a share of the range.
    let roughness = |value: fn(u16) -> u16| {
        let (least, most) = samples.iter().fold((u16::MAX, 0), |(least, most), s| (least.min(value(*s)), most.max(value(*s))));
        let steps: u64 = samples.iter().zip(samples.iter().skip(channels)).map(|(a, b)| u64::from(value(*a).abs_diff(value(*b)))).sum();
        steps as f64 / f64::from(most.saturating_sub(least).max(1))
    };
    if roughness(|sample| sample) > FAR_LESS * roughness(u16::swap_bytes) {
        return Err(DecodeError::Kind { why: "a picture of 16 bits whose two bytes were exchanged when it was written".into() });
    }
    Ok(())
}

fn of_image(error: ImageError, format: ImageFormat, formats: Formats) -> DecodeError {
    let why = error.to_string();
    match error {
        ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            // The decoder says the same of some sound tiles whose size is no multiple of 16.
            let tiled = if format == ImageFormat::Tiff { ", or it has tiles that cannot be read: then save it without tiles" } else { "" };
            DecodeError::Incomplete { format, why: format!("the file ends before its last pixel{tiled}") }
        }
        ImageError::Unsupported(_) => DecodeError::Kind { why: format!("this kind of {format:?} ({why})") },
        _ => DecodeError::Unreadable { expected: formats.words, why },
    }
}
