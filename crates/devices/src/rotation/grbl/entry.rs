//! What the registry of drivers knows about Grbl and grblHAL.

use super::report::Line;
use super::{Dialect, intervention};
use crate::DeviceError;
use crate::rotation::driver::{Entry, Example, Serial, Setup};
use crate::rotation::identify::{Answer, Key, Wire};
use std::collections::BTreeMap;
use std::time::Duration;

/// Time of an Arduino's boot loader until its greeting.
const BOOT: Duration = Duration::from_millis(2500);

pub(in crate::rotation) const ENTRY: Entry = Entry {
    name: "grbl",
    example: Example { file: "vast-grbl.toml", text: include_str!("../../../../../config/vast-grbl.toml") },
    serial: Some(Serial { protocol: "Grbl, grblHAL", identify }),
    setup: Ok(Setup {
        can_home: true,
        usual_steps: "500",
        lights: &[("flood_coolant", "Flood coolant, M8"), ("mist_coolant", "Mist coolant, M7"), ("spindle", "Spindle, M3")],
    }),
    fixed_steps: None,
};

/// A controller sends its name at a start, and its status at any time. A bridge sends OK, which other controllers send as well.
fn identify(wire: &mut Wire) -> Result<Option<Answer>, DeviceError> {
    let is_greeting = |text: &str| text.get(..4).is_some_and(|head| head.eq_ignore_ascii_case("grbl"));
    let greeting = wire.hear(BOOT, |text| is_greeting(text).then(|| text.to_owned()))?;
    let status = wire.ask(b"?", |text| text.starts_with('<').then(|| text.to_owned()))?;
    if greeting.is_none() && status.is_none() {
        return Ok(None);
    }
    wire.quiet()?;
    let build: Vec<String> = wire.listing(b"$I\n")?.into_iter().filter(|l| l.starts_with('[')).collect();
    let settings: BTreeMap<u16, f64> = wire.listing(b"$$\n")?.iter().filter_map(|l| setting(l)).collect();
    let name = greeting.and_then(|g| Some(g.split(" [").next()?.to_owned()));
    let is_driven = name
        .as_ref()
        .map_or_else(|| status.as_ref().is_some_and(|status| is_driven(status, &build)), |name| Dialect::Auto.of(name).is_ok());
    let held = status.as_deref().and_then(held);
    // What is refused without a name is shown by its report too: the report may be why.
    let report = status.filter(|_| name.is_none() && !is_driven);
    let version = name.into_iter().chain(build).chain(report).collect::<Vec<_>>().join(" ");
    Ok(Some(answer(is_driven, &version, &settings, held)))
}

/// What keeps a controller with this report from moving. `None` if nothing does.
fn held(report: &str) -> Option<String> {
    let Line::Status(status) = Line::parse(report) else { return None };
    match intervention::of(&status, true)? {
        DeviceError::Intervention { what, .. } => Some(format!("it would not move now: {what}. End that before the first run")),
        _ => None,
    }
}

/// Whether the driver accepts a controller that was not reset, by its status and its answer to `$I`. Grbl 0.9 separates the fields of its
/// status by commas. A busy controller refuses `$I`; an idle one without a version is another firmware.
fn is_driven(status: &str, build: &[String]) -> bool {
    let versions: Vec<&str> = build.iter().filter_map(|line| line.strip_prefix("[VER:")).collect();
    let may_say_none = !status.starts_with("<Idle");
    status.contains('|') && (may_say_none || !versions.is_empty()) && versions.iter().all(|version| version.starts_with("1.1"))
}

fn setting(line: &str) -> Option<(u16, f64)> {
    let (number, value) = line.strip_prefix('$')?.split_once('=')?;
    Some((number.parse().ok()?, value.parse().ok()?))
}

/// `version`: greeting and answer to `$I`. `settings`: answer to `$$`, empty if the controller was too busy to print it. `held`: what keeps it
/// from moving.
fn answer(is_driven: bool, version: &str, settings: &BTreeMap<u16, f64>, held: Option<String>) -> Answer {
    let is_hal = version.to_ascii_lowercase().contains("grblhal");
    if !is_driven {
        let refusal = "the driver of carved accepts Grbl 1.1 and grblHAL 1.1 only; install one of them on this controller";
        return Answer { refusal: Some(refusal), ..Answer::plain("grbl", version.into()) };
    }
    let of_axis_x = [(100, "steps_per_unit"), (110, "max_rate_units_per_min"), (120, "acceleration_units_per_s2")];
    let mut keys: Vec<Key> = of_axis_x
        .into_iter()
        .filter_map(|(number, name)| {
            let value = settings.get(&number)?;
            let value = if number == 100 { ratio(*value) } else { format!("{value:?}") };
            Some(Key { name, value, source: format!("its ${number}, for axis X; Y has ${}", number + 1) })
        })
        .collect();
    keys.extend(settings.get(&22).map(|on| {
        let (value, state) = if *on as u32 & 1 == 1 { ("\"home\"", "on") } else { ("\"here\"", "off") };
        Key { name: "reference", value: value.into(), source: format!("its $22 is {state}") }
    }));
    let of_settings = if settings.is_empty() {
        Some("its settings could not be read. Ask again when it is idle".to_owned())
    } else {
        idle(is_hal, settings)
    };
    let remarks: Vec<String> = held.into_iter().chain(of_settings).collect();
    let remark = (!remarks.is_empty()).then(|| remarks.join(". "));
    let name = format!("{}: {version}", if is_hal { "grblHAL" } else { "Grbl" });
    Answer { keys, remark, ..Answer::plain("grbl", name) }
}

