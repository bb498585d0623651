//! Pictures that other programs write, whole, cut, turned, in pages, and of kinds that a decoder does not stand.

use super::*;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, GrayImage, ImageEncoder, RgbImage};
use tiff::encoder::colortype::Gray8;
use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffKind};
use tiff::tags::Tag;

const SIZE: (u32, u32) = (70, 41);

/// Without two pixels alike in a row or a column, so that no part is like another.
fn grey(first: u8) -> GrayImage {
    GrayImage::from_fn(SIZE.0, SIZE.1, |u, v| image::Luma([(u * 7 + v * 13) as u8 ^ first]))
}

fn rgb() -> RgbImage {
    RgbImage::from_fn(SIZE.0, SIZE.1, |u, v| image::Rgb([(u * 3) as u8, (v * 5) as u8, (u * v) as u8]))
}

fn saved(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    picture.into().write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// A page of a TIFF: its picture, a further tag, and its description.
type Page<'a> = (GrayImage, Option<(Tag, u32)>, &'a str);

/// Pages with their tags.
fn tiff<K: TiffKind>(encoder: TiffEncoder<&mut Cursor<Vec<u8>>, K>, pages: &[Page]) {
    let mut encoder = encoder;
    for (page, tag, text) in pages {
        let mut image = encoder.new_image::<Gray8>(page.width(), page.height()).unwrap();
        image.rows_per_strip(8).unwrap();
        if let Some((tag, value)) = tag {
            image.encoder().write_tag(*tag, *value).unwrap();
        }
        if !text.is_empty() {
            image.encoder().write_tag(Tag::ImageDescription, *text).unwrap();
        }
        image.write_data(page).unwrap();
    }
}

fn pages_of_tiff(pages: &[Page]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    tiff(TiffEncoder::new(&mut out).unwrap(), pages);
    out.into_inner()
}

fn short(value: u16) -> [u8; 2] {
    value.to_le_bytes()
}

