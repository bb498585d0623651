//! What a person is asked, and the rules for an answer that need nothing else than the question.

use carved_core::units::StepsPerRevolution;
use serde::Serialize;

/// One question. The same `id` is the key of its answer in a file of answers.
#[derive(Debug, Clone, PartialEq)]
pub struct Question {
    pub id: &'static str,
    pub text: String,
    pub kind: Kind,
    /// The answer that is taken if none is given. `None`: an answer must be given.
    pub default: Option<String>,
    /// Why this is asked again: what is wrong and what to do. An answer must then be given, also where there is a default.
    pub problem: Option<String>,
}

/// Short names of the questions, for a list of answers.
const TITLES: [(&str, &str); 19] = [
    ("name", "Name of the instrument"),
    ("controller", "Port of the controller"),
    ("steps", "Steps of one turn"),
    ("reference", "Step 0"),
    ("light", "Light"),
    ("camera", "Camera"),
    ("pixel_format", "Format of the frames"),
    ("width", "Width of the picture"),
    ("height", "Height of the picture"),
    ("data_dir", "Folder for the runs"),
    ("empty", "The capillary is empty"),
    ("bore_um", "Inner diameter of the capillary"),
    ("bead_um", "Diameter of the bead"),
    ("tolerance_percent", "Accepted deviation"),
    ("loaded", "The bead is in the picture"),
    ("motion", "The motors may move"),
    ("sense", "Sense of the turn"),
    ("ruler", "Ruler"),
    ("replace", "Write the file"),
];

/// The ids of all questions.
pub fn ids() -> impl Iterator<Item = &'static str> {
    TITLES.iter().map(|(id, _)| *id)
}

/// The short name of a question.
pub fn title(id: &str) -> &str {
    TITLES.iter().find(|(known, _)| *known == id).map_or(id, |(_, title)| title)
}

/// The form of the answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "form", rename_all = "lowercase")]
pub enum Kind {
    Text,
    Number {
        unit: &'static str,
        range: [f64; 2],
    },
    /// A product of whole numbers and fractions, such as `200 x 16 x 5/2`.
    Steps,
    Choice {
        options: Vec<Choice>,
        /// Other text is accepted as well.
        open: bool,
    },
    /// `yes` is the only answer that goes on.
    Confirm,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Choice {
    pub value: String,
    pub label: String,
}

impl Choice {
    pub fn new(value: impl Into<String>, label: impl Into<String>) -> Self {
        Self { value: value.into(), label: label.into() }
    }
}

impl Kind {
    /// The answer as it is stored.
    ///
    /// # Errors
    /// What was typed, what is expected, in words for the person.
    pub fn read(&self, typed: &str) -> Result<String, String> {
        let typed = typed.trim();
        match self {
            Self::Text if typed.is_empty() => Err("The answer is empty; type a text".into()),
            Self::Text => Ok(typed.to_owned()),
            Self::Number { unit, range: [least, most] } => {
                let number: f64 = typed.parse().map_err(|_| format!("{typed:?} is no number; expected {least} to {most} {unit}"))?;
                if (*least..=*most).contains(&number) {
                    Ok(typed.to_owned())
                } else {
                    Err(format!("{number} {unit}; expected {least} to {most} {unit}"))
                }
            }
            Self::Steps => steps(typed).map(|ratio| written(<[u32; 2]>::from(ratio))),
            Self::Choice { options, open } => {
                let chosen = typed.parse::<usize>().ok().and_then(|n| options.get(n.checked_sub(1)?));
                match options.iter().find(|option| option.value == typed).or(chosen) {
                    Some(option) => Ok(option.value.clone()),
                    None if *open && !typed.is_empty() => Ok(typed.to_owned()),
                    None => {
                        let known: Vec<_> = options.iter().map(|option| option.value.as_str()).collect();
                        Err(format!("{typed:?} is none of the answers; expected one of: {}", known.join(", ")))
                    }
                }
            }
            Self::Confirm if ["yes", "y", "true"].contains(&typed) => Ok("yes".into()),
            Self::Confirm => Err(format!("{typed:?}; type yes to go on, or end the set-up with Ctrl-C")),
        }
    }
}

/// Reads `500`, `160/9` or `200 x 16 x 5/2` as an exact ratio.
pub fn steps(typed: &str) -> Result<StepsPerRevolution, String> {
    let refused = || format!("{typed:?} is no number of steps; expected motor steps x microsteps x gear, as in 500, 200 x 16 or 200 x 5/2");
    let [mut num, mut den] = [1_u64; 2];
    for factor in typed.split(['x', '*']) {
        let (above, below) = factor.split_once('/').unwrap_or((factor, "1"));
        let whole = |text: &str| text.trim().parse::<u32>().ok().filter(|n| *n > 0).map(u64::from).ok_or_else(refused);
        num = num.checked_mul(whole(above)?).ok_or_else(refused)?;
        den = den.checked_mul(whole(below)?).ok_or_else(refused)?;
        let common = gcd(num, den);
        (num, den) = (num / common, den / common);
    }
    let [num, den] = [num, den].map(|n| u32::try_from(n).map_err(|_| refused()));
    let ratio = StepsPerRevolution::new(num?, den?).map_err(|error| error.to_string())?;
    let [num, den] = <[u32; 2]>::from(ratio);
    if u64::from(num) < 64 * u64::from(den) {
        return Err(format!(
            "{typed} are {:.1} steps per turn; expected 64 or more: fewer cannot be placed evenly around a turn",
            ratio_f64(ratio)
        ));
    }
    Ok(ratio)
}

pub fn ratio_f64(ratio: StepsPerRevolution) -> f64 {
    let [num, den] = <[u32; 2]>::from(ratio);
    f64::from(num) / f64::from(den)
}

fn written([num, den]: [u32; 2]) -> String {
    if den == 1 { num.to_string() } else { format!("{num}/{den}") }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_an_exact_product() {
        for (typed, expected) in [("500", "500"), ("200 x 16 x 5/2", "8000"), ("200*32*7/9", "44800/9"), (" 160/2 ", "80")] {
            assert_eq!(Kind::Steps.read(typed).unwrap(), expected);
        }
        for typed in ["0", "200 x", "half", "63", "4000000000 x 9", "1/0"] {
            assert!(Kind::Steps.read(typed).is_err(), "{typed}");
        }
    }

    #[test]
    fn an_answer_of_another_form_is_refused_with_what_is_expected() {
        let number = Kind::Number { unit: "um", range: [100.0, 5000.0] };
        assert_eq!(number.read(" 650 ").unwrap(), "650");
        assert_eq!(number.read("60").unwrap_err(), "60 um; expected 100 to 5000 um");
        assert!(number.read("NaN").is_err() && number.read("six").is_err());
        let options = vec![Choice::new("near", "Near"), Choice::new("far", "Far")];
        let closed = Kind::Choice { options: options.clone(), open: false };
        assert_eq!((closed.read("2").unwrap(), closed.read("near").unwrap()), ("far".into(), "near".into()));
        assert!(closed.read("3").is_err() && closed.read("left").unwrap_err().contains("near, far"));
        assert_eq!(Kind::Choice { options, open: true }.read("/dev/ttyUSB7").unwrap(), "/dev/ttyUSB7");
        assert!(Kind::Confirm.read("yes").is_ok() && Kind::Confirm.read("no").is_err() && Kind::Text.read(" ").is_err());
    }
}
