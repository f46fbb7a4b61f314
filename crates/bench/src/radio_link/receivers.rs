//! Receivers of many links: points, a file of points, the scene's trajectory.

use super::{PointArg, table};
use crate::note;
use anyhow::Result;
use corf_scene::config::SceneConfig;
use corf_scene::{Error, bounds, io, npz, trajectory};
use glam::DVec3;
use std::path::Path;

/// All receivers asked for, in the order points, file, trajectory.
///
/// # Errors
/// None at all, a file that is no list of points, a scene without a trajectory.
pub fn receivers(config: &SceneConfig, points: &[PointArg], file: Option<&Path>, poses: Option<usize>) -> Result<Vec<DVec3>> {
    let mut all: Vec<DVec3> = points.iter().map(|p| p.0).collect();
    if let Some(path) = file {
        all.extend(read(path)?);
    }
    if let Some(count) = poses {
        bounds::count("--rx-trajectory", count, bounds::MAX_LINKS, "receivers")?;
        let Some(way) = &config.trajectory else {
            let help = "add waypoints_m under [trajectory], or give receivers with --rx or --rx-file";
            return Err(Error::invalid(config.source.display().to_string(), "it has no [trajectory]", help).into());
        };
        all.extend(trajectory::generate(way, count)?.iter().map(|pose| pose.world_from_camera.translation));
    }
    if all.is_empty() {
        return Err(Error::invalid("receivers", "there is none", "give --rx X,Y,Z, --rx-file FILE or --rx-trajectory N").into());
    }
    Ok(all)
}

/// Points of a `.npy` file (N × 3), or of a [`table`] in a text file.
fn read(path: &Path) -> Result<Vec<DVec3>> {
    let place = path.display().to_string();
    let points = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        let npz::NpyNumbers { shape, values, stored } = npz::decode_npy(&io::read(path)?, &place)?;
        if stored == npz::Scalar::Whole {
            let what = "holds whole numbers, which may be anything from millimetres up";
            return Err(Error::invalid(place, what, "save metres as float64").into());
        }
        if shape.len() != 2 || shape[1] != 3 {
            return Err(
                Error::invalid(place, format!("its shape is {shape:?}"), "give one row x, y, z a receiver: (N, 3)").into()
            );
        }
        values.chunks_exact(3).map(DVec3::from_slice).collect()
    } else {
        let table = table::read(&io::read_text(path)?, &place)?;
        table.notes.iter().for_each(|word| note!("{word}"));
        table.points
    };
    points.iter().enumerate().try_for_each(|(i, p)| bounds::position(&format!("{place}: row {i}"), *p))?;
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_file_gives_a_point_a_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rx.npy");
        let array = |shape: &[usize]| npz::Array::new("rx", shape, npz::Values::F64(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        std::fs::write(&path, array(&[2, 3]).to_npy()).unwrap();
        assert_eq!(read(&path).unwrap(), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
        std::fs::write(&path, array(&[3, 2]).to_npy()).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("[3, 2]"));
    }
}
