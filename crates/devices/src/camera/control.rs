//! Asks by GigE Vision's own protocol who controls a camera, without opening it.
//!
//! ```text
//!   write "control" to the privilege register ── accepted ──► free: written back to 0 at once
//!                                             └─ denied ────► controlled; the primary application's register tells by whom (GigE Vision 2)
//! ```

use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

const PORT: u16 = 3956;
const WAIT: Duration = Duration::from_millis(300);
const ATTEMPTS: u16 = 3;
const READ_REGISTER: u8 = 0x80;
const WRITE_REGISTER: u8 = 0x82;
const PRIVILEGE: u32 = 0xa00;
const PRIMARY_APPLICATION: u32 = 0xa14;
const CONTROL: u32 = 2;
const ACCESS_DENIED: u16 = 0x8006;

/// The controller of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// The camera is free.
    Nobody,
    /// A program, with its computer's address if the camera tells it.
    Somebody(Option<Ipv4Addr>),
    /// The camera does not answer.
    Unknown,
}

/// Asks the camera at an address who controls it. A free camera is controlled for a moment.
pub fn controller(address: Ipv4Addr) -> Controller {
    asked(address, PORT).unwrap_or(Controller::Unknown)
}

fn asked(address: Ipv4Addr, port: u16) -> Option<Controller> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((address, port)).ok()?;
    socket.set_read_timeout(Some(WAIT)).ok()?;
    let word = |address: u32, value: u32| [address.to_be_bytes(), value.to_be_bytes()].concat();
    match transact(&socket, 1, WRITE_REGISTER, &word(PRIVILEGE, CONTROL))? {
        Ok(_) => {
            transact(&socket, 2, WRITE_REGISTER, &word(PRIVILEGE, 0))?.ok()?;
            Some(Controller::Nobody)
        }
        Err(ACCESS_DENIED) => {
            let register = transact(&socket, 3, READ_REGISTER, &PRIMARY_APPLICATION.to_be_bytes()).and_then(Result::ok);
            Some(Controller::Somebody(register.as_deref().and_then(application)))
        }
        Err(_) => None,
    }
}

/// The data of the answer, or its error status; `None` without an answer.
fn transact(socket: &UdpSocket, id: u16, command: u8, data: &[u8]) -> Option<Result<Vec<u8>, u16>> {
    let [length_high, length_low] = (data.len() as u16).to_be_bytes();
    let [id_high, id_low] = id.to_be_bytes();
    let mut request = vec![0x42, 1, 0, command, length_high, length_low, id_high, id_low];
    request.extend_from_slice(data);
    for _ in 0..ATTEMPTS {
        socket.send(&request).ok()?;
        let mut answer = [0; 576];
        while let Ok(n) = socket.recv(&mut answer) {
            if let Some(found) = answer.get(..n).and_then(|packet| in_packet(packet, command, id)) {
                return Some(found);
            }
        }
    }
    None
}

/// The data of the answer in a packet, or its error status. `None` if it does not answer this request.
fn in_packet(packet: &[u8], command: u8, id: u16) -> Option<Result<Vec<u8>, u16>> {
    let ([status_high, status_low, _, acknowledged, _, _, id_high, id_low], data) = packet.split_first_chunk()?;
    let is_answer = (*acknowledged, u16::from_be_bytes([*id_high, *id_low])) == (command + 1, id);
    let status = u16::from_be_bytes([*status_high, *status_low]);
    is_answer.then(|| if status == 0 { Ok(data.to_vec()) } else { Err(status) })
}

/// The address in the register of the primary application. `None` if it names none.
fn application(register: &[u8]) -> Option<Ipv4Addr> {
    let bits = register.first_chunk().map(|bytes| u32::from_be_bytes(*bytes))?;
    (bits != 0).then(|| bits.into())
}

/// For tests that feed it bytes of any kind: the packet of a camera that tells who controls it.
#[cfg(any(test, feature = "testing"))]
pub fn answer_of_camera(packet: &[u8]) -> Option<Ipv4Addr> {
    application(&in_packet(packet, READ_REGISTER, 3)?.ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera with GigE Vision 2 that has a controller. The first request is lost.
    #[test]
    fn a_camera_that_says_who_has_it_is_understood_and_a_lost_answer_asked_for_again() {
        let camera = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = camera.local_addr().unwrap().port();
        let thread = std::thread::spawn(move || {
            let mut packet = [0; 64];
            camera.recv_from(&mut packet).unwrap();
            for (expected, answer) in [
                (&[0x42, 1, 0, 0x82, 0, 8, 0, 1, 0, 0, 0x0a, 0, 0, 0, 0, 2][..], &[0x80, 0x06, 0, 0x83, 0, 0, 0, 1][..]),
                (&[0x42, 1, 0, 0x80, 0, 4, 0, 3, 0, 0, 0x0a, 0x14][..], &[0, 0, 0, 0x81, 0, 4, 0, 3, 192, 168, 10, 7][..]),
            ] {
                let (n, from) = camera.recv_from(&mut packet).unwrap();
                assert_eq!(&packet[..n], expected);
                camera.send_to(answer, from).unwrap();
            }
        });
        assert_eq!(asked(Ipv4Addr::LOCALHOST, port), Some(Controller::Somebody(Some(Ipv4Addr::new(192, 168, 10, 7)))));
        thread.join().unwrap();
    }
}
