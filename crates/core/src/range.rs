//! Ranges of settings: one table per settings struct.
//!
//! ```text
//!            ┌─ Ranged::outside ──> messages about values that are out of range
//! RANGES ────┤
//!            └─ in_schema ────────> minimum, maximum and x-unit in the schema of the configuration   (feature `schema`)
//! ```
//! [`ranges!`](crate::ranges) takes the key from the name of the field. A key that is not a field does not compile.

/// A setting that is out of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key} = {found}; expected {least} to {most} {unit}")]
pub struct OutOfRange {
    /// Key of the setting, relative to the table that was checked.
    pub key: String,
    /// The value that was given.
    pub found: f64,
    /// The smallest allowed value.
    pub least: f64,
    /// The largest allowed value.
    pub most: f64,
    /// Unit of the three values.
    pub unit: &'static str,
}

impl OutOfRange {
    /// The same, with the key relative to the table that holds `table`.
    #[must_use]
    pub fn below(self, table: &str) -> Self {
        Self { key: format!("{table}.{}", self.key), ..self }
    }
}

/// One key of the settings `T` with its range. Both ends are allowed.
#[derive(Debug)]
pub struct Range<T> {
    /// The key.
    pub key: &'static str,
    /// Reads the numbers of the key: one, all of a list, or none where the key is left out.
    pub numbers: fn(&T) -> Vec<f64>,
    /// The smallest allowed value.
    pub least: f64,
    /// The largest allowed value.
    pub most: f64,
    /// Unit of the values.
    pub unit: &'static str,
}

/// Settings whose numbers have ranges.
pub trait Ranged: Sized + 'static {
    /// The ranges of the table's own numbers.
    const RANGES: &'static [Range<Self>];

    /// Numbers out of range in the tables inside of this one, with their keys relative to this one.
    fn outside_below(&self) -> Vec<OutOfRange> {
        Vec::new()
    }

    /// Every number that is out of its range. A value that is not a number is in no range.
    fn outside(&self) -> Vec<OutOfRange> {
        let own = Self::RANGES.iter().flat_map(|range| {
            let &Range { key, numbers, least, most, unit } = range;
            let wrong = numbers(self).into_iter().filter(move |found| !(least..=most).contains(found));
            wrong.map(move |found| OutOfRange { key: key.into(), found, least, most, unit })
        });
        own.chain(self.outside_below()).collect()
    }
}

/// Numbers out of range of a table inside of another, with their keys relative to the outer one.
pub fn outside_in(table: &str, settings: &impl Ranged) -> impl Iterator<Item = OutOfRange> {
    settings.outside().into_iter().map(move |breach| breach.below(table))
}

/// What has numbers: a number, a list of them, or one that may be left out.
pub trait Numbers {
    /// The numbers, in the order in which they are written.
    fn numbers(&self) -> Vec<f64>;
}

macro_rules! number {
    ($($exact:ty),*; $($rounded:ty),*) => {
        $(impl Numbers for $exact {
            fn numbers(&self) -> Vec<f64> {
                vec![f64::from(*self)]
            }
        })*
        $(impl Numbers for $rounded {
            fn numbers(&self) -> Vec<f64> {
                vec![*self as f64]
            }
        })*
    };
}

number!(u8, i32, u32, f32, f64; i64, u64, usize);

impl<T: Numbers> Numbers for Option<T> {
    fn numbers(&self) -> Vec<f64> {
        self.as_ref().map_or_else(Vec::new, T::numbers)
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn numbers(&self) -> Vec<f64> {
        self.iter().flat_map(T::numbers).collect()
    }
}

/// The table of [`Ranged::RANGES`]: `field: least, most, unit;` for each number.
#[macro_export]
macro_rules! ranges {
    ($($key:ident: $least:expr, $most:expr, $unit:expr;)*) => {
        &[$($crate::range::Range {
            key: stringify!($key),
            numbers: |settings: &Self| $crate::range::Numbers::numbers(&settings.$key),
            least: $least,
            most: $most,
            unit: $unit,
        }),*]
    };
}

/// Writes the ranges and units of `T` into its schema. The keys of an enum's variants count as keys of the enum.
#[cfg(feature = "schema")]
pub fn in_schema<T: Ranged>(schema: &mut schemars::Schema) {
    fn describe<T>(node: &mut serde_json::Value, range: &Range<T>) {
        if let Some(items) = node.get_mut("items") {
            return describe(items, range);
        }
        let is_integer = node["type"] == "integer" || node["type"][0] == "integer";
        let end = |value: f64| if is_integer { serde_json::Value::from(value as i64) } else { value.into() };
        node["minimum"] = end(range.least);
        node["maximum"] = end(range.most);
        node["x-unit"] = range.unit.into();
    }
    fn key<'a>(node: &'a mut serde_json::Value, key: &str) -> Option<&'a mut serde_json::Value> {
        if node["properties"].get(key).is_some() {
            return node["properties"].get_mut(key);
        }
        node.get_mut("oneOf")?.as_array_mut()?.iter_mut().find_map(|variant| variant.get_mut("properties")?.get_mut(key))
    }
    let mut node = std::mem::take(schema).to_value();
    for range in T::RANGES {
        if let Some(found) = key(&mut node, range.key) {
            describe(found, range);
        }
    }
    if let Ok(described) = schemars::Schema::try_from(node) {
        *schema = described;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Inner {
        pair: [u32; 2],
    }

    struct Outer {
        share: f64,
        left_out: Option<u32>,
        inner: Inner,
    }

    impl Ranged for Inner {
        const RANGES: &'static [Range<Self>] = ranges![pair: 1.0, 9.0, "steps";];
    }

    impl Ranged for Outer {
        const RANGES: &'static [Range<Self>] = ranges![share: 0.0, 1.0, "(share)"; left_out: 3.0, 4.0, "px";];

        fn outside_below(&self) -> Vec<OutOfRange> {
            outside_in("inner", &self.inner).collect()
        }
    }

    #[test]
    fn every_number_out_of_range_is_named_with_its_path_and_both_ends_are_allowed() {
        let said = |share, left_out, pair| -> Vec<String> {
            Outer { share, left_out, inner: Inner { pair } }.outside().iter().map(ToString::to_string).collect()
        };
        assert_eq!(said(0.0, None, [1, 9]), Vec::<String>::new());
        assert_eq!(said(1.0, Some(4), [9, 1]), Vec::<String>::new());
        assert_eq!(
            said(f64::NAN, Some(5), [0, 10]),
            [
                "share = NaN; expected 0 to 1 (share)",
                "left_out = 5; expected 3 to 4 px",
                "inner.pair = 0; expected 1 to 9 steps",
                "inner.pair = 10; expected 1 to 9 steps",
            ]
        );
    }
}
