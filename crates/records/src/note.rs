//! What people say about wells: that one is left out of the run, measured again, or is to be read with care. Each says who, and why.

use crate::FieldError;
use serde::{Deserialize, Serialize};

/// Longest name of a person and longest tag, characters.
const SHORT: usize = 64;
/// Longest comment, characters.
const LONG: usize = 1000;
/// Most tags of a well.
const TAGS: usize = 16;

/// Who asks for something, and why. Data of `well.skipped` and `well.redo_requested`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SaidBy {
    /// Name of the person.
    #[cfg_attr(feature = "schema", schema(max_length = 64, pattern = r"\S"))]
    pub by: String,
    /// The reason.
    #[cfg_attr(feature = "schema", schema(max_length = 1000, pattern = r"\S"))]
    pub reason: String,
}

/// A person's remark on a well. A newer one replaces it; the events of the run keep all. Data of `well.noted`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct WellNote {
    /// Name of the person.
    pub by: String,
    /// RFC 3339, UTC.
    pub time: String,
    /// Whether statistics leave the well out. Its numbers stay. The well then has the flag `excluded`.
    pub excluded: bool,
    /// The reason of an exclusion, or any remark. May be empty.
    pub comment: String,
    /// Words to find wells by.
    pub tags: Vec<String>,
}

impl SaidBy {
    /// Every field that is wrong.
    pub fn mistakes(&self) -> Vec<FieldError> {
        [text("/by", &self.by, SHORT, true), text("/reason", &self.reason, LONG, true)].into_iter().flatten().collect()
    }
}

impl WellNote {
    /// Every field that is wrong.
    pub fn mistakes(&self) -> Vec<FieldError> {
        let tags = self.tags.iter().enumerate().filter_map(|(at, tag)| {
            let pointer = format!("/tags/{at}");
            // Tables join the tags of a well by it.
            if tag.contains(';') {
                return Some(FieldError { pointer, detail: "a tag has no semicolon".into() });
            }
            text(&pointer, tag, SHORT, true)
        });
        let many = (self.tags.len() > TAGS)
            .then(|| FieldError { pointer: "/tags".into(), detail: format!("{} tags; a well has at most {TAGS}", self.tags.len()) });
        [text("/by", &self.by, SHORT, true), text("/comment", &self.comment, LONG, self.excluded)]
            .into_iter()
            .flatten()
            .chain(tags)
            .chain(many)
            .collect()
    }

    /// The remark when its well is measured again. An exclusion was said of the measurement before, and ends with it: its comment says so,
    /// cut to the most characters of a comment. The event of the remark keeps the whole.
    #[must_use]
    pub fn measured_again(self) -> Self {
        if !self.excluded {
            return self;
        }
        let comment = format!("the measurement before was left out of statistics: {}", self.comment);
        Self { excluded: false, comment: comment.chars().take(LONG).collect(), ..self }
    }

    /// Whether it says the same, whenever that was.
    pub fn says_the_same(&self, other: &Self) -> bool {
        (&self.by, self.excluded, &self.comment, &self.tags) == (&other.by, other.excluded, &other.comment, &other.tags)
    }
}

fn text(pointer: &str, text: &str, most: usize, is_needed: bool) -> Option<FieldError> {
    let detail = if is_needed && text.trim().is_empty() {
        "it is empty".to_owned()
    } else if text.chars().count() > most || text.chars().any(char::is_control) {
        format!("use at most {most} characters of one line; these are {}", text.chars().count())
    } else {
        return None;
    };
    Some(FieldError { pointer: pointer.to_owned(), detail })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_names_its_person_and_an_exclusion_its_reason() {
        let note = |by: &str, excluded, comment: &str, tags: &[&str]| WellNote {
            by: by.into(),
            time: String::new(),
            excluded,
            comment: comment.into(),
            tags: tags.iter().map(|&tag| tag.into()).collect(),
        };
        let wrong = |note: WellNote| note.mistakes().into_iter().map(|mistake| mistake.pointer).collect::<Vec<_>>();
        assert!(wrong(note("kim", false, "", &["oedema"])).is_empty());
        assert!(wrong(note("kim", true, "two larvae", &[])).is_empty());
        assert_eq!(wrong(note(" ", true, "", &["a;b", ""])), ["/by", "/comment", "/tags/0", "/tags/1"]);
        assert_eq!(wrong(note("kim", false, "two\nlines", &[])), ["/comment"]);
        assert_eq!(wrong(note("kim", false, "", &["t"; 17])), ["/tags"]);
        assert_eq!(SaidBy { by: String::new(), reason: "x".repeat(1001) }.mistakes().len(), 2);
    }

    #[test]
    fn an_exclusion_ends_with_the_measurement_that_it_was_said_of() {
        let said =
            |excluded, comment: String| WellNote { by: "kim".into(), time: "t".into(), excluded, comment, tags: vec!["twin".into()] };
        let again = said(true, "two larvae".into()).measured_again();
        assert_eq!(again, said(false, "the measurement before was left out of statistics: two larvae".into()));
        assert_eq!(again.clone().measured_again(), again, "a third measurement does not change it");
        assert_eq!(said(true, "ü".repeat(LONG)).measured_again().mistakes(), []);
    }
}
