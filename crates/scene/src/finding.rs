//! What a validator has to say.

use serde::{Deserialize, Serialize};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing.
    Note,
    /// Likely to mislead or to cost quality.
    Warning,
    /// Unusable as it is.
    Error,
}

/// One finding of a validator.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// File, material, index: where.
    pub place: String,
    /// What was found.
    pub what: String,
    /// What to do about it.
    pub help: String,
}

impl Finding {
    /// A finding.
    pub fn new(severity: Severity, place: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self { severity, place: place.into(), what: what.into(), help: help.into() }
    }

    /// An error found.
    pub fn error(place: impl Into<String>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::new(Severity::Error, place, what, help)
    }
}

impl From<crate::Error> for Finding {
    fn from(error: crate::Error) -> Self {
        match error {
            crate::Error::Invalid { place, what, help } => Self::error(place, what, help),
            other => Self::error("input", other.to_string(), ""),
        }
    }
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let severity = match self.severity {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        write!(f, "{severity}: {}: {}", self.place, self.what)?;
        if self.help.is_empty() { Ok(()) } else { write!(f, "\n  help: {}", self.help) }
    }
}
