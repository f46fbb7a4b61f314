//! Text of files, plain or gzip-compressed, within a bound: what a file holds never takes more memory than its reader allows.

use super::corrupt;
use super::regular::open;
use crate::{Error, Result};
use flate2::bufread::MultiGzDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Most bytes of text that a gzip file may hold: a few hundred thousand paths of a keyframe.
pub const MAX_GZIP_TEXT_BYTES: u64 = 1 << 28;

/// Reads a text file of no more than `most_bytes`, whatever kind of file it is.
///
/// # Errors
/// The file cannot be read, is no UTF-8 or holds more.
pub fn read_text_within(path: impl AsRef<Path>, most_bytes: u64) -> Result<String> {
    let path = path.as_ref();
    text_within(open(path)?, path, "text", most_bytes)
}

/// Reads a gzip-compressed text file, all of its members.
///
/// # Errors
/// The file cannot be read, is no whole gzip file, holds no UTF-8 or more than [`MAX_GZIP_TEXT_BYTES`].
pub fn read_gzip_text(path: impl AsRef<Path>) -> Result<String> {
    let path = path.as_ref();
    gunzip_text(BufReader::new(open(path)?), path, MAX_GZIP_TEXT_BYTES)
}

/// The text of up to `most_bytes` in gzip's `bytes`; `path` names them in messages.
pub(super) fn gunzip_text(bytes: impl BufRead, path: impl AsRef<Path>, most_bytes: u64) -> Result<String> {
    text_within(MultiGzDecoder::new(bytes), path.as_ref(), "gzip text", most_bytes)
}

/// What a reader gives, up to `most_bytes`. Nothing is taken in advance: memory grows with what comes out.
fn text_within(reader: impl Read, path: &Path, kind: &str, most_bytes: u64) -> Result<String> {
    let mut text = Vec::new();
    reader.take(most_bytes + 1).read_to_end(&mut text).map_err(|e| corrupt(path, kind, e))?;
    if text.len() as u64 > most_bytes {
        return Err(too_long(&path.display().to_string(), &format!("more than {most_bytes} bytes of {kind}")));
    }
    String::from_utf8(text).map_err(|e| corrupt(path, kind, e))
}

fn too_long(place: &str, what: &str) -> Error {
    Error::invalid(
        place,
        format!("it holds {what}"),
        "a file of its kind is smaller than that; it is damaged, or of another kind",
    )
}

/// The lines of a gzip-compressed text file, all of its members, one in memory at a time.
#[derive(Debug)]
pub struct GzipLines {
    path: PathBuf,
    reader: BufReader<MultiGzDecoder<BufReader<File>>>,
    bounds: LineBounds,
    line: usize,
    read_bytes: u64,
}

/// Bounds of a file that is read line by line.
#[derive(Clone, Copy, Debug)]
pub struct LineBounds {
    /// Most bytes of a line.
    pub line_bytes: u64,
    /// Most bytes of all lines together.
    pub file_bytes: u64,
}

impl GzipLines {
    /// Opens a file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(path: impl AsRef<Path>, bounds: LineBounds) -> Result<Self> {
        let path = path.as_ref().to_owned();
        let reader = BufReader::new(MultiGzDecoder::new(BufReader::new(open(&path)?)));
        Ok(Self { path, reader, bounds, line: 0, read_bytes: 0 })
    }

    /// The next line, without its end.
    fn read(&mut self) -> Result<Option<String>> {
        let mut bytes = Vec::new();
        let most = self.bounds.line_bytes.min(self.bounds.file_bytes.saturating_sub(self.read_bytes));
        // The end of a line counts as well.
        let read = self.reader.by_ref().take(most + 1).read_until(b'\n', &mut bytes);
        let place = |line: usize| format!("{}, line {line}", self.path.display());
        let read = read.map_err(|e| corrupt(Path::new(&place(self.line + 1)), "gzip text", e))? as u64;
        if read == 0 {
            return Ok(None);
        }
        self.line += 1;
        self.read_bytes += read;
        if read > most {
            let LineBounds { line_bytes, file_bytes } = self.bounds;
            let what = format!("a line of more than {line_bytes} bytes, or more than {file_bytes} bytes up to its end");
            return Err(too_long(&place(self.line), &what));
        }
        if bytes.last() == Some(&b'\n') {
            bytes.pop();
        }
        String::from_utf8(bytes).map(Some).map_err(|e| corrupt(Path::new(&place(self.line)), "text", e))
    }
}

impl Iterator for GzipLines {
    type Item = Result<String>;

    fn next(&mut self) -> Option<Self::Item> {
        self.read().transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::super::gzip;
    use super::*;

    const BOUNDS: LineBounds = LineBounds { line_bytes: 1000, file_bytes: 10_000 };

    fn lines(bytes: &[u8]) -> Result<Vec<String>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lines.gz");
        std::fs::write(&path, bytes).unwrap();
        GzipLines::open(&path, BOUNDS)?.collect()
    }

    #[test]
    fn lines_of_all_members_are_read_and_nothing_else_may_follow() {
        // A line may begin in one member and end in the next.
        let whole = [gzip(b"one\ntw").unwrap(), gzip(b"").unwrap(), gzip(b"o\n\nfour").unwrap()].concat();
        assert_eq!(lines(&whole).unwrap(), ["one", "two", "", "four"]);
        for bad in [&whole[..whole.len() - 1], &[&whole[..], b"garbage"].concat(), &[&whole[..], &whole[..5]].concat()] {
            let error = lines(bad).unwrap_err().to_string();
            assert!(error.contains("lines.gz, line ") && error.contains("gzip text"), "{error}");
        }
        let error = lines(&gzip(b"fine\n\xff\n").unwrap()).unwrap_err().to_string();
        assert!(error.contains("lines.gz, line 2"), "{error}");
    }

    #[test]
    fn a_line_and_a_file_have_their_bounds() {
        let of = |length: usize, count: usize| gzip(format!("{}\n", "x".repeat(length - 1)).repeat(count).as_bytes()).unwrap();
        assert_eq!(lines(&of(1000, 10)).unwrap().len(), 10);
        for (bytes, line) in [(of(1001, 1), 1), (of(1000, 11), 11), (of(1_000_000, 1), 1)] {
            let error = lines(&bytes).unwrap_err().to_string();
            assert!(error.contains(&format!("line {line}")) && error.contains("1000 bytes"), "{error}");
        }
    }

    #[test]
    fn plain_text_has_a_bound_as_well() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read_text_within(&path, 5).unwrap(), "12345");
        let error = read_text_within(&path, 4).unwrap_err().to_string();
        assert!(error.contains("a.txt") && error.contains("more than 4 bytes"), "{error}");
        #[cfg(unix)]
        assert!(read_text_within("/dev/zero", 1000).is_err());
    }
}
