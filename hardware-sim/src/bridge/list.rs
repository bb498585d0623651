//! The list of stops of the machine, `external.txt`.
//!
//! ```text
//! tomography  x_position  degrees  ctrl_output  trigger_input  adjust_rotation  tray_LED      tabs, decimal comma
//! 1           0           3,60     1            1              0                1
//! ```

/// The degrees of every line. A text that is not a valid list gives no degrees, and the machine then does not begin.
pub(super) fn degrees(text: &str) -> Vec<f64> {
    text.lines().map(line).collect::<Option<_>>().unwrap_or_default()
}

fn line(line: &str) -> Option<f64> {
    let columns: Vec<&str> = line.split('\t').collect();
    let [tomography, x_position, degrees, rest @ ..] = columns.as_slice() else { return None };
    let flags = rest.len() == 4 && rest.iter().chain([tomography]).all(|flag| matches!(*flag, "0" | "1"));
    number(x_position)?;
    flags.then(|| number(degrees)).flatten()
}

/// A number with a decimal comma, as a Dutch Windows writes it. A decimal point is an error.
fn number(text: &str) -> Option<f64> {
    if text.contains('.') { None } else { text.replace(',', ".").parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incomplete_or_malformed_list_is_refused() {
        let sound = "1\t0\t0,00\t1\t1\t0\t1\r\n1\t-12,5\t3,60\t1\t1\t0\t1\r\n";
        assert_eq!(degrees(sound), [0.0, 3.6]);
        for (from, to) in [("3,60", "3.60"), ("\t0\t1\r\n", "\t0\r\n"), ("\t", ","), ("3,60", "x"), ("\t0\t1\r\n", "\t2\t1\r\n")] {
            assert!(degrees(&sound.replace(from, to)).is_empty(), "{from:?} as {to:?}");
        }
        assert!(degrees(&sound[..sound.len() - 5]).is_empty(), "an incomplete line");
    }
}
