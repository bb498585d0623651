//! The questions as they are asked: words, form and default, by what is known.

use super::bench::Listed;
use super::question::{Choice, Kind, Question};
use super::state::State;

/// The answer of a rig whose light carved does not switch.
pub const NO_LIGHT: &str = "none";

/// The last question. It is asked only where a file exists or could not be written.
pub const REPLACE: &str = "replace";

/// Diameters of capillary bores that are in use, um, and of beads.
const BEAD_UM: [f64; 2] = [20.0, 4500.0];
/// From this difference on, a person must say which of both is the ruler, %. The walls of a bore are seen to half a per cent, and capillaries
/// are made to one or two.
const UNUSUAL_SCALE_PERCENT: f64 = 4.0;

/// A question, as it is asked now.
pub fn question(s: &State, id: &'static str) -> Question {
    let (text, kind, default) = words(s, id);
    let problem = s.problem.as_ref().filter(|problem| problem.id == id);
    let default = problem.and_then(|p| p.proposal.clone()).or(default);
    Question { id, text, kind, default, problem: problem.map(|p| p.text.clone()) }
}

/// Text, form and default of a question.
fn words(s: &State, id: &str) -> (String, Kind, Option<String>) {
    let listed = |list: &Option<Vec<Listed>>| list.iter().flatten().map(|l| Choice::new(&l.name, &l.label)).collect::<Vec<_>>();
    let only = |options: &[Choice]| if let [one] = options { Some(one.value.clone()) } else { None };
    let some = |text: &str| Some(text.to_owned());
    let chosen = |options: &[(&str, &str)]| Kind::Choice {
        options: options.iter().map(|(value, label)| Choice::new(*value, *label)).collect(),
        open: false,
    };
    let pixels = Kind::Number { unit: "px", range: [64.0, 65_535.0] };
    match id {
        "controller" => {
            let options = listed(&s.ports);
            let text = "Port of the controller that turns the capillary, such as /dev/ttyUSB0, or HOST:PORT of a VAST relay.";
            let default = only(&options);
            (text.into(), Kind::Choice { options, open: true }, default)
        }
        "steps" => (
            "Motor steps of one turn of the capillary: motor steps x microsteps x gear, such as 500, 200 x 16 or 200 x 32 x 5/2.".into(),
            Kind::Steps,
            some(s.controller_setup().map_or("500", |setup| setup.usual_steps)),
        ),
        "reference" => (
            "Where step 0 is.".into(),
            chosen(&[("home", "The motors search a home switch"), ("here", "Where the motors stand when carved starts")]),
            some(if s.controller.as_ref().and_then(|c| c.homes) == Some(false) { "here" } else { "home" }),
        ),
        "light" => (
            "Output of the controller that switches the light. carved then has it on while it takes pictures, and off otherwise.".into(),
            Kind::Choice { options: light_pins(s), open: false },
            some(NO_LIGHT),
        ),
        "camera" => {
            let options = listed(&s.cameras);
            let default = only(&options);
            ("Address of the camera that looks at the capillary.".into(), Kind::Choice { options, open: true }, default)
        }
        "pixel_format" => (
            "Format of the frames.".into(),
            chosen(&[
                ("BayerRG8", "A colour camera, as on VAST"),
                ("BayerGR8", "A colour camera whose first row begins with green and red"),
                ("BayerGB8", "A colour camera whose first row begins with green and blue"),
                ("BayerBG8", "A colour camera whose first row begins with blue"),
                ("Mono8", "Grey"),
                ("RGB8Packed", "Colour, made by the camera"),
            ]),
            some("BayerRG8"),
        ),
        "width" => ("Width of the picture, along the capillary.".into(), pixels, some("1024")),
        "height" => ("Height of the picture, across the capillary.".into(), pixels, some("1024")),
        "data_dir" => ("Folder for the runs.".into(), Kind::Text, some("/var/lib/carved")),
        "tolerance_percent" => (
            "How far the measured diameter may be from the stated one. The spread of the batch is on the certificate.".into(),
            Kind::Number { unit: "%", range: [0.1, 10.0] },
            some("1"),
        ),
        REPLACE => ("Write the configuration? A file of that name is kept with the ending .bak.".into(), Kind::Confirm, None),
        "name" => ("Name of this instrument. It is written into every recording.".into(), Kind::Text, some("vast-1")),
        _ => words_of_specimens(s, id),
    }
}

/// The outputs of the controller at which a light can be.
fn light_pins(s: &State) -> Vec<Choice> {
    let mut options = vec![Choice::new(NO_LIGHT, "None: the light is always on, or something else switches it")];
    options.extend(s.controller_setup().into_iter().flat_map(|setup| setup.lights).map(|(pin, label)| Choice::new(*pin, *label)));
    options
}

/// As `words`, for the questions about what is in the capillary.
fn words_of_specimens(s: &State, id: &str) -> (String, Kind, Option<String>) {
    match id {
            "empty" => ("Flush the capillary, so that it is empty and full of water. Is it empty?".into(), Kind::Confirm, None),
            "bore_um" => (
                "Inner diameter of the capillary, by its data sheet.".into(),
                Kind::Number { unit: "um", range: [100.0, 5000.0] },
                // No usual value: whoever takes it without reading the data sheet gets all volumes wrong.
                None,
            ),
            "bead_um" => ("Certified diameter of the bead.".into(), Kind::Number { unit: "um", range: BEAD_UM }, Some("500".into())),
            "loaded" => ("Bring one bead into the middle of the picture. Is it there?".into(), Kind::Confirm, None),
            "motion" => (
                "The motors will now home and turn the capillary: two turns forwards, then one turn up to three times. Nothing else moves. Keep a \
                 hand on their power switch. May they move?"
                    .into(),
                Kind::Confirm,
                None,
            ),
            "sense" => (
                "While the capillary turned forwards, did its near side go down or up in the picture? A wrong answer makes the models mirror \
                 images; volumes do not change."
                    .into(),
                Kind::Choice {
                    options: vec![
                        Choice::new("down", "Down"),
                        Choice::new("up", "Up"),
                        Choice::new("unknown", "Not seen; measure it later with carved calibrate marked"),
                    ],
                    open: false,
                },
                Some("unknown".into()),
            ),
            _ => {
                let off = s.off_percent(s.bead.as_ref()).unwrap_or(0.0);
                let is_usual = off.abs() <= UNUSUAL_SCALE_PERCENT;
                let advice = if is_usual {
                    "The walls are seen to about half a per cent, so take the bead unless you doubt its certificate."
                } else {
                    "So large a difference comes from a wrong number: read both certificates again, and type back to correct the diameter of \
                     the bore or of the bead."
                };
                (
                    format!("By the scale of the bore the bead measures {off:+.2} % against its certificate. Which of both is the ruler? {advice}"),
                    Kind::Choice { options: vec![Choice::new("bead", "The bead"), Choice::new("bore", "The bore")], open: false },
                    is_usual.then(|| "bead".into()),
                )
            }
        }
}
