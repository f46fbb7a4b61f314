//! Receivers of many links: points, a file of points, the scene's trajectory.

use super::Point;
use anyhow::Result;
use corf_scene::config::SceneConfig;
use corf_scene::{Error, bounds, io, npz, trajectory};
use glam::DVec3;
use std::path::Path;

/// All receivers asked for, in the order points, file, trajectory.
///
/// # Errors
/// None at all, a file that is no list of points, a scene without a trajectory.
pub fn receivers(config: &SceneConfig, points: &[Point], file: Option<&Path>, poses: Option<usize>) -> Result<Vec<DVec3>> {
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

/// Points of a `.npy` file (N × 3), or of a text file with x, y, z in each line (commas or blanks between, one line of names allowed).
fn read(path: &Path) -> Result<Vec<DVec3>> {
    let place = path.display().to_string();
    let points = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        let npz::Numbers { shape, values, stored } = npz::decode_npy(&io::read(path)?, &place)?;
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
        from_text(&io::read_text(path)?, &place)?
    };
    points.iter().enumerate().try_for_each(|(i, p)| bounds::position(&format!("{place}: row {i}"), *p))?;
    Ok(points)
}

fn from_text(text: &str, place: &str) -> Result<Vec<DVec3>, Error> {
    let mut points = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let fields: Vec<&str> = line.split([',', ';', ' ', '\t']).map(str::trim).filter(|f| !f.is_empty()).collect();
        if fields.is_empty() || fields[0].starts_with('#') {
            continue;
        }
        let values: Vec<f64> = fields.iter().filter_map(|f| f.parse().ok()).collect();
        match values.as_slice() {
            [x, y, z] if fields.len() == 3 => points.push(DVec3::new(*x, *y, *z)),
            // Names of the columns.
            [] if points.is_empty() => {}
            _ => {
                let what = format!("`{}` is not x, y, z", line.trim());
                return Err(Error::invalid(format!("{place}:{}", number + 1), what, "give three numbers a line, in metres"));
            }
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_points_are_read_and_others_named() {
        let read = |text: &str| from_text(text, "rx.csv");
        let two = vec![DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.5, 0.0, 1.6)];
        assert_eq!(read("x,y,z\n1,2,3\n\n-1.5, 0, 1.6\n").unwrap(), two);
        assert_eq!(read("# metres\n1 2 3\n-1.5\t0 1.6").unwrap(), two);
        for (bad, place) in [("1,2,3\n1,2", "rx.csv:2"), ("1,2,3,4", "rx.csv:1"), ("1,2,3\nx,y,z", "rx.csv:2")] {
            assert!(read(bad).unwrap_err().to_string().contains(place), "{bad}");
        }
    }

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