/// Colours in planes of their own, in tiles of 16 px: what libtiff writes with `PLANARCONFIG_SEPARATE` and `TIFFTAG_TILEWIDTH`.
fn planar_tiles(width: u16, height: u16) -> Vec<u8> {
    let tiles = 3 * usize::from(width.div_ceil(16)) * usize::from(height.div_ceil(16));
    let tags: [(u16, u16, u32, u32); 11] = [
        (256, 3, 1, width.into()),
        (257, 3, 1, height.into()),
        (258, 3, 3, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (277, 3, 1, 3),
        (284, 3, 1, 2),
        (322, 3, 1, 16),
        (323, 3, 1, 16),
        (324, 4, tiles as u32, 0),
        (325, 4, tiles as u32, 0),
    ];
    let lists = 8 + 2 + 12 * tags.len() + 4;
    let (offsets, counts) = (lists + 6, lists + 6 + 4 * tiles);
    let pixels = counts + 4 * tiles;
    let mut out = b"II\x2a\0\x08\0\0\0".to_vec();
    out.extend(short(tags.len() as u16));
    for (tag, kind, count, value) in tags {
        let value = match tag {
            258 => lists as u32,
            324 => offsets as u32,
            325 => counts as u32,
            _ => value,
        };
        out.extend([short(tag), short(kind)].concat());
        out.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    out.extend([0; 4]);
    out.extend([short(8); 3].concat());
    (0..tiles).for_each(|tile| out.extend(((pixels + 256 * tile) as u32).to_le_bytes()));
    (0..tiles).for_each(|_| out.extend(256u32.to_le_bytes()));
    out.extend((0..256 * tiles).map(|i| (i % 251) as u8));
    out
}

#[test]
fn a_panic_of_a_decoder_is_an_error_of_that_picture() {
    // 41 is no multiple of 16.
    for bytes in [planar_tiles(48, 41), planar_tiles(70, 41)] {
        let error = decode(&bytes, FRAMES).unwrap_err();
        assert!(matches!(error, DecodeError::Panicked { .. }), "{error}");
        assert!(error.to_string().contains("save it again"), "{error}");
    }
    let told = isolated::<()>(|| panic!("{} words", 2)).unwrap_err().to_string();
    assert!(told.contains("2 words"), "{told}");
}

#[test]
fn a_picture_that_was_cut_is_refused_or_whole() {
    let mut deflated = Cursor::new(Vec::new());
    let packed = TiffEncoder::new(&mut deflated).unwrap().with_compression(Compression::Deflate(DeflateLevel::Balanced));
    tiff(packed, &[(grey(0), None, "")]);
    let mut directory_first = planar_tiles(48, 32);
    directory_first[8 + 2 + 12 * 4 + 8] = 2;
    let files = [
        ("PNG", saved(grey(0), ImageFormat::Png)),
        ("PNG in colour", saved(rgb(), ImageFormat::Png)),
        ("JPEG", saved(grey(0), ImageFormat::Jpeg)),
        ("JPEG in colour", saved(rgb(), ImageFormat::Jpeg)),
        ("TIFF", saved(rgb(), ImageFormat::Tiff)),
        ("TIFF in strips", pages_of_tiff(&[(grey(0), None, "")])),
        ("TIFF, deflated", deflated.into_inner()),
        ("TIFF, directory first", directory_first),
        ("BMP", saved(rgb(), ImageFormat::Bmp)),
        ("PGM", saved(grey(0), ImageFormat::Pnm)),
    ];
    for (name, whole) in &files {
        let picture = decode(whole, FRAMES).unwrap_or_else(|e| panic!("{name}: {e}"));
        let (mut refused, mut incomplete) = (0, 0);
        for length in 0..whole.len() {
            match decode(&whole[..length], FRAMES) {
                Ok(found) => assert_eq!(found, picture, "{name}, cut at {length} of {}", whole.len()),
                Err(error) => {
                    refused += 1;
                    incomplete += usize::from(error.to_string().contains("incomplete"));
                }
            }
        }
        // Some bytes of a header, and what comes after the pixels.
        assert!(refused + 40 > whole.len() && incomplete * 4 > 3 * whole.len(), "{name}: {refused}, {incomplete} of {}", whole.len());
    }
}

#[test]
fn a_jpeg_needs_the_marker_of_its_own_end() {
    let whole = saved(rgb(), ImageFormat::Jpeg);
    // A program that reserves the file before it writes it.
    let mut reserved = whole.clone();
    reserved[whole.len() * 3 / 4..].fill(0);
    assert!(decode(&reserved, FRAMES).is_err_and(|error| error.to_string().contains("incomplete")));
    // A preview in a segment has an end too.
    let preview = [&whole[..2], &[0xff, 0xe1, 0, 6, 0xff, 0xd8, 0xff, 0xd9], &whole[2..]].concat();
    assert!(decode(&preview, FRAMES).is_ok_and(|found| found == decode(&whole, FRAMES).unwrap()));
    assert!(decode(&preview[..preview.len() * 9 / 10], FRAMES).is_err_and(|error| error.to_string().contains("incomplete")));
    // What other programs add after the end.
    assert!(decode(&[&whole[..], b"more"].concat(), FRAMES).is_ok_and(|found| found == decode(&whole, FRAMES).unwrap()));
}

/// Of libjpeg: progressive, with restarts, with colours of half the size, and within a TIFF.
const JPEGS: [(&str, &[u8]); 5] = [
    ("progressive", include_bytes!("data/progressive.jpg")),
    ("grey, progressive", include_bytes!("data/grey_progressive.jpg")),
    ("subsampled", include_bytes!("data/subsampled.jpg")),
    ("restarts", include_bytes!("data/restarts.jpg")),
    ("grey, restarts", include_bytes!("data/grey_restarts.jpg")),
];

fn jpegs() -> Vec<(&'static str, Vec<u8>)> {
    let mut all: Vec<_> = JPEGS.iter().map(|(name, bytes)| (*name, bytes.to_vec())).collect();
    all.extend([("grey", saved(grey(0), ImageFormat::Jpeg)), ("colour", saved(rgb(), ImageFormat::Jpeg))]);
    all
}

#[test]
fn a_jpeg_that_was_cut_and_closed_with_a_marker_of_an_end_is_refused() {
    for (name, whole) in jpegs() {
        let picture = decode(&whole, FRAMES).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((picture.width(), picture.height()), SIZE, "{name}");
        for length in 2..whole.len() - 2 {
            let closed = [&whole[..length], &[0xff, 0xd9]].concat();
            assert!(decode(&closed, FRAMES).is_err(), "{name}: cut at {length} of {} and closed", whole.len());
        }
    }
}

#[test]
fn a_jpeg_that_lacks_blocks_or_has_some_twice_is_refused() {
    for (name, whole) in jpegs() {
        let start = whole.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap() + 14;
        let (mut cases, mut missed) = (0, 0);
        for at in start..whole.len() - 12 {
            for length in [60, 150].into_iter().filter(|length| at + length < whole.len() - 12) {
                let lacking = [&whole[..at], &whole[at + length..]].concat();
                let twice = [&whole[..at + length], &whole[at..]].concat();
                cases += 2;
                missed += [lacking, twice].iter().filter(|bytes| decode(bytes, FRAMES).is_ok()).count();
            }
        }
        // Codes of another place can fill the picture to the last byte by chance.
        eprintln!("{name}: {missed} of {cases}");
        assert!(missed * 50 < cases, "{name}: {missed} of {cases}");
    }
}

#[test]
fn a_damaged_jpeg_in_a_tiff_is_refused() {
    for (name, whole) in [("grey", &include_bytes!("data/grey_jpeg.tif")[..]), ("colour", include_bytes!("data/jpeg.tif"))] {
        let picture = decode(whole, FRAMES).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((picture.width(), picture.height(), size(whole, FRAMES).unwrap()), (SIZE.0, SIZE.1, SIZE), "{name}");
        let expected = DynamicImage::from(rgb()).to_luma8();
        let worst = picture.to_luma8().iter().zip(expected.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        // Sharp steps of the pattern, at the quality of the file.
        assert!(worst < 100, "{name}: {worst}");
        let scan = whole.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
        let end = scan + whole[scan..].windows(2).position(|pair| pair == [0xff, 0xd9]).unwrap();
        let mut zeroed = whole.to_vec();
        zeroed[end - 40..end].fill(0);
        let mut closed = whole.to_vec();
        closed[end - 40..end - 38].copy_from_slice(&[0xff, 0xd9]);
        for damaged in [zeroed, closed] {
            let error = decode(&damaged, FRAMES).unwrap_err().to_string();
            assert!(error.contains("incomplete"), "{name}: {error}");
        }
    }
}

#[test]
fn palettes_of_grey_are_read_and_those_of_colours_refused() {
    let numbers = grey(0);
    let of = |colour: &dyn Fn(u8) -> [u8; 3], scale: u16| {
        let mut out = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut out).unwrap();
        let mut image = encoder.new_image::<Gray8>(SIZE.0, SIZE.1).unwrap();
        let map: Vec<u16> =
            (0..3).flat_map(|channel| (0..=255).map(move |n| (n, channel))).map(|(n, c)| u16::from(colour(n)[c]) * scale).collect();
        image.encoder().write_tag(Tag::PhotometricInterpretation, 3u16).unwrap();
        image.encoder().write_tag(Tag::ColorMap, &map[..]).unwrap();
        image.write_data(&numbers).unwrap();
        out.into_inner()
    };
    let mut inverted = numbers.clone();
    inverted.iter_mut().for_each(|v| *v = 255 - *v);
    for scale in [1, 256, 257] {
        let bytes = of(&|n| [255 - n; 3], scale);
        assert_eq!(decode(&bytes, FRAMES).unwrap(), inverted.clone().into(), "{scale}");
        assert_eq!(size(&bytes, FRAMES).unwrap(), SIZE);
    }
    let tinted = decode(&of(&|n| [n, n, n.saturating_sub(20)], 257), FRAMES).unwrap();
    assert!(tinted.color().has_color() && tinted.to_rgb8().pixels().zip(numbers.pixels()).all(|(p, n)| p.0[..2] == [n.0[0]; 2]));
    let error = decode(&of(&|n| [n, 0, 255 - n], 257), FRAMES).unwrap_err().to_string();
    assert!(error.contains("other colours than grey") && error.contains("save it as"), "{error}");
}

#[test]
fn palettes_of_png_are_read_as_those_of_tiff() {
    let of = |colour: &dyn Fn(u8) -> [u8; 3]| {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, SIZE.0, SIZE.1);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette((0..=255).flat_map(colour).collect::<Vec<u8>>());
        encoder.write_header().unwrap().write_image_data(&grey(0)).unwrap();
        out
    };
    assert_eq!(decode(&of(&|n| [n; 3]), FRAMES).unwrap(), grey(0).into());
    let error = decode(&of(&|n| [n, 0, 255 - n]), FRAMES).unwrap_err().to_string();
    assert!(error.contains("other colours than grey"), "{error}");
}

#[test]
fn floating_point_numbers_are_read_by_their_range_and_refused_where_it_is_none() {
    let of = |value: &dyn Fn(u8) -> f32| {
        let mut out = Cursor::new(Vec::new());
        let values: Vec<f32> = grey(0).iter().map(|v| value(*v)).collect();
        TiffEncoder::new(&mut out).unwrap().write_image::<tiff::encoder::colortype::Gray32Float>(SIZE.0, SIZE.1, &values).unwrap();
        out.into_inner()
    };
    let expected = DynamicImage::from(grey(0));
    for bytes in [of(&|v| f32::from(v) / 255.0), of(&f32::from), of(&|v| f32::from(v) * 0.999)] {
        assert_eq!(size(&bytes, FRAMES).unwrap(), SIZE);
        let found = decode(&bytes, FRAMES).unwrap().into_luma8();
        assert!(found.iter().zip(grey(0).iter()).all(|(a, b)| a.abs_diff(*b) <= 1));
    }
    assert_eq!(decode(&of(&f32::from), FRAMES).unwrap(), expected);
    let counts = decode(&of(&|v| f32::from(v) * 16.0), FRAMES).unwrap().into_luma16();
    assert!(counts.iter().zip(grey(0).iter()).all(|(a, b)| *a == u16::from(*b) * 16));
    let ambiguous: [(&str, &dyn Fn(u8) -> f32); 5] = [
        ("below zero", &|v| f32::from(v) - 100.0),
        ("no numbers", &|v| if v == 0 { f32::NAN } else { f32::from(v) }),
        ("a mask", &|v| f32::from(v / 128)),
        ("of another scale", &|v| f32::from(v) / 100.0),
        ("too large", &|v| f32::from(v) * 1000.0),
    ];
    for (name, value) in ambiguous {
        let error = decode(&of(value), FRAMES).unwrap_err().to_string();
        assert!(error.contains("floating point numbers from") && error.contains("save it as"), "{name}: {error}");
    }
}

#[test]
fn pages_are_counted_and_thumbnails_are_none() {
    let reduced = Some((Tag::NewSubfileType, 1));
    let small = GrayImage::new(20, 12);
    let bytes = pages_of_tiff(&[(small, reduced, ""), (grey(0), None, ""), (grey(1), Some((Tag::NewSubfileType, 2)), "")]);
    assert_eq!(pages(&bytes, FRAMES).unwrap(), 2);
    assert!(matches!(size(&bytes, FRAMES), Err(DecodeError::Pages { pages: 2 })));
    assert_eq!(decode_page(&bytes, 0, FRAMES).unwrap(), grey(0).into());
    assert_eq!(decode_page(&bytes, 1, FRAMES).unwrap(), grey(1).into());
    assert!(decode_page(&bytes, 2, FRAMES).unwrap_err().to_string().contains("the file has 2"));
    let error = decode(&bytes, FRAMES).unwrap_err().to_string();
    assert!(error.contains("2 pages") && error.contains("carved import"), "{error}");
    let with_thumbnail = pages_of_tiff(&[(grey(3), reduced, ""), (grey(0), None, "")]);
    assert_eq!((decode(&with_thumbnail, FRAMES).unwrap(), size(&with_thumbnail, FRAMES).unwrap()), (grey(0).into(), SIZE));
    assert_eq!(pages(&saved(grey(0), ImageFormat::Png), FRAMES).unwrap(), 1);

    let mut big = Cursor::new(Vec::new());
    tiff(TiffEncoder::new_big(&mut big).unwrap(), &[(grey(0), None, ""), (grey(1), None, "")]);
    assert_eq!(decode_page(big.get_ref(), 1, FRAMES).unwrap(), grey(1).into());
}

/// Pictures behind each other under one directory, which stands before or behind them: what Fiji writes of a large stack.
fn under_one_directory(text: impl AsRef<[u8]>, pictures: &[GrayImage], is_first: bool) -> Vec<u8> {
    let pixels: Vec<u8> = pictures.iter().flat_map(|picture| picture.as_raw().clone()).collect();
    let (entries, text) = (9, [text.as_ref(), &[0]].concat());
    let of_directory = 2 + 12 * entries + 4 + text.len();
    let (directory, first) = if is_first { (8, 8 + of_directory) } else { (8 + pixels.len(), 8) };
    let tags: [(u16, u16, u32, u32); 9] = [
        (256, 4, 1, SIZE.0),
        (257, 4, 1, SIZE.1),
        (258, 3, 1, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (270, 2, text.len() as u32, (directory + of_directory - text.len()) as u32),
        (273, 4, 1, first as u32),
        (278, 4, 1, SIZE.1),
        (279, 4, 1, SIZE.0 * SIZE.1),
    ];
    let mut written = [&short(entries as u16)[..], &[]].concat();
    for (tag, kind, count, value) in tags {
        written.extend([short(tag), short(kind)].concat());
        written.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    written.extend([0; 4]);
    written.extend(text);
    let head = [&b"II\x2a\0"[..], &(directory as u32).to_le_bytes()].concat();
    if is_first { [head, written, pixels].concat() } else { [head, pixels, written].concat() }
}

#[test]
fn pictures_under_one_directory_are_all_read_or_refused_by_name() {
    let all: Vec<GrayImage> = (0..4).map(grey).collect();
    for text in ["ImageJ=1.54f\nimages=4\nframes=4\nhyperstack=true\n", "{\"shape\": [4, 41, 70]}"] {
        for is_first in [true, false] {
            let bytes = under_one_directory(text, &all, is_first);
            // A directory behind the pictures is none of them.
            assert_eq!(pages(&bytes, FRAMES).unwrap(), 4, "{text} {is_first}");
            for (page, picture) in all.iter().enumerate() {
                assert_eq!(decode_page(&bytes, page, FRAMES).unwrap(), picture.clone().into(), "{text} {is_first} {page}");
            }
            assert!(decode(&bytes, FRAMES).unwrap_err().to_string().contains("4 pages"));
        }
    }
    // Without a word about them, or with fewer than the word says.
    for (text, pictures) in [("", &all[..]), ("ImageJ=1.54f\nunit=um\n", &all[..]), ("ImageJ=1.54f\nimages=5\n", &all[..])] {
        let error = decode_page(&under_one_directory(text, pictures, true), 0, FRAMES).unwrap_err().to_string();
        assert!(error.contains("pictures that are stored as 1 page") && error.contains("OME-TIFF"), "{error}");
    }
    assert_eq!(decode(&under_one_directory("", &all[..1], true), FRAMES).unwrap(), all[0].clone().into());
    // A micro sign of one byte.
    let latin = under_one_directory(b"ImageJ=1.54f\nimages=4\nunit=\xb5m\n", &all, true);
    assert_eq!(pages(&latin, FRAMES).unwrap(), 4);
    let channels = under_one_directory("ImageJ=1.54f\nimages=4\nchannels=2\nframes=2\n", &all, true);
    assert!(pages(&channels, FRAMES).unwrap_err().to_string().contains("2 channels"));
}

#[test]
fn files_of_several_pictures_are_refused_and_not_read_as_their_first() {
    let mut animated = Vec::new();
    let mut encoder = png::Encoder::new(&mut animated, SIZE.0, SIZE.1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_animated(2, 0).unwrap();
    let mut writer = encoder.write_header().unwrap();
    (0..2).for_each(|frame| writer.write_image_data(&grey(frame)).unwrap());
    writer.finish().unwrap();
    let one = saved(grey(0), ImageFormat::Pnm);
    let pgm = [b"P5\n# of a camera\n70 41\n255\n", grey(0).as_raw().as_slice()].concat();
    let twice = |one: &[u8]| [one, b"\n", one].concat();
    assert!(decode(&pgm, FRAMES).is_ok());
    for bytes in [animated, twice(&one), twice(&pgm)] {
        let error = decode(&bytes, FRAMES).unwrap_err().to_string();
        assert!(error.contains("pictures is not read") && error.contains("file of its own"), "{error}");
    }
    assert!(decode(&[&one[..], b"more"].concat(), FRAMES).is_ok());
}

/// A coded TIFF in strips of 8 rows: the last one has a single row, and the pieces end before their codes do.
fn coded(compression: Compression) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    // Codes for several pixels each.
    let steps = GrayImage::from_fn(SIZE.0, SIZE.1, |u, v| image::Luma([(u / 8 * 9 + v / 4 * 13) as u8]));
    tiff(TiffEncoder::new(&mut out).unwrap().with_compression(compression), &[(steps, None, "")]);
    out.into_inner()
}

#[test]
fn a_wrong_bit_in_a_coded_tiff_is_known_where_the_codes_tell_it() {
    // Within the pixels, which the encoder writes first. The lists of strips come before the directory.
    const LISTS: usize = 64;
    for (name, coding, least_percent) in [
        ("Deflate", Compression::Deflate(DeflateLevel::Balanced), 100),
        ("LZW", Compression::Lzw, 50),
        ("PackBits", Compression::Packbits, 50),
    ] {
        let whole = coded(coding);
        let picture = decode(&whole, FRAMES).unwrap();
        let directory = u32::from_le_bytes(whole[4..8].try_into().unwrap()) as usize;
        let pixels = 8..directory - LISTS;
        let (mut cases, mut missed) = (0, 0);
        for at in pixels.step_by(3) {
            let mut flipped = whole.clone();
            flipped[at] ^= 1 << (at % 8);
            cases += 1;
            missed += usize::from(decode(&flipped, FRAMES).is_ok_and(|found| found != picture));
        }
        eprintln!("{name}: {missed} of {cases} are read with other pixels");
        assert!(100 * (cases - missed) >= least_percent * cases, "{name}: {missed} of {cases}");
    }
}

#[test]
fn a_check_sum_is_read_also_where_a_tile_goes_beyond_the_picture() {
    // 41 rows of 70 px in tiles of 32 px, which stand behind the directory.
    const FIRST_TILE: usize = 224;
    let whole = include_bytes!("data/deflated_tiles.tif");
    assert_eq!(decode(whole, FRAMES).unwrap(), grey(0).into());
    let mut cases = 0;
    for at in (FIRST_TILE..whole.len()).step_by(5) {
        let mut flipped = whole.to_vec();
        flipped[at] ^= 1 << (at % 8);
        if let Ok(found) = decode(&flipped, FRAMES) {
            assert_eq!(found, grey(0).into(), "byte {at}");
        }
        cases += 1;
    }
    assert!(cases > 300, "{cases}");
}

#[test]
fn a_picture_that_was_not_written_to_its_end_is_refused() {
    let noisy = |value: u8, from: usize| {
        let mut picture = grey(0);
        picture.iter_mut().skip(from).for_each(|pixel| *pixel = value);
        picture
    };
    let width = SIZE.0 as usize;
    for format in [ImageFormat::Tiff, ImageFormat::Bmp, ImageFormat::Pnm, ImageFormat::Png] {
        let of = |value, from| decode(&saved(noisy(value, from), format), FRAMES).map_err(|error| error.to_string());
        for value in [0, 255] {
            let error = of(value, 30 * width + 21).unwrap_err();
            assert!(error.contains("incomplete") && error.contains("from row 30, column 2"), "{format:?} {value}: {error}");
            // A program fills whole rows.
            assert!(of(value, 30 * width).is_ok(), "{format:?} {value}");
        }
    }
    // A border on all sides, and a silhouette.
    let mut bordered = noisy(0, 30 * width);
    bordered.enumerate_pixels_mut().filter(|(u, ..)| *u > 50).for_each(|(.., pixel)| pixel.0 = [0]);
    let shape = GrayImage::from_fn(SIZE.0, SIZE.1, |u, v| image::Luma([if u + v < 60 && v < 25 { 255 } else { 0 }]));
    for picture in [bordered, shape] {
        assert!(decode(&saved(picture, ImageFormat::Tiff), FRAMES).is_ok());
    }
}

#[test]
fn stacks_that_pages_do_not_show_are_refused_with_a_way_out() {
    for (text, pages, what) in [
        ("ImageJ=1.54f\nimages=21\nslices=21\n", 1, "21 pictures that are stored as 1 page"),
        ("ImageJ=1.54f\nimages=2\nchannels=2\nmode=grayscale\n", 2, "2 channels"),
        ("<OME><Pixels SizeC=\"2\" SizeT=\"1\"/></OME>", 2, "2 channels"),
    ] {
        let all: Vec<_> = (0..pages).map(|page| (grey(page), None, text)).collect();
        let error = decode_page(&pages_of_tiff(&all), 0, FRAMES).unwrap_err().to_string();
        assert!(error.contains(what) && error.contains("save it as"), "{error}");
    }
    let fits = pages_of_tiff(&[(grey(0), None, "ImageJ=1.54f\nimages=2\n"), (grey(1), None, "")]);
    assert_eq!(decode_page(&fits, 1, FRAMES).unwrap(), grey(1).into());
    let without_colours = pages_of_tiff(&[(grey(0), Some((Tag::PhotometricInterpretation, 3)), "")]);
    let error = decode(&without_colours, FRAMES).unwrap_err().to_string();
    assert!(error.contains("palette") && error.contains("save it as"), "{error}");
}

/// EXIF with the one tag.
fn exif(orientation: u16) -> Vec<u8> {
    [&b"II\x2a\0\x08\0\0\0\x01\0"[..], &[0x12, 1, 3, 0, 1, 0, 0, 0], &short(orientation), &[0; 6]].concat()
}

#[test]
fn orientation_tags_of_every_format_are_applied() {
    let picture = grey(0);
    for orientation in 1..=8u16 {
        let mut turned = DynamicImage::from(picture.clone());
        turned.apply_orientation(Orientation::from_exif(orientation as u8).unwrap());
        let mut png = Vec::new();
        let mut encoder = PngEncoder::new(&mut png);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder.write_image(&picture, SIZE.0, SIZE.1, ExtendedColorType::L8).unwrap();
        let tiff = pages_of_tiff(&[(picture.clone(), Some((Tag::Orientation, orientation.into())), "")]);
        for bytes in [&png, &tiff] {
            assert_eq!(decode(bytes, FRAMES).unwrap(), turned, "{orientation}");
            assert_eq!(size(bytes, FRAMES).unwrap(), (turned.width(), turned.height()), "{orientation}");
        }
        let mut jpeg = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, 100);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder.write_image(&picture, SIZE.0, SIZE.1, ExtendedColorType::L8).unwrap();
        let found = decode(&jpeg, FRAMES).unwrap().into_luma8();
        let worst = found.iter().zip(turned.to_luma8().iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(found.dimensions() == (turned.width(), turned.height()) && worst < Some(8), "{orientation}: {worst:?}");
        assert_eq!(size(&jpeg, FRAMES).unwrap(), found.dimensions());
    }
}

#[test]
fn other_formats_are_named() {
    assert!(decode(b"text", FRAMES).unwrap_err().to_string().contains("found no picture, expected PNG"));
    let error = decode(&saved(rgb(), ImageFormat::Bmp), SILHOUETTES).unwrap_err().to_string();
    assert!(error.contains("format Bmp, expected PNG or PGM"), "{error}");
}

/// Memory for 30 GB of pixels is refused by the system, which ends the process and is no panic.
#[test]
fn a_header_that_states_more_pixels_than_memory_has_is_an_error_of_that_picture() {
    const WIDE: u32 = 100_000;
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, WIDE, WIDE);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().unwrap();
    writer.write_chunk(png::chunk::IDAT, &[0x78, 0x9c, 0x03, 0, 0, 0, 0, 1]).unwrap();
    drop(writer);
    let pgm = format!("P6\n{WIDE} {WIDE}\n255\n000").into_bytes();
    let mut bmp = saved(rgb(), ImageFormat::Bmp);
    for at in [18, 22] {
        bmp[at..at + 4].copy_from_slice(&30_000u32.to_le_bytes());
    }
    for bytes in [&png, &pgm, &bmp] {
        for error in [decode(bytes, FRAMES).unwrap_err(), size(bytes, FRAMES).unwrap_err()] {
            assert!(matches!(error, DecodeError::Large { width: 30_000.., height: 30_000.., .. }), "{error}");
        }
    }
}

/// Twelve bits in sixteen, at either end, as a program writes them that does not ask for the order of the bytes.
#[test]
fn bytes_of_16_bits_that_were_exchanged_are_refused_and_numbers_of_any_width_are_read() {
    let noise = |u: u32, v: u32| u.wrapping_mul(2_654_435_761).wrapping_add(v.wrapping_mul(40_503)) >> 27;
    let grey16 = |scale: u32, shift: u32| {
        image::ImageBuffer::<image::Luma<u16>, _>::from_fn(SIZE.0, SIZE.1, |u, v| {
            let light = 100 + u + if (10..30).contains(&v) { 40 } else { 0 };
            image::Luma([((light * scale + noise(u, v)) << shift) as u16])
        })
    };
    for (scale, shift) in [(1, 0), (1, 8), (16, 0), (16, 4), (256, 0)] {
        let picture = grey16(scale, shift);
        let mut exchanged = picture.clone();
        exchanged.iter_mut().for_each(|sample| *sample = sample.swap_bytes());
        for format in [ImageFormat::Png, ImageFormat::Tiff] {
            assert_eq!(decode(&saved(picture.clone(), format), FRAMES).unwrap(), picture.clone().into(), "{scale} << {shift}");
            let found = decode(&saved(exchanged.clone(), format), FRAMES);
            // Numbers of 8 bits at one end are numbers of 8 bits at the other.
            if (scale, shift) != (1, 8) && scale > 1 {
                assert!(found.unwrap_err().to_string().contains("two bytes were exchanged"), "{scale} << {shift}");
            }
        }
    }
}
