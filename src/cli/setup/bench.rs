//! What the machine asks of the instrument, and what comes back. No device is named here, so a test can play the instrument.

use super::period::Orbit;
use carved_core::flag::StoredFlag;
use carved_records::SweepSettings;
use serde::{Deserialize, Serialize};
use std::fmt;

/// One piece of work on the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// List the serial ports. None is opened.
    ListPorts,
    /// Ask which controller answers on the port, or at the address of a relay.
    Identify,
    /// List the cameras that answer.
    ListCameras,
    /// Find the exposure with an empty capillary.
    Expose,
    /// Take and store a picture of the empty capillary, and find its walls.
    LookAtEmpty,
    /// Home the motors, and take one picture.
    Home,
    /// Home, and take pictures over two turns.
    Turn,
    /// Home, and measure the bead over one turn.
    Measure,
    /// Write the configuration and check it.
    Write,
}

impl Action {
    /// What happens meanwhile, for the person.
    pub fn doing(self) -> &'static str {
        match self {
            Self::ListPorts => "Listing the serial ports.",
            Self::Identify => "Asking which controller answers. This takes a few seconds, and nothing moves.",
            Self::ListCameras => "Looking for cameras.",
            Self::Expose => "Finding the exposure.",
            Self::LookAtEmpty => "Taking pictures of the empty capillary.",
            Self::Home => "The motors go to their reference position.",
            Self::Turn => "The capillary turns twice.",
            Self::Measure => "Measuring the bead over one turn.",
            Self::Write => "Writing and checking the configuration.",
        }
    }
}

/// The answers that an action needs beside the draft of the configuration.
pub struct Request<'a> {
    pub action: Action,
    /// The configuration as far as it is known; it can be loaded.
    pub draft: &'a str,
    /// The port or address of [`Action::Identify`].
    pub controller: &'a str,
    /// Whether an older configuration may be replaced.
    pub replaces: bool,
}

/// The instrument, the disk, and the rules of a configuration.
pub trait Bench {
    /// Does one piece of work. The motors are at rest when it returns.
    ///
    /// # Errors
    /// What is wrong and what to do, for the person.
    fn perform(&mut self, request: &Request) -> Result<Outcome, String>;
    /// The doubts of a configuration.
    ///
    /// # Errors
    /// What `carved config check` refuses.
    fn check(&self, draft: &str) -> Result<Vec<String>, String>;
    /// Whether the configuration's file exists already.
    fn exists(&self) -> bool;
}

/// The result of an action.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    Ports(Vec<Listed>),
    Controller(Controller),
    Cameras(Vec<Listed>),
    Exposure(FoundExposure),
    Empty(Empty),
    Home,
    Turn(Turn),
    Bead(Bead),
    Written(Written),
}

/// Something to choose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Listed {
    /// Name of the port or address of the camera.
    pub name: String,
    pub label: String,
}

/// The controller that answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Controller {
    /// Driver in `[rotation]`.
    pub driver: String,
    /// Its own name.
    pub name: String,
    /// Keys of `[rotation]` with their values as TOML.
    pub keys: Vec<(String, String)>,
    /// Whether it homes, where it says so.
    pub homes: Option<bool>,
    /// What to change in the controller, if anything.
    pub remark: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundExposure {
    pub exposure_us: f64,
    /// Level of the brightest half per cent, 0 to 255.
    pub top: f64,
    /// Whether the light follows the exposure.
    pub follows: bool,
}

/// The empty capillary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Empty {
    /// Distance of the inner walls in the middle column, px.
    pub bore_px: f64,
    /// Row of the middle of the bore, px.
    pub middle_px: f64,
    /// Slope of the bore, deg; positive where the right end is lower.
    pub tilt_deg: f64,
    /// File of the picture, beside the configuration.
    pub file: String,
}

/// Two turns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Turn {
    /// Steps per turn that were commanded.
    pub commanded_steps: f64,
    /// The path of the bead. `None` where it does not go around.
    pub orbit: Option<Orbit>,
    /// Pictures that show a bead, and all pictures.
    pub seen: [usize; 2],
}

