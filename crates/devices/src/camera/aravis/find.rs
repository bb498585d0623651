//! Finds the camera that the configuration names.

use super::super::Listed;
use super::CameraSelect;
use crate::DeviceError;
use aravis::GvDevice;
use std::net::{Ipv4Addr, UdpSocket};

/// GigE Vision's control port.
const GVCP_PORT: u16 = 3956;
/// So many broadcasts look for a camera. It answers each with one datagram, which a busy computer or network may lose.
const DISCOVERIES: u32 = 2;

pub(super) fn find(select: &CameraSelect) -> Result<aravis::Camera, DeviceError> {
    let not_found = |why: String| DeviceError::Open {
        device: "camera",
        address: select.to_string(),
        why,
        remedy: "Check its power and cable; `carved doctor` lists the cameras that answer",
    };
    let opened = match select {
        CameraSelect::Address(address) => {
            let device = device_at(*address).map_err(not_found)?;
            aravis::Camera::with_device(&device)
        }
        CameraSelect::Id(id) => aravis::Camera::new(Some(id)),
        CameraSelect::Serial(serial) => {
            let id = listed(|camera| camera.serial.as_ref() == Some(serial));
            aravis::Camera::new(Some(&id.map_err(|there| not_found(format!("no camera with this serial number answers; {there}")))?))
        }
        CameraSelect::Mac(mac) => {
            let id = listed(|camera| camera.mac.as_deref().and_then(|found| found.parse().ok()) == Some(*mac));
            aravis::Camera::new(Some(&id.map_err(|there| not_found(format!("no camera with this hardware address answers; {there}")))?))
        }
    };
    opened.map_err(|e| not_found(e.message().into()))
}

/// Opens the device at an address without any discovery, through the interface that leads there.
fn device_at(address: Ipv4Addr) -> Result<GvDevice, String> {
    // Connecting a datagram socket sends nothing. It makes the kernel choose the interface.
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(|e| e.to_string())?;
    socket.connect((address, GVCP_PORT)).map_err(|e| e.to_string())?;
    let here = socket.local_addr().map_err(|e| e.to_string())?.ip();
    let inet = |text: String| gio::InetAddress::from_string(&text).ok_or(format!("{text} is not an address"));
    GvDevice::new(&inet(here.to_string())?, &inet(address.to_string())?).map_err(|e| e.message().to_owned())
}

/// The id of the first camera that fits; otherwise a text with the cameras that answer.
fn listed(fits: impl Fn(&Listed) -> bool) -> Result<String, String> {
    let mut all = Vec::new();
    for _ in 0..DISCOVERIES {
        all = discover();
        if let Some(id) = all.iter().find(|camera| fits(camera)).and_then(|camera| camera.id.clone()) {
            return Ok(id);
        }
    }
    let word = |text: &Option<String>| text.clone().unwrap_or_else(|| "unknown".into());
    let there: Vec<String> = all.iter().map(|c| format!("serial number {}, hardware address {}", word(&c.serial), word(&c.mac))).collect();
    Err(if there.is_empty() { "none does".into() } else { format!("these do: {}", there.join("; ")) })
}

#[allow(unsafe_code)]
pub(in super::super) fn discover() -> Vec<Listed> {
    let text = |pointer: *const std::ffi::c_char| {
        // SAFETY: the list functions return null or a NUL-terminated string that lives until the next update of the
        // list; it is copied before anything else is called.
        (!pointer.is_null()).then(|| unsafe { std::ffi::CStr::from_ptr(pointer) }.to_string_lossy().into_owned())
    };
    // SAFETY: takes no argument; the library locks its list.
    unsafe { aravis_sys::arv_update_device_list() };
    // SAFETY: as above.
    let devices = unsafe { aravis_sys::arv_get_n_devices() };
    (0..devices)
        .map(|index| Listed {
            // SAFETY: any index is allowed, one beyond the list gives null.
            id: text(unsafe { aravis_sys::arv_get_device_id(index) }),
            // SAFETY: as above.
            vendor: text(unsafe { aravis_sys::arv_get_device_vendor(index) }),
            // SAFETY: as above.
            model: text(unsafe { aravis_sys::arv_get_device_model(index) }),
            // SAFETY: as above.
            address: text(unsafe { aravis_sys::arv_get_device_address(index) }),
            // SAFETY: as above.
            serial: text(unsafe { aravis_sys::arv_get_device_serial_nbr(index) }),
            // SAFETY: as above.
            mac: text(unsafe { aravis_sys::arv_get_device_physical_id(index) }),
        })
        .collect()
}
