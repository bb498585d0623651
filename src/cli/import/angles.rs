//! The angle of every picture, read from a file.
//!
//! ```text
//!  external.txt   tomography  x_position  degrees ...     VAST's list for its trigger bridge: 7 columns, tabs or spaces, decimal comma
//!                 no          0           3,60    ...     flags are words or numbers
//!  CSV            file,angle_deg      or view,omega_rad, ...         header required
//!  a column       0                   degrees, one per line
//!                 17,14
//!  a film         file,time_s         times of a turn at a constant speed
//!  JSON           [0, 17.14, ...]     degrees
//! ```
//! Degrees are angles of the axis, which the rig's sense converts to omega. Radians are omega.

use anyhow::{Context, anyhow, bail, ensure};
use std::collections::BTreeMap;
use std::path::Path;

/// One angle per picture, in the order of the pictures.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::cli) enum Angles {
    /// Angles of the axis, deg.
    Degrees(Vec<f64>),
    /// Angles omega, rad.
    Rad(Vec<f64>),
    /// Times of pictures of an axis that turns at a constant speed, s.
    Seconds(Vec<f64>),
}

/// The pictures of a plate, for a list that names files.
pub(in crate::cli) struct PlatePictures<'a> {
    /// Numbers of the views in the order of the turn.
    pub views: &'a [u32],
    /// Every picture with the number of its view.
    pub pictures: Vec<(u32, &'a Path)>,
}

/// The angles of `pictures`, which are file names in order. With `plate` they are the names of its views.
pub(super) fn read(file: &Path, pictures: &[String], plate: Option<&PlatePictures>) -> anyhow::Result<Angles> {
    let name = || format!("--angles {}", file.display());
    let bytes = carved_files::read(file).with_context(|| format!("{}: cannot be read", name()))?;
    let text = String::from_utf8(bytes).map_err(|_| anyhow!("{}: found bytes that are no UTF-8 text; save it as plain text", name()))?;
    parse(&text, pictures, plate).with_context(name)
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    File,
    View,
    Degrees,
    Rad,
    Seconds,
}

const COLUMNS: &str = "angle_deg (or degrees), omega_rad or time_s, and perhaps view or file";

fn column(name: &str) -> Option<Column> {
    Some(match name.to_lowercase().replace([' ', '-'], "_").as_str() {
        "file" | "file_name" | "filename" | "name" | "frame" | "image" | "picture" => Column::File,
        "view" => Column::View,
        "angle_deg" | "degrees" | "deg" => Column::Degrees,
        "omega_rad" | "omega" => Column::Rad,
        "time_s" | "seconds" => Column::Seconds,
        _ => return None,
    })
}

/// The number of a line in the file, from 1, and its fields.
type Row = (usize, Vec<String>);

/// The angles in the text of such a file.
pub(in crate::cli) fn parse(text: &str, pictures: &[String], plate: Option<&PlatePictures>) -> anyhow::Result<Angles> {
    let text = text.trim_start_matches('\u{feff}');
    if text.trim_start().starts_with(['[', '{']) {
        let expected = "found JSON that is no list of numbers, expected the degrees of the pictures, as in [0, 120, 240]";
        return of_all(serde_json::from_str(text).context(expected)?, pictures).map(Angles::Degrees);
    }
    let lines = (1..).zip(text.lines());
    let lines: Vec<(usize, &str)> = lines.filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#')).collect();
    let Some((_, first)) = lines.first() else { bail!("found no line, expected one angle per picture") };
    if number(first).is_some() {
        let degrees = lines.iter().map(|(n, l)| number(l).with_context(|| expected_number(*n, l)));
        return of_all(degrees.collect::<anyhow::Result<_>>()?, pictures).map(Angles::Degrees);
    }
    let separator = separator(first);
    let mut rows: Vec<Row> = lines.iter().map(|(n, l)| (*n, fields(l, separator))).collect();
    let is_header = rows[0].1.iter().any(|f| number(f).is_none() && !is_flag(f));
    if !is_header && (separator == '\t' || rows[0].1.len() == EXTERNAL) {
        return external(&rows, pictures);
    }
    ensure!(
        is_header,
        "line {}: found {} columns of numbers and no header before them; expected a header that names: {COLUMNS}",
        rows[0].0,
        rows[0].1.len()
    );
    let (_, header) = rows.remove(0);
    table(&header, &rows, pictures, plate)
}

