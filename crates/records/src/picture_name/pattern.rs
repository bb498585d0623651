//! A user's pattern for the names of pictures.
//!
//! ```text
//!  {date}_{age}dpf_{_}_W_{well}_{fish}_{view}_rot.tiff
//!  {well}/VAST_{fish}_{view}                            with folders; without an extension it matches any picture
//! ```
//! A number is always read completely: `{fish}` never matches a part of its digits. The case of letters is ignored.

use std::collections::{BTreeMap, BTreeSet};

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Field {
    Well,
    Fish,
    View,
    Age,
    Date,
    Plate,
    /// `{_}`: any text.
    Any,
}

impl Field {
    const ALL: [(&'static str, Self); 7] = [
        ("well", Self::Well),
        ("fish", Self::Fish),
        ("view", Self::View),
        ("age", Self::Age),
        ("date", Self::Date),
        ("plate", Self::Plate),
        ("_", Self::Any),
    ];

    fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, field)| *field)
    }

    /// Possible lengths of the field at the beginning of a text, preferred length first.
    fn lengths(self, text: &str) -> Vec<usize> {
        let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        match self {
            Self::Well => {
                let letters = text.bytes().take_while(u8::is_ascii_alphabetic).count();
                let column = digits(&text[letters..]);
                // The rows AA to AF of a plate of 1536. In `dataB02` the row is B.
                let is_row = match &text.as_bytes()[..letters] {
                    [_] => true,
                    [b'A', second] => second.is_ascii_uppercase(),
                    [b'a', second] => second.is_ascii_lowercase(),
                    _ => false,
                };
                if is_row && (1..=2).contains(&column) { vec![letters + column] } else { Vec::new() }
            }
            Self::Fish | Self::View => Some(digits(text)).filter(|n| *n > 0).into_iter().collect(),
            Self::Age => {
                let whole = digits(text);
                let part = text[whole..].strip_prefix(['.', ',']).map_or(0, digits);
                let lengths = [(part > 0, whole + 1 + part), (true, whole)];
                lengths.into_iter().filter(|(is, _)| *is && whole > 0).map(|(_, n)| n).collect()
            }
            Self::Date | Self::Plate | Self::Any => {
                let end = text.find('/').unwrap_or(text.len());
                text[..end].char_indices().map(|(at, c)| at + c.len_utf8()).collect()
            }
        }
    }

    fn is_number(self) -> bool {
        matches!(self, Self::Fish | Self::View | Self::Age)
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Part {
    Text(String),
    Field(Field),
}

/// A pattern with a mistake.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    #[error("found }} without {{ before it; expected fields as {}", known())]
    NotOpened,
    #[error("found {{{rest} without }}; expected fields as {}", known())]
    NotClosed { rest: String },
    #[error("found {{{name}}}, expected one of {}", known())]
    Unknown { name: String },
    #[error("found {{{name}}} twice, expected it once; {{_}} stands for a text that is not used")]
    Twice { name: String },
    #[error("found no {{view}}, which gives a picture its angle; the fields are {}", known())]
    NoView,
}

/// The names of all fields.
fn known() -> String {
    Field::ALL.iter().map(|(name, _)| format!("{{{name}}}")).collect::<Vec<_>>().join(", ")
}

/// A pattern for the names of pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    parts: Vec<Part>,
    /// Number of folders before the name.
    folders: usize,
    /// Whether it ends with the extension of a picture.
    has_ending: bool,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// A field is unknown, occurs twice or is not closed, or the pattern has no `{view}`.
    pub fn read(text: &str) -> Result<Self, PatternError> {
        let mut parts: Vec<Part> = Vec::new();
        let mut named = BTreeSet::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            if before.contains('}') {
                return Err(PatternError::NotOpened);
            }
            if !before.is_empty() {
                parts.push(Part::Text(before.to_lowercase()));
            }
            let (name, after) = after.split_once('}').ok_or_else(|| PatternError::NotClosed { rest: after.to_owned() })?;
            let field = Field::named(name).ok_or_else(|| PatternError::Unknown { name: name.to_owned() })?;
            if field != Field::Any && !named.insert(field) {
                return Err(PatternError::Twice { name: name.to_owned() });
            }
            parts.push(Part::Field(field));
            rest = after;
        }
        if rest.contains('}') {
            return Err(PatternError::NotOpened);
        }
        if !rest.is_empty() {
            parts.push(Part::Text(rest.to_lowercase()));
        }
        if !named.contains(&Field::View) {
            return Err(PatternError::NoView);
        }
        let has_ending = super::is_picture(std::path::Path::new(text));
        Ok(Self { parts, folders: text.matches('/').count(), has_ending })
    }

    /// The fields of a path with `/` between its folders. `None` if the path does not match.
    pub(super) fn fields(&self, path: &str) -> Option<BTreeMap<Field, String>> {
        let mut from = path.len();
        for _ in 0..=self.folders {
            from = path[..from].rfind('/')?;
        }
        let text = &path[from + 1..];
        let text = if self.has_ending { text } else { text.rsplit_once('.').map_or(text, |(stem, _)| stem) };
        let mut search = Search { parts: &self.parts, text, failed: BTreeSet::new(), found: Vec::new() };
        search.from(0, 0).then(|| search.found.into_iter().map(|(field, at, end)| (field, text[at..end].to_owned())).collect())
    }
}

