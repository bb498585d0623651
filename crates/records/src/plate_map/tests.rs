use super::*;
use crate::{ConcentrationUnit, Control, SpecimenKind};
use proptest::prelude::*;

const FULL: &str = "well,compound,concentration,concentration_unit,dpf,strain,treatment,control,replicate\n\
    A01,DMSO,0.1,% v/v,3,AB,bath,negative,1\n\
    A02,valproate,50,µM,3,AB,bath,,1\n\
    A03,\"ethanol, absolute\",1.5,%,3,AB,bath,positive,2\n";

fn csv(text: &str) -> Result<PlateMap, Vec<Mistake>> {
    read(text.as_bytes(), Format::Csv, None, None)
}

fn json(text: &str) -> Result<PlateMap, Vec<Mistake>> {
    read(text.as_bytes(), Format::Json, None, None)
}

fn places(text: &str) -> Vec<(u64, String)> {
    let line = |m: Mistake| (m.line.unwrap(), m.column.unwrap_or_default());
    csv(text).unwrap_err().into_iter().map(line).collect()
}

fn pointers(text: &str) -> Vec<String> {
    json(text).unwrap_err().into_iter().map(|m| m.pointer.unwrap()).collect()
}

fn names(map: &PlateMap) -> Vec<&str> {
    map.plate_map.iter().map(|w| w.well.as_str()).collect()
}

#[test]
fn a_full_map_is_read() {
    let map = csv(FULL).unwrap();
    assert_eq!((names(&map), map.notes.len()), (vec!["A01", "A02", "A03"], 0));
    let third = &map.plate_map[2];
    assert_eq!((third.compound.as_deref(), third.concentration), (Some("ethanol, absolute"), Some(1.5)));
    assert_eq!((third.concentration_unit, third.control), (Some(ConcentrationUnit::Percent), Some(Control::Positive)));
    assert_eq!((third.dpf, third.replicate, third.specimen), (Some(3.0), Some(2), SpecimenKind::Larva));
    assert_eq!(map.plate_map[1].concentration_unit, Some(ConcentrationUnit::Micromolar));
}

#[test]
fn a_well_beyond_the_plate_is_a_mistake_where_the_plate_is_chosen_and_a_note_where_it_is_not() {
    let map = b"well\nA01\nI12\nP24\n";
    let mistakes = read(map, Format::Csv, None, Some(96)).unwrap_err();
    let said: Vec<_> = mistakes.iter().map(ToString::to_string).collect();
    assert_eq!(said[0], "line 3, well: I12 is not on a plate of 96 wells: A01 to H12");
    assert_eq!((said.len(), mistakes[1].line), (2, Some(4)));
    let found = read(map, Format::Csv, None, Some(384)).unwrap();
    assert_eq!((found.plate_format, found.notes.len()), (Some(384), 0));
    let note = &csv("well\nA01\nI12\nP24\n").unwrap().notes[0];
    let of_384 = "not on a plate of 96 wells, so the plate counts as one of 384 wells; choose the plate if it is another";
    assert_eq!(note, &format!("line 3: I12, line 4: P24: {of_384}"));
    let many = csv("well\nI01\nI02\nI03\nI04\nI05\n").unwrap();
    assert_eq!(many.notes, [format!("line 2: I01, line 3: I02, line 4: I03 and 2 more: {of_384}")]);
    // The choice counts before the name in the file.
    let named = br#"{"plate_format": 384, "plate_map": [{"well": "P24"}]}"#;
    assert_eq!(read(named, Format::Json, None, Some(96)).unwrap_err()[0].pointer.as_deref(), Some("/plate_map/0/well"));
    assert_eq!(read(named, Format::Json, None, Some(97)).unwrap_err()[0].pointer.as_deref(), Some("/plate_format"));
}

