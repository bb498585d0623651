//! Plates of the usual formats, and the names of their wells.
//!
//! ```text
//!       01 02 ... 48
//!   A    .  .      .      rows are letters, A to Z and then AA to AF; columns have two digits
//!   ..                    a plate of 96 wells has the rows A to H and the columns 01 to 12
//!   AF   .  .      .
//! ```

/// A plate by its rows and columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlateFormat {
    /// Number of rows.
    pub rows: u32,
    /// Number of columns.
    pub columns: u32,
}

impl PlateFormat {
    /// The formats, the smallest first: 6, 12, 24, 48, 96, 384 and 1536 wells.
    pub const ALL: [Self; 7] = [
        Self { rows: 2, columns: 3 },
        Self { rows: 3, columns: 4 },
        Self { rows: 4, columns: 6 },
        Self { rows: 6, columns: 8 },
        Self { rows: 8, columns: 12 },
        Self { rows: 16, columns: 24 },
        Self::LARGEST,
    ];

    /// Numbers of wells of plates that need not be stated, below the largest.
    const USUAL: [u32; 2] = [96, 384];

    /// 1536 wells: the plate on which every well has its place.
    const LARGEST: Self = Self { rows: 32, columns: 48 };

    /// The format with this number of wells. `None` if there is no such format.
    pub fn of_wells(wells: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.wells() == wells)
    }

    /// The plate that these wells are shown on: the one with the stated number of wells if it holds them, or else the smallest of 96, 384
    /// and 1536 wells that does. Few wells say nothing about the plate: smaller plates must be stated.
    pub fn shown<'w>(stated: Option<u32>, wells: &(impl Iterator<Item = &'w str> + Clone)) -> Self {
        let holds_all = |format: &Self| wells.clone().all(|well| format.holds(well));
        stated.into_iter().chain(Self::USUAL).filter_map(Self::of_wells).find(holds_all).unwrap_or(Self::LARGEST)
    }

    /// The largest usual format with fewer wells: of 1536 that of 384, of 384 that of 96. `None` of the smallest.
    pub fn next_usual_below(self) -> Option<Self> {
        Self::USUAL.into_iter().rev().filter(|wells| *wells < self.wells()).find_map(Self::of_wells)
    }

    /// Number of wells.
    pub fn wells(self) -> u32 {
        self.rows * self.columns
    }

    /// Whether a well of this name is on the plate.
    pub fn holds(self, well: &str) -> bool {
        place(well).is_some_and(|(row, column)| row < self.rows && column < self.columns)
    }

    /// The well in the last row and column, such as `H12`.
    pub fn last_well(self) -> String {
        name(self.rows - 1, self.columns - 1)
    }

    /// The numbers of wells for a message: `6, 12, 24, 48, 96, 384, 1536`.
    pub fn known() -> String {
        Self::ALL.map(|format| format.wells().to_string()).join(", ")
    }
}

/// Row and column of a well from 0. `None` for a name that no plate has.
pub fn place(well: &str) -> Option<(u32, u32)> {
    let letters = well.bytes().take_while(u8::is_ascii_uppercase).count();
    let (row, column) = well.split_at(letters);
    let row = match row.as_bytes() {
        [letter] => u32::from(letter - b'A'),
        [b'A', letter] => 26 + u32::from(letter - b'A'),
        _ => return None,
    };
    let [tens, ones] = column.as_bytes() else { return None };
    if !(tens.is_ascii_digit() && ones.is_ascii_digit()) {
        return None;
    }
    let column = (u32::from(tens - b'0') * 10 + u32::from(ones - b'0')).checked_sub(1)?;
    (row < PlateFormat::LARGEST.rows && column < PlateFormat::LARGEST.columns).then_some((row, column))
}

/// The name of the well in a row and a column, both from 0.
pub fn name(row: u32, column: u32) -> String {
    let letter = char::from(b'A' + (row % 26) as u8);
    let before = if row < 26 { "" } else { "A" };
    format!("{before}{letter}{:02}", column + 1)
}

/// Whether a name is a well's, on plates of up to 1536 wells: `A01` to `AF48`.
pub fn is_well(name: &str) -> bool {
    place(name).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_places_are_each_others_inverse_on_the_largest_plate() {
        for row in 0..32 {
            for column in 0..48 {
                assert_eq!(place(&name(row, column)), Some((row, column)));
            }
        }
        for (well, at) in [("A01", (0, 0)), ("H12", (7, 11)), ("P24", (15, 23)), ("Z48", (25, 47)), ("AA01", (26, 0)), ("AF48", (31, 47))] {
            assert_eq!(place(well), Some(at), "{well}");
        }
        for wrong in ["", "A", "A1", "A00", "A49", "AG01", "BA01", "AAA01", "a01", "A001", "01", "A0x", "A\u{661}", "Ä01"] {
            assert!(!is_well(wrong), "{wrong}");
        }
    }

    #[test]
    fn a_plate_that_is_not_stated_has_at_least_96_wells() {
        let of = |stated, wells: &[&str]| PlateFormat::shown(stated, &wells.iter().copied()).wells();
        for (wells, expected) in
            [(vec!["A01"], 96), (vec!["A01", "C03"], 96), (vec!["H13"], 384), (vec!["P24", "A01"], 384), (vec!["AF48"], 1536)]
        {
            assert_eq!(of(None, &wells), expected, "{wells:?}");
        }
        assert_eq!((of(Some(24), &["A01", "C03"]), of(Some(384), &["A01"])), (24, 384));
        assert_eq!((of(Some(24), &["H12"]), of(Some(95), &["A01"])), (96, 96), "a plate without these wells, and one that there is not");
    }

    #[test]
    fn each_format_holds_its_own_wells_and_the_next_does_not_end_there() {
        let last: Vec<_> = PlateFormat::ALL.iter().map(|f| (f.wells(), f.last_well())).collect();
        let expected = [(6, "B03"), (12, "C04"), (24, "D06"), (48, "F08"), (96, "H12"), (384, "P24"), (1536, "AF48")];
        assert_eq!(last, expected.map(|(wells, well)| (wells, well.to_owned())));
        for pair in PlateFormat::ALL.windows(2) {
            assert!(pair[1].holds(&pair[0].last_well()) && !pair[0].holds(&pair[1].last_well()));
        }
        assert_eq!(PlateFormat::of_wells(95), None);
        assert_eq!(PlateFormat::of_wells(384), Some(PlateFormat { rows: 16, columns: 24 }));
    }
}
