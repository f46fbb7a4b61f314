use std::path::{Path, PathBuf};

/// Error in a user's input or files. Every message says what was wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder could not be read, created, written or renamed.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The attempted action, as a verb: "read", "write", "create".
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The input was read, and what it says cannot be used.
    #[error("{place}: {what}\n  help: {help}")]
    Invalid {
        /// File, line, key, index: where the fault is.
        place: String,
        /// Description of the fault.
        what: String,
        /// Advice on how to correct it.
        help: String,
    },
    /// The user asked for the work to stop (Ctrl-C); what was finished is on disk.
    #[error("interrupted: {what}")]
    Interrupted {
        /// Summary of the completed part, and how to resume.
        what: String,
    },
}

/// The result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Invalid`].
    pub fn invalid(place: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), what: what.into(), help: help.into() }
    }

    /// Turns an I/O error into one that says what was tried on which path; for `map_err`.
    pub fn io(action: &'static str, path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { action, path, source }
    }
}
