//! `STEM__SHAPES.json`, the files of FishInspector (github.com/sscholz-UFZ/FishInspector): written to be corrected there, and read as
//! annotations.
//!
//! ```text
//!  { "version": 0.99, "enabled": 1, "imageDimensions": [width, height, channels],
//!    "capillary":   { mode, parameter, shape: [ upper, upper_in, lower, lower_in ] }      a row per column of the picture
//!    "fishContour": { mode, parameter, shape: [ binaryShape, fineContour ] } }            closed outlines
//!                     shape = { name, x: [..], y: [..] }, px, centre of the first pixel (1, 1), x to the right, y down
//! ```
//! Newer releases find outlines by neural networks and store them as `contour_net` (from the side) or `contourDV_net` (from above or below),
//! with one shape each. jsonlab, which FishInspector writes with, leaves a list of one entry out, writes columns as lists of lists and NaN as
//! `"_NaN_"`.

use carved_core::profile::{Line, Polygon, Profile, Walls};
use carved_store::Software;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// How the names of these files end, after the picture's name without its ending.
pub(super) const SUFFIX: &str = "__SHAPES.json";
/// Features that are the outline of the larva. Of two of the same mode the first counts: FishInspector keeps the features of other releases
/// in a file, and the newer release is the one that was used last.
const OUTLINES: [&str; 3] = ["contour_net", "contourDV_net", "fishContour"];
/// The fins of the same releases. The outline of the larva leaves them out.
const FINS: [&str; 2] = ["fin1_net", "fin2_net"];
/// The shape of a feature that FishInspector measures and draws.
const FINE: &str = "fineContour";
/// More vertices are no outline. FishInspector writes about one per px.
const MOST_VERTICES: usize = 50_000;
/// An outline may end this far beyond the picture, px.
const BEYOND_PX: f64 = 2.0;

