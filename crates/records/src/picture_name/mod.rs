//! Reads the name of a picture, by a user's pattern or by the names that VAST's programs use.
//!
//! ```text
//!  2021.10.11_5dpf_tail_W_A02_1_4_rot.tiff     date, age, well, fish, view; `_rot` and other words at the end are ignored
//!  W_A02_1_4.tiff   A02_4.tiff                 the fish may be missing
//!  Well_A02/VAST_1_4.tiff                      the well of the nearest folder with the name of a well
//! ```

mod pattern;

pub use pattern::{Pattern, PatternError};

use crate::PlateFormat;
use crate::plate_map::well_of;
use pattern::Field;
use std::collections::BTreeMap;
use std::path::Path;

/// Extensions of readable pictures.
pub const ENDINGS: [&str; 6] = ["png", "jpg", "jpeg", "bmp", "tif", "tiff"];

/// Whether a name has the extension of a picture. Names that begin with a dot are excluded.
pub fn is_picture(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) && !is_hidden
}

/// The content of a name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Label {
    /// `A01` to `AF48`; a name without a pattern names wells up to `P24`.
    pub well: Option<String>,
    /// Number of the fish in its well.
    pub fish: Option<u32>,
    /// Number of the view, as in the name.
    pub view: u32,
    /// Days post fertilisation.
    pub dpf: Option<f64>,
    /// Marks that distinguish plates: names of folders without that of the well, date, plate.
    pub group: Group,
}

/// Marks that pictures of one plate share.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Group {
    pub folder: String,
    pub date: Option<String>,
    pub plate: Option<String>,
}

impl std::fmt::Display for Group {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let folder = if self.folder.is_empty() { "the folder itself" } else { self.folder.as_str() };
        write!(f, "{folder}")?;
        self.date.iter().try_for_each(|date| write!(f, ", date {date}"))?;
        self.plate.iter().try_for_each(|plate| write!(f, ", plate {plate}"))
    }
}

/// Reads a path relative to the named folder. `None` if it does not name a view.
pub fn read(path: &Path, pattern: Option<&Pattern>) -> Option<Label> {
    let path = path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
    match pattern {
        Some(pattern) => of_fields(&path, &pattern.fields(&format!("/{path}"))?),
        None => of_vast(&path),
    }
}

fn of_fields(path: &str, fields: &BTreeMap<Field, String>) -> Option<Label> {
    let text = |field| fields.get(&field).map(String::as_str);
    // An invalid field means that the name does not match.
    let number = |field| text(field).map(str::parse::<u32>).transpose().ok();
    let well = match text(Field::Well) {
        Some(written) => Some(well_of(written)?),
        None => None,
    };
    let (well, folder) = in_folders(path, well);
    Some(Label {
        well,
        fish: number(Field::Fish)?,
        view: number(Field::View)??,
        dpf: text(Field::Age).and_then(age),
        group: Group { folder, date: text(Field::Date).map(str::to_owned), plate: text(Field::Plate).map(str::to_owned) },
    })
}

fn of_vast(path: &str) -> Option<Label> {
    let name = path.rsplit('/').next().unwrap_or(path);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let mut tokens: Vec<&str> = stem.split(['_', '-', ' ']).filter(|t| !t.is_empty()).collect();
    while tokens.len() > 1 && tokens.last().is_some_and(|t| t.chars().all(char::is_alphabetic)) {
        tokens.pop();
    }
    let number = |token: Option<&&str>| token.filter(|t| t.bytes().all(|b| b.is_ascii_digit())).and_then(|t| t.parse::<u32>().ok());
    let view = number(tokens.last())?;
    tokens.pop();
    let fish = number(tokens.last());
    if fish.is_some() {
        tokens.pop();
    }
    // The well is beside the numbers. `W` before it is not needed.
    let well = tokens.last().and_then(|token| well_of_vast(token));
    let (well, folder) = in_folders(path, well);
    // Without a well, any numbered picture would be read as a view.
    well.as_ref()?;
    let is_date = |t: &&str| t.bytes().filter(u8::is_ascii_digit).count() >= 6 && t.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    Some(Label {
        well,
        fish,
        view,
        dpf: tokens.iter().find_map(|t| age(t.to_lowercase().strip_suffix("dpf")?)),
        group: Group { folder, date: tokens.iter().copied().find(|t| is_date(t)).map(str::to_owned), plate: None },
    })
}

