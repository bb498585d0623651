//! Which parameters a search over silhouettes may change, and why the others are refused.
//!
//! ```text
//!   determined               uy, gamma                        free within bounds
//!   weakly determined        alpha, omega_i, dy_i             bounded, and held by a prior
//!   not, or wrongly          kx, ky, f, ux, s, phi            refused
//! ```
//! A prior costs `GAIN_LEAST / 2` of the logarithm of the objective at one standard deviation. A parameter that gains less than
//! that is not accepted.

use super::psi::Psi;
use super::search::Reach;
use crate::statistics::mean;
use std::str::FromStr;

/// Twice the relative gain that one standard deviation of a prior is worth. Half a percent is what the bias of the edges does.
const GAIN_LEAST: f64 = 0.005;

/// A parameter of the paper's camera vector psi, as an operator names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parameter {
    /// Distance of the projection centre from the axis, um.
    F,
    /// Scale along the capillary, px/um.
    Kx,
    /// Scale across the capillary, px/um.
    Ky,
    /// Column of the principal point, px.
    Ux,
    /// Row of the principal point, px.
    Uy,
    /// Skew, px/um.
    S,
    /// Tilt of the capillary towards the camera.
    Alpha,
    /// Roll of the capillary in the image.
    Gamma,
    /// Elevation of the projection centre.
    Phi,
    /// The angle of every view but the first. The first is the angle at which the capillary was taken to be.
    Omega,
    /// The shift of every view down the image, px.
    Dy,
}

/// How far a parameter may go, and the prior that holds it; px or rad.
struct Room {
    most: f64,
    usual: f64,
    step: f64,
    prior_sd: Option<f64>,
}

const DEG: f64 = std::f64::consts::PI / 180.0;

impl Parameter {
    /// Every parameter, in the order of the vector.
    pub const ALL: [Self; 11] =
        [Self::F, Self::Kx, Self::Ky, Self::Ux, Self::Uy, Self::S, Self::Alpha, Self::Gamma, Self::Phi, Self::Omega, Self::Dy];

    /// The name that an operator uses.
    pub fn name(self) -> &'static str {
        match self {
            Self::F => "f",
            Self::Kx => "kx",
            Self::Ky => "ky",
            Self::Ux => "ux",
            Self::Uy => "uy",
            Self::S => "s",
            Self::Alpha => "alpha",
            Self::Gamma => "gamma",
            Self::Phi => "phi",
            Self::Omega => "omega",
            Self::Dy => "dy",
        }
    }

    fn is_angle(self) -> bool {
        matches!(self, Self::Alpha | Self::Gamma | Self::Omega | Self::Phi)
    }

    fn unit(self) -> &'static str {
        if self.is_angle() { "deg" } else { "px" }
    }

    /// Internal units in one unit of the operator: 1 for px, the radians of a degree for angles.
    fn of_unit(self) -> f64 {
        if self.is_angle() { DEG } else { 1.0 }
    }

    /// The room of a parameter that may be freed. `uy` and `gamma` may go as far as a day's drift and a newly mounted capillary
    /// need. The priors are those of the least squares; that of an angle covers the rounding of a step and the play of a belt.
    fn room(self) -> Option<Room> {
        let room = |most: f64, usual: f64, step: f64, prior_sd: Option<f64>| {
            Some(Room {
                most: most * self.of_unit(),
                usual: usual * self.of_unit(),
                step: step * self.of_unit(),
                prior_sd: prior_sd.map(|sd| sd * self.of_unit()),
            })
        };
        match self {
            Self::Uy => room(100.0, 20.0, 3.0, None),
            Self::Gamma => room(5.0, 2.0, 0.2, None),
            Self::Alpha => room(1.0, 1.0, 0.2, Some(1.0)),
            Self::Omega => room(1.5, 1.5, 0.2, Some(0.5)),
            Self::Dy => room(3.0, 3.0, 0.3, Some(1.0)),
            Self::F | Self::Kx | Self::Ky | Self::Ux | Self::S | Self::Phi => None,
        }
    }

    /// What an objective over silhouettes does with this parameter when it is free, and where its value comes from instead.
    fn why(self) -> &'static str {
        match self {
            Self::Kx | Self::Ky => {
                "a scale 10 % too small leaves 37 % more volume and one smaller still leaves more, without bound. Take kx and ky from beads, a stage micrometer or a measured bore"
            }
            Self::F => "40 to 90 mm change the volume left by 0.03 to 0.05 %. Take it from the lens",
            Self::Ux => "the volume left is flat in it: the model only slides along the capillary. Leave it at the middle of the sensor",
            Self::S => "the volume left is flat in it. Leave it at 0",
            Self::Phi => "it shifts the image as uy does. Leave it at 90 deg and free uy",
            Self::Alpha => {
                "5 deg to either side change the volume left by less than 0.7 %, always the same way: unbounded searches ran to 45 deg"
            }
            Self::Omega => {
                "one angle 20 deg off changes the volume left by 0.2 to 3 %, and all views turned into one direction leave 108 to 140 % more: the largest volume is nonsense. The ledger knows better"
            }
            Self::Uy | Self::Gamma => "the ledger of the rig is within that",
            Self::Dy => "a mounted capillary is within that",
        }
    }
}

