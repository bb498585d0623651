//! Lines of the Zaber ASCII protocol.
//!
//! ```text
//! command   /1 1 06 move abs 32000:A9        device, axis, message id, words, checksum
//! reply     @01 1 06 OK BUSY -- 0:DC         ..., accepted?, moving?, warning flag, data
//! info      #01 1 06 ...                     more about the command of that id
//! alert     !01 1 IDLE --                    not requested
//! ```
//! With the checksum, the sum of all bytes between the first one and the colon is 0 modulo 256.

/// A command, `/1 1 06 words:XX`, with its line end.
pub(super) fn command(device: u8, axis: u8, id: u8, words: &str) -> String {
    let mut content = format!("{device} {axis} {id:02}");
    if !words.is_empty() {
        content = format!("{content} {words}");
    }
    format!("/{content}:{:02X}\n", checksum(&content))
}

/// The stop, without id and checksum, so that noise in them cannot disturb it.
pub(super) fn stop(device: u8, axis: u8) -> String {
    format!("/{device} {axis} stop\n")
}

/// The reply to a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::rotation) struct Reply {
    pub device: u8,
    pub axis: u8,
    pub id: Option<u8>,
    pub accepted: bool,
    pub moving: bool,
    /// The most important flag that is set; `--` if none is.
    pub flag: String,
    /// The answer, or the reason for a refusal.
    pub data: String,
}

/// A line from the controller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::rotation) enum Line {
    /// A reply with a correct checksum.
    Reply(Reply),
    /// A reply without a checksum. Checksums were not switched on, or a restart has switched them off.
    Bare(Reply),
    /// Information or an alert, which answers nothing.
    Aside,
    /// Not a line of this protocol, or one with a wrong checksum.
    Noise,
}

impl Line {
    pub fn parse(text: &str) -> Self {
        // Noise on an idle line, and a line whose end was lost, stand before the next line.
        let Some(begin) = text.rfind(['@', '#', '!']) else { return Self::Noise };
        let Some((content, sum)) = text[begin + 1..].rsplit_once(':') else {
            return reply(&text[begin + 1..]).filter(|_| text[begin..].starts_with('@')).map_or(Self::Noise, Self::Bare);
        };
        if sum.len() != 2 || u8::from_str_radix(sum, 16).ok() != Some(checksum(content)) {
            return Self::Noise;
        }
        match text.as_bytes()[begin] {
            b'@' => reply(content).map_or(Self::Noise, Self::Reply),
            _ => Self::Aside,
        }
    }
}

fn reply(content: &str) -> Option<Reply> {
    let mut words = content.splitn(4, ' ');
    let device = words.next()?.parse().ok()?;
    let axis = words.next()?.parse().ok()?;
    let (id, rest) = match words.next()? {
        verdict @ ("OK" | "RJ") => (None, format!("{verdict} {}", words.next()?)),
        id => (Some(id.parse().ok()?), words.next()?.to_owned()),
    };
    let mut words = rest.splitn(4, ' ');
    let accepted = match words.next()? {
        "OK" => true,
        "RJ" => false,
        _ => return None,
    };
    let moving = match words.next()? {
        "BUSY" => true,
        "IDLE" => false,
        _ => return None,
    };
    let flag = words.next().filter(|flag| flag.len() == 2)?.to_owned();
    Some(Reply { device, axis, id, accepted, moving, flag, data: words.next().unwrap_or_default().to_owned() })
}

fn checksum(content: &str) -> u8 {
    content.bytes().fold(0_u8, u8::wrapping_add).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_are_those_that_zaber_publishes() {
        assert_eq!(command(1, 1, 6, "move rel 32000"), "/1 1 06 move rel 32000:A9\n");
        let busy = Reply { device: 1, axis: 1, id: Some(6), accepted: true, moving: true, flag: "WR".into(), data: "0".into() };
        assert_eq!(Line::parse("@01 1 06 OK BUSY WR 0:92"), Line::Reply(busy));
        // "01 tools echo" sums to 0x71 modulo 256.
        assert_eq!(checksum("01 tools echo"), 0x8F);
    }

    fn with_sum(content: &str) -> String {
        format!("{content}:{:02X}", checksum(&content[1..]))
    }

    #[test]
    fn replies_with_and_without_id_asides_and_noise_are_distinguished() {
        let Line::Reply(refused) = Line::parse(&with_sum("@02 0 RJ IDLE -- BADCOMMAND")) else { panic!() };
        assert_eq!((refused.id, refused.accepted, refused.data.as_str()), (None, false, "BADCOMMAND"));
        let Line::Reply(words) = Line::parse(&with_sum("@01 1 99 OK IDLE NI 7 8 9")) else { panic!() };
        assert_eq!((words.id, words.data.as_str()), (Some(99), "7 8 9"));
        for aside in ["!01 1 IDLE --", "#01 1 06 some words"] {
            assert_eq!(Line::parse(&with_sum(aside)), Line::Aside);
        }
        assert!(matches!(Line::parse("@01 1 06 OK IDLE WR 0"), Line::Bare(bare) if bare.id == Some(6)));
        let stray = format!("\u{fffd}x{}", with_sum("@01 1 06 OK IDLE -- 0"));
        assert!(matches!(Line::parse(&stray), Line::Reply(_)));
        for noise in ["", "@", "!01 1 06 OK IDLE -- 0", "@01 1 06 OK IDLE -- 0:00", "@01 1 06 OK IDLE -- 0:9", "/1 1 06 stop:23"] {
            assert_eq!(Line::parse(noise), Line::Noise, "{noise}");
        }
        for broken in ["@01 1 06 OK", "@01 1 06 NO IDLE -- 0", "@01 1 06 OK IDLE", "@x 1 06 OK IDLE -- 0", "@01 1 06 OK LAZY -- 0"] {
            assert_eq!(Line::parse(&with_sum(broken)), Line::Noise, "{broken}");
        }
    }

    proptest! {
        #[test]
        fn a_reply_comes_back_as_it_was_and_any_one_flipped_bit_is_seen(
            id in 0_u8..100, value: i32, moving: bool, flag in "(--|FS|WR|NI)", at: prop::sample::Index, bit in 0_u8..7
        ) {
            let state = if moving { "BUSY" } else { "IDLE" };
            let text = with_sum(&format!("@01 1 {id:02} OK {state} {flag} {value}"));
            let sent = Reply { device: 1, axis: 1, id: Some(id), accepted: true, moving, flag, data: value.to_string() };
            prop_assert_eq!(Line::parse(&text), Line::Reply(sent.clone()));
            let mut bytes = text.into_bytes();
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            let flipped = String::from_utf8_lossy(&bytes).into_owned();
            // The case of a hexadecimal digit carries nothing.
            if let Line::Reply(read) = Line::parse(&flipped) {
                prop_assert_eq!(read, sent);
            }
        }

        #[test]
        fn no_line_whatever_panics(text in "\\PC*", printable in "[@#!][ -~]{0,60}") {
            Line::parse(&text);
            Line::parse(&printable);
            Line::parse(&with_sum(&printable));
        }
    }
}
