//! The acceptance rule for frames.

use super::AravisSettings;
use crate::camera::settings::Packed;
use aravis::{BufferPayloadType, BufferStatus};
use carved_core::frame::{PixelFormat, RawFrame};

/// The verdict on a buffer.
pub(super) enum Verdict {
    /// The frame is accepted.
    Taken { frame: RawFrame, frame_id: u64 },
    /// The frame was exposed before the request. The right one may still come.
    Stale(String),
    /// The frame is incomplete or has another format.
    Lost(String),
}

/// Accepts a frame that is complete, an image, of the configured geometry, format and size, exposed after `since_ns` of the camera's clock
/// (`None` without one), and not the last frame again.
pub(super) fn accept(buffer: &aravis::Buffer, settings: &AravisSettings, last_frame_id: Option<u64>, since_ns: Option<u64>) -> Verdict {
    let status = buffer.status();
    if status != BufferStatus::Success {
        return Verdict::Lost(format!("the frame is not whole ({status:?}): {}", missing(settings)));
    }
    let payload = buffer.payload_type();
    if payload != BufferPayloadType::Image {
        return Verdict::Lost(format!("not an image ({payload:?})"));
    }
    let (x, y, width, height) = buffer.image_region();
    let format = buffer.image_pixel_format();
    let expected = [settings.width, settings.height, settings.offset_x, settings.offset_y].map(i64::from);
    let found = [width, height, x, y].map(i64::from);
    if found != expected || format != on_the_wire(settings.pixel_format, settings.sent_as) {
        return Verdict::Lost(format!(
            "expected {} of width, height, x, y {expected:?}, got {} of {found:?}",
            settings.format_sent(),
            name(format)
        ));
    }
    let frame_id = buffer.frame_id();
    if last_frame_id == Some(frame_id) {
        return Verdict::Stale(format!("frame {frame_id} came again"));
    }
    if let Some(since_ns) = since_ns
        && buffer.timestamp() < since_ns
    {
        let early_ms = (since_ns - buffer.timestamp()) as f64 * 1e-6;
        return Verdict::Stale(format!("frame {frame_id} was exposed {early_ms:.3} ms before it was asked for"));
    }
    let sent = buffer.image_data();
    let pixels = match settings.sent_as {
        Some(packed) => packed.unpack(&sent, settings.width as usize * settings.height as usize),
        None => sent,
    };
    match RawFrame::new(settings.width, settings.height, settings.pixel_format, pixels) {
        Ok(frame) => Verdict::Taken { frame, frame_id },
        Err(e) => Verdict::Lost(e.to_string()),
    }
}

/// What to look for if frames are not whole. Aravis does not tell how many bytes of an incomplete frame came: it counts none or all.
fn missing(settings: &AravisSettings) -> String {
    let (all, packet) = (settings.frame_bytes(), settings.packet_size);
    format!(
        "packets are missing of its {all} bytes. If no frame comes whole, packets of {packet} bytes do not pass, because the MTU of a device \
         between is lower: set packet_size in the configuration to that MTU"
    )
}

/// GenICam's name of a known format; the number of another one.
fn name(format: aravis::PixelFormat) -> String {
    PixelFormat::ALL
        .into_iter()
        .find(|known| on_the_wire(*known, None) == format)
        .map_or_else(|| format!("format {:#010x}", format.raw()), |known| known.name().to_owned())
}

fn on_the_wire(format: PixelFormat, sent_as: Option<Packed>) -> aravis::PixelFormat {
    match sent_as {
        None => {}
        // Aravis 0.8 has no name for the formats of PFNC.
        Some(Packed::Mono10p) => return aravis::PixelFormat::from_raw(0x010a_0046),
        Some(Packed::Mono12p) => return aravis::PixelFormat::from_raw(0x010c_0047),
        Some(Packed::Mono10Packed) => return aravis::PixelFormat::MONO_10_PACKED,
        Some(Packed::Mono12Packed) => return aravis::PixelFormat::MONO_12_PACKED,
    }
    match format {
        PixelFormat::Mono8 => aravis::PixelFormat::MONO_8,
        PixelFormat::BayerRG8 => aravis::PixelFormat::BAYER_RG_8,
        PixelFormat::BayerGR8 => aravis::PixelFormat::BAYER_GR_8,
        PixelFormat::BayerGB8 => aravis::PixelFormat::BAYER_GB_8,
        PixelFormat::BayerBG8 => aravis::PixelFormat::BAYER_BG_8,
        PixelFormat::RGB8Packed => aravis::PixelFormat::RGB_8_PACKED,
    }
}
