//! What an import leaves out or changes, one line a kind.

use super::ImportReport;
use crate::Severity;

/// Counts notes of a kind and keeps the first place of each.
#[derive(Debug, Default)]
pub(super) struct Notes(Vec<Entry>);

#[derive(Debug)]
struct Entry {
    severity: Severity,
    what: String,
    first: String,
    count: usize,
}

impl Notes {
    /// Notes something that changes what is seen or heard.
    pub(super) fn warn(&mut self, what: impl Into<String>, place: impl Into<String>) {
        self.add(Severity::Warning, what.into(), place.into());
    }

    /// Notes something that is worth knowing.
    pub(super) fn note(&mut self, what: impl Into<String>, place: impl Into<String>) {
        self.add(Severity::Note, what.into(), place.into());
    }

    fn add(&mut self, severity: Severity, what: String, first: String) {
        match self.0.iter_mut().find(|e| e.severity == severity && e.what == what) {
            Some(entry) => entry.count += 1,
            None => self.0.push(Entry { severity, what, first, count: 1 }),
        }
    }

    /// Writes one line a kind into the report.
    pub(super) fn finish(self, report: &mut ImportReport) {
        for Entry { severity, what, first, count } in self.0 {
            let line = if count == 1 { format!("{first}: {what}") } else { format!("{first} and {} more: {what}", count - 1) };
            match severity {
                Severity::Note => report.unread.push(line),
                Severity::Warning | Severity::Error => report.notes.push(line),
            }
        }
    }
}
