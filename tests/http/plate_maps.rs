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
