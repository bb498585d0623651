//! Cameras from a file: psi with its angles, or one matrix per view.
//!
//! ```text
//!  {"f": .., "kx": .., .., "omega": [..]}        psi
//!  [[[4], [4], [4]], ..] or [[12], ..]           matrices, row by row
//!  12 numbers per line                           matrices, row by row; blank lines and lines from # on are skipped
//!  a count, then name K R t per line             Middlebury's _par.txt
//! ```

use anyhow::{Context, anyhow, bail};
use carved_core::geometry::Projection;
use carved_offline::silhouettes::{Cameras, Psi};
use nalgebra::{Matrix3, Matrix3x4};
use serde_json::Value;
use std::path::Path;

pub(in crate::cli) fn read(file: &Path) -> anyhow::Result<Cameras> {
    let name = || format!("--cameras {}", file.display());
    let bytes = carved_files::read(file).with_context(|| format!("{}: cannot be read", name()))?;
    let text =
        String::from_utf8(bytes).map_err(|_| anyhow!("{}: found bytes that are no text, expected JSON or lines of 12 numbers", name()))?;
    parse(&text).with_context(name)
}

/// The cameras in the text of such a file.
pub(in crate::cli) fn parse(text: &str) -> anyhow::Result<Cameras> {
    // An editor of Windows begins a file with a byte order mark.
    let text = text.trim_start_matches('\u{feff}');
    match text.trim_start().chars().next() {
        Some('{') => psi(text),
        Some('[') => matrices(text),
        Some(_) if text.lines().find(|l| !l.trim().is_empty()).is_some_and(|l| l.trim().parse::<usize>().is_ok()) => par(text),
        Some(_) => lines(text),
        None => bail!("found an empty file, expected camera.json or 3 x 4 matrices"),
    }
}

fn psi(text: &str) -> anyhow::Result<Cameras> {
    let psi: Psi =
        serde_json::from_str(text).context("expected an object with f, kx, ky, ux, uy, width, height and the angles omega (rad)")?;
    psi.camera.check()?;
    if psi.omega.is_empty() {
        bail!("omega holds 0 angles, expected one per view");
    }
    if let Some((at, angle)) = psi.omega.iter().enumerate().find(|(_, angle)| !angle.is_finite()) {
        bail!("omega holds {angle} at place {at} (counted from 0), expected a finite number of rad");
    }
    Ok(Cameras::Psi(psi))
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
    Ok(Cameras::Matrices { projections, names: None })
}

/// The numbers of a matrix, given as nested or flat lists.
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
    Ok(Cameras::Matrices { projections, names: None })
}

/// Middlebury's `_par.txt`: a count, then a line per image of its name, K, R (each 3 x 3, row by row) and t; P = K [R | t].
fn par(text: &str) -> anyhow::Result<Cameras> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let count: usize = lines.next().and_then(|(_, line)| line.trim().parse().ok()).context("line 1: expected the number of images")?;
    let (mut projections, mut names) = (Vec::new(), Vec::new());
    for (at, line) in lines {
        let place = || format!("line {}", at + 1);
        let words: Vec<&str> = line.split_whitespace().collect();
        let [name, numbers @ ..] = &words[..] else { continue };
        let numbers: Vec<f64> = numbers
            .iter()
            .map(|w| w.parse().map_err(|_| anyhow!("found {w:?} where a number is expected")))
            .collect::<anyhow::Result<_>>()
            .with_context(place)?;
        if numbers.len() != 21 {
            bail!("{}: found {} numbers after the name, expected 21: K and R (3 x 3, row by row) and t", place(), numbers.len());
        }
        let (k, r, t) = (Matrix3::from_row_slice(&numbers[..9]), Matrix3::from_row_slice(&numbers[9..18]), &numbers[18..]);
        let pose = Matrix3x4::from_fn(|i, j| if j < 3 { r[(i, j)] } else { t[i] });
        let p = k * pose;
        projections.push(projection(p.transpose().as_slice()).with_context(place)?);
        names.push((*name).to_owned());
    }
    if projections.len() != count {
        bail!("line 1 announces {count} images, {} follow", projections.len());
    }
    Ok(Cameras::Matrices { projections, names: Some(names) })
}

/// A projection from 12 numbers, row by row.
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
        let expected = Cameras::Matrices { projections: vec![Projection::from_matrix(ROWS).unwrap(); 2], names: None };
        let marked = format!("\u{feff}{nested}");
        for text in [nested, flat, lines, marked] {
            assert_eq!(parse(&text).unwrap(), expected, "{text}");
        }
    }

    /// K [R | t] computed by hand: a quarter turn about x, so that the camera's y is the world's -z.
    #[test]
    fn middleburys_cameras_are_put_together() {
        let line = "a0.png 900 2 500 0 900 400 0 0 1  1 0 0 0 0 -1 0 1 0  0.5 -1 60";
        let Cameras::Matrices { projections, names } = parse(&format!("1\n{line}\n")).unwrap() else { panic!("psi") };
        assert_eq!(names, Some(vec!["a0.png".to_owned()]));
        let rows =
            [[900.0, 500.0, -2.0, 900.0 * 0.5 - 2.0 + 500.0 * 60.0], [0.0, 400.0, -900.0, -900.0 + 400.0 * 60.0], [0.0, 1.0, 0.0, 60.0]];
        assert_eq!(projections, vec![Projection::from_matrix(rows).unwrap()]);
        assert!(format!("{:#}", parse(&format!("2\n{line}\n")).unwrap_err()).contains("announces 2 images, 1 follow"));
        assert!(format!("{:#}", parse("1\na0.png 1 2\n").unwrap_err()).contains("line 2: found 2 numbers after the name"));
    }

    #[test]
    fn psi_comes_with_its_angles() {
        let text = r#"{"f": 6e4, "kx": 0.18, "ky": 0.19, "ux": 511.5, "uy": 510, "width": 1024, "height": 768, "omega": [0, 0.3, -1], "views": 3}"#;
        let Cameras::Psi(psi) = parse(text).unwrap() else { panic!("matrices") };
        assert_eq!((psi.omega, psi.camera.height, psi.camera.ky), (vec![0.0, 0.3, -1.0], 768, 0.19));
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