/// A measured bead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bead {
    pub diameter_um: f64,
    /// Length along the capillary over width across it.
    pub aspect: f64,
    pub volume_um3: f64,
    /// Overlap of the views at 0 and 360 deg, 0 to 1. `None` where one of them shows no bead.
    pub closure_iou: Option<f64>,
    /// Shift of the bead between these two, px, along and across.
    pub closure_px: Option<[f64; 2]>,
    /// Row and roll of the axis in the middle column, px and deg.
    pub uy_px: f64,
    pub gamma_deg: f64,
    /// Median blur of the edges, px, and that for which the method is set.
    pub blur_px: Option<[f64; 2]>,
    pub flags: Vec<StoredFlag>,
    /// Axis and camera can take the usual sweep ([`SWEEP`]).
    #[serde(default)]
    pub can_sweep: bool,
}

/// The sweep that is proposed for a rig: its views, and frames per second.
pub const SWEEP: (u32, f64) = (84, SweepSettings::USUAL_HZ);

/// The files that were written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Written {
    pub file: String,
    /// The older configuration, if there was one.
    pub backup: Option<String>,
    pub doubts: Vec<String>,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Ports(ports) if ports.is_empty() => write!(f, "This computer lists no serial port."),
            Self::Ports(ports) => write!(f, "Serial ports: {}.", ports.iter().map(|p| p.label.as_str()).collect::<Vec<_>>().join(", ")),
            Self::Controller(c) => {
                write!(f, "The controller answers: {}.", c.name)?;
                c.remark.as_ref().map_or(Ok(()), |remark| write!(f, " {remark}"))
            }
            Self::Cameras(cameras) if cameras.is_empty() => {
                write!(f, "No camera answers. Check its power and cable, and that this computer has an address in its network.")
            }
            Self::Cameras(cameras) => write!(f, "Cameras: {}.", cameras.iter().map(|c| c.label.as_str()).collect::<Vec<_>>().join(", ")),
            Self::Exposure(e) if e.follows => {
                write!(f, "Exposure {:.1} us: the brightest half per cent of the picture is at {:.0} of 255.", e.exposure_us, e.top)
            }
            Self::Exposure(e) => write!(
                f,
                "The brightness does not follow the exposure. The picture is at {:.0} of 255, which is usable, so the exposure stays {:.1} us.",
                e.top, e.exposure_us
            ),
            Self::Empty(e) => write!(
                f,
                "The walls were found. The bore is {:.1} px wide, its middle is at row {:.1}, its slope is {:+.2} deg. The picture is stored in {}.",
                e.bore_px, e.middle_px, e.tilt_deg, e.file
            ),
            Self::Home => write!(f, "The motors are at their reference position."),
            Self::Turn(turn) => turn.fmt(f),
            Self::Bead(b) => b.fmt(f),
            Self::Written(w) => {
                write!(f, "Wrote {}.", w.file)?;
                w.backup.as_ref().map_or(Ok(()), |backup| write!(f, " The older file is now {backup}."))
            }
        }
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [seen, all] = self.seen;
        write!(f, "The bead was found in {seen} of {all} pictures.")?;
        if let Some(o) = self.orbit {
            write!(
                f,
                " It goes around row {:.1} at a distance of {:.1} px, once in {:.1} steps ({} were configured).",
                o.axis_px, o.radius_px, o.period_steps, self.commanded_steps
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Bead {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(
            f,
            "The bead measures {:.1} um, {:.2} nL, length over width {:.4}. The axis is at row {:.2}, rolled by {:+.3} deg.",
            self.diameter_um,
            self.volume_um3 / 1e6,
            self.aspect,
            self.uy_px,
            self.gamma_deg
        )?;
        match (self.closure_iou, self.closure_px) {
            (Some(iou), Some([along, across])) => {
                write!(f, " After one turn it overlaps with itself by {:.2} %, shifted by {along:+.2} and {across:+.2} px.", 100.0 * iou)
            }
            _ => write!(f, " Its closure could not be measured."),
        }
    }
}
