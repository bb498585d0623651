//! A plate map's file over HTTP: its wells can go into a plan, and its errors are named.

use crate::rig::Rig;
use serde_json::{Value, json};

const CSV: [(&str, &str); 1] = [("Content-Type", "text/csv; charset=utf-8")];
const JSON: [(&str, &str); 1] = [("Content-Type", "application/json")];
const CHECK: &str = "/v1/plate-maps/check";
const MAP: &str = "Well;Compound;Concentration;Concentration Unit;dpf\r\nA1;DMSO;0,1;%;3\r\nA02;x;5;µM;3\r\n";

#[test]
fn what_a_check_answers_is_taken_in_a_plan() {
    let rig = Rig::start();
    let answer = rig.send("POST", CHECK, &CSV, MAP);
    assert_eq!(answer.status, 200, "{}", answer.json());
    let map = answer.json();
    assert_eq!(
        map["plate_map"][0],
        json!({"well": "A01", "specimen": "larva", "dpf": 3.0, "compound": "DMSO", "concentration": 0.1, "concentration_unit": "%"})
    );
    assert_eq!(map["notes"], json!(["line 2: A1 is read as A01"]));
    let plan =
        json!({"plate_barcode": "P", "method": "standard", "operator": "kim", "plate_map": map["plate_map"], "metadata": {"a": [1]}});
    assert_eq!(rig.put("/v1/runs/r", &plan.to_string()).status, 201);
    assert_eq!(rig.send("POST", CHECK, &JSON, &map.to_string()).status, 200, "what was answered can be asked again");
    assert_eq!(*rig.commands.lock().unwrap(), ["put r"], "a check starts nothing");
}

#[test]
fn every_mistake_is_named_with_its_line() {
    let rig = Rig::start();
    let answer = rig.send("POST", CHECK, &CSV, &MAP.replace("µM", "furlong").replace("A1", "AG1"));
    assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid_plate_map"));
    let problem = answer.json();
    let places: Vec<(&Value, &Value)> = problem["errors"].as_array().unwrap().iter().map(|e| (&e["line"], &e["column"])).collect();
    assert_eq!(places, [(&json!(2), &json!("Well")), (&json!(3), &json!("Concentration Unit"))]);
    assert!(problem["detail"].as_str().unwrap().contains("line 3, Concentration Unit: "), "{problem}");
    assert_eq!(problem["scheduler_action"], "reject_plate");
    // A well that the chosen plate does not have.
    let answer = rig.send("POST", &format!("{CHECK}?plate_format=96"), &CSV, "well\nA01\nI12\n");
    assert_eq!((answer.status, &answer.json()["errors"][0]["line"]), (422, &json!(3)));
    assert_eq!(rig.send("POST", &format!("{CHECK}?plate_format=97"), &CSV, "well\nA01\n").status, 422);
    let answer = rig.send("POST", CHECK, &JSON, r#"[{"well": "A01", "dpf": 99}]"#);
    assert_eq!((answer.status, &answer.json()["errors"][0]["pointer"]), (422, &json!("/0/dpf")));
}

#[test]
fn one_of_several_plates_is_chosen_by_the_query() {
    let rig = Rig::start();
    let two = r#"{"AssayConditions": [{"Plate": "P1", "Well": "A1"}, {"Plate": "P2", "Well": "B1"}]}"#;
    assert_eq!(rig.send("POST", CHECK, &JSON, two).status, 422);
    let chosen = rig.send("POST", &format!("{CHECK}?plate=P2"), &JSON, two);
    assert_eq!(chosen.json()["plate_map"][0]["well"], "B01");
    let wrong = rig.send("POST", &format!("{CHECK}?plaet=P2"), &JSON, two);
    assert_eq!((wrong.status, wrong.problem().as_str()), (400, "bad_query"));
}

#[test]
fn types_and_sizes_are_bounded() {
    let rig = Rig::start();
    let xlsx = [("Content-Type", "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet")];
    for kind in [&[][..], &xlsx] {
        let answer = rig.send("POST", CHECK, kind, MAP);
        assert_eq!((answer.status, answer.problem().as_str()), (415, "not_a_plate_map"));
    }
    let padded = |length: usize| format!("{MAP}{}", "\n".repeat(length - MAP.len()));
    assert_eq!(rig.send("POST", CHECK, &CSV, &padded(1 << 20)).status, 200);
    assert_eq!(rig.send("POST", CHECK, &CSV, &padded((1 << 20) + 1)).status, 413);
}

#[test]
fn the_columns_of_a_foreign_table_are_proposed_and_read_as_a_person_says() {
    let rig = Rig::start();
    let table = "Position;Drug;Dose (uM)\r\na1;x;1,5\r\n";
    assert_eq!(rig.send("POST", CHECK, &CSV, table).status, 422, "its columns are not known");
    let columns = "/v1/plate-maps/columns";
    let proposed = rig.send("POST", columns, &CSV, table);
    assert_eq!(proposed.status, 200, "{}", proposed.json());
    let proposed = proposed.json();
    let of = |at: usize| (&proposed["columns"][at]["column"], &proposed["columns"][at]["unit"]);
    assert_eq!(
        [of(0), of(1), of(2)],
        [(&json!("well"), &Value::Null), (&json!("compound"), &Value::Null), (&json!("concentration"), &json!("uM"))]
    );
    let said = json!([{"heading": "Position", "column": "well"}, {"heading": "Drug", "column": "strain"}, {"heading": "Dose (uM)", "column": null}]);
    let query: String = said.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect();
    let read = rig.send("POST", &format!("{CHECK}?columns={query}"), &CSV, table);
    assert_eq!(read.status, 200, "{}", read.json());
    let map = read.json();
    assert_eq!(map["plate_map"], json!([{"well": "A01", "specimen": "larva", "dpf": null, "strain": "x"}]));
    assert_eq!((&map["metadata"]["columns"], &map["metadata"]["column_mapping"]), (&json!({"Dose (uM)": {"A01": "1,5"}}), &said));
    assert_eq!(rig.send("POST", &format!("{CHECK}?columns=[7]"), &CSV, table).problem(), "bad_query");
    for path in [columns, &format!("{CHECK}?columns=[]")] {
        assert_eq!(rig.send("POST", path, &JSON, "[]").problem(), "not_a_plate_map", "{path}");
    }
    assert_eq!(rig.send("POST", columns, &CSV, "compound,1,2,3\nA,x,y,z\n").status, 422, "it is in the layout of the plate");
    assert!(rig.commands.lock().unwrap().is_empty());
}
