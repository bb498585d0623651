//! The `[views]` table of `driver = "folder"`.

use crate::DeviceError;
use crate::setting::in_range;
use carved_core::frame::PixelFormat;
use carved_core::range::{Range, Ranged};
use carved_core::ranges;
use carved_records::picture_name::Pattern;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Duration;

pub(super) const DEVICE: &str = "views";

/// Pictures that another program stores in a folder while it turns the capillary.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct FolderSettings {
    /// Folder into which the other program writes the pictures of one plate, as an absolute path. `{plate}` stands for the barcode of
    /// the plate and `{run}` for the name of the run; one of them must be there, because plates have the same wells. Folders below it
    /// are read too.
    pub folder: String,
    /// How the pictures are named: `{well}`, `{fish}`, `{view}` (required), and `{_}` for any other text, as in
    /// `"W_{well}_{fish}_{view}_rot.tiff"`. If it is left out, the names of VAST's programs are read.
    #[serde(default)]
    pub pattern: Option<String>,
    /// The fish of each well that is measured. Pictures of other fish are ignored.
    #[serde(default = "one")]
    pub fish: u32,
    /// Number of the first view in the names. The next ones count up by 1 around the turn.
    #[serde(default = "one")]
    pub first_view: u32,
    /// Whether a turn ends with a picture at 360 deg, which repeats the first view. It shows whether the specimen has moved.
    #[serde(default)]
    pub repeats_first: bool,
    /// Format of the pictures. `RGB8Packed` for pictures in colour, `Mono8` for grey ones.
    #[serde(default = "colour")]
    pub pixel_format: PixelFormat,
    /// Pause between two looks at the folder, ms. Shares of a network send no messages about new files.
    #[serde(default = "poll_ms")]
    pub poll_ms: u32,
    /// A picture is complete if its size and time have not changed for this long, ms, and it can be decoded.
    #[serde(default = "quiet_ms")]
    pub quiet_ms: u32,
    /// Longest wait for the next picture in the middle of a turn, s. Then the run is held.
    #[serde(default = "next_picture_s")]
    pub next_picture_s: u32,
    /// The run ends if no picture comes for this long between two wells, s: the wells without pictures are skipped. The wait begins with
    /// the first picture of the run. 0: the run waits until somebody ends it.
    #[serde(default = "end_after_s")]
    pub end_after_s: u32,
}

fn one() -> u32 {
    1
}

fn colour() -> PixelFormat {
    PixelFormat::RGB8Packed
}

fn poll_ms() -> u32 {
    500
}

fn quiet_ms() -> u32 {
    2000
}

fn next_picture_s() -> u32 {
    300
}

fn end_after_s() -> u32 {
    3600
}

/// Longest wait that is meant, s: a day.
const WAIT_MOST_S: f64 = 86_400.0;

impl Ranged for FolderSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        fish: 1.0, 1000.0, "(number in the names)";
        first_view: 0.0, 1000.0, "(number in the names)";
        poll_ms: 10.0, 10_000.0, "ms";
        quiet_ms: 0.0, 60_000.0, "ms";
        next_picture_s: 1.0, WAIT_MOST_S, "s";
        end_after_s: 0.0, WAIT_MOST_S, "s";
    ];
}

impl FolderSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range(DEVICE, self)?;
        let wrong = |name: &str, found: String, rule: String| Err(DeviceError::Setting { device: DEVICE, name: name.into(), found, rule });
        let text = self.folder.replace("{plate}", "").replace("{run}", "");
        if text.contains(['{', '}']) {
            return wrong("views.folder", format!("{:?}", self.folder), "only {plate} and {run} are replaced".into());
        }
        if text == self.folder {
            let rule = "it must contain {plate} or {run}, as in /mnt/vast/{plate}: each plate needs a folder of its own".into();
            return wrong("views.folder", format!("{:?}", self.folder), rule);
        }
        if !Path::new(&self.folder).is_absolute() {
            return wrong("views.folder", format!("{:?}", self.folder), "it must begin with /".into());
        }
        if self.pixel_format.first_red().is_some() {
            let rule = "it must be RGB8Packed or Mono8, as stored pictures are".into();
            return wrong("views.pixel_format", self.pixel_format.name().into(), rule);
        }
        match self.read_pattern() {
            Ok(_) => Ok(()),
            Err(why) => wrong("views.pattern", format!("{:?}", self.pattern.as_deref().unwrap_or_default()), why),
        }
    }

    /// The pattern of the names. `None`: the names of VAST's programs.
    pub(super) fn read_pattern(&self) -> Result<Option<Pattern>, String> {
        self.pattern.as_deref().map(Pattern::read).transpose().map_err(|e| e.to_string())
    }

    /// The folder that must be there before any plate: the path before the part that depends on the plate.
    pub(super) fn root(&self) -> PathBuf {
        Path::new(&self.folder).iter().take_while(|part| !part.to_string_lossy().contains('{')).collect()
    }

    /// The folder of a plate's pictures.
    pub(super) fn of_plate(&self, run: &str, plate: &str) -> PathBuf {
        PathBuf::from(self.folder.replace("{plate}", plate).replace("{run}", run))
    }

    pub(super) fn poll(&self) -> Duration {
        Duration::from_millis(self.poll_ms.into())
    }

    pub(super) fn quiet(&self) -> Duration {
        Duration::from_millis(self.quiet_ms.into())
    }

    pub(super) fn next_picture(&self) -> Duration {
        Duration::from_secs(self.next_picture_s.into())
    }

    /// `None`: never.
    pub(super) fn end_after(&self) -> Option<Duration> {
        (self.end_after_s > 0).then(|| Duration::from_secs(self.end_after_s.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_the_plate_a_relative_one_and_a_bad_pattern_are_refused() {
        let of = |text: &str| toml::from_str::<FolderSettings>(text).unwrap();
        let said = |text: &str| of(text).check().unwrap_err().to_string();
        assert_eq!(of("folder = \"/mnt/vast/{plate}\"").check().map_err(|e| e.to_string()), Ok(()));
        assert!(said("folder = \"/mnt/vast\"").contains("must contain {plate} or {run}"));
        assert!(said("folder = \"vast/{plate}\"").contains("must begin with /"));
        assert!(said("folder = \"/mnt/{barcode}/{plate}\"").contains("only {plate} and {run}"));
        assert!(said("folder = \"/mnt/{plate}\"\npattern = \"{well}_{fish}\"").contains("found no {view}"));
        assert!(said("folder = \"/mnt/{plate}\"\npixel_format = \"BayerRG8\"").contains("RGB8Packed or Mono8"));
        assert!(said("folder = \"/mnt/{plate}\"\npoll_ms = 0").contains("from 10 to 10000 ms"));
    }

    #[test]
    fn the_folder_of_a_plate_is_below_the_root() {
        let settings: FolderSettings = toml::from_str("folder = \"/mnt/vast/run {run}/{plate}\"").unwrap();
        assert_eq!(settings.root(), Path::new("/mnt/vast"));
        assert_eq!(settings.of_plate("r-1", "P-017"), Path::new("/mnt/vast/run r-1/P-017"));
    }
}
