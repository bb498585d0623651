//! Sorts names in natural order: view2 before view10.
//!
//! No crate fits: `natord` is no longer maintained, `alphanumeric-sort` compares upper and lower case, and neither gives names that
//! compare equal a fixed order.

use std::cmp::Ordering;

/// Splits a name into runs of digits and the text between them.
pub(super) fn chunks(name: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut from = 0;
    let bytes = name.as_bytes();
    for at in 1..bytes.len() {
        if bytes[at].is_ascii_digit() != bytes[at - 1].is_ascii_digit() {
            found.push(&name[from..at]);
            from = at;
        }
    }
    found.push(&name[from..]);
    found
}

/// Compares numbers by value, and letters without regard to case.
pub(in crate::cli) fn natural(a: &str, b: &str) -> Ordering {
    let (lower_a, lower_b) = (a.to_lowercase(), b.to_lowercase());
    let (mut x, mut y) = (lower_a.as_str(), lower_b.as_str());
    loop {
        let order = match (x.chars().next(), y.chars().next()) {
            (Some(c), Some(d)) if c.is_ascii_digit() && d.is_ascii_digit() => {
                let (m, n) = (digits(&mut x), digits(&mut y));
                m.len().cmp(&n.len()).then_with(|| m.cmp(n))
            }
            (Some(c), Some(d)) => {
                (x, y) = (&x[c.len_utf8()..], &y[d.len_utf8()..]);
                c.cmp(&d)
            }
            // The longer name comes after its prefix. Names that compare equal still need a fixed order.
            (None, None) => return a.cmp(b),
            (c, d) => return c.cmp(&d),
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Takes the number at the front of the text, without its leading zeros.
fn digits<'a>(text: &mut &'a str) -> &'a str {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    *text = rest;
    number.trim_start_matches('0')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_by_their_value() {
        let sorted = ["0.72.png", "9.36.png", "10.08.png", "view.png", "view1.png", "View2.png", "view002b.png", "view10.png", "ä3.png"];
        let mut names = sorted;
        names.reverse();
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, sorted);
        assert_eq!(natural("", "a"), Ordering::Less);
    }
}