/// Why a file gives no outline.
#[derive(Debug, thiserror::Error)]
pub(in crate::cli) enum ShapesError {
    #[error("it is not readable JSON ({0}); save the shapes again in FishInspector")]
    NotJson(#[from] serde_json::Error),
    #[error("FishInspector has excluded this picture (\"enabled\" is off); tick the picture in its list")]
    Excluded,
    #[error("it has no outline of the larva (fishContour, contour_net or contourDV_net); draw it in FishInspector and save the shapes")]
    NoOutline,
    #[error("{feature} has no shape fineContour; found {found}; save the shapes again in FishInspector")]
    NoFineContour { feature: &'static str, found: String },
    #[error("{feature} has {x} values of x and {y} of y; save the shapes again in FishInspector")]
    Lengths { feature: &'static str, x: usize, y: usize },
    #[error("{feature} has {found} vertices, expected 3 to {MOST_VERTICES}; draw the outline again in FishInspector")]
    Vertices { feature: &'static str, found: usize },
    #[error("value {index} of {list} of {feature} is {found}, expected a number; draw the outline again in FishInspector")]
    NotANumber { feature: &'static str, list: &'static str, index: usize, found: String },
    #[error("it is of a picture of {} x {} px, this picture is {} x {} px; annotate the picture that is segmented", found[0], found[1], expected[0], expected[1])]
    OtherSize { found: [f64; 2], expected: [usize; 2] },
    #[error("its capillary has {found} columns, this picture has {expected}; annotate the picture that is segmented")]
    OtherWidth { found: usize, expected: usize },
    #[error("{feature} goes to x = {}, y = {}, this picture is {} x {} px; annotate the picture that is segmented", at[0], at[1], expected[0], expected[1])]
    Outside { feature: &'static str, at: [f64; 2], expected: [usize; 2] },
}

/// The outline of the larva in a file.
#[derive(Debug, PartialEq)]
pub(in crate::cli) struct Outline {
    /// The key that it is stored under.
    pub feature: &'static str,
    /// In carved's pixel coordinates: centre of the first pixel (0, 0).
    pub polygon: Polygon,
    /// The outlines of the fins, where they have their own.
    pub fins: Vec<Polygon>,
}

/// The outline in the text of a file of a picture of that size. Other keys are ignored.
pub(in crate::cli) fn read(text: &[u8], size: [usize; 2]) -> Result<Outline, ShapesError> {
    let file: Value = serde_json::from_slice(text)?;
    if file.get("enabled").is_some_and(|on| on.as_bool() == Some(false) || on.as_f64() == Some(0.0)) {
        return Err(ShapesError::Excluded);
    }
    check_size(&file, size)?;
    let with_shape = |feature: &&&'static str| file.get(**feature).is_some_and(|f| !shapes(f).is_empty());
    let is_manual = |feature: &&&'static str| file[**feature]["mode"] == "manual";
    let there = || OUTLINES.iter().filter(with_shape);
    let feature = there().find(is_manual).or_else(|| there().next()).copied().ok_or(ShapesError::NoOutline)?;
    let polygon = polygon(&file, feature, size)?;
    let own_fins = FINS.iter().filter(|fin| feature != "fishContour" && with_shape(fin));
    let fins = own_fins.map(|fin| self::polygon(&file, fin, size)).collect::<Result<_, _>>()?;
    Ok(Outline { feature, polygon, fins })
}

/// The outline of a feature, in carved's pixel coordinates.
fn polygon(file: &Value, feature: &'static str, size: [usize; 2]) -> Result<Polygon, ShapesError> {
    let shapes = shapes(&file[feature]);
    let fine = shapes.iter().find(|shape| shape["name"] == FINE).or_else(|| shapes.first().filter(|_| shapes.len() == 1));
    let Some(fine) = fine else {
        let found: Vec<String> = shapes.iter().map(|shape| shape["name"].to_string()).collect();
        return Err(ShapesError::NoFineContour { feature, found: found.join(", ") });
    };
    let list = |list: &'static str| {
        let not_a_number = |(index, found): (usize, &Value)| ShapesError::NotANumber { feature, list, index, found: found.to_string() };
        numbers(&fine[list]).map_err(not_a_number)
    };
    let (x, y) = (list("x")?, list("y")?);
    if x.len() != y.len() {
        return Err(ShapesError::Lengths { feature, x: x.len(), y: y.len() });
    }
    if !(3..=MOST_VERTICES).contains(&x.len()) {
        return Err(ShapesError::Vertices { feature, found: x.len() });
    }
    let within = |x: f64, length: usize| x >= 0.5 - BEYOND_PX && x <= length as f64 + 0.5 + BEYOND_PX;
    if let Some((&x, &y)) = x.iter().zip(&y).find(|(x, y)| !within(**x, size[0]) || !within(**y, size[1])) {
        return Err(ShapesError::Outside { feature, at: [x, y], expected: size });
    }
    Ok(Polygon { vertices: x.iter().zip(&y).map(|(x, y)| [x - 1.0, y - 1.0]).collect() })
}

/// Newer files state the size of their picture. In older ones the lines of the capillary have an entry per column.
fn check_size(file: &Value, expected: [usize; 2]) -> Result<(), ShapesError> {
    let stated = numbers(&file["imageDimensions"]).unwrap_or_default();
    if let [width, height, ..] = stated[..] {
        // Published files have columns first. MATLAB's own order is rows, columns.
        let is = |columns: f64, rows: f64| (columns - expected[0] as f64).abs() < 0.5 && (rows - expected[1] as f64).abs() < 0.5;
        return if is(width, height) || is(height, width) {
            Ok(())
        } else {
            Err(ShapesError::OtherSize { found: [width, height], expected })
        };
    }
    for line in shapes(&file["capillary"]) {
        let columns = numbers(&line["y"]).map_or(0, |y| y.len());
        if columns > 0 && columns != expected[0] {
            return Err(ShapesError::OtherWidth { found: columns, expected: expected[0] });
        }
    }
    Ok(())
}

/// The shapes of a feature: one, a list, or a list of lists.
fn shapes(feature: &Value) -> Vec<&Value> {
    fn collect<'a>(value: &'a Value, into: &mut Vec<&'a Value>) {
        match value {
            Value::Array(values) => values.iter().for_each(|value| collect(value, into)),
            Value::Object(shape) if !shape.is_empty() => into.push(value),
            _ => {}
        }
    }
    let mut shapes = Vec::new();
    collect(&feature["shape"], &mut shapes);
    shapes
}

/// A number, a list of numbers, a list of lists, or an array that jsonlab annotated. The error is the position and value that is none.
fn numbers(value: &Value) -> Result<Vec<f64>, (usize, &Value)> {
    fn collect<'a>(value: &'a Value, into: &mut Vec<f64>) -> Result<(), (usize, &'a Value)> {
        match value {
            Value::Array(values) => values.iter().try_for_each(|value| collect(value, into)),
            Value::Object(array) if array.contains_key("_ArraySize_") => {
                array.get("_ArrayData_").map_or(Ok(()), |data| collect(data, into))
            }
            _ => {
                into.push(value.as_f64().ok_or((into.len() + 1, value))?);
                Ok(())
            }
        }
    }
    let mut numbers = Vec::new();
    if value.is_null() {
        return Ok(numbers);
    }
    collect(value, &mut numbers).map(|()| numbers)
}

/// The feature that the outline is written as.
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
pub(super) enum Feature {
    /// Of the releases of 2018; with the walls of the capillary
    #[value(name = "fishContour")]
    FishContour,
    /// Of releases with neural networks, larva seen from the side
    #[value(name = "contour_net")]
    ContourNet,
    /// Of releases with neural networks, larva seen from above or below
    #[value(name = "contourDV_net")]
    ContourDvNet,
}

impl Feature {
    fn key(self) -> &'static str {
        match self {
            Self::FishContour => "fishContour",
            Self::ContourNet => "contour_net",
            Self::ContourDvNet => "contourDV_net",
        }
    }
}

/// A file as FishInspector writes it.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct File<'a> {
    version: f64,
    enabled: u8,
    image_dimensions: [usize; 3],
    #[serde(flatten)]
    features: BTreeMap<&'static str, FeatureShape>,
    carved: Origin<'a>,
}