#[test]
fn a_single_well_that_makes_the_plate_larger_is_to_be_confirmed() {
    let confirm = |text: &str| csv(text).unwrap().confirm;
    let words = |at: &str, smaller: u32, larger: u32| {
        Some(format!(
            "{at} is the only well that is not on a plate of {smaller} wells, so the plate counts as one of {larger} wells; choose the plate, or \
             correct the well"
        ))
    };
    assert_eq!(confirm("well\nA01\nI12\n"), words("line 3: I12", 96, 384));
    assert_eq!(confirm("well\nA01\nZ05\n"), words("line 3: Z05", 384, 1536));
    assert_eq!(confirm("well\nA01\nI12\nP24\nZ05\n"), words("line 5: Z05", 384, 1536), "of a plate of 384 wells");
    assert_eq!(json(r#"{"plate_map": [{"well": "A1"}, {"well": "P24"}]}"#).unwrap().confirm, words("/plate_map/1: P24", 96, 384));
    assert_eq!((confirm("well\nA01\nH12\n"), confirm("well\nI12\nP24\n"), confirm("well\nA01\nI12\nP24\n")), (None, None, None));
    let chosen = read(b"well\nA01\nI12\n", Format::Csv, None, Some(384)).unwrap();
    assert_eq!((chosen.confirm, chosen.notes.len()), (None, 0));
}

#[test]
fn the_same_map_reads_the_same_however_a_spreadsheet_saves_it() {
    let plain = csv(FULL).unwrap();
    let semicolons =
        FULL.replace("\"ethanol, absolute\"", "ethanol; absolute").replace(',', ";").replace("ethanol; absolute", "\"ethanol, absolute\"");
    for text in [
        format!("\u{feff}{FULL}"),
        FULL.replace('\n', "\r\n"),
        FULL.replace('\n', "\r"),
        semicolons.clone(),
        semicolons.replace("0.1", "0,1").replace("1.5", "1,5"),
        format!("sep=;\r\n{}", semicolons.replace('\n', "\r\n")),
        FULL.replace("\"ethanol, absolute\"", "ethanol# absolute").replace(',', "\t").replace('#', ","),
        FULL.replace("concentration_unit", "Concentration Unit").replace("well,", "WELL ,"),
        FULL.replace('\n', "\n,,,,,,,,\n\n"),
        FULL.replace("0.1,", "\"0,1\","),
        FULL.replace("negative", "Negative"),
    ] {
        assert_eq!(csv(&text), Ok(plain.clone()), "{text}");
    }
    let moved = csv("dpf;specimen;well\n3;;B02\n;bead;B01\n").unwrap();
    assert_eq!(names(&moved), ["B02", "B01"], "the order is the file's");
    assert_eq!((moved.plate_map[1].specimen, moved.plate_map[1].dpf), (SpecimenKind::Bead, None));
}

#[test]
fn names_of_wells_are_read_as_people_write_them_and_that_is_said() {
    let map = csv("well\na1\nA2\nP24\n\"A03\"\n\"af48\"\n").unwrap();
    assert_eq!(names(&map), ["A01", "A02", "P24", "A03", "AF48"]);
    assert_eq!(map.notes, ["line 2: a1 is read as A01", "line 3: A2 is read as A02", "line 6: af48 is read as AF48"]);
    assert!(map.confirm.unwrap().starts_with("line 6: AF48 is the only well that is not on a plate of 384 wells"));
    // Row b of A in the names of some programs, and the 28th row here.
    for written in ["Ab1", "aB01", "Ad12", "Aa1"] {
        let mistakes = csv(&format!("well\nA01\n{written}\n")).unwrap_err();
        assert!(mistakes[0].to_string().contains(&format!("{written:?} is not a well")), "{}", mistakes[0]);
    }
}

#[test]
fn a_json_map_names_its_plate_and_wells_beyond_it_are_mistakes() {
    let of = |format: &str| json(&format!(r#"{{"plate_format": {format}, "plate_map": [{{"well": "A1"}}, {{"well": "P24"}}]}}"#));
    assert_eq!(of("384").unwrap().plate_format, Some(384));
    assert_eq!(of("null").unwrap().plate_format, None);
    let mistakes = of("96").unwrap_err();
    assert_eq!(mistakes[0].to_string(), "/plate_map/1/well: P24 is not on a plate of 96 wells: A01 to H12");
    for wrong in ["95", "-6", "\"96\"", "96.5", "[]"] {
        assert_eq!(of(wrong).unwrap_err()[0].pointer.as_deref(), Some("/plate_format"), "{wrong}");
    }
    let again = serde_json::to_string(&of("384").unwrap()).unwrap();
    assert_eq!(json(&again).unwrap().plate_format, Some(384));
}

#[test]
fn every_mistake_is_listed_with_its_line_and_column() {
    let text = "well,compound,concentration,concentration_unit,dpf,control,replicate\n\
        A1,x,3,,3,,\n\
        AG01,,-1,mM,31,maybe,0\n\
        \n\
        ,x,,,,,\n\
        A01,,three,furlong,,,1.5\n\
        A49,,1,MM,,,\n\
        B01,,,mM,old,,\n";
    let of = |line, column: &str| (line, column.to_owned());
    let expected = [
        of(2, "concentration_unit"),
        of(3, "well"),
        of(3, "control"),
        of(3, "dpf"),
        of(3, "concentration"),
        of(3, "replicate"),
        of(5, "well"),
        of(6, "concentration"),
        of(6, "concentration_unit"),
        of(6, "replicate"),
        of(6, "well"),
        of(7, "well"),
        of(7, "concentration_unit"),
        of(8, "dpf"),
        of(8, "concentration"),
    ];
    let mut found = places(text);
    let mut expected = expected.to_vec();
    found.sort();
    expected.sort();
    assert_eq!(found, expected);
    for end in ["\n", "\r\n", "\r"] {
        assert_eq!(places(&["well", "A01", "", "ZZ9"].join(end)), [of(4, "well")], "{end:?}");
    }
    let twice = csv("well\nA01\nA1\n").unwrap_err();
    assert_eq!(twice[0].to_string(), "line 3, well: A01 stands in the plate map twice, first at line 2");
}

#[test]
fn a_file_of_another_form_is_refused_by_what_is_wrong_with_it() {
    let refused = |text: &str| csv(text).unwrap_err().into_iter().map(|m| m.to_string()).collect::<Vec<_>>();
    assert!(refused("Well,WELL\nA01,A02\n")[0].contains("twice"));
    assert!(refused("compound\nDMSO\n")[0].contains("the column well is missing"));
    for empty in ["", "\n\n", "\u{feff}"] {
        assert!(refused(empty)[0].starts_with("line 1: the file is empty"), "{empty:?}");
    }
    assert_eq!(refused("well,dpf\n"), ["line 1: the plate map names no well"]);
    assert!(refused("well,dpf\nA01\nA02,3\n")[0].starts_with("line 2: 1 cells"));
    assert!(refused("well,dpf\nA01,3,4\n")[0].starts_with("line 2: 3 cells"));
    assert!(refused("well,\nA01,\nA02,x\n")[0].starts_with("line 3: \"x\" stands in a column without a heading"));
    // An unclosed quote takes in the rest of the file. Its line is reported.
    assert!(refused("well,compound\nA01,x\nA02,\"y\nA03,z\n")[0].starts_with("line 3"));
    for (open, line) in [
        ("well,compound\nA01,x\nA02,\"y\n", 3),
        ("well,compound\nA01,x\nA02,\"y", 3),
        ("well\nA01\n\"A02", 3),
        ("well\n\"A01", 2),
        ("\"well\nA01\n", 1),
        ("well,compound\nA01,\"y \"\"z\n", 2),
        ("well,compound\n\"A01\",\"two\nlines\"\nA02,\"y\n", 4),
        ("sep=;\nwell;compound\r\nA01;\"y\r\n", 3),
    ] {
        let said = refused(open);
        assert!(said.len() == 1 && said[0].starts_with(&format!("line {line}: a quote opens")), "{open:?}: {said:?}");
    }
    // Quotes that are closed, or inside a cell, are valid.
    for sound in [
        "well,compound\nA01,\"y \"\"z\"\n",
        "well,compound\nA01,5\" plate\n",
        "well,compound\nA01,\"\"\n",
        "well,strain\n\"A01\",\"AB, wild\"\n",
    ] {
        assert!(csv(sound).is_ok(), "{sound:?}: {:?}", csv(sound));
    }
    assert!(
        read(b"well,compound\r\nA01,x\r\nA02,\xb5\r\n", Format::Csv, None, None).unwrap_err()[0]
            .to_string()
            .starts_with("line 3: the byte 0xb5")
    );
    assert!(read(b"PK\x03\x04well,dpf\nA01,3\n", Format::Csv, None, None).unwrap_err()[0].to_string().contains("workbook"));
    let headless = csv("A01,larva,3\nA02,larva,3\n").unwrap_err();
    assert!(headless.len() == 1 && headless[0].to_string().contains("must name the columns"), "{headless:?}");
    assert!(read(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", Format::Csv, None, None).unwrap_err()[0].to_string().contains("a picture"));
    assert!(read(b"\xff\xfew\0e\0", Format::Csv, None, None).unwrap_err()[0].to_string().contains("UTF-16"));
    assert!(refused("well;concentration;concentration_unit\nA01;1.500;mM\n")[0].contains("could be 1500 or 1.500"));
}

#[test]
fn a_column_that_is_not_known_is_kept_and_hides_no_mistake() {
    let map = csv("well,colour,dpf,box 7\na1,red,3,\nA02,,4,x\nA03,\"a, b\",5,\n").unwrap();
    assert_eq!(map.plate_map.iter().map(|well| well.dpf).collect::<Vec<_>>(), [Some(3.0), Some(4.0), Some(5.0)]);
    let kept = serde_json::json!({"columns": {"colour": {"A01": "red", "A03": "a, b"}, "box 7": {"A02": "x"}}});
    assert_eq!(serde_json::Value::Object(map.metadata), kept);
    assert!(map.notes[0].starts_with("line 1, colour: ") && map.notes[0].contains("concentration_unit"), "{:?}", map.notes);
    assert_eq!(map.notes.len(), 3, "both columns, and a1");
    assert_eq!(places("well,colour,dpf\nZZ9,red,3\nA01,blue,x\n"), [(2, "well".into()), (3, "dpf".into())]);
    assert_eq!(places("well,colour,colour,DPF,dpf\nA01,,,3,\nA02,,,x,\n"), [(1, "colour".into()), (1, "dpf".into()), (3, "DPF".into())]);
}

#[test]
fn a_file_of_nothing_but_mistakes_is_not_answered_with_as_many_lines() {
    let text = format!("well\n{}", "Z99\n".repeat(5000));
    let mistakes = csv(&text).unwrap_err();
    assert_eq!(mistakes.len(), LISTED + 1);
    assert!(mistakes[LISTED].detail.starts_with("4000 more"), "{}", mistakes[LISTED]);
}

#[test]
fn json_is_read_as_a_list_or_as_what_a_check_answers() {
    let list =
        r#"[{"well": "A1", "concentration": 2, "concentration_unit": "uM", "replicate": 1, "control": null}, {"well": "A02", "dpf": 3.5}]"#;
    let map = json(list).unwrap();
    assert_eq!((names(&map), &map.notes[..]), (vec!["A01", "A02"], &["/0: A1 is read as A01".to_owned()][..]));
    let again = serde_json::to_string(&PlateMap { notes: vec!["x".into()], ..csv(FULL).unwrap() }).unwrap();
    assert_eq!(json(&again), csv(FULL));
    assert_eq!(
        pointers(r#"[{"well": "A01", "dose": 1}, 4, {"well": ["A02"]}, {"wel/l": 1, "well": "A03"}]"#),
        ["/0/dose", "/1", "/2/well", "/2/well", "/3/wel~1l"]
    );
    assert_eq!(pointers(r#"{"plate_map": [{"well": "A99"}], "metadata": 3, "stages": []}"#), ["/metadata", "/plate_map/0/well", "/stages"]);
    assert_eq!(pointers("{}"), ["/plate_map"]);
    assert_eq!(pointers("3"), [""]);
    let broken = json("[\n{\"well\": \"A01\"},\n}").unwrap_err();
    assert_eq!((broken.len(), broken[0].line), (1, Some(3)));
}

const MIHCSME: &str = r#"{
    "InvestigationInformation": {"DataOwner": {"First Name": "Kim"}},
    "AssayInformation": {"Assay": {"Assay Title": "growth"}},
    "AssayConditions": [
        {"Plate": "P1", "Well": "A1", "Compound": "DMSO", "Dose": "0.1%", "CellLine": "none", "Strain": "AB", "DPF": 3},
        {"Plate": "P1", "Well": "A02", "Compound": "x", "Dose": "10", "Dose Unit": "µM", "ControlType": "positive"}]}"#;

#[test]
fn mihcsme_is_kept_whole_and_its_conditions_become_the_wells() {
    let map = json(MIHCSME).unwrap();
    assert_eq!(names(&map), ["A01", "A02"]);
    let (first, second) = (&map.plate_map[0], &map.plate_map[1]);
    assert_eq!((first.concentration, first.concentration_unit), (Some(0.1), Some(ConcentrationUnit::Percent)));
    assert_eq!((first.strain.as_deref(), first.dpf), (Some("AB"), Some(3.0)));
    assert_eq!((second.concentration, second.concentration_unit), (Some(10.0), Some(ConcentrationUnit::Micromolar)));
    assert_eq!(second.control, Some(Control::Positive));
    assert_eq!(map.metadata["InvestigationInformation"]["DataOwner"]["First Name"], "Kim");
    assert_eq!(map.metadata["AssayConditions"][0]["CellLine"], "none");
    let model = r#"{"assay_conditions": [{"plate": "P1", "well": "B3", "conditions": {"Compound": "y", "Dose": "high"}}]}"#;
    assert_eq!(pointers(model), ["/assay_conditions/0/conditions/Dose"]);
    assert_eq!(json(&model.replace("high", "2 nM")).unwrap().plate_map[0].concentration_unit, Some(ConcentrationUnit::Nanomolar));
}

#[test]
fn of_several_plates_one_has_to_be_chosen() {
    let two = MIHCSME.replacen("P1", "P2", 1);
    assert!(json(&two).unwrap_err()[0].to_string().contains("P1, P2"));
    assert!(read(two.as_bytes(), Format::Json, Some("P3"), None).is_err());
    let chosen = read(two.as_bytes(), Format::Json, Some("P2"), None).unwrap();
    assert_eq!(names(&chosen), ["A01"]);
    assert_eq!(names(&read(MIHCSME.as_bytes(), Format::Json, Some("barcode-7"), None).unwrap()).len(), 2, "one plate is the plate");
}

fn check(bytes: &[u8], format: Format) -> Result<(), TestCaseError> {
    match read(bytes, format, Some("P1"), None) {
        Ok(map) => {
            prop_assert!(!map.plate_map.is_empty());
            for well in &map.plate_map {
                prop_assert!(crate::is_well(&well.well) && well.mistakes().is_empty(), "{well:?}");
            }
        }
        Err(mistakes) => {
            prop_assert!(!mistakes.is_empty());
            let lines = 1 + bytes.iter().filter(|b| matches!(b, b'\n' | b'\r')).count() as u64;
            for mistake in mistakes {
                prop_assert!(mistake.pointer.is_some() || mistake.line.is_some_and(|l| (1..=lines).contains(&l)), "{mistake:?}");
            }
        }
    }
    Ok(())
}

/// Valid cells and nearly valid cells.
fn cell() -> impl Strategy<Value = String> {
    let common = [
        "", "A01", "b2", "aa1", "P24", "AG1", "1,5", "1.500", "0.1", "-1", "µM", "% v/v", "mM", "negative", "Positive", "larva", "bead",
        "\"", "\"x", "nan", "1e400", "0", "3",
    ];
    prop_oneof![8 => prop::sample::select(common.to_vec()).prop_map(str::to_owned), 1 => "[ -~µ\\r\\n]{0,6}"]
}

proptest! {
    #[test]
    fn bytes_of_any_kind_are_read_or_refused_with_their_place(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        check(&bytes, Format::Csv)?;
        check(&bytes, Format::Json)?;
    }

    #[test]
    fn tables_of_any_kind_are_read_or_refused_with_their_place(
        headings in prop::sample::subsequence(cell::Column::ALL.to_vec(), 1..=10),
        rows in prop::collection::vec(prop::collection::vec(cell(), 10), 0..12),
        delimiter in prop::sample::select(vec![",", ";", "\t"]),
        end in prop::sample::select(vec!["\n", "\r\n", "\r", "\n\n"]),
    ) {
        let heading = headings.iter().map(|c| c.name()).collect::<Vec<_>>().join(delimiter);
        let rows = rows.iter().map(|row| format!("{end}{}", row[..headings.len()].join(delimiter))).collect::<String>();
        check(format!("{heading}{rows}").as_bytes(), Format::Csv)?;
    }

    #[test]
    fn conditions_of_any_kind_are_read_or_refused_with_their_place(
        wells in prop::collection::vec(prop::collection::vec((prop::sample::select(vec!["Well", "Plate", "Dose", "Compound", "DoseUnit", "x/y"]), cell()), 0..5), 0..6),
    ) {
        let wells: Vec<_> = wells.into_iter().map(|w| w.into_iter().map(|(k, v)| (k, v.into())).collect::<std::collections::BTreeMap<&str, serde_json::Value>>()).collect();
        check(serde_json::json!({ "AssayConditions": wells }).to_string().as_bytes(), Format::Json)?;
        check(serde_json::json!(wells).to_string().as_bytes(), Format::Json)?;
    }
}

#[test]
fn the_example_of_the_documents_is_sound() {
    let map = csv(include_str!("../../../../config/plate-map.csv")).unwrap();
    assert_eq!((map.plate_map.len(), map.notes.len()), (7, 0));
    let documents = include_str!("../../../../docs/plate-map.md");
    for column in cell::Column::ALL {
        assert!(documents.contains(&format!("`{}`", column.name())), "docs/plate-map.md lacks {}", column.name());
    }
    for unit in ConcentrationUnit::ALL {
        assert!(documents.contains(&format!("`{}`", unit.symbol())), "docs/plate-map.md lacks {}", unit.symbol());
    }
}

/// The layout of plater: a block per column.
#[test]
fn blocks_in_the_layout_of_the_plate_are_read() {
    let map = csv("compound,1,2,3\nA,DMSO,rapamycin,\nB,,rapamycin,\n,,,\nconcentration,1,2,3\nA,,5,\nB,,10,\n\n\
         concentration_unit,1,2,3\nA,,uM,\nB,,uM,\n\nClutch,1,2,3\nA,a,b,\nB,,b,c\n")
    .unwrap();
    let wells: Vec<(&str, Option<&str>, Option<f64>)> =
        map.plate_map.iter().map(|p| (p.well.as_str(), p.compound.as_deref(), p.concentration)).collect();
    let expected =
        [("A01", Some("DMSO"), None), ("A02", Some("rapamycin"), Some(5.0)), ("B02", Some("rapamycin"), Some(10.0)), ("B03", None, None)];
    assert_eq!(wells, expected);
    assert_eq!(map.metadata["columns"]["Clutch"], serde_json::json!({"A01": "a", "A02": "b", "B02": "b", "B03": "c"}));
    let wrong = csv("compound,1,2,3\nA,x,,\nA,y,,\nrow 3,,,\nC,x,y,z,w\n").unwrap_err();
    let said: Vec<String> = wrong.iter().map(ToString::to_string).collect();
    assert!(said[0].starts_with("line 3, compound: the block compound is there twice"), "{said:?}");
    assert!(said[1].starts_with("line 4, compound: expected a letter of a row and 3 cells"), "{said:?}");
    assert!(said[2].starts_with("line 5, compound: expected a letter"), "{said:?}");
}

/// The kind of an Echo's transfer report: lines before and behind the list, and a backfill of solvent.
#[test]
fn a_report_of_an_acoustic_dispenser_is_read() {
    let map = csv(
        "Run ID,14618\nRun Date/Time,11/27/2026 09:12\n\n[DETAILS]\nSource Well,Destination Plate Barcode,Destination Well,Sample Name,\
         Transfer Volume,Destination Concentration,Destination Concentration Units\nA1,P-7,B3,rapamycin,2.5,5,uM\n\
         A2,P-7,B3,DMSO,22.5,,\nA2,P-7,B4,DMSO,25,,\n\nInstrument Name,E5XX-1\nInstrument Serial Number,E5XX-1234\n",
    )
    .unwrap();
    let wells: Vec<(&str, Option<&str>, Option<f64>)> =
        map.plate_map.iter().map(|p| (p.well.as_str(), p.compound.as_deref(), p.concentration)).collect();
    assert_eq!(wells, [("B03", Some("rapamycin"), Some(5.0)), ("B04", Some("DMSO"), None)]);
    for part in
        ["Destination Well: is read as well", "Sample Name: is read as compound", "1 line(s) of a solvent", "2 line(s) that name no well"]
    {
        assert!(map.notes.iter().any(|note| note.contains(part)), "{part}: {:?}", map.notes);
    }
    assert_eq!(map.metadata["columns"]["Source Well"]["B03"], "A1");
    // Two compounds in one well: which one it is must be said.
    let wrong = csv("Destination Well,Sample Name\nA1,a\nA1,b\n").unwrap_err();
    assert!(wrong[0].to_string().contains("A01 stands in the plate map twice"), "{wrong:?}");
}

#[test]
fn a_report_that_is_not_one_plate_as_it_was_dispensed_is_refused() {
    let refusal = |text: &str| csv(text).unwrap_err()[0].to_string();
    let plates = refusal("Destination Plate Barcode,Destination Well,Sample Name\nP-7,A1,a\nP-8,E1,b\n");
    assert!(plates.contains("the file has the plates P-7, P-8"), "{plates}");
    let failed = refusal("Destination Well,Sample Name,Actual Volume,Transfer Status\nA1,a,2.5,\nB1,b,0,MM0202007: no fluid\n");
    assert!(failed.contains("the transfer to B01 failed"), "{failed}");
    // Failed transfers are listed before the others, under other columns.
    let map = csv("[EXCEPTIONS]\nDestination Well,Source Well,Transfer Status\nC1,A1,MM0202007\n\n[DETAILS]\nSource Well,Destination Well,Sample Name\n\
                   A1,A1,a\n")
        .unwrap();
    assert_eq!(map.plate_map.iter().map(|p| p.well.as_str()).collect::<Vec<_>>(), ["A01"]);
    // A compound whose name begins like a solvent.
    let two = refusal("Destination Well,Sample Name\nA1,PBS-1086\nA1,rapamycin\n");
    assert!(two.contains("A01 stands in the plate map twice"), "{two}");
}

#[test]
fn a_report_of_a_digital_dispenser_and_a_table_of_omero_are_read() {
    let map =
        csv("Dispensed well,Fluid name,Dispensed conc.,Conc. units\nA1,rapamycin,\"0.5\",\u{b5}M\nB1,DMSO normalization,,\n").unwrap();
    assert_eq!((map.plate_map[0].concentration, map.plate_map[0].compound.as_deref()), (Some(0.5), Some("rapamycin")));
    let map = csv("# header s,s,s,d\nPlate,Well,Compound,DPF\nP-7,A1,DMSO,4\n").unwrap();
    assert_eq!((map.plate_map[0].well.as_str(), map.plate_map[0].dpf), ("A01", Some(4.0)));
    // A lab's own column of such a name stays its own beside carved's.
    let map = csv("well,compound,Sample Name\nA01,DMSO,s-17\n").unwrap();
    assert_eq!((map.plate_map[0].compound.as_deref(), &map.metadata["columns"]["Sample Name"]["A01"]), (Some("DMSO"), &"s-17".into()));
}