impl std::fmt::Display for Parameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a parameter is not freed as it was requested.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Silhouettes do not determine the parameter, or determine it wrongly.
    #[error("{0} is not freed: {why}", why = .0.why())]
    NotTold(Parameter),
    /// The requested reach is too large; the search uses `most`.
    #[error("{parameter} is bounded to {most} {unit} to either side, {asked} were asked for: {why}", why = .parameter.why())]
    TooFar {
        /// The parameter.
        parameter: Parameter,
        /// The requested reach to either side, in `unit`.
        asked: f64,
        /// The largest reach, in `unit`.
        most: f64,
        /// `px` or `deg`.
        unit: &'static str,
    },
    /// The text after `=` is not a reach.
    #[error("{text:?} is no reach; ask for a number above 0 of {unit}, as in {parameter}={usual}")]
    Reach {
        /// The parameter.
        parameter: Parameter,
        /// The text that was given.
        text: String,
        /// A usual reach, in `unit`, for the message.
        usual: f64,
        /// `px` or `deg`.
        unit: &'static str,
    },
    /// The name is not that of a parameter.
    #[error("{0:?} is no parameter; uy, gamma, alpha, omega and dy can be freed")]
    Unknown(String),
    /// The parameter is requested more than once.
    #[error("{0} is asked for twice")]
    Twice(Parameter),
}

/// A parameter, with the reach that was requested for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ask {
    /// The parameter to free.
    pub parameter: Parameter,
    /// Reach to either side, px or deg. `None` asks for the usual one.
    pub reach: Option<f64>,
}

impl FromStr for Ask {
    type Err = Refusal;

    /// Reads `alpha`, or `alpha=0.5` with a reach.
    fn from_str(text: &str) -> Result<Self, Refusal> {
        let (name, reach) = text.split_once('=').map_or((text, None), |(name, reach)| (name, Some(reach)));
        let name = match name.trim() {
            // The paper's single scale, and the usual word for the skew.
            "k" => "kx",
            "skew" => "s",
            name => name,
        };
        let parameter = Parameter::ALL.into_iter().find(|p| p.name() == name).ok_or_else(|| Refusal::Unknown(name.to_owned()))?;
        let reach = reach.map(|text| {
            text.trim().parse::<f64>().ok().filter(|reach| *reach > 0.0).ok_or_else(|| Refusal::Reach {
                parameter,
                text: text.trim().to_owned(),
                usual: parameter.room().map_or(1.0, |room| room.usual / parameter.of_unit()),
                unit: parameter.unit(),
            })
        });
        Ok(Self { parameter, reach: reach.transpose()? })
    }
}

/// The parameters that a search changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Free(Vec<Freed>);

#[derive(Debug, Clone, Copy, PartialEq)]
struct Freed {
    parameter: Parameter,
    far: f64,
    step: f64,
    prior_sd: Option<f64>,
}

impl Free {
    /// The requested parameters that may be freed, and a refusal for each of the others. A reach that is too large is bounded,
    /// and refused as [`Refusal::TooFar`].
    pub fn new(asked: &[Ask]) -> (Self, Vec<Refusal>) {
        let (mut freed, mut refusals) = (Vec::<Freed>::new(), Vec::new());
        for &Ask { parameter, reach } in asked {
            let Some(Room { most, usual, step, prior_sd }) = parameter.room() else {
                refusals.push(Refusal::NotTold(parameter));
                continue;
            };
            if freed.iter().any(|f| f.parameter == parameter) {
                refusals.push(Refusal::Twice(parameter));
                continue;
            }
            let wanted = reach.map_or(usual, |reach| reach * parameter.of_unit());
            // Degrees to radians and back is not exact to the last bit.
            if wanted > most * (1.0 + 1e-12) {
                let (asked, most) = (wanted / parameter.of_unit(), (most / parameter.of_unit() * 1e9).round() / 1e9);
                refusals.push(Refusal::TooFar { parameter, asked, most, unit: parameter.unit() });
            }
            let far = wanted.min(most);
            freed.push(Freed { parameter, far, step: step.min(far / 2.0), prior_sd });
        }
        (Self(freed), refusals)
    }

