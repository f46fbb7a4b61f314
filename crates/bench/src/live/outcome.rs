//! Choices and ends of a live run.

use serde::{Deserialize, Serialize};

/// What happens to keyframes that come faster than they are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum WhenBehind {
    /// They wait, all of them, in order; the result does not depend on when they came.
    #[default]
    Queue,
    /// The latest one waits and takes the place of those before it, which are left out, named and counted.
    Drop,
}

/// Why a live run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndedBy {
    /// The file `end`.
    Marker,
    /// Ctrl-C.
    Interrupt,
    /// The live folder is no longer there.
    FolderGone,
}

impl EndedBy {
    /// It in words.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Marker => "the file `end`",
            Self::Interrupt => "an interrupt",
            Self::FolderGone => "the live folder is gone",
        }
    }
}