/// A backtracking search. Failed choices are remembered, so that the search is fast for any pattern.
struct Search<'a> {
    parts: &'a [Part],
    text: &'a str,
    failed: BTreeSet<(usize, usize)>,
    found: Vec<(Field, usize, usize)>,
}

impl Search<'_> {
    fn from(&mut self, part: usize, at: usize) -> bool {
        let Some(next) = self.parts.get(part) else { return at == self.text.len() };
        if self.failed.contains(&(part, at)) {
            return false;
        }
        let rest = &self.text[at..];
        let matches = match next {
            Part::Text(text) => rest.get(..text.len()).is_some_and(|t| t.to_lowercase() == *text) && self.from(part + 1, at + text.len()),
            Part::Field(field) => {
                let splits_number = field.is_number()
                    && part > 0
                    && matches!(self.parts[part - 1], Part::Field(_))
                    && self.text[..at].ends_with(|c: char| c.is_ascii_digit());
                !splits_number && self.field(*field, part, at)
            }
        };
        if !matches {
            self.failed.insert((part, at));
        }
        matches
    }

    fn field(&mut self, field: Field, part: usize, at: usize) -> bool {
        for length in field.lengths(&self.text[at..]) {
            let known = self.found.len();
            if field != Field::Any {
                self.found.push((field, at, at + length));
            }
            if self.from(part + 1, at + length) {
                return true;
            }
            self.found.truncate(known);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(pattern: &str, path: &str) -> Option<String> {
        let fields = Pattern::read(pattern).unwrap().fields(&format!("/{path}"))?;
        Some(fields.values().map(String::as_str).collect::<Vec<_>>().join(" "))
    }

    #[test]
    fn fields_are_found_in_names_and_folders() {
        let vast = "{date}_{age}dpf_{_}_W_{well}_{fish}_{view}_rot.tiff";
        for (pattern, path, expected) in [
            (vast, "2021.10.11_5dpf_tail_W_A02_1_4_rot.tiff", Some("A02 1 4 5 2021.10.11")),
            (vast, "2021.10.11_5dpf_tail_W_A02_1_12_ROT.TIFF", Some("A02 1 12 5 2021.10.11")),
            (vast, "2021.10.11_5.5dpf_a_b_W_h12_10_1_rot.tiff", Some("h12 10 1 5.5 2021.10.11")),
            (vast, "2021.10.11_5dpf_tail_W_A02_1_4.tiff", None),
            (vast, "2021.10.11_5dpf_W_A02_1_4_rot.tiff", None),
            ("{well}_{fish}_{view}.tiff", "A02_1_4.tiff", Some("A02 1 4")),
            ("{well}_{fish}_{view}.tiff", "AF48_1_4.tiff", Some("AF48 1 4")),
            ("{_}{well}_{view}", "plateA02_4.tiff", Some("A02 4")),
            ("{_}{well}_{view}", "dataB02_4.tiff", Some("B02 4")),
            ("{_}{well}_{view}", "p_AB02_4.tiff", Some("AB02 4")),
            ("{well}/VAST_{fish}_{view}", "plate/B03/VAST_1_4.png", Some("B03 1 4")),
            ("{well}/VAST_{fish}_{view}", "VAST_1_4.png", None),
            ("{plate}/{_}{view}", "P-1/v12.png", Some("12 P-1")),
            ("{_}{view}", "12.png", None),
            ("v{view}", "v007.png", Some("007")),
            ("{_}{view}µ", "µ7µ.png", Some("7")),
        ] {
            assert_eq!(found(pattern, path).as_deref(), expected, "{pattern} {path}");
        }
    }

    #[test]
    fn a_pattern_that_means_nothing_is_refused() {
        for (pattern, expected) in [
            ("{well}_{fish}", "found no {view}"),
            ("{wel}_{view}", "found {wel}, expected one of {well}, {fish}"),
            ("{view", "found {view without }"),
            ("view}_{view}", "found } without {"),
            ("{view}}", "found } without {"),
            ("{view}_{view}", "found {view} twice"),
        ] {
            let said = Pattern::read(pattern).unwrap_err().to_string();
            assert!(said.contains(expected), "{pattern}: {said}");
        }
    }

    #[test]
    fn a_search_ends_for_many_wildcards() {
        let name = "a".repeat(250);
        assert_eq!(found(&format!("{}{{view}}", "{_}a".repeat(20)), &format!("{name}.png")), None);
    }
}