    /// `uy` and `gamma`, the two parameters that silhouettes determine, with the error of the closed form as reach.
    pub(super) fn near(uy_px: f64, gamma_rad: f64) -> Self {
        let freed = |parameter: Parameter, far: f64| Freed { parameter, far, step: far / 15.0, prior_sd: None };
        Self(vec![freed(Parameter::Uy, uy_px), freed(Parameter::Gamma, gamma_rad)])
    }

    /// Whether nothing is free.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One search range per unknown, about `psi`.
    pub(crate) fn reaches(&self, psi: &Psi) -> Vec<Reach> {
        let of = |freed: &Freed| {
            let reach = |value: f64| Reach::about(value, freed.far, freed.step);
            match freed.parameter {
                Parameter::Uy => vec![reach(psi.camera.uy)],
                Parameter::Gamma => vec![reach(psi.camera.gamma)],
                Parameter::Alpha => {
                    vec![Reach { start: psi.camera.alpha.clamp(-freed.far, freed.far), ..Reach::about(0.0, freed.far, freed.step) }]
                }
                Parameter::Omega => psi.omega[1.min(psi.omega.len())..].iter().map(|&omega| reach(omega)).collect(),
                Parameter::Dy => psi.dy_px.iter().map(|&dy| reach(dy)).collect(),
                Parameter::F | Parameter::Kx | Parameter::Ky | Parameter::Ux | Parameter::S | Parameter::Phi => Vec::new(),
            }
        };
        self.0.iter().flat_map(of).collect()
    }

    /// The free parameters, in the order in which they were requested.
    pub fn parameters(&self) -> impl Iterator<Item = Parameter> {
        self.0.iter().map(|freed| freed.parameter)
    }

    /// The parameters of which some value lies at the end of its range.
    pub(super) fn on_bound(&self, start: &Psi, values: &[f64]) -> Vec<Parameter> {
        let mut values = values.iter();
        let mut ended = |freed: &Freed| {
            let alone = Self(vec![*freed]).reaches(start);
            let ends = alone.iter().zip(values.by_ref()).filter(|(r, v)| (r.high - **v).min(**v - r.low) <= 1e-9 * freed.far);
            ends.count() > 0
        };
        self.0.iter().filter(|freed| ended(freed)).map(|freed| freed.parameter).collect()
    }

    /// `psi` with these values of the unknowns.
    pub(crate) fn apply(&self, psi: &Psi, values: &[f64]) -> Psi {
        let mut psi = psi.clone();
        let mut values = values.iter().copied();
        let mut next = |place: &mut f64| {
            if let Some(value) = values.next() {
                *place = value;
            }
        };
        for freed in &self.0 {
            match freed.parameter {
                Parameter::Uy => next(&mut psi.camera.uy),
                Parameter::Gamma => next(&mut psi.camera.gamma),
                Parameter::Alpha => next(&mut psi.camera.alpha),
                Parameter::Omega => psi.omega.iter_mut().skip(1).for_each(&mut next),
                Parameter::Dy => {
                    psi.dy_px.iter_mut().for_each(&mut next);
                    // A shift of all views is a change of `uy`.
                    let mean = mean(&psi.dy_px);
                    psi.dy_px.iter_mut().for_each(|dy| *dy -= mean);
                }
                Parameter::F | Parameter::Kx | Parameter::Ky | Parameter::Ux | Parameter::S | Parameter::Phi => {}
            }
        }
        psi
    }

    /// What the priors cost. That of alpha is about 0, the others are about the start of the search.
    pub(super) fn cost(&self, start: &Psi, psi: &Psi) -> f64 {
        let deviations = |freed: &Freed, sd: f64| -> f64 {
            let all = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| ((a - b) / sd).powi(2)).sum::<f64>();
            match freed.parameter {
                Parameter::Alpha => (psi.camera.alpha / sd).powi(2),
                Parameter::Omega => all(&psi.omega, &start.omega),
                Parameter::Dy => all(&psi.dy_px, &start.dy_px),
                _ => 0.0,
            }
        };
        GAIN_LEAST / 2.0 * self.0.iter().filter_map(|freed| Some(deviations(freed, freed.prior_sd?))).sum::<f64>()
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the numbers compared are exact")]
mod tests {
    use super::*;
    use crate::geometry::Camera;

