//! Messages of the bridge: `OK`, `R1`, `R2`, `E0` to `E3`, one per line.
//!
//! A line whose end was lost is merged with the next one (`OKR1`). All messages have two characters, so they can still be separated.

/// A message of the bridge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::rotation) enum Message {
    /// The answer to a request, or the greeting after a start.
    Ok,
    /// VAST's IN.1: in position.
    Arrived,
    /// VAST's IN.2.
    Second,
    /// The bridge could not serve a request, by its number.
    Error(u8),
    /// A line of settings, or noise.
    Other(String),
}

/// The messages of a line. A line with anything else in it is one [`Message::Other`].
pub(in crate::rotation) fn of(line: &str) -> Vec<Message> {
    let line = line.trim();
    let mut rest = line;
    let mut found = Vec::new();
    while let Some((word, after)) = rest.split_at_checked(2) {
        found.push(match word {
            "OK" => Message::Ok,
            "R1" => Message::Arrived,
            "R2" => Message::Second,
            "E0" => Message::Error(0),
            "E1" => Message::Error(1),
            "E2" => Message::Error(2),
            "E3" => Message::Error(3),
            _ => return vec![Message::Other(line.to_owned())],
        });
        rest = after.trim_start();
    }
    if rest.is_empty() { found } else { vec![Message::Other(line.to_owned())] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_are_distinguished_in_merged_lines_and_noise_is_none_of_them() {
        assert_eq!(of("OK\r"), [Message::Ok]);
        assert_eq!(of("OKR1"), [Message::Ok, Message::Arrived]);
        assert_eq!(of("R1 OKE3"), [Message::Arrived, Message::Ok, Message::Error(3)]);
        assert_eq!(of(""), []);
        for noise in ["R", "OKR", "R3", "E4", "ok", "xR1", "R1\u{fffd}", "pulse 50 ms"] {
            assert_eq!(of(noise), [Message::Other(noise.into())], "{noise:?}");
        }
    }

    proptest! {
        #[test]
        fn any_line_is_read(line in ".{0,40}") {
            of(&line);
        }
    }
}
