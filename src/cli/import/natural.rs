//! Names in the order in which a person counts: view2 before view10.

use std::cmp::Ordering;

/// Runs of digits and what stands between them.
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

/// Numbers by their value, letters whether large or small.
pub(super) fn natural(a: &str, b: &str) -> Ordering {
    let is_number = |c: &str| c.as_bytes().first().is_some_and(u8::is_ascii_digit);
    for (x, y) in chunks(a).into_iter().zip(chunks(b)) {
        let order = if is_number(x) && is_number(y) {
            let (x, y) = (x.trim_start_matches('0'), y.trim_start_matches('0'));
            x.len().cmp(&y.len()).then_with(|| x.cmp(y))
        } else {
            x.to_lowercase().cmp(&y.to_lowercase())
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    chunks(a).len().cmp(&chunks(b).len()).then_with(|| a.cmp(b))
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
