//! Cameras from a file: psi with its angles, or one matrix per view.
//!
//! ```text
//!  {"f": .., "kx": .., .., "omega": [..]}        psi
//!  [[[4], [4], [4]], ..] or [[12], ..]           matrices, row by row
//!  12 numbers per line                           matrices, row by row; blank lines and lines from # on are skipped
//! ```

use crate::geometry::{Camera, Projection};
use anyhow::{Context, anyhow, bail};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

#[derive(Debug)]
pub(super) struct Cameras {
    pub projections: Vec<Projection>,
    /// What was counted, for messages.
    pub what: &'static str,
    /// Width and height where the file gives them.
    pub sensor: Option<(usize, usize)>,
}

#[derive(Deserialize)]
struct Psi {
    #[serde(flatten)]
    camera: Camera,
    omega: Vec<f64>,
}

pub(super) fn read(file: &Path) -> anyhow::Result<Cameras> {
    let name = || format!("--cameras {}", file.display());
    let bytes = std::fs::read(file).with_context(|| format!("{}: cannot be read", name()))?;
    let text =
        String::from_utf8(bytes).map_err(|_| anyhow!("{}: found bytes that are no text, expected JSON or lines of 12 numbers", name()))?;
    parse(&text).with_context(name)
}

fn parse(text: &str) -> anyhow::Result<Cameras> {
    match text.trim_start().chars().next() {
        Some('{') => psi(text),
        Some('[') => matrices(text),
        Some(_) => lines(text),
        None => bail!("found an empty file, expected camera.json or 3 x 4 matrices"),
    }
}

fn psi(text: &str) -> anyhow::Result<Cameras> {
    let Psi { camera, omega } =
        serde_json::from_str(text).context("expected an object with f, kx, ky, ux, uy, width, height and the angles omega (rad)")?;
    camera.check()?;
    if omega.is_empty() {
        bail!("omega holds 0 angles, expected one per view");
    }
    let sensor = Some((camera.width as usize, camera.height as usize));
    let projections = omega.iter().map(|&angle| camera.projection(angle)).collect();
    Ok(Cameras { projections, what: "angles in omega", sensor })
}

fn matrices(text: &str) -> anyhow::Result<Cameras> {
    let list: Vec<Value> = serde_json::from_str(text).context("expected a list of 3 x 4 matrices")?;
    let projections = list
        .iter()
        .enumerate()
        .map(|(at, value)| matrix(value).and_then(|rows| projection(&rows)).with_context(|| format!("matrix {at} (counted from 0)")))
        .collect::<anyhow::Result<Vec<_>>>()?;
    if projections.is_empty() {
        bail!("found 0 matrices, expected one per view");
    }
    Ok(Cameras { projections, what: "matrices", sensor: None })
}

/// The numbers of a matrix, nested or flat.
fn matrix(value: &Value) -> anyhow::Result<Vec<f64>> {
    const EXPECTED: &str = "expected 3 rows of 4 numbers, or 12 numbers row by row";
    let Value::Array(items) = value else { bail!("found {}, {EXPECTED}", kind(value)) };
    if items.iter().all(Value::is_array) {
        let lengths: Vec<usize> = items.iter().filter_map(Value::as_array).map(Vec::len).collect();
        if lengths != [4, 4, 4] {
            bail!("found {} rows of lengths {lengths:?}, {EXPECTED}", items.len());
        }
        return items.iter().filter_map(Value::as_array).flatten().map(number).collect();
    }
    if items.len() != 12 {
        bail!("found {} numbers, {EXPECTED}", items.len());
    }
    items.iter().map(number).collect()
}

fn number(value: &Value) -> anyhow::Result<f64> {
    value.as_f64().ok_or_else(|| anyhow!("found {} where a number is expected", kind(value)))
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

fn lines(text: &str) -> anyhow::Result<Cameras> {
    let mut projections = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let place = || format!("line {}", at + 1);
        let words = line.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty());
        let numbers: Vec<f64> = words
            .map(|w| w.parse().map_err(|_| anyhow!("found {w:?} where a number is expected")))
            .collect::<anyhow::Result<_>>()
            .with_context(place)?;
        if numbers.len() != 12 {
            bail!("{}: found {} numbers, expected 12 (3 x 4, row by row)", place(), numbers.len());
        }
        projections.push(projection(&numbers).with_context(place)?);
    }
    if projections.is_empty() {
        bail!("found no matrix, expected lines of 12 numbers");
    }
    Ok(Cameras { projections, what: "matrices", sensor: None })
}

/// `numbers` are 12, row by row.
fn projection(numbers: &[f64]) -> anyhow::Result<Projection> {
    Ok(Projection::from_matrix(std::array::from_fn(|r| std::array::from_fn(|c| numbers[4 * r + c])))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [[f64; 4]; 3] = [[900.0, 2.0, 500.0, 7.0], [1.0, 900.0, 400.0, -3.0], [0.0, 0.0, 1.0, 60.0]];

    fn text_of(rows: &[[f64; 4]; 3]) -> String {
        rows.concat().iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn the_same_matrices_come_from_each_notation() {
        let nested = serde_json::to_string(&[ROWS, ROWS]).unwrap();
        let flat = serde_json::to_string(&[ROWS.concat(), ROWS.concat()]).unwrap();
        let lines = format!("# two views\n{}\n\n  {}  # the second\n", text_of(&ROWS), text_of(&ROWS).replace(' ', ", "));
        let expected = vec![Projection::from_matrix(ROWS).unwrap(); 2];
        for text in [nested, flat, lines] {
            assert_eq!(parse(&text).unwrap().projections, expected, "{text}");
        }
    }

    #[test]
    fn psi_gives_one_projection_per_angle() {
        let text = r#"{"f": 6e4, "kx": 0.18, "ky": 0.19, "ux": 511.5, "uy": 510, "width": 1024, "height": 768, "omega": [0, 0.3, -1], "views": 3}"#;
        let cameras = parse(text).unwrap();
        assert_eq!((cameras.projections.len(), cameras.sensor), (3, Some((1024, 768))));
        assert_ne!(cameras.projections[0], cameras.projections[1]);
    }

    #[test]
    fn what_is_no_camera_is_named_with_what_was_found_and_expected() {
        let refused = |text: &str| format!("{:#}", parse(text).unwrap_err());
        for (text, expected) in [
            ("", "empty file"),
            ("[]", "found 0 matrices"),
            ("[[[1,2,3],[1,2,3],[1,2,3]]]", "matrix 0 (counted from 0): found 3 rows of lengths [3, 3, 3], expected 3 rows of 4"),
            ("[[1,2,3]]", "found 3 numbers, expected 3 rows of 4 numbers, or 12"),
            ("[[1,2,3,4,5,6,7,8,9,10,11,\"x\"]]", "found a string where a number"),
            ("1 2 3 4 5 6 7 8 9 10 11\n", "line 1: found 11 numbers, expected 12"),
            ("1 2 3 4 5 6 7 8 9 10 11 twelve\n", "line 1: found \"twelve\""),
            ("1 0 0 0 0 1 0 0 0 0 0 1\n", "determinant"),
            ("{\"f\": 1}", "missing field"),
            (
                r#"{"f": -6e4, "kx": 0.18, "ky": 0.19, "ux": 511.5, "uy": 510, "width": 1024, "height": 768, "omega": [0]}"#,
                "f is -60000; it must be a finite number above 0",
            ),
        ] {
            let message = refused(text);
            assert!(message.contains(expected), "{text:?}: {message}");
        }
    }
}