/// A well on a plate that VAST takes. On larger plates words such as `AB12` and `Z9` would be wells, too.
fn well_of_vast(word: &str) -> Option<String> {
    well_of(word).filter(|well| PlateFormat { rows: 16, columns: 24 }.holds(well))
}

fn age(text: &str) -> Option<f64> {
    text.replacen(',', ".", 1).parse().ok().filter(|age: &f64| age.is_finite())
}

/// The well of the name, or of the nearest folder with the name of one well, and the other folders.
fn in_folders(path: &str, well: Option<String>) -> (Option<String>, String) {
    let mut folders: Vec<&str> = path.split('/').collect();
    folders.pop();
    let of_folder = |name: &str| {
        let wells: Vec<String> = name.split(['_', '-', ' ']).filter_map(well_of_vast).collect();
        if let [well] = &wells[..] { Some(well.clone()) } else { None }
    };
    // A plate's folder may have a name such as P1. It is read as a well only if the name of the picture contains no well.
    let at = folders.iter().rposition(|name| of_folder(name).is_some_and(|w| well.as_ref().is_none_or(|well| *well == w)));
    let named = at.and_then(|at| of_folder(folders.remove(at)));
    (well.or(named), folders.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(path: &str, pattern: Option<&str>) -> Option<String> {
        let pattern = pattern.map(|p| Pattern::read(p).unwrap());
        let Label { well, fish, view, dpf, group } = read(Path::new(path), pattern.as_ref())?;
        let date = group.date.as_deref().unwrap_or("-");
        Some(format!("{} {fish:?} {view} {dpf:?} {date} [{}]", well.as_deref().unwrap_or("-"), group.folder).replace("Some", ""))
    }

    #[test]
    fn names_of_vast_are_understood() {
        for (path, expected) in [
            ("2021.10.11_5dpf_tail_W_A02_1_1_rot.tiff", "A02 (1) 1 (5.0) 2021.10.11 []"),
            ("20211011_3,5dpf_W_h7_2_12.png", "H07 (2) 12 (3.5) 20211011 []"),
            ("W_A02_1_4.tiff", "A02 (1) 4 None - []"),
            ("W_A02_1_4_rot_crop.tiff", "A02 (1) 4 None - []"),
            ("A2_4.tiff", "A02 None 4 None - []"),
            ("B12/VAST_1_4.tiff", "B12 (1) 4 None - []"),
            ("P1/Well_B12/VAST_3_4_rot.tiff", "B12 (3) 4 None - [P1]"),
            ("P1/W_A02_1_4.tiff", "A02 (1) 4 None - [P1]"),
            ("P1/A02/W_A02_1_4.tiff", "A02 (1) 4 None - [P1]"),
        ] {
            assert_eq!(said(path, None).as_deref(), Some(expected), "{path}");
        }
        for path in ["VAST_1_4.tiff", "overview.png", "W_A02.tiff", "W_A02_1_99999999999.tiff", "W_Z9_1_4.tiff"] {
            assert_eq!(said(path, None), None, "{path}");
        }
    }

    #[test]
    fn a_pattern_reads_other_names() {
        let of = |path, pattern| said(path, Some(pattern));
        assert_eq!(of("x/d3-F2-v4-C05.png", "d{age}-F{fish}-v{view}-{well}").unwrap(), "C05 (2) 4 (3.0) - [x]");
        assert_eq!(of("C05/v4.png", "v{view}").unwrap(), "C05 None 4 None - []");
        assert_eq!(of("v4.png", "v{view}").unwrap(), "- None 4 None - []");
        assert_eq!(of("AF48_v4.png", "{well}_v{view}").unwrap(), "AF48 None 4 None - []");
        assert_eq!(of("Z99_v4.png", "{well}_v{view}"), None);
        assert_eq!(of("A01_v99999999999.png", "{well}_v{view}"), None);
    }
}
