//! The points of a data set's sparse model: what there is to see of a room before anything is reconstructed.

use anyhow::{Context, Result, ensure};
use corf_scene::dataset::Dataset;
use std::path::Path;

/// Reads the points of a modality's folder (`optical` or `rf`): x, y, z in metres as `f32` and a colour in four bytes each, little endian. A data
/// set without them has none.
///
/// # Errors
/// A file that cannot be read, or a line that is no point.
pub(super) fn read(dataset: &Dataset, modality: &str) -> Result<Vec<u8>> {
    let path = dataset.dir().join(modality).join("sparse/0/points3D.txt");
    if path.exists() { parse(&corf_scene::io::read_text(&path)?, &path) } else { Ok(Vec::new()) }
}

/// COLMAP's text: `ID X Y Z R G B …`, comments behind `#`.
fn parse(text: &str, path: &Path) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let place = || format!("{}: line {} is no point (ID X Y Z R G B ...)", path.display(), number + 1);
        let words: Vec<&str> = line.split_ascii_whitespace().take(7).collect();
        ensure!(words.len() == 7, place());
        for word in &words[1..4] {
            let value: f32 = word.parse().with_context(place)?;
            ensure!(value.is_finite(), place());
            out.extend(value.to_le_bytes());
        }
        for word in &words[4..7] {
            out.push(word.parse().with_context(place)?);
        }
        out.push(255);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_read_and_other_lines_refused() {
        let path = Path::new("points3D.txt");
        let bytes = parse("# ID X Y Z R G B ERROR\n1 0.5 -2 3 255 0 7 0 2 0\n", path).unwrap();
        let expected: Vec<u8> = [0.5_f32, -2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).chain([255, 0, 7, 255]).collect();
        assert_eq!(bytes, expected);
        for wrong in ["1 2 3", "1 nan 0 0 1 2 3", "1 0 0 0 256 0 0", "1 x 0 0 1 2 3"] {
            let error = parse(&format!("# head\n{wrong}\n"), path).unwrap_err().to_string();
            assert!(error.contains("points3D.txt: line 2"), "{error}");
        }
    }
}