/// Number of columns of VAST's list.
const EXTERNAL: usize = 7;

/// Whether a field of VAST's list is a flag: its programs write 0 and 1, or words.
fn is_flag(field: &str) -> bool {
    ["no", "yes", "off", "on", "false", "true"].iter().any(|word| field.eq_ignore_ascii_case(word))
}

/// What separates the columns. Only VAST's list may have spaces there.
fn separator(line: &str) -> char {
    let by_spaces = || line.split_whitespace().count() == EXTERNAL && line.split_whitespace().all(|field| !field.ends_with(','));
    match ['\t', ';'].into_iter().find(|s| line.contains(*s)) {
        Some(separator) => separator,
        None if by_spaces() => ' ',
        None => ',',
    }
}

/// Reads seven columns without a header: VAST's list as written by its program.
fn external(rows: &[Row], pictures: &[String]) -> anyhow::Result<Angles> {
    let angle = |(n, row): &Row| {
        let found = row.len();
        ensure!(
            found == EXTERNAL,
            "line {n}: found {found} columns, expected the 7 of VAST's external.txt, or a header that names: {COLUMNS}"
        );
        number(&row[2]).with_context(|| expected_number(*n, &row[2]))
    };
    of_all(rows.iter().map(angle).collect::<anyhow::Result<_>>()?, pictures).map(Angles::Degrees)
}

fn table(header: &[String], rows: &[Row], pictures: &[String], plate: Option<&PlatePictures>) -> anyhow::Result<Angles> {
    let found = || format!("found the columns {}", header.join(", "));
    let at = |wanted: &[Column]| -> anyhow::Result<Option<usize>> {
        let places: Vec<usize> = (0..header.len()).filter(|&i| column(&header[i]).is_some_and(|c| wanted.contains(&c))).collect();
        ensure!(places.len() < 2, "{}, expected one of {COLUMNS}: two of them say the same thing", found());
        Ok(places.first().copied())
    };
    let Some(angle) = at(&[Column::Degrees, Column::Rad, Column::Seconds])? else { bail!("{}, expected {COLUMNS}", found()) };
    let key = at(&[Column::File, Column::View])?;
    let mut angles = Vec::new();
    let mut keys = Vec::new();
    for (n, row) in rows {
        ensure!(row.len() == header.len(), "line {n}: found {} columns, the header has {}", row.len(), header.len());
        angles.push(number(&row[angle]).with_context(|| expected_number(*n, &row[angle]))?);
        keys.extend(key.map(|key| (*n, row[key].as_str())));
    }
    let angles = match key.map(|key| column(&header[key])) {
        Some(Some(Column::File)) => match plate {
            Some(plate) => by_file_of_plate(&keys, &angles, plate)?,
            None => by_file(&keys, &angles, pictures)?,
        },
        Some(_) => by_view(&keys, &of_all(angles, pictures)?)?,
        None => of_all(angles, pictures)?,
    };
    Ok(match column(&header[angle]) {
        Some(Column::Rad) => Angles::Rad(angles),
        Some(Column::Seconds) => Angles::Seconds(angles),
        _ => Angles::Degrees(angles),
    })
}

fn of_all(angles: Vec<f64>, pictures: &[String]) -> anyhow::Result<Vec<f64>> {
    ensure!(
        angles.len() == pictures.len(),
        "found {} angles for {} pictures ({} to {}); one per picture is expected",
        angles.len(),
        pictures.len(),
        pictures.first().map_or("", String::as_str),
        pictures.last().map_or("", String::as_str)
    );
    Ok(angles)
}

