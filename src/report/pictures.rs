//! The pictures of a specimen for a report: the standard pictures of a larva, the frame from its side, and from above, each cut to the
//! specimen, with the outline drawn in, and the model from three sides.

use crate::export::read_ply;
use carved_core::frame::PixelFormat;
use carved_core::pipeline::standard::Aspect;
use carved_core::profile::Picture;
use carved_pictures::decode;
use carved_pictures::model::from_three_sides;
use carved_store::{SpecimenFile, StoreError, StoredWell, frames};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, RgbImage, imageops};
use serde_json::Value;
use std::io::Cursor;

/// Colour of the outline: visible on the bright bore and on a dark larva.
const OUTLINE: [u8; 3] = [255, 64, 160];
/// Room around the specimen, px of the frame.
const ROOM: u32 = 24;
/// Largest width, px. A plate of 96 wells with four pictures each stays below some MB.
const WIDTH: u32 = 360;
const QUALITY: u8 = 78;

/// What the picture of a model shows.
const MODEL: &str = "model from the side, from the front and from above";

/// A picture as it stands in the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    /// `left side`, `back`, `from the side`, `from above`, `view 0`, or that nothing was outlined.
    pub words: String,
    pub jpeg: Vec<u8>,
}

/// The pictures of a well.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Pictures {
    pub shown: Vec<Shown>,
    /// Sentences about the files that are there and cannot be shown.
    pub left_out: Vec<String>,
}

/// Why a picture is not shown.
enum NotShown {
    /// A file is not on this disk any more, or it shows no specimen.
    Nothing,
    /// A file is not what it was when it was recorded, or cannot be read.
    LeftOut(String),
}

/// The pictures of a well. None where its frames are not on this disk any more. The numbers do not depend on them: a file that was altered
/// is left out, and named.
pub fn of(well: &StoredWell) -> Pictures {
    let mut pictures = Pictures::default();
    let Some(recording) = &well.recording else { return pictures };
    let Ok(format) = serde_json::from_value::<PixelFormat>(recording["rig"]["pixel_format"].clone()) else { return pictures };
    let mut add = |words: String, drawn: Result<RgbImage, NotShown>| match drawn {
        Ok(picture) => pictures.shown.extend(jpeg(&picture).map(|jpeg| Shown { words, jpeg })),
        Err(NotShown::Nothing) => {}
        Err(NotShown::LeftOut(sentence)) => pictures.left_out.push(sentence),
    };
    let Some(measurement) = &well.measurement else {
        add("nothing was measured".to_owned(), frame(well, "frames/detect.png", format));
        return pictures;
    };
    for (aspect, words) in [(Aspect::Lateral, "left side"), (Aspect::Dorsal, "back")] {
        add(words.to_owned(), standard(well, &SpecimenFile::standard_name(aspect, false)));
    }
    for (view, words) in views(measurement) {
        add(words, outlined(well, &frame_of(recording, view), &format!("profiles/view_{view:03}.png"), format));
    }
    add(MODEL.to_owned(), model(well, measurement));
    pictures
}

/// The bytes of a file, compared with its checksum.
fn verified(well: &StoredWell, name: &str) -> Result<Vec<u8>, NotShown> {
    match well.files.verified(name) {
        Ok(bytes) => bytes.ok_or(NotShown::Nothing),
        Err(StoreError::Altered { .. }) => Err(NotShown::LeftOut(format!("{name} was altered after it was recorded. It is not shown."))),
        Err(_) => Err(unreadable(name)),
    }
}

fn unreadable(name: &str) -> NotShown {
    NotShown::LeftOut(format!("{name} cannot be read. It is not shown."))
}

/// A frame with the outline that was measured.
fn outlined(well: &StoredWell, frame_name: &str, mask_name: &str, format: PixelFormat) -> Result<RgbImage, NotShown> {
    let picture = frame(well, frame_name, format)?;
    let mask = decode::decode(&verified(well, mask_name)?, decode::PNG).map_err(|_| unreadable(mask_name))?.to_luma8();
    cut(picture, &mask).ok_or(NotShown::Nothing)
}

/// A standard picture with its scale bar. It needs no frames.
fn standard(well: &StoredWell, name: &str) -> Result<RgbImage, NotShown> {
    Ok(decode::decode(&verified(well, name)?, decode::PNG).map_err(|_| unreadable(name))?.to_rgb8())
}

/// The model from three sides. It needs no frames.
fn model(well: &StoredWell, measurement: &Value) -> Result<RgbImage, NotShown> {
    const MESH: &str = "mesh.ply";
    let mesh = read_ply(&verified(well, MESH)?).map_err(|_| unreadable(MESH))?;
    // Not there where head or back are not known.
    let to_body = measurement.pointer("/shape/body/to_body/rotation").and_then(|rows| serde_json::from_value(rows.clone()).ok());
    from_three_sides(&mesh, to_body).ok_or(NotShown::Nothing)
}

/// The views to show, each with its name.
fn views(measurement: &Value) -> Vec<(u64, String)> {
    let facing = &measurement["facing"];
    let side = facing["lateral_views"].as_array().and_then(|views| views.first()?.as_u64());
    let above = facing["dorsal_view"].as_u64();
    if let (Some(side), Some(above)) = (side, above) {
        return vec![(side, "from the side".into()), (above, "from above".into())];
    }
    // A bead, and a larva whose back is not known.
    let used = measurement["views"].as_array().into_iter().flatten().find(|view| view["used"] == true);
    used.and_then(|view| view["index"].as_u64()).map(|view| (view, format!("view {view}"))).into_iter().collect()
}