    fn ask(text: &str) -> (Free, Vec<Refusal>) {
        Free::new(&text.split(',').map(|t| t.parse().unwrap()).collect::<Vec<Ask>>())
    }

    fn psi() -> Psi {
        let camera = Camera {
            f: 6e4,
            kx: 0.2,
            ky: 0.2,
            ux: 511.5,
            uy: 500.0,
            s: 0.0,
            alpha: 0.0,
            gamma: 0.01,
            phi: 1.57,
            width: 1024,
            height: 1024,
            glass: None,
        };
        Psi::new(camera, vec![0.0, 2.0, 4.0])
    }

    #[test]
    fn what_silhouettes_do_not_tell_is_refused_by_name_with_its_number() {
        for (name, number) in
            [("kx", "37 %"), ("k", "37 %"), ("ky", "37 %"), ("f", "0.05 %"), ("ux", "flat"), ("s", "flat"), ("phi", "as uy does")]
        {
            let (free, refusals) = ask(name);
            assert!(free.is_empty());
            let said = refusals.iter().map(ToString::to_string).collect::<String>();
            assert!(said.starts_with(&name[..1]) && said.contains(" is not freed: ") && said.contains(number), "{said}");
        }
    }

    #[test]
    fn what_is_hardly_observable_is_bounded() {
        let (free, refusals) = ask("alpha=45,omega=inf,uy");
        let said: Vec<_> = refusals.iter().map(ToString::to_string).collect();
        assert!(
            said[0].starts_with("alpha is bounded to 1 deg to either side, 45 were asked for: ") && said[0].contains("0.7 %"),
            "{said:?}"
        );
        assert!(
            said[1].starts_with("omega is bounded to 1.5 deg") && said[1].contains("108 to 140 %") && said[1].contains("0.2 to 3 %"),
            "{said:?}"
        );
        let reaches = free.reaches(&psi());
        assert_eq!(reaches.len(), 1 + 2 + 1, "the first view's angle stands");
        assert!((reaches[0].high - DEG).abs() < 1e-12 && (reaches[1].high - (2.0 + 1.5 * DEG)).abs() < 1e-12, "{reaches:?}");
        assert_eq!((reaches[3].low, reaches[3].high), (480.0, 520.0));
        assert!(ask("alpha=1,gamma=0.5,omega=1.5,dy=3").1.is_empty());
    }

    #[test]
    fn what_cannot_be_read_says_what_can() {
        for (text, said) in [
            ("tilt", "\"tilt\" is no parameter; uy, gamma, alpha, omega and dy can be freed"),
            ("uy=far", "\"far\" is no reach; ask for a number above 0 of px, as in uy=20"),
            ("gamma=-1", "\"-1\" is no reach; ask for a number above 0 of deg, as in gamma=2"),
        ] {
            assert_eq!(text.parse::<Ask>().unwrap_err().to_string(), said);
        }
        assert_eq!(ask("uy,uy").1, [Refusal::Twice(Parameter::Uy)]);
    }

    #[test]
    fn what_ends_at_its_reach_is_reported() {
        let (free, _) = ask("uy=5,omega,gamma=1");
        let start = psi();
        let mut values: Vec<f64> = free.reaches(&start).iter().map(|r| r.start).collect();
        assert_eq!(free.on_bound(&start, &values), []);
        values[2] += 1.5 * DEG;
        values[3] -= DEG;
        assert_eq!(free.on_bound(&start, &values), [Parameter::Omega, Parameter::Gamma]);
    }

    #[test]
    fn the_unknowns_go_where_they_belong_and_shifts_keep_their_sum() {
        let (free, _) = ask("gamma,dy,omega,uy,alpha");
        let values: Vec<f64> = (1..=8).map(f64::from).collect();
        let set = free.apply(&psi(), &values);
        assert_eq!((set.camera.gamma, set.camera.uy, set.camera.alpha), (1.0, 7.0, 8.0));
        assert_eq!((set.dy_px, set.omega), (vec![-1.0, 0.0, 1.0], vec![0.0, 5.0, 6.0]));
        let start = psi();
        let unchanged: Vec<f64> = free.reaches(&start).iter().map(|r| r.start).collect();
        assert_eq!(free.apply(&start, &unchanged), start);
        assert_eq!(free.cost(&start, &start), 0.0);
        let mut off = start.clone();
        off.omega[1] += 0.5 * DEG;
        off.camera.alpha = DEG;
        assert!((free.cost(&start, &off) - GAIN_LEAST).abs() < 1e-12, "half of it per standard deviation");
    }
}