/// The angle of each picture, by its file name with or without extension.
fn by_file(keys: &[(usize, &str)], angles: &[f64], pictures: &[String]) -> anyhow::Result<Vec<f64>> {
    let stem = |name: &str| Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned());
    let mut given: BTreeMap<&str, f64> = BTreeMap::new();
    for ((n, key), angle) in keys.iter().zip(angles) {
        let mut parts = key.rsplit(['/', '\\']);
        let base = parts.next().unwrap_or(key);
        ensure!(
            !parts.any(|part| part == ".."),
            "line {n}: found {key:?}, which leads out of a folder; expected the name of one of the {} pictures",
            pictures.len()
        );
        let picture = pictures.iter().find(|p| p.as_str() == base).or_else(|| pictures.iter().find(|p| stem(p).as_deref() == Some(base)));
        let Some(picture) = picture else { bail!("line {n}: found {key:?}, which is none of the {} pictures", pictures.len()) };
        ensure!(given.insert(picture, *angle).is_none(), "line {n}: found {picture} a second time");
    }
    let missing: Vec<&str> = pictures.iter().map(String::as_str).filter(|p| !given.contains_key(p)).collect();
    ensure!(missing.is_empty(), "found no angle of {}; expected one of every picture", missing.join(", "));
    Ok(pictures.iter().filter_map(|p| given.get(p.as_str()).copied()).collect())
}

/// Largest difference between two angles that a list gives for one view, deg or rad: they are the same, written with other digits.
const SAME_ANGLE: f64 = 1e-3;

/// The angle of each view of a plate, by the names of pictures with or without folders and extension. A name fits the pictures whose paths
/// end with it. All wells have the same angles.
fn by_file_of_plate(keys: &[(usize, &str)], angles: &[f64], plate: &PlatePictures) -> anyhow::Result<Vec<f64>> {
    let mut given: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
    for ((n, key), angle) in keys.iter().zip(angles) {
        let written = key.replace('\\', "/");
        let fits = |path: &Path| path.ends_with(&written) || path.with_extension("").ends_with(&written);
        let mut views: Vec<u32> = plate.pictures.iter().filter(|(_, path)| fits(path)).map(|(view, _)| *view).collect();
        views.dedup();
        let (Some(view), true) = (views.first(), views.iter().all(|view| *view == views[0])) else {
            bail!("line {n}: found {key:?}, which is none of the {} pictures", plate.pictures.len())
        };
        let (first, known) = *given.entry(*view).or_insert((*n, *angle));
        ensure!(
            (known - angle).abs() <= SAME_ANGLE,
            "line {n}: found {angle} for view {view}, line {first} has {known}; expected one angle per view, the same in all wells. Import wells \
             that were turned to other angles in a run of their own"
        );
    }
    let missing: Vec<String> = plate.views.iter().filter(|view| !given.contains_key(view)).map(u32::to_string).collect();
    ensure!(missing.is_empty(), "found no angle of view {}; expected one of every view of the turn", missing.join(", "));
    Ok(plate.views.iter().filter_map(|view| Some(given.get(view)?.1)).collect())
}

/// The angles by view number. Views count the pictures in order, from 0 or from 1.
fn by_view(keys: &[(usize, &str)], angles: &[f64]) -> anyhow::Result<Vec<f64>> {
    let whole = |(n, key): &(usize, &str)| {
        key.parse::<usize>().map(|view| (*n, view)).map_err(|_| anyhow!("line {n}: found the view {key:?}, expected a whole number"))
    };
    let views: Vec<(usize, usize)> = keys.iter().map(whole).collect::<anyhow::Result<_>>()?;
    let first = usize::from(views.iter().all(|(_, view)| *view > 0));
    let last = angles.len() + first - 1;
    let mut given = vec![None; angles.len()];
    for ((n, view), angle) in views.iter().zip(angles) {
        let place = view.checked_sub(first).and_then(|at| given.get_mut(at));
        let place = place.with_context(|| format!("line {n}: found view {view}, expected every number from {first} to {last} once"))?;
        ensure!(place.replace(*angle).is_none(), "line {n}: found view {view} a second time");
    }
    Ok(given.into_iter().flatten().collect())
}

