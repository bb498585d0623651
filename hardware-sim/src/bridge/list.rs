//! The list of stops of the machine, `external.txt`.
//!
//! ```text
//! tomography  x_position  degrees  ctrl_output  trigger_input  adjust_rotation  tray_LED      tabs, decimal comma
//! no          0           3,60     1            1              no               off
//! ```
//! The columns and words are those of the public writer (`github.com/JensVanBijs/vast_automation`). It writes positions from 0 to less than
//! 360 deg, and `no` and `off` only; `yes` and `on` are accepted as their counterparts.

/// The degrees of every line. A text that is not a valid list gives no degrees, and the machine then does not begin.
pub(super) fn degrees(text: &str) -> Vec<f64> {
    text.lines().map(line).collect::<Option<_>>().unwrap_or_default()
}

fn line(line: &str) -> Option<f64> {
    let columns: Vec<&str> = line.split('\t').collect();
    let [tomography, x_position, degrees, ctrl_output, trigger_input, adjust_rotation, tray_led] = columns[..] else { return None };
    let words = [tomography, adjust_rotation].iter().all(|word| matches!(*word, "no" | "yes")) && matches!(tray_led, "off" | "on");
    let lines = [ctrl_output, trigger_input].iter().all(|line| matches!(*line, "1" | "2"));
    number(x_position)?;
    let degrees = number(degrees)?;
    (words && lines && (0.0..360.0).contains(&degrees)).then_some(degrees)
}

/// A number with a decimal comma, as a Dutch Windows writes it. A decimal point is an error.
fn number(text: &str) -> Option<f64> {
    if text.contains('.') { None } else { text.replace(',', ".").parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the public program writes: 100 positions, the last of which is 360 deg.
    fn of_the_public_writer() -> String {
        let position = |i: u32| format!("{},{}0", i * 36 % 3600 / 10, i * 36 % 10);
        (1..=100).map(|i| format!("no\t0\t{}\t1\t1\tno\toff\r\n", position(i))).collect()
    }

    #[test]
    fn the_list_of_the_public_writer_is_read() {
        let read = degrees(&of_the_public_writer());
        assert_eq!((read.len(), read[0], read[9], read[98], read[99]), (100, 3.6, 36.0, 356.4, 0.0));
    }

    #[test]
    fn an_incomplete_or_malformed_list_is_refused() {
        let sound = "no\t0\t0,00\t1\t1\tno\ton\r\nno\t-12,5\t3,60\t1\t1\tno\ton\r\n";
        assert_eq!(degrees(sound), [0.0, 3.6]);
        let spoiled = [
            ("3,60", "3.60"),
            ("3,60", "363,60"),
            ("3,60", "-3,60"),
            ("3,60", "x"),
            ("\tno\ton\r\n", "\tno\r\n"),
            ("\t", ","),
            ("\tno\ton\r\n", "\t0\t1\r\n"),
            ("no\t0\t", "1\t0\t"),
        ];
        for (from, to) in spoiled {
            assert!(sound.contains(from) && degrees(&sound.replace(from, to)).is_empty(), "{from:?} as {to:?}");
        }
        assert!(degrees(&sound[..sound.len() - 5]).is_empty(), "an incomplete line");
    }
}