/// The file of a view: of its newest take.
fn frame_of(recording: &Value, view: u64) -> String {
    let ledger = recording["ledger"].as_array().into_iter().flatten();
    let takes = ledger.filter(|entry| entry["view"] == view && entry["closure"] != true).map(|entry| entry["retake"].as_u64().unwrap_or(0));
    match takes.max() {
        None | Some(0) => format!("frames/view_{view:03}.png"),
        Some(take) => format!("frames/view_{view:03}.retake-{take}.png"),
    }
}

fn frame(well: &StoredWell, name: &str, format: PixelFormat) -> Result<RgbImage, NotShown> {
    let bytes = verified(well, name)?;
    let decoded = frames::decode_bytes(&well.files.path(name), &bytes, format).map_err(|_| unreadable(name))?;
    let picture = Picture::from_frame(&decoded);
    RgbImage::from_raw(picture.width() as u32, picture.height() as u32, picture.to_rgb()).ok_or_else(|| unreadable(name))
}

/// The part of a frame around the mask, with the border of the mask drawn in. `None` where the mask is empty or of another size.
fn cut(mut frame: RgbImage, mask: &image::GrayImage) -> Option<RgbImage> {
    if mask.dimensions() != frame.dimensions() {
        return None;
    }
    let (width, height) = mask.dimensions();
    let inside = |u: i64, v: i64| {
        (0..i64::from(width)).contains(&u) && (0..i64::from(height)).contains(&v) && mask.get_pixel(u as u32, v as u32).0[0] > 127
    };
    let mut bounds: Option<[u32; 4]> = None;
    for (u, v, _) in mask.enumerate_pixels().filter(|(_, _, pixel)| pixel.0[0] > 127) {
        let [u0, v0, u1, v1] = bounds.unwrap_or([u, v, u, v]);
        bounds = Some([u0.min(u), v0.min(v), u1.max(u), v1.max(v)]);
        let (x, y) = (i64::from(u), i64::from(v));
        if ![(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].into_iter().all(|(x, y)| inside(x, y)) {
            frame.put_pixel(u, v, image::Rgb(OUTLINE));
        }
    }
    let [u0, v0, u1, v1] = bounds?;
    let (left, top) = (u0.saturating_sub(ROOM), v0.saturating_sub(ROOM));
    let (right, bottom) = ((u1 + ROOM + 1).min(width), (v1 + ROOM + 1).min(height));
    Some(imageops::crop_imm(&frame, left, top, right - left, bottom - top).to_image())
}

/// A picture of at most [`WIDTH`] as JPEG.
fn jpeg(picture: &RgbImage) -> Option<Vec<u8>> {
    let (width, height) = picture.dimensions();
    let small = if width > WIDTH {
        let height = (u64::from(height) * u64::from(WIDTH) / u64::from(width)).max(1) as u32;
        imageops::resize(picture, WIDTH, height, imageops::FilterType::Triangle)
    } else {
        picture.clone()
    };
    let mut bytes = Cursor::new(Vec::new());
    let encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    small.write_with_encoder(encoder).ok()?;
    debug_assert!(image::guess_format(bytes.get_ref()).is_ok_and(|format| format == ImageFormat::Jpeg));
    Some(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_picture_is_cut_to_the_specimen_and_shows_its_border() {
        let frame = RgbImage::from_pixel(300, 200, image::Rgb([200, 200, 200]));
        let mut mask = image::GrayImage::new(300, 200);
        (100..150).for_each(|u| (80..90).for_each(|v| mask.put_pixel(u, v, image::Luma([255]))));
        let cut = cut(frame.clone(), &mask).unwrap();
        assert_eq!(cut.dimensions(), (50 + 2 * ROOM, 10 + 2 * ROOM));
        assert_eq!(cut.get_pixel(ROOM, ROOM).0, OUTLINE);
        assert_eq!(cut.get_pixel(ROOM + 5, ROOM + 5).0, [200, 200, 200]);
        assert_eq!(super::cut(frame.clone(), &image::GrayImage::new(300, 200)), None);
        assert_eq!(super::cut(frame, &image::GrayImage::new(30, 20)), None);
    }

    #[test]
    fn the_newest_take_of_a_view_is_shown() {
        let recording =
            json!({"ledger": [{"view": 3}, {"view": 3, "retake": 2}, {"view": 3, "retake": 1}, {"view": 4, "closure": true, "retake": 7}]});
        assert_eq!(frame_of(&recording, 3), "frames/view_003.retake-2.png");
        assert_eq!(frame_of(&recording, 4), "frames/view_004.png");
    }

    #[test]
    fn a_larva_is_shown_from_the_side_and_from_above_and_a_bead_from_its_first_view() {
        let larva = json!({"facing": {"lateral_views": [7, 18], "dorsal_view": 2}, "views": []});
        assert_eq!(views(&larva), [(7, "from the side".to_owned()), (2, "from above".to_owned())]);
        let bead = json!({"views": [{"index": 0, "used": false}, {"index": 1, "used": true}]});
        assert_eq!(views(&bead), [(1, "view 1".to_owned())]);
    }
}
