//! Frames of TMCL: nine bytes in both directions, big endian, the last one the sum of the first eight.
//!
//! ```text
//! request   ADR   CMD  TYPE    MOTOR  VALUE VALUE VALUE VALUE  SUM8
//! reply     HOST  ADR  STATUS  CMD    VALUE VALUE VALUE VALUE  SUM8
//! ```

pub(in crate::rotation) const BYTES: usize = 9;

/// Commands of TMCL that this driver speaks.
mod command {
    pub const STOP: u8 = 3;
    pub const MOVE: u8 = 4;
    pub const SET_AXIS: u8 = 5;
    pub const GET_AXIS: u8 = 6;
    pub const SET_GLOBAL: u8 = 9;
    pub const GET_GLOBAL: u8 = 10;
    pub const SEARCH: u8 = 13;
    pub const SET_OUTPUT: u8 = 14;
    pub const GET_OUTPUT: u8 = 15;
    pub const VERSION: u8 = 136;
}

/// Axis parameters that this driver reads or writes.
pub(super) mod parameter {
    pub const ACTUAL_POSITION: u8 = 1;
    pub const ACTUAL_SPEED: u8 = 3;
    pub const MAX_SPEED: u8 = 4;
    pub const MAX_ACCELERATION: u8 = 5;
    pub const RIGHT_LIMIT: u8 = 10;
    pub const LEFT_LIMIT: u8 = 11;
    pub const MICROSTEP_RESOLUTION: u8 = 140;
    pub const RAMP_DIVISOR: u8 = 153;
    pub const PULSE_DIVISOR: u8 = 154;
    pub const STOP_ON_STALL: u8 = 181;
    pub const LOAD: u8 = 206;
}

/// The bank of the user variables, and the last two of them. They are in RAM, so they are 0 after a reset.
const USER_BANK: u8 = 2;
const MARK: u8 = 55;
/// 1 while the maximum speed is that of a sweep.
const SLOWED: u8 = 54;

/// The bank of the digital outputs, in `SIO` and `GIO`.
const OUTPUT_BANK: u8 = 2;

/// A request to the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Request {
    pub command: u8,
    kind: u8,
    motor: u8,
    value: i32,
}

impl Request {
    const fn new(command: u8, kind: u8, motor: u8, value: i32) -> Self {
        Self { command, kind, motor, value }
    }

    pub fn get(parameter: u8, motor: u8) -> Self {
        Self::new(command::GET_AXIS, parameter, motor, 0)
    }

    pub fn set(parameter: u8, motor: u8, value: i32) -> Self {
        Self::new(command::SET_AXIS, parameter, motor, value)
    }

    /// A move to an absolute position.
    pub fn go(motor: u8, target: i32) -> Self {
        Self::new(command::MOVE, 0, motor, target)
    }

    pub fn stop(motor: u8) -> Self {
        Self::new(command::STOP, 0, motor, 0)
    }

    pub fn search(motor: u8) -> Self {
        Self::new(command::SEARCH, 0, motor, 0)
    }

    fn end_search(motor: u8) -> Self {
        Self::new(command::SEARCH, 1, motor, 0)
    }

    /// Asks whether the search runs; 0 after its end.
    pub fn searching(motor: u8) -> Self {
        Self::new(command::SEARCH, 2, motor, 0)
    }

    /// Asks for type and version as numbers. The other variant of this command answers in letters without a checksum.
    pub fn version() -> Self {
        Self::new(command::VERSION, 1, 0, 0)
    }

    /// `SIO`: switches a digital output.
    pub fn set_output(port: u8, on: bool) -> Self {
        Self::new(command::SET_OUTPUT, port, OUTPUT_BANK, on.into())
    }

    /// `GIO`: reads a digital output back, 0 or 1.
    pub fn output(port: u8) -> Self {
        Self::new(command::GET_OUTPUT, port, OUTPUT_BANK, 0)
    }

    pub fn set_mark(mark: i32) -> Self {
        Self::new(command::SET_GLOBAL, MARK, USER_BANK, mark)
    }

    pub fn mark() -> Self {
        Self::new(command::GET_GLOBAL, MARK, USER_BANK, 0)
    }

    pub fn set_slowed(is_slowed: bool) -> Self {
        Self::new(command::SET_GLOBAL, SLOWED, USER_BANK, is_slowed.into())
    }

    pub fn slowed() -> Self {
        Self::new(command::GET_GLOBAL, SLOWED, USER_BANK, 0)
    }

    pub fn encode(self, module: u8) -> [u8; BYTES] {
        let [a, b, c, d] = self.value.to_be_bytes();
        let mut bytes = [module, self.command, self.kind, self.motor, a, b, c, d, 0];
        bytes[BYTES - 1] = sum8(&bytes);
        bytes
    }
}

impl std::fmt::Display for Request {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { command, kind, motor, value } = self;
        write!(f, "command {command} type {kind} motor {motor} value {value}")
    }
}

/// An answer of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::rotation) struct Reply {
    pub host: u8,
    pub module: u8,
    pub status: u8,
    pub command: u8,
    pub value: i32,
}

