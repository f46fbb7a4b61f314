//! The points of a data set's sparse model: what there is to see of a room before anything is reconstructed.

use anyhow::Result;
use corf_scene::capture::read_points;
use corf_scene::dataset::Dataset;
use std::path::Path;

/// Reads the points of a modality's folder (`optical` or `rf`): x, y, z in metres as `f32` and a colour in four bytes each, little endian. A data
/// set without them has none.
///
/// # Errors
/// A file that cannot be read, or a line that is no point.
pub(super) fn read(dataset: &Dataset, modality: &str) -> Result<Vec<u8>> {
    let path = dataset.dir().join(modality).join("sparse/0/points3D.txt");
    if path.exists() { bytes(&path) } else { Ok(Vec::new()) }
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    for point in read_points(path)? {
        out.extend(point.position.as_vec3().to_array().iter().flat_map(|v| v.to_le_bytes()));
        out.extend(point.color);
        out.push(255);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_read_and_other_lines_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points3D.txt");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            bytes(&path)
        };
        let points = read("# ID X Y Z R G B ERROR\n1 0.5 -2 3 255 0 7 0 2 0\n").unwrap();
        let expected: Vec<u8> = [0.5_f32, -2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).chain([255, 0, 7, 255]).collect();
        assert_eq!(points, expected);
        for wrong in ["1 2 3", "1 nan 0 0 1 2 3", "1 0 0 0 256 0 0", "1 x 0 0 1 2 3"] {
            let error = read(&format!("# head\n{wrong}\n")).unwrap_err().to_string();
            assert!(error.contains("points3D.txt:2"), "{error}");
        }
    }
}
