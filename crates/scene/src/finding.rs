//! Findings of a validator: errors, warnings and notes, each with its place and a remedy.

use serde::{Deserialize, Serialize};

/// Severity of a finding.
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
    /// Its severity.
    pub severity: Severity,
    /// File, material, index: where.
    pub place: String,
    /// Description of the finding.
    pub what: String,
    /// Suggested remedy.
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