impl Reply {
    /// `None` if the checksum is wrong.
    pub fn decode(bytes: [u8; BYTES]) -> Option<Self> {
        let [host, module, status, command, a, b, c, d, sum] = bytes;
        (sum == sum8(&bytes)).then(|| Self { host, module, status, command, value: i32::from_be_bytes([a, b, c, d]) })
    }
}

/// Type and firmware of a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::rotation) struct Version {
    pub module: u16,
    major: u8,
    minor: u8,
}

impl Version {
    /// The request for it, encoded.
    pub fn question(module: u8) -> [u8; BYTES] {
        Request::version().encode(module)
    }

    /// The version in an answer, from any module and to any host; `None` if it is another answer.
    pub fn in_answer(bytes: [u8; BYTES]) -> Option<Self> {
        let reply = Reply::decode(bytes).filter(|r| (r.command, r.status) == (command::VERSION, 100))?;
        Some(Self::of(reply.value))
    }

    /// The type in the upper half, major and minor version in the lower.
    pub fn of(value: i32) -> Self {
        let [a, b, major, minor] = value.to_be_bytes();
        Self { module: u16::from_be_bytes([a, b]), major, minor }
    }

    pub fn firmware(self) -> String {
        format!("{}.{:02}", self.major, self.minor)
    }
}

fn sum8(bytes: &[u8; BYTES]) -> u8 {
    bytes[..BYTES - 1].iter().fold(0, |sum, b| sum.wrapping_add(*b))
}

/// The bytes that stop both motors, in a move and in a search. They work also if the module still waits for the rest of an earlier
/// frame: the same frames are repeated for each of the nine bytes at which its next frame may begin. Each piece is one frame, because
/// the module answers each frame.
pub(super) fn stop_pieces(module: u8, motors: [u8; 2]) -> Vec<Vec<u8>> {
    let pass = |requests: [Request; 2]| {
        let [first, second] = requests.map(|request| request.encode(module).to_vec());
        // The zero after the second frame shifts the next repetition by one byte.
        (0..BYTES).flat_map(move |_| [first.clone(), [second.clone(), vec![0]].concat()])
    };
    pass(motors.map(Request::stop)).chain(pass(motors.map(Request::end_search))).collect()
}

/// The meaning of a status other than "executed".
pub(super) fn status_text(status: u8) -> &'static str {
    match status {
        1 => "wrong checksum",
        2 => "invalid command",
        3 => "wrong type",
        4 => "invalid value",
        5 => "EEPROM locked",
        6 => "command not available",
        128 => "delayed",
        _ => "see TMCL's list of status codes",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_are_those_that_trinamic_publishes() {
        assert_eq!(Request::get(1, 0).encode(1), [0x01, 0x06, 0x01, 0, 0, 0, 0, 0, 0x08]);
        assert_eq!(Request::go(0, -20_000).encode(1), [0x01, 0x04, 0, 0, 0xff, 0xff, 0xb1, 0xe0, 0x94]);
        let reply = Reply { host: 2, module: 1, status: 100, command: 6, value: 76 };
        assert_eq!(Reply::decode([0x02, 0x01, 0x64, 0x06, 0, 0, 0, 0x4c, 0xb9]), Some(reply));
    }

    proptest! {
        #[test]
        fn a_frame_comes_back_as_it_was_and_any_one_flipped_bit_is_seen(
            module: u8, command: u8, kind: u8, motor: u8, value: i32, bit in 0_usize..72
        ) {
            let mut bytes = Request::new(command, kind, motor, value).encode(module);
            // A reply has the same shape: four bytes, a value, the sum.
            let reply = Reply { host: module, module: command, status: kind, command: motor, value };
            prop_assert_eq!(Reply::decode(bytes), Some(reply));
            bytes[bit / 8] ^= 1 << (bit % 8);
            prop_assert_eq!(Reply::decode(bytes), None);
        }

        /// A module in the middle of a frame takes the next nine bytes as they come.
        #[test]
        fn a_stop_is_heard_by_a_module_that_waits_for_the_rest_of_a_frame(half in prop::collection::vec(any::<u8>(), 0..BYTES)) {
            let mut stream = half;
            stream.extend(stop_pieces(1, [0, 1]).concat());
            let heard: Vec<Request> = stream
                .as_chunks::<BYTES>().0
                .iter()
                .filter_map(|frame| Reply::decode(*frame).filter(|r| r.host == 1))
                .map(|r| Request::new(r.module, r.status, r.command, r.value))
                .collect();
            for motor in [0, 1] {
                prop_assert!(heard.contains(&Request::stop(motor)));
                prop_assert!(heard.contains(&Request::end_search(motor)));
            }
            // The first frame may be what was begun; after it nothing but stops is heard.
            let stops = heard.iter().rev().take_while(|r| [command::STOP, command::SEARCH].contains(&r.command)).count();
            prop_assert!(stops + 1 >= heard.len(), "{:?}", heard);
        }
    }
}
