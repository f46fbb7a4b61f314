//! Notes about what an import leaves out or changes, merged to one line a kind.

use super::ImportReport;
use crate::Severity;
use std::collections::HashMap;

/// Counts notes of a kind and keeps the first place of each, in the order of their first places.
#[derive(Debug, Default)]
pub(super) struct Notes {
    entries: Vec<Entry>,
    /// Index into `entries` by severity and kind.
    index_of: HashMap<(Severity, String), usize>,
}

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
        match self.index_of.get(&(severity, what.clone())) {
            Some(&i) => self.entries[i].count += 1,
            None => {
                self.index_of.insert((severity, what.clone()), self.entries.len());
                self.entries.push(Entry { severity, what, first, count: 1 });
            }
        }
    }

    /// Writes one line a kind into the report.
    pub(super) fn finish(self, report: &mut ImportReport) {
        for Entry { severity, what, first, count } in self.entries {
            let line = if count == 1 { format!("{first}: {what}") } else { format!("{first} and {} more: {what}", count - 1) };
            match severity {
                Severity::Note => report.unread.push(line),
                Severity::Warning | Severity::Error => report.notes.push(line),
            }
        }
    }
}
