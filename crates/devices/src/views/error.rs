//! What goes wrong with pictures that another program stores.

use std::path::PathBuf;

/// An error of the pictures of another program, as the operator reads it.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum ViewsError {
    /// The folder, or the share that it is on, is not there.
    #[error("views: the folder {} cannot be read: {why}. Check that the computer with the folder is on and that its share is mounted", path.display())]
    FolderLost { path: PathBuf, why: String },
    /// Pictures from before the run. They may belong to another plate.
    #[error(
        "views: {count} picture(s) were in {} before the run began, {} among them. If the run continues, they are measured as this plate",
        folder.display(),
        example.display()
    )]
    Earlier { folder: PathBuf, count: usize, example: PathBuf },
    /// The other program stores no picture any more.
    #[error(
        "views: view {view} of well {well} has not come into {} within {waited_s} s. Look whether the other program still turns and stores",
        folder.display()
    )]
    Late { well: String, view: u32, waited_s: u64, folder: PathBuf },
    /// The other program has gone on without this view.
    #[error(
        "view {view} is missing: the other program has stored {next} since. Import the well's pictures without this view, or take it again"
    )]
    Missing { view: u32, next: String },
    /// A picture that was used was replaced by another one.
    #[error("the picture {} was replaced by another one in the middle of its turn", path.display())]
    Replaced { path: PathBuf },
    /// A file that is not one readable picture of its view.
    #[error("the picture {} cannot be used: {why}", path.display())]
    Unusable { path: PathBuf, why: String },
    /// A picture of another camera setting than the configured one.
    #[error("views: the picture {} is {found}; expected {expected} by [optics] and [views]", path.display())]
    Unfit { path: PathBuf, found: String, expected: String },
    /// A picture was asked for while no well is read.
    #[error("views: no well is being read. Pictures come from another program, one per view of a run")]
    NoWell,
}

impl ViewsError {
    /// Whether the pictures can be read again with another result.
    pub fn may_be_tried_again(&self) -> bool {
        matches!(self, Self::Replaced { .. })
    }

    /// Whether it says nothing about the pictures of other wells.
    pub fn is_of_one_well(&self) -> bool {
        matches!(self, Self::Missing { .. } | Self::Replaced { .. } | Self::Unusable { .. })
    }
}
