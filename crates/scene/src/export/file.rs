//! Files of an exported data set, in the order in which they are to be written.

use crate::{Finding, Result};

/// A file: its path below the output folder, with forward slashes, and its bytes.
pub type File = (String, Vec<u8>);

/// A data set in the layout of another program, made keyframe by keyframe.
pub trait FolderExport {
    /// The files of a keyframe.
    ///
    /// # Errors
    /// Those of [`crate::dataset::Dataset::keyframe`].
    fn keyframe(&self, index: usize) -> Result<Vec<File>>;

    /// The files of the whole, which name those of the keyframes and are written behind them: without them no reader opens the folder.
    fn whole(&self) -> Vec<File>;

    /// Changes on the way that a user should know of.
    fn findings(&self) -> Vec<Finding> {
        Vec::new()
    }
}
