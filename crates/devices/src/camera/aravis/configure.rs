//! The configuration of a camera before the first frame.

use super::{AravisSettings, Trigger, refused};
use crate::DeviceError;
use aravis::prelude::*;
use aravis::{AcquisitionMode, RangeCheckPolicy};

/// Cameras take a rate in steps of their line time, which is below 0.1 % of a frame.
const RATE_TOLERANCE: f64 = 0.01;

/// Sets everything in the configuration, and checks the size of a frame.
pub(super) fn configure(camera: &aravis::Camera, settings: &AravisSettings) -> Result<(), DeviceError> {
    // Without this policy a value out of range is accepted and ignored.
    camera.set_range_check_policy(RangeCheckPolicy::Enable);
    super::features::set_neutral(camera, settings)?;
    if let Some(device) = camera.device() {
        for (name, value) in &settings.features {
            let what = || format!("{name} = {value}");
            device.set_features_from_string(&format!("{name}={value}")).map_err(|e| refused(&what(), &e))?;
        }
    }
    let format = settings.format_sent();
    camera.set_pixel_format_from_string(format).map_err(|e| refused(&format!("PixelFormat = {format}"), &e))?;
    // Offsets of 0 first, so that any size fits.
    for (name, value) in [
        ("OffsetX", 0),
        ("OffsetY", 0),
        ("Width", settings.width),
        ("Height", settings.height),
        ("OffsetX", settings.offset_x),
        ("OffsetY", settings.offset_y),
    ] {
        camera.set_integer(name, value.into()).map_err(|e| refused(&format!("{name} = {value}"), &e))?;
    }
    let exposure = settings.exposure_us;
    camera.set_exposure_time(exposure).map_err(|e| refused(&format!("exposure = {exposure} us"), &e))?;
    set_gain(camera, settings)?;
    let packet = settings.packet_size;
    camera.gv_set_packet_size(packet as i32).map_err(|e| refused(&format!("packet size = {packet}"), &e))?;
    camera.set_acquisition_mode(AcquisitionMode::Continuous).map_err(|e| refused("AcquisitionMode = Continuous", &e))?;
    // Last, because setting a frame rate switches all triggers off, also those of the features above.
    set_trigger(camera, &settings.trigger)?;

    let payload = camera.payload().map_err(|e| refused("PayloadSize", &e))? as usize;
    let expected = settings.frame_bytes();
    if payload != expected {
        let why = format!("{} x {} {format} has {expected} bytes, the camera sends {payload}", settings.width, settings.height);
        return Err(DeviceError::Camera { what: "PayloadSize".into(), why });
    }
    Ok(())
}

/// Sets what begins an exposure, and reads it back.
pub(super) fn set_trigger(camera: &aravis::Camera, trigger: &Trigger) -> Result<(), DeviceError> {
    let source = match trigger {
        Trigger::Software => "Software",
        Trigger::Line(line) => line,
        Trigger::FixedRateHz(rate) => return set_free_run(camera, *rate).map(|_| ()),
    };
    let what = format!("TriggerSource = {source}");
    camera.set_trigger(source).map_err(|e| refused(&what, &e))?;
    for (name, expected) in [("TriggerMode", "On"), ("TriggerSource", source)] {
        let found = camera.string(name).map_err(|e| refused(name, &e))?;
        if found != expected {
            return Err(DeviceError::Camera { what, why: format!("the camera has {name} = {found} instead of {expected}") });
        }
    }
    Ok(())
}

/// Lets the camera take frames by itself. Returns the rate that it reports, Hz.
pub(super) fn set_free_run(camera: &aravis::Camera, rate_hz: f64) -> Result<f64, DeviceError> {
    camera.clear_triggers().map_err(|e| refused("TriggerMode = Off", &e))?;
    let what = format!("frame rate = {rate_hz} Hz");
    // Aravis silently clamps a rate that is out of range.
    let (least, most) = camera.frame_rate_bounds().map_err(|e| refused(&what, &e))?;
    if !(least..=most).contains(&rate_hz) {
        return Err(DeviceError::Camera { what, why: format!("this camera takes {least} to {most} Hz as it is configured") });
    }
    camera.set_frame_rate(rate_hz).map_err(|e| refused(&what, &e))?;
    let found = camera.frame_rate().map_err(|e| refused(&what, &e))?;
    if (found / rate_hz - 1.0).abs() > RATE_TOLERANCE {
        return Err(DeviceError::Camera { what, why: format!("the camera sets {found} Hz; choose a rate that it takes") });
    }
    Ok(found)
}

/// Sets the gain. A camera has either `Gain` or `GainRaw`, and the configured value for that one is used.
fn set_gain(camera: &aravis::Camera, settings: &AravisSettings) -> Result<(), DeviceError> {
    if settings.gain.is_none() && settings.gain_raw.is_none() {
        return Ok(());
    }
    let has = |name| camera.is_feature_available(name).map_err(|e| refused(name, &e));
    let (has_gain, has_raw) = (has("Gain")?, has("GainRaw")?);
    match (settings.gain.filter(|_| has_gain), settings.gain_raw.filter(|_| has_raw)) {
        (Some(gain), _) => camera.set_float("Gain", gain).map_err(|e| refused(&format!("Gain = {gain}"), &e)),
        (None, Some(raw)) => camera.set_integer("GainRaw", raw).map_err(|e| refused(&format!("GainRaw = {raw}"), &e)),
        (None, None) => {
            let way_out = match (has_gain, has_raw) {
                (true, _) => "this camera has no GainRaw; configure `gain`, in its unit",
                (false, true) => "this camera has no Gain; configure `gain_raw`, in its integer scale",
                (false, false) => "this camera has neither Gain nor GainRaw; leave both keys out",
            };
            Err(DeviceError::Camera { what: "gain".into(), why: way_out.into() })
        }
    }
}