/// What to change where the motors lose their current after each move. `None` where they keep it.
fn idle(is_hal: bool, settings: &BTreeMap<u16, f64>) -> Option<String> {
    // grblHAL may instead list the motors that stay powered.
    let kept = is_hal && settings.get(&37).is_some_and(|mask| *mask != 0.0);
    let ms = settings.get(&1).filter(|ms| **ms as u32 != 255 && !kept)?;
    Some(format!("set $1=255 in the controller: now its motors lose their current {ms} ms after each move"))
}

/// The exact ratio of a value that was printed with three decimals, if a fraction with a small denominator matches.
fn ratio(printed: f64) -> String {
    let fits = |den: &u32| {
        let num = printed * f64::from(*den);
        (num.round() / f64::from(*den) - printed).abs() <= 0.000_501
    };
    match (1..=1000).find(fits) {
        Some(den) => format!("[{}, {den}]", (printed * f64::from(den)).round()),
        None => format!("[{}, 1000]", (printed * 1000.0).round()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_configuration_is_offered_for_a_firmware_that_the_driver_refuses() {
        let settings = BTreeMap::from([(100, 100.0)]);
        let refused = answer(false, "Grbl 3.7 [VER:3.7 FluidNC v3.7.15:]", &settings, None);
        assert!(refused.name.contains("FluidNC") && refused.refusal.is_some() && refused.keys.is_empty(), "{refused:?}");
        let driven = answer(true, "Grbl 1.1h", &settings, None);
        assert!(driven.refusal.is_none() && driven.keys.len() == 1, "{driven:?}");
    }

    #[test]
    fn a_controller_that_a_person_holds_is_offered_with_what_keeps_it_from_moving() {
        for (report, word) in [
            ("<Check|MPos:0.000,0.000,0.000|FS:0,0>", "check mode"),
            ("<Door:1|MPos:0.000,0.000,0.000|FS:0,0|Pn:D>", "door is open"),
            ("<Sleep|MPos:0.000,0.000,0.000|FS:0,0>", "sleeps"),
            ("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>", "feed hold"),
        ] {
            let settings = BTreeMap::from([(1, 25.0), (100, 100.0)]);
            let offered = answer(true, "Grbl 1.1h", &settings, held(report));
            let remark = offered.remark.unwrap();
            assert!(remark.contains(word) && remark.contains("$1=255") && !offered.keys.is_empty(), "{remark}");
        }
        assert_eq!(held("<Idle|MPos:0.000,0.000,0.000|FS:0,0>"), None);
    }

    #[test]
    fn a_version_that_is_missing_is_allowed_to_a_busy_controller_only() {
        let lines = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        for (status, build, expected) in [
            ("<Idle|MPos:0.000,0.000,0.000|FS:0,0>", "[VER:1.1h.20190830:] [OPT:V,15,128]", true),
            ("<Idle|MPos:0.000,0.000,0.000|FS:0,0>", "[OPT:V,15,128]", false),
            ("<Idle|MPos:0.000,0.000,0.000|FS:0,0>", "", false),
            ("<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>", "", true),
            ("<Idle|MPos:0.000,0.000,0.000|FS:0,0>", "[VER:3.7]", false),
            ("<Idle,MPos:0.000,0.000,0.000,WPos:0.000,0.000,0.000>", "[VER:1.1h.20190830:]", false),
        ] {
            assert_eq!(is_driven(status, &lines(build)), expected, "{status} {build}");
        }
    }

    #[test]
    fn ratios_are_found_behind_three_decimals() {
        for (printed, written) in [(100.0, "[100, 1]"), (17.778, "[160, 9]"), (213.333, "[640, 3]"), (1.389, "[25, 18]"), (0.5, "[1, 2]")] {
            assert_eq!(ratio(printed), written);
        }
    }
}
