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
    let palette = pages_of_tiff(&[(grey(0), Some((Tag::PhotometricInterpretation, 3)), "")]);
    let error = decode(&palette, FRAMES).unwrap_err().to_string();
    assert!(error.contains("palette") && error.contains("save it as"), "{error}");
    let mut float = Cursor::new(Vec::new());
    let values: Vec<f32> = grey(0).iter().map(|v| f32::from(*v)).collect();
    TiffEncoder::new(&mut float).unwrap().write_image::<tiff::encoder::colortype::Gray32Float>(SIZE.0, SIZE.1, &values).unwrap();
    let error = decode(float.get_ref(), FRAMES).unwrap_err().to_string();
    assert!(error.contains("32 bit floating point") && error.contains("save it as"), "{error}");
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