/// A number with a decimal point or a decimal comma.
fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    let text = if text.contains('.') { text.to_owned() } else { text.replacen(',', ".", 1) };
    text.parse().ok().filter(|x: &f64| x.is_finite())
}

fn expected_number(line: usize, found: &str) -> String {
    format!("line {line}: found {:?}, expected an angle as 3.6 or 3,6", found.trim())
}

/// The fields of a line. A field in quotes may contain the separator.
fn fields(line: &str, separator: char) -> Vec<String> {
    if separator == ' ' {
        return line.split_whitespace().map(str::to_owned).collect();
    }
    let mut fields = vec![String::new()];
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '"' => quoted = !quoted,
            c if c == separator && !quoted => fields.push(String::new()),
            c => fields.last_mut().into_iter().for_each(|f| f.push(c)),
        }
    }
    // A line of a list may end with a separator.
    if separator != ',' && fields.len() > 1 && fields.last().is_some_and(|field| field.trim().is_empty()) {
        fields.pop();
    }
    fields.into_iter().map(|f| f.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pictures(n: usize) -> Vec<String> {
        (0..n).map(|i| format!("v{i}.png")).collect()
    }

    #[test]
    fn every_notation_gives_the_pictures_angles_in_their_order() {
        let deg = Angles::Degrees(vec![0.0, 3.6, 7.2]);
        let external = "1\t0\t0,00\t1\t1\t0\t1\r\n1\t0\t3,60\t1\t1\t0\t1\r\n1\t0\t7,20\t1\t1\t0\t1\r\n";
        let header = "tomography\tx_position\tdegrees\tctrl_output\ttrigger_input\tadjust_rotation\ttray_LED\n";
        for text in [
            external,
            &format!("\u{feff}{header}{external}"),
            "no\t0\t0,00\t1\t1\tno\toff\t\r\nno\t0\t3,60\t1\t1\tno\toff\t\r\nno\t0\t7,20\t1\t1\tno\ton\r\n",
            "no 0 0,00 1 1 no off\nno  0  3,60 1 1 no off \nYES 0 7,20 1 1 yes ON\n",
            &format!("{}no 0 0,00 1 1 no off\nno 0 3,60 1 1 no off\nno 0 7,20 1 1 no off\n", header.replace('\t', " ")),
            "no;0;0,00;1;1;no;off\nno;0;3,60;1;1;no;off\nno;0;7,20;1;1;no;off\n",
            "0;0;0.00;1;1;0;1\n0;0;3.60;1;1;0;1\n0;0;7.20;1;1;0;1\n",
            "no,0,0.00,1,1,no,off\nno,0,3.60,1,1,no,off\nno,0,7.20,1,1,no,off\n",
            "0\n3,6\n7.2\n",
            "\u{feff} [0,\n 3.6, 7.2]\n",
            "# turn\nfile,angle_deg\nv2.png,7.2\nv0.png,0\nv1,3.6\n",
            "file;angle_deg\nC:\\x\\v1.png;3,6\nv0.png;0\nv2.png;7,2\n",
            "view,angle_deg\n3,7.2\n1,0\n2,\"3,6\"\n",
            "view, degrees, note\n0,0,\n2,7.2,b\n1,3.6,c\n",
            "angle_deg\n0\n3.6\n7.2\n",
        ] {
            assert_eq!(parse(text, &pictures(3), None).unwrap(), deg, "{text}");
        }
        assert_eq!(parse("view,omega_rad\n0,0\n1,-0.5\n", &pictures(2), None).unwrap(), Angles::Rad(vec![0.0, -0.5]));
    }

    #[test]
    fn what_is_no_list_of_angles_is_named() {
        for (text, expected) in [
            ("", "found no line"),
            ("0\n1\n", "found 2 angles for 3 pictures (v0.png to v2.png)"),
            ("0\nx\n2\n", "line 2: found \"x\""),
            ("0\nnan\n2\n", "line 2: found \"nan\""),
            ("0,1,2\n", "no header"),
            ("[0, 1]", "found 2 angles for 3 pictures"),
            ("[0, null, 1]", "found JSON that is no list of numbers"),
            ("{\"omega\": [0, 1, 2]}", "found JSON that is no list of numbers, expected the degrees"),
            ("0\t1\t2\n", "found 3 columns, expected the 7"),
            ("no 0 0,00 1 1 no off\nno 0 x 1 1 no off\nno 0 2 1 1 no off\n", "line 2: found \"x\""),
            ("no 0 0,00 1 1 no off\nno 0 3,60 1 1 no\nno 0 2 1 1 no off\n", "line 2: found 6 columns, expected the 7"),
            ("no,0,3,60,1,1,no,off\n", "found 8 columns of numbers and no header"),
            ("a,b\n0,1\n", "found the columns a, b, expected angle_deg"),
            ("angle_deg,omega_rad\n0,1\n", "say the same thing"),
            ("file,angle_deg\nv0.png,0\nv1.png,1\n", "found no angle of v2.png"),
            ("file,angle_deg\nv0.png,0\nv0.png,1\n", "line 3: found v0.png a second time"),
            ("file,angle_deg\nv9.png,0\n", "none of the 3 pictures"),
            ("file,angle_deg\nv0.png,0\n../other/v1.png,1\n", "line 3: found \"../other/v1.png\", which leads out of a folder"),
            ("file,angle_deg\n..\\v0.png,0\n", "leads out of a folder"),
            ("view,angle_deg\n0,0\n1,1\n3,2\n", "found view 3, expected every number from 0 to 2 once"),
            ("view,angle_deg\n0,0\n1\n", "line 3: found 1 columns, the header has 2"),
        ] {
            let said = format!("{:#}", parse(text, &pictures(3), None).unwrap_err());
            assert!(said.contains(expected), "{text:?}: {said}");
        }
    }

    #[test]
    fn a_list_of_files_gives_a_plate_the_angles_of_its_views() {
        let paths: Vec<String> = ["A01", "B02"].iter().flat_map(|well| (1..=3).map(move |v| format!("P/{well}/VAST_1_{v}.tiff"))).collect();
        let of = |text: &str| {
            let pictures = paths.iter().zip([1, 2, 3, 1, 2, 3]).map(|(path, view)| (view, Path::new(path))).collect();
            let names: Vec<String> = (1..=3).map(|view| format!("view {view}")).collect();
            parse(text, &names, Some(&PlatePictures { views: &[1, 2, 3], pictures }))
        };
        let expected = Angles::Degrees(vec![0.0, 120.0, 240.0]);
        for text in [
            "file,degrees\nVAST_1_2.tiff,120\nVAST_1_1,0\nVAST_1_3.tiff,240\n",
            "file,degrees\nA01/VAST_1_1.tiff,0\nA01\\VAST_1_2.tiff,120\nB02/VAST_1_2.tiff,120.0\nP/B02/VAST_1_3,240\n",
        ] {
            assert_eq!(of(text).unwrap(), expected, "{text}");
        }
        for (text, words) in [
            ("file,degrees\nA01/VAST_1_1.tiff,0\nB02/VAST_1_1.tiff,5\n", "line 3: found 5 for view 1, line 2 has 0"),
            ("file,degrees\nVAST_1_1.tiff,0\nVAST_1_3.tiff,240\n", "found no angle of view 2"),
            ("file,degrees\nC03/VAST_1_1.tiff,0\n", "line 2: found \"C03/VAST_1_1.tiff\", which is none of the 6 pictures"),
        ] {
            let said = format!("{:#}", of(text).unwrap_err());
            assert!(said.contains(words), "{said}");
        }
    }
}
