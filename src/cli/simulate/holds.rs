//! Wells of a simulated plate whose contents differ from the plate map.

use carved_records::is_well;
use hardware_sim::scene::{Contents, Placement, Specimen};
use std::str::FromStr;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Surprise {
    /// Two larvae, one behind the other.
    Two,
    /// A bubble of air.
    Bubble,
    /// A chip of plastic.
    Debris,
    /// A larva that extends beyond the left side of the picture.
    Clipped,
    /// A dead larva.
    Dead,
}

/// An option such as `B02=two`.
#[derive(Debug, Clone)]
pub struct Holds {
    pub well: String,
    pub what: Surprise,
}

impl FromStr for Holds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (well, what) = text.split_once('=').filter(|(well, _)| is_well(well)).ok_or("give WELL=WHAT, as in B02=two")?;
        Ok(Self { well: well.to_owned(), what: <Surprise as clap::ValueEnum>::from_str(what, false)? })
    }
}

impl Surprise {
    /// The contents of the scene. `dpf` and `seed` determine the larva.
    pub fn contents(self, dpf: u8, seed: u64) -> anyhow::Result<Contents> {
        let along = |x_um: f64| Placement { x_um, ..Placement::default() };
        Ok(match self {
            Self::Two => Contents {
                specimens: vec![Specimen::larva(3, seed)?.placed(along(-1950.0)), Specimen::larva(3, seed + 1)?.placed(along(1950.0))],
                clutter: Vec::new(),
            },
            Self::Bubble => Contents::default().beside(Specimen::bubble(400.0)?),
            Self::Debris => Contents::default().beside(Specimen::chip(250.0, seed)?),
            Self::Clipped => Specimen::larva(dpf, seed)?.placed(along(-2300.0)).into(),
            Self::Dead => Specimen::dead_larva(dpf, seed)?.into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;
    use hardware_sim::scene::{Scene, SceneSettings};

    #[test]
    fn a_well_and_what_it_holds_or_a_word_about_it() {
        let holds: Holds = "B02=two".parse().unwrap();
        assert_eq!((holds.well.as_str(), holds.what), ("B02", Surprise::Two));
        assert!("B2=two".parse::<Holds>().unwrap_err().contains("WELL=WHAT"));
        assert!("B02=tow".parse::<Holds>().is_err());
    }

    #[test]
    fn every_surprise_fits_the_bore() {
        let scene = Scene::new(SceneSettings::default());
        for &surprise in Surprise::value_variants() {
            let contents = surprise.contents(5, 11).unwrap();
            assert!(!contents.specimens.is_empty() || !contents.clutter.is_empty(), "{surprise:?} is nothing");
            scene.load(contents).unwrap_or_else(|e| panic!("{surprise:?}: {e}"));
        }
    }
}