/// What was found of a feature.
#[derive(Serialize)]
struct FeatureShape {
    mode: &'static str,
    /// The editor of a feature opens only if its parameters are in the file. These are FishInspector's own defaults.
    parameter: Value,
    shape: Shapes,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Shapes {
    One(Shape),
    Many(Vec<Shape>),
}

#[derive(Serialize)]
struct Shape {
    name: &'static str,
    x: Vec<f64>,
    y: Vec<f64>,
}

/// FishInspector keeps keys that it does not know.
#[derive(Serialize)]
struct Origin<'a> {
    software: Software,
    picture: &'a str,
}

/// The text of a file with the largest outline of a profile; a file has room for one. With `fishContour`, the walls are written too.
pub(super) fn write(profile: &Profile, feature: Feature, channels: usize, picture: &str) -> serde_json::Result<Vec<u8>> {
    let size = [profile.mask.width(), profile.mask.height()];
    let mut features = BTreeMap::new();
    if feature == Feature::FishContour {
        features.insert("capillary", capillary(&profile.walls, size));
    }
    if let Some(largest) = profile.edge.iter().max_by(|a, b| a.area_px2().total_cmp(&b.area_px2())) {
        features.insert(feature.key(), contour(largest, feature));
    }
    let image_dimensions = [size[0], size[1], channels];
    let file = File { version: 0.99, enabled: 1, image_dimensions, features, carved: Origin { software: Software::this(), picture } };
    let mut text = serde_json::to_vec(&file)?;
    text.push(b'\n');
    Ok(text)
}

