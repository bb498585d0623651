//! The parsers of the commands' files and of the daemon's answers, for tests that feed them bytes of any kind.

use super::setup::bench::{Bench, Outcome, Request};
use super::setup::machine::{Machine, Step};
use super::setup::terminal::Answers;
use super::{import, reconstruct, reference, run, segment};
use crate::api::Status;
use carved_records::picture_name;
use std::path::Path;

/// The lists of angles that `carved import --angles` reads.
pub fn angles(bytes: &[u8]) -> anyhow::Result<()> {
    let pictures: Vec<String> = (0..4).map(|n| format!("v{n}.png")).collect();
    let text = std::str::from_utf8(bytes)?;
    let paths = pictures.iter().map(Path::new);
    let plate = import::angles::PlatePictures { views: &[0, 1, 2, 3], pictures: (0..).zip(paths).collect() };
    import::angles::parse(text, &pictures, Some(&plate)).ok();
    import::angles::parse(text, &pictures, None).map(|_| ())
}

/// The cameras that `carved reconstruct --cameras` reads.
pub fn cameras(bytes: &[u8]) -> anyhow::Result<()> {
    reconstruct::cameras::parse(std::str::from_utf8(bytes)?).map(|_| ())
}

/// The shapes of FishInspector.
pub fn shapes(bytes: &[u8]) -> anyhow::Result<()> {
    segment::shapes::read(bytes, [40, 20])?;
    Ok(())
}

/// Pictures at the door of `carved import` and `carved segment`.
pub fn picture(bytes: &[u8]) -> anyhow::Result<()> {
    segment::input::decode(bytes, None).map(|_| ())
}

/// The mask that `carved segment --compare` reads, of a picture of 40 x 20 px.
pub fn mask(bytes: &[u8]) -> anyhow::Result<()> {
    segment::annotation::decode_mask(bytes, [40, 20]).map(|_| ())
}

/// The settings of `carved segment --settings`.
pub fn segment_settings(bytes: &[u8]) -> anyhow::Result<()> {
    segment::parse_settings(std::str::from_utf8(bytes)?).map(|_| ())
}

/// The camera that `carved import --cameras` reads.
pub fn camera_of_pictures(bytes: &[u8]) -> anyhow::Result<()> {
    import::rig::parse(std::str::from_utf8(bytes)?).map(|_| ())
}

/// The names of the pictures of a plate, one per line, as `carved import --plate` sorts them.
pub fn plate_of_pictures(bytes: &[u8]) -> anyhow::Result<()> {
    let names = std::str::from_utf8(bytes)?.lines().map(Path::new);
    let labelled = names.filter_map(|name| Some((name.to_owned(), picture_name::read(name, None)?))).collect();
    let plate = import::plate::sort::sort(labelled, None)?;
    let views = plate.views(None)?;
    for pictures in plate.wells.values() {
        pictures.missing(&views);
        pictures.in_order(&views)?;
    }
    Ok(())
}

/// A silhouette that `carved reconstruct` reads.
pub fn silhouette(file: &Path) -> anyhow::Result<()> {
    reconstruct::views::view(file).map(|_| ())
}

/// The table of control larvae that `carved reference build` reads.
pub fn controls(bytes: &[u8]) -> anyhow::Result<()> {
    reference::controls::rows(bytes, Path::new("controls.csv"), &reference::controls::Words::default()).map(|_| ())
}

/// The file of `carved setup --answers`.
pub fn setup_answers(bytes: &[u8]) -> anyhow::Result<()> {
    Answers::parse(std::str::from_utf8(bytes)?).map(|_| ())
}

/// An interrupted set-up, on the first line, and answers to what it asks next, one per line.
pub fn setup(bytes: &[u8]) -> anyhow::Result<()> {
    struct NoBench;
    impl Bench for NoBench {
        fn perform(&mut self, _: &Request) -> Result<Outcome, String> {
            Err("there is no instrument".into())
        }
        fn check(&self, _: &str) -> Result<Vec<String>, String> {
            Ok(Vec::new())
        }
        fn exists(&self) -> bool {
            false
        }
    }
    let (state, answers) = std::str::from_utf8(bytes)?.split_once('\n').unwrap_or_default();
    let mut machine = Machine::resume(serde_json::from_str(state)?);
    for typed in answers.lines() {
        let step = machine.next(false);
        machine.stage(&step);
        if let Step::Act(action) = step {
            let draft = machine.draft();
            let failed = NoBench.perform(&machine.request(action, &draft)).err().unwrap_or_default();
            machine.failed(action, failed);
        } else if let Err(refused) = machine.answer(typed, &NoBench) {
            refused.text();
        }
    }
    machine.draft();
    machine.summary();
    Ok(())
}

/// What a daemon answers to `carved run`: the status of HTTP on the first line, and the body.
pub fn answer_of_daemon(bytes: &[u8]) -> anyhow::Result<()> {
    let (code, body) = std::str::from_utf8(bytes)?.split_once('\n').unwrap_or_default();
    let answer = run::client::judge("http://daemon", code.trim().parse()?, body)?;
    let status: Status = serde_json::from_value(answer)?;
    run::show::status(&status);
    status.faults.iter().map(run::show::fault).for_each(drop);
    if let Some(shown) = &status.run {
        run::show::counts(shown);
        run::show::end(shown, status.mode);
        shown.results.iter().map(|well| run::show::well(well, status.mode)).for_each(drop);
    }
    Ok(())
}
