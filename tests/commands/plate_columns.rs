//! The columns of a table of another program, on the command line: proposed, corrected and read.

use crate::common::{run, stderr};
use serde_json::{Value, json};
use std::path::Path;

const FOREIGN: &str = "Plate layout of 3 March\nPosition;Drug;Dose (µM);Type\na1;valproate;1,5;test\na2;DMSO;;vehicle\n";

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn the_columns_of_a_foreign_table_are_proposed_corrected_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let (file, columns) = (dir.path().join("layout.csv"), dir.path().join("columns.json"));
    std::fs::write(&file, FOREIGN).unwrap();
    assert_eq!(run(&["plate", "check", text(&file)]).status.code(), Some(3), "nothing is read by a guess");

    let proposed = run(&["plate", "columns", text(&file)]);
    let said = stderr(&proposed);
    assert!(
        said.contains("the headings are in line 2, and 2 line(s) follow") && said.contains("Type: kept as it is (cells: test, vehicle)"),
        "{said}"
    );
    let mut named: Value = serde_json::from_slice(&proposed.stdout).unwrap();
    assert_eq!(
        named,
        json!([
            {"heading": "Position", "column": "well"},
            {"heading": "Drug", "column": "compound"},
            {"heading": "Dose (µM)", "column": "concentration", "unit": "uM"},
            {"heading": "Type", "column": null},
        ])
    );
    named[3]["column"] = "treatment".into();
    // As an editor of Windows stores it.
    std::fs::write(&columns, format!("\u{feff}{named}")).unwrap();
    let read = run(&["plate", "check", text(&file), "--columns", text(&columns), "--json"]);
    let map: Value = serde_json::from_slice(&read.stdout).unwrap_or_else(|e| panic!("{e}: {}", stderr(&read)));
    assert_eq!(map["plate_map"][0]["concentration"], 1.5);
    assert_eq!((&map["plate_map"][0]["well"], &map["plate_map"][1]["treatment"]), (&"A01".into(), &"vehicle".into()));
    assert_eq!(map["metadata"]["column_mapping"], named);
}

#[test]
fn what_is_no_list_of_columns_is_refused_with_the_way_to_one() {
    let dir = tempfile::tempdir().unwrap();
    let (file, columns) = (dir.path().join("layout.csv"), dir.path().join("columns.json"));
    std::fs::write(&file, FOREIGN).unwrap();
    for wrong in ["Position=well", "{}", r#"[{"heading": "Position", "column": "position"}]"#, r#"[{"heading": "Position", "cell": 1}]"#] {
        std::fs::write(&columns, wrong).unwrap();
        let refused = run(&["plate", "check", text(&file), "--columns", text(&columns)]);
        let said = stderr(&refused);
        assert!(refused.status.code() == Some(1) && said.contains("corrected output of `carved plate columns`"), "{wrong}: {said}");
    }
    let map = dir.path().join("map.json");
    std::fs::write(&map, "[]").unwrap();
    let refused = run(&["plate", "check", text(&map), "--columns", text(&columns)]);
    assert!(stderr(&refused).contains("is JSON; leave it out"), "{}", stderr(&refused));
    // A table that has no headings has no columns to name.
    std::fs::write(&file, "compound,1,2,3\nA,x,y,z\n").unwrap();
    assert_eq!(run(&["plate", "columns", text(&file)]).status.code(), Some(3));
}