fn capillary(walls: &Walls, [width, height]: [usize; 2]) -> FeatureShape {
    let row = |line: &Line, u: usize| (((line.at(u as f64) + 1.0) * 10.0).round() / 10.0).clamp(1.0, height as f64);
    let line = |name: &'static str, line: &Line| Shape {
        name,
        x: (1..=width).map(|x| x as f64).collect(),
        y: (0..width).map(|u| row(line, u)).collect(),
    };
    FeatureShape {
        // FishInspector has no manual mode for the capillary.
        mode: "auto",
        parameter: json!({ "threshMultiplier": 0.95, "vertCutoff": 0.075, "horizCutoff": 0.25, "steps": 0.0125 }),
        shape: Shapes::Many(vec![
            line("upper", &walls.upper.outer),
            line("upper_in", &walls.upper.inner),
            line("lower", &walls.lower.outer),
            line("lower_in", &walls.lower.inner),
        ]),
    }
}

fn contour(polygon: &Polygon, feature: Feature) -> FeatureShape {
    let along = |axis: usize| polygon.vertices.iter().map(|vertex| ((vertex[axis] + 1.0) * 1e4).round() / 1e4).collect();
    let shape = |name: &'static str| Shape { name, x: along(0), y: along(1) };
    let (parameter, shape) = match feature {
        // A manual outline has the line as drawn beside the refined one.
        Feature::FishContour => (
            json!({ "auto_thresh_multiplier": 0.35, "width_of_capillary_wall": 0.11, "imclose_disksize": 0.06,
                "binary_contour_smoothing": 0.21, "min_peak_width": 0.01 }),
            Shapes::Many(vec![shape("binaryShape"), shape(FINE)]),
        ),
        Feature::ContourNet | Feature::ContourDvNet => {
            (json!({ "disksize_CloseOpen": 0, "min_peak_width": 0, "contour_smoothing": 0 }), Shapes::One(shape(FINE)))
        }
    };
    // FishInspector computes an outline of the mode "auto" anew when features are updated.
    FeatureShape { mode: "manual", parameter, shape }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [40, 20];
    const SQUARE: &str = r#""x": [3, 9.5, 9.5, 3], "y": [4, 4, 12, 12]"#;

    fn read_text(text: &str) -> Result<Outline, ShapesError> {
        read(text.as_bytes(), SIZE)
    }

    /// The files of each release, as its source or its published example shows, with keys that carved does not read.
    #[test]
    fn files_of_older_and_newer_releases_are_read() {
        let expected = [[2.0, 3.0], [8.5, 3.0], [8.5, 11.0], [2.0, 11.0]];
        let files = [
            // 2016 to 2018: a list of two shapes. jsonlab writes true as 1 or as true.
            (
                "fishContour",
                format!(
                    r#"{{"version": 0.99, "enabled": true, "fishEye": {{"shape": {{"name": "fishEye", "x": [1, 2], "y": [1, 2]}}}},
                "fishContour": {{"mode": "auto", "parameter": {{"imclose_disksize": 0.06}},
                "shape": [{{"name": "binaryShape", "x": [1], "y": [1]}}, {{"name": "fineContour", {SQUARE}}}]}}}}"#
                ),
            ),
            // The order of the shapes does not matter, a nested list neither, and the columns of the capillary fit.
            (
                "fishContour",
                format!(
                    r#"{{"enabled": 1, "capillary": {{"shape": [{{"name": "upper", "x": [1], "y": {:?}}}]}}, "fishContour":
                {{"shape": [[{{"name": "fineContour", {SQUARE}}}], [{{"name": "binaryShape", "x": [1], "y": [1]}}]]}}}}"#,
                    [2.5; 40]
                ),
            ),
            // Neural networks: one shape without a list, and the size of the picture.
            (
                "contourDV_net",
                format!(
                    r#"{{"version": 0.99, "enabled": 1, "imageDimensions": [40, 20, 3], "contourDV_net": {{"mode": "auto",
                "shape": {{"name": "fineContour", {SQUARE}}}, "regionprops": {{"Area": 52}}}}, "yolkDV_net": {{"shape": null}}}}"#
                ),
            ),
            // Columns of numbers, and empty features.
            (
                "contour_net",
                r#"{"imageDimensions": [20, 40, 3], "fishContour": {"shape": []}, "contourDV_net": [], "contour_net":
                {"shape": {"name": "any", "x": [[3], [9.5], [9.5], [3]], "y": {"_ArrayType_": "double", "_ArraySize_": [1, 4],
                "_ArrayData_": [4, 4, 12, 12]}}}}"#
                    .to_owned(),
            ),
        ];
        for (feature, text) in files {
            let outline = read_text(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
            assert_eq!((outline.feature, outline.polygon.vertices.as_slice()), (feature, expected.as_slice()), "{text}");
        }
    }

    #[test]
    fn of_two_outlines_the_one_drawn_by_hand_counts() {
        let file = |contour: &str, net: &str| {
            format!(
                r#"{{"fishContour": {{"mode": "{contour}", "shape": {{"name": "fineContour", {SQUARE}}}}},
                "contour_net": {{"mode": "{net}", "shape": {{"name": "fineContour", {SQUARE}}}}}}}"#
            )
        };
        for (contour, net, expected) in [
            ("manual", "auto", "fishContour"),
            ("auto", "manual", "contour_net"),
            ("auto", "auto", "contour_net"),
            ("manual", "manual", "contour_net"),
        ] {
            assert_eq!(read_text(&file(contour, net)).unwrap().feature, expected, "{contour} {net}");
        }
    }

    #[test]
    fn files_that_give_no_outline_say_why() {
        let contour = |rest: &str| format!(r#"{{"fishContour": {{"shape": {{"name": "fineContour", {rest}}}}}}}"#);
        for (text, why) in [
            ("not JSON".to_owned(), "not readable JSON"),
            (contour(SQUARE)[..60].to_owned(), "not readable JSON"),
            (format!(r#"{{"enabled": 0, {}"#, &contour(SQUARE)[1..]), "excluded"),
            (format!(r#"{{"enabled": false, {}"#, &contour(SQUARE)[1..]), "excluded"),
            ("{}".to_owned(), "no outline"),
            ("[]".to_owned(), "no outline"),
            (r#"{"fishContour": {"mode": "auto"}}"#.to_owned(), "no outline"),
            (
                r#"{"fishContour": {"shape": [{"name": "binaryShape"}, {"name": "other"}]}}"#.to_owned(),
                r#"no shape fineContour; found "binaryShape", "other""#,
            ),
            (contour(r#""x": [1, 2, 3], "y": [1, 2]"#), "3 values of x and 2 of y"),
            (contour(r#""x": [1, 2], "y": [1, 2]"#), "2 vertices, expected 3 to 50000"),
            (contour(r#""x": 5, "y": 6"#), "1 vertices"),
            (contour(r#""name": "fineContour""#), "0 vertices"),
            (contour(r#""x": [1, "_NaN_", 3], "y": [1, 2, 3]"#), r#"value 2 of x of fishContour is "_NaN_""#),
            (contour(r#""x": [1, 2, 3], "y": [1, 2, null]"#), "value 3 of y of fishContour is null"),
            (contour(r#""x": [1, 43, 3], "y": [1, 2, 3]"#), "x = 43, y = 2, this picture is 40 x 20 px"),
            (contour(r#""x": [1, 4, 3], "y": [1, -2, 3]"#), "x = 4, y = -2"),
            (format!(r#"{{"imageDimensions": [1024, 200, 3], {}"#, &contour(SQUARE)[1..]), "1024 x 200 px, this picture is 40 x 20 px"),
            (
                format!(r#"{{"capillary": {{"shape": [{{"y": [1, 2, 3]}}]}}, {}"#, &contour(SQUARE)[1..]),
                "capillary has 3 columns, this picture has 40",
            ),
        ] {
            let error = read_text(&text).unwrap_err().to_string();
            assert!(error.contains(why), "{text}: {error}");
        }
    }
}
