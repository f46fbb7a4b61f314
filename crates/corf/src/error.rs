use std::path::PathBuf;

/// Error of a reconstruction.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The attempted action, as a verb.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An input cannot be used: `place` says where, `help` what to do.
    #[error("{place}: {what}\n  help: {help}")]
    Invalid {
        /// File, key, index.
        place: String,
        /// Description of the fault.
        what: String,
        /// Advice on how to correct it.
        help: String,
    },
    /// The caller's progress callback asked for the work to end.
    #[error("stopped by the caller")]
    Stopped,
    /// A keyframe, data set or GPU error.
    #[error(transparent)]
    Scene(#[from] corf_scene::Error),
}

/// The result of this crate's fallible functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An [`Error::Invalid`].
    pub fn invalid(place: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), what: what.into(), help: help.into() }
    }

    /// The same error once more, for another who asks.
    #[cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "devices of their own keep errors"))]
    pub(crate) fn repeated(&self) -> Self {
        match self {
            Self::Invalid { place, what, help } | Self::Scene(corf_scene::Error::Invalid { place, what, help }) => {
                Self::invalid(place, what, help)
            }
            other => Self::invalid("the device", other.to_string(), "start again"),
        }
    }
}
