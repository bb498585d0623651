//! The vendor's program as it is seen from outside: it loads a specimen, turns it, and stores a picture per view in a folder.
//!
//! ```text
//!  load ── view 1 ── view 2 ── ... ── view N ── the next well
//!            └ W_A02_1_1.tiff, 24 bit RGB, demosaicked, in one of five manners:
//!              at once | in pieces | twice | under another name first | reserved first, then filled
//! ```
//! How a real program writes is not known in every detail. The manners are what file shares and programs do in general.

use crate::scene::{Contents, Exposure, PlacementError, Rgb, Scene};
use std::fs::{self, File};
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// How a picture gets into the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    AtOnce,
    /// In three pieces, with pauses between them.
    InPieces,
    /// The same picture again under the same name, after a pause.
    Twice,
    /// Under a name that is no picture's, then renamed.
    Renamed,
    /// The file has its whole size from the beginning and is filled after a pause.
    Reserved,
}

impl Manner {
    pub const ALL: [Self; 5] = [Self::AtOnce, Self::InPieces, Self::Twice, Self::Renamed, Self::Reserved];
}

/// What the program does wrong in a well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mistake {
    /// This view is not stored.
    LeavesOut(u32),
    /// After the last view this one is stored again, from another angle.
    Replaces(u32),
    /// After this view the program stores no picture of the well any more.
    StopsAfter(u32),
}

#[derive(Debug, Clone, PartialEq)]
pub struct VastProgramSettings {
    /// Folder of the plate. It is made with the first picture.
    pub folder: PathBuf,
    /// Views per turn, evenly spaced.
    pub views: u32,
    /// Whether the picture at 360 deg is stored too.
    pub repeats_first: bool,
    /// From one view to the next.
    pub step: Duration,
    /// Between the pieces of a picture.
    pub pause: Duration,
    /// The manners, in turn.
    pub manners: Vec<Manner>,
}

#[derive(Debug, thiserror::Error)]
pub enum VastProgramError {
    #[error("the specimen of well {well} does not fit the scene: {why}")]
    Specimen { well: String, why: PlacementError },
    #[error("{}: {why}", path.display())]
    Write { path: PathBuf, why: io::Error },
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] image::ImageError),
}

/// The program, with the scene that its camera sees.
pub struct VastProgram {
    scene: Arc<Scene>,
    settings: VastProgramSettings,
    /// Number of the next exposure.
    exposures: u64,
}

impl VastProgram {
    pub fn new(scene: Arc<Scene>, settings: VastProgramSettings) -> Self {
        Self { scene, settings, exposures: 0 }
    }

    /// Takes the views of a specimen. `rest` waits, and returns whether the program is ended.
    pub fn turn(
        &mut self,
        well: &str,
        contents: impl Into<Contents>,
        mistake: Option<Mistake>,
        rest: &dyn Fn(Duration) -> bool,
    ) -> Result<(), VastProgramError> {
        self.scene.load(contents).map_err(|why| VastProgramError::Specimen { well: well.to_owned(), why })?;
        self.go_on(well, 1, mistake, rest)
    }

    /// Takes the views of the specimen that is loaded, from this view on.
    pub fn go_on(
        &mut self,
        well: &str,
        from_view: u32,
        mistake: Option<Mistake>,
        rest: &dyn Fn(Duration) -> bool,
    ) -> Result<(), VastProgramError> {
        for view in from_view..=self.settings.views + u32::from(self.settings.repeats_first) {
            if rest(self.settings.step) {
                return Ok(());
            }
            match mistake {
                Some(Mistake::LeavesOut(left_out)) if left_out == view => continue,
                Some(Mistake::StopsAfter(last)) if view > last => return Ok(()),
                _ => {}
            }
            let manner = self.settings.manners[view as usize % self.settings.manners.len()];
            self.store(well, view, view - 1, manner, rest)?;
        }
        if let Some(Mistake::Replaces(view)) = mistake {
            self.store(well, view, view, Manner::AtOnce, rest)?;
        }
        Ok(())
    }

