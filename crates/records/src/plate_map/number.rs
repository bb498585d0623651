//! Reads numbers with a decimal point or a decimal comma, as spreadsheets write them.

/// The decimal sign of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decimal {
    /// The delimiter is a comma. A comma in a number may be a thousands separator.
    Point,
    /// The delimiter is a semicolon, as Excel uses it with a decimal comma.
    Comma,
    /// The delimiter is a tab. The decimal sign is unknown.
    Either,
}

/// Reads a number. The error says why it is invalid or ambiguous.
pub fn read(written: &str, decimal: Decimal) -> Result<f64, String> {
    let signs = written.chars().filter(|c| matches!(c, ',' | '.')).count();
    if signs > 1 {
        return Err(format!("{written:?} is not a number: write it without signs between thousands"));
    }
    let foreign = match decimal {
        Decimal::Point => Some(','),
        Decimal::Comma => Some('.'),
        Decimal::Either => written.chars().find(|&c| c == ','),
    };
    if let Some((head, tail)) = foreign.and_then(|sign| written.split_once(sign)) {
        let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        if digits(head) && digits(tail) && tail.len() == 3 && head.len() <= 3 && !head.starts_with('0') {
            return Err(format!("{written:?} could be {head}{tail} or {head}.{tail}: write {head}{tail} or {head}.{tail}0"));
        }
    }
    let plain = written.replace(',', ".");
    // `inf` and `nan` are valid for `parse`, but not in a plate map.
    plain.parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(|| format!("{written:?} is not a number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn either_decimal_sign_is_read() {
        for (written, decimal, number) in [
            ("0.5", Decimal::Point, 0.5),
            ("0,5", Decimal::Point, 0.5),
            ("0,125", Decimal::Point, 0.125),
            ("1,500", Decimal::Comma, 1.5),
            ("0.125", Decimal::Comma, 0.125),
            ("1.500", Decimal::Either, 1.5),
            ("1e-3", Decimal::Comma, 0.001),
            ("-2", Decimal::Point, -2.0),
            ("1500", Decimal::Point, 1500.0),
            ("1500,125", Decimal::Point, 1500.125),
        ] {
            assert_eq!(read(written, decimal), Ok(number), "{written} {decimal:?}");
        }
    }

    #[test]
    fn what_could_be_a_thousand_times_more_is_refused() {
        for (written, decimal) in [("1,500", Decimal::Point), ("1.500", Decimal::Comma), ("12,500", Decimal::Either)] {
            assert!(read(written, decimal).unwrap_err().contains("could be"), "{written} {decimal:?}");
        }
        for none in ["", "x", "1.000,5", "1,000,000", "nan", "inf", "5 uM", "1 000"] {
            assert!(read(none, Decimal::Point).is_err(), "{none}");
        }
    }
}
