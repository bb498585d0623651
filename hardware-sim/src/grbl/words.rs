//! A line of G-code as letters and numbers.

/// One letter with its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Word {
    pub letter: u8,
    pub value: f32,
}

/// Splits a line without white space. The error is Grbl's number.
pub(super) fn split(line: &[u8]) -> Result<Vec<Word>, u8> {
    let mut words = Vec::new();
    let mut rest = line;
    while let [letter, tail @ ..] = rest {
        if !letter.is_ascii_uppercase() {
            return Err(1);
        }
        let (value, used) = number(tail).ok_or(2)?;
        words.push(Word { letter: *letter, value });
        rest = &tail[used..];
    }
    Ok(words)
}

/// The number at the start of `text`, and its length in bytes. Grbl has no exponents.
pub(super) fn number(text: &[u8]) -> Option<(f32, usize)> {
    let sign = usize::from(matches!(text.first(), Some(b'+' | b'-')));
    let digits = text[sign..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
    let taken = std::str::from_utf8(&text[..sign + digits]).ok()?;
    // Two points, or only a point, are not a number.
    let value: f32 = taken.parse().ok()?;
    Some((value, sign + digits))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_their_errors() {
        let w = split(b"G1X-1.5F.25").unwrap();
        assert_eq!(w.iter().map(|w| (w.letter, w.value)).collect::<Vec<_>>(), [(b'G', 1.0), (b'X', -1.5), (b'F', 0.25)]);
        assert_eq!(split(b"1X").unwrap_err(), 1);
        assert_eq!(split(b"GX").unwrap_err(), 2);
        assert_eq!(split(b"X1.2.3").unwrap_err(), 2);
        assert_eq!(split(b"X.").unwrap_err(), 2);
        assert!(split(b"").unwrap().is_empty());
    }
}
