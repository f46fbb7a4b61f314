//! Reading a TOML file with complaints a person can act on.

use crate::{Error, Result, io};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a TOML file into `T`.
///
/// # Errors
/// The file cannot be read, is no TOML, or has an unknown, missing or mistyped key; the message names file, line and column.
pub fn read_toml<T: DeserializeOwned>(path: impl AsRef<Path>) -> Result<T> {
    let path = path.as_ref();
    from_toml(&config_text(path)?, &path.display().to_string())
}

/// The text of a configuration file.
pub(super) fn config_text(path: &Path) -> Result<String> {
    let help = "give a configuration file (.toml); a mesh is named in one, as `file` of its [scene]";
    io::read_config_text(path).map_err(|e| match e {
        Error::Invalid { place, what, .. } => Error::invalid(place, what, help),
        other => other,
    })
}

/// Reads TOML text into `T`; `file` names it in messages.
///
/// # Errors
/// As [`read_toml`].
pub fn from_toml<T: DeserializeOwned>(text: &str, file: &str) -> Result<T> {
    toml::from_str(text).map_err(|e| {
        let message = e.message().trim().to_string();
        let place = e.span().map_or_else(
            || file.to_string(),
            |span| {
                let (line, column) = line_column(text, span.start);
                let source = text.lines().nth(line - 1).unwrap_or("").trim();
                format!("{file}:{line}:{column} (`{source}`)")
            },
        );
        let help = help_for(&message);
        Error::invalid(place, message, help)
    })
}

/// 1-based line and column (in characters) of byte `at`.
fn line_column(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at).unwrap_or(text);
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    (before.matches('\n').count() + 1, before[start..].chars().count() + 1)
}

/// Advice on one of serde's messages.
fn help_for(message: &str) -> String {
    if let Some(help) = help_with_name(message) {
        return help;
    }
    if let Some(rest) = message.strip_prefix("missing field ") {
        return format!("add {rest} to this table");
    }
    "see the documented keys of this file".to_string()
}

/// What was meant by a key or a word that a message of serde's, alone or within others, calls unknown; `None` for other messages.
pub fn help_with_name(message: &str) -> Option<String> {
    // serde writes: unknown field `a`, expected one of `b`, `c` / unknown variant `a`, expected `b` or `c`.
    let at = ["unknown field `", "unknown variant `"].iter().filter_map(|words| message.find(words)).min()?;
    let mut names = message[at..].lines().next()?.split('`').skip(1).step_by(2);
    let given = names.next().unwrap_or("");
    let known: Vec<&str> = names.collect();
    Some(match nearest(given, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None if known.is_empty() => "remove it".to_string(),
        None => format!("use one of: {}", known.join(", ")),
    })
}

/// The candidate nearest to `given` in edit distance, if it is near enough to be a misspelling.
pub fn nearest<'a>(given: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = given.to_lowercase();
    candidates
        .into_iter()
        .map(|c| (edit_distance(&given, &c.to_lowercase()), c))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, c)| *distance <= 1 + given.len().max(c.len()) / 3)
        .map(|(_, c)| c)
}

/// Levenshtein distance over characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_of_textbook_words() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("same", "same"), 0);
    }

    #[test]
    fn an_unknown_name_is_found_within_other_words() {
        let said = "in the configuration of m: TOML parse error at line 1\n1 | `a` = 3\nunknown field `stepss`, expected one of `rays`, `steps`\nin `t`";
        assert_eq!(help_with_name(said).unwrap(), "did you mean `steps`?");
        assert_eq!(help_with_name("unknown variant `q`, expected `jet` or `db`").unwrap(), "use one of: jet, db");
        assert_eq!(help_with_name("unknown method `q`"), None);
    }

    #[test]
    fn nearest_refuses_what_is_no_misspelling() {
        assert_eq!(nearest("keyframe", ["keyframes", "seed"]), Some("keyframes"));
        assert_eq!(nearest("zzzzzz", ["keyframes", "seed"]), None);
    }
}