    /// Stores what the camera sees at `turned` steps of the turn as a view.
    fn store(
        &mut self,
        well: &str,
        view: u32,
        turned: u32,
        manner: Manner,
        rest: &dyn Fn(Duration) -> bool,
    ) -> Result<(), VastProgramError> {
        let angle_rad = std::f64::consts::TAU * f64::from(turned) / f64::from(self.settings.views);
        self.exposures += 1;
        let bytes = tiff(&self.scene.render(&Exposure { angle_rad, number: self.exposures }).demosaicked())?;
        let path = self.settings.folder.join(format!("W_{well}_1_{view}.tiff"));
        write(&path, &bytes, manner, self.settings.pause, rest).map_err(|why| VastProgramError::Write { path, why })
    }
}

fn tiff(picture: &Rgb) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut bytes,
        &picture.data,
        picture.width,
        picture.height,
        image::ColorType::Rgb8,
        image::ImageFormat::Tiff,
    )?;
    Ok(bytes.into_inner())
}

fn write(path: &Path, bytes: &[u8], manner: Manner, pause: Duration, rest: &dyn Fn(Duration) -> bool) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    match manner {
        Manner::AtOnce => fs::write(path, bytes),
        Manner::InPieces => {
            let mut file = File::create(path)?;
            for piece in bytes.chunks(bytes.len() / 3 + 1) {
                file.write_all(piece)?;
                if rest(pause) {
                    return Ok(());
                }
            }
            Ok(())
        }
        Manner::Twice => {
            fs::write(path, bytes)?;
            if rest(pause) { Ok(()) } else { fs::write(path, bytes) }
        }
        Manner::Renamed => {
            let other = path.with_extension("tiff.part");
            fs::write(&other, bytes)?;
            if rest(pause) { Ok(()) } else { fs::rename(other, path) }
        }
        Manner::Reserved => {
            let mut file = File::create(path)?;
            file.set_len(bytes.len() as u64)?;
            if rest(pause) {
                return Ok(());
            }
            file.seek(SeekFrom::Start(0))?;
            file.write_all(bytes)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, SceneSettings, Specimen};

    fn program(folder: &Path, views: u32) -> VastProgram {
        let camera = Camera { width: 256, height: 160, ux_px: 127.5, uy_px: 79.5, ..Camera::default() };
        let scene = Scene::new(SceneSettings { camera, ..SceneSettings::default() });
        let settings = VastProgramSettings {
            folder: folder.join("P1"),
            views,
            repeats_first: false,
            step: Duration::ZERO,
            pause: Duration::ZERO,
            manners: Manner::ALL.to_vec(),
        };
        VastProgram::new(Arc::new(scene), settings)
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder.join("P1")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = entries.collect();
        names.sort();
        names
    }

    #[test]
    fn every_manner_ends_with_the_whole_picture() {
        let folder = tempfile::tempdir().unwrap();
        let mut program = program(folder.path(), 5);
        program.turn("A02", Specimen::bead(400.0).unwrap(), None, &|_| false).unwrap();
        assert_eq!(names(folder.path()), (1..=5).map(|view| format!("W_A02_1_{view}.tiff")).collect::<Vec<_>>());
        for name in names(folder.path()) {
            let picture = image::open(folder.path().join("P1").join(&name)).unwrap();
            assert!(matches!(&picture, image::DynamicImage::ImageRgb8(rgb) if rgb.dimensions() == (256, 160)), "{name}");
        }
    }

    #[test]
    fn mistakes_are_made_where_they_are_asked_for() {
        let bead = || Specimen::bead(400.0).unwrap();
        let turn = |mistake| {
            let folder = tempfile::tempdir().unwrap();
            program(folder.path(), 3).turn("A02", bead(), Some(mistake), &|_| false).unwrap();
            (names(folder.path()), folder)
        };
        assert_eq!(turn(Mistake::LeavesOut(2)).0, ["W_A02_1_1.tiff", "W_A02_1_3.tiff"]);
        assert_eq!(turn(Mistake::StopsAfter(1)).0, ["W_A02_1_1.tiff"]);
        let (_, replaced) = turn(Mistake::Replaces(1));
        let (_, whole) = turn(Mistake::LeavesOut(9));
        let first = |folder: &tempfile::TempDir| fs::read(folder.path().join("P1/W_A02_1_1.tiff")).unwrap();
        assert_ne!(first(&replaced), first(&whole));
    }
}
