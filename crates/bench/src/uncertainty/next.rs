//! Which poses of a way are worth measuring next: those that would make most of it more certain.

use super::calibration::Calibration;
use super::signs::TrainingKeyframes;
use crate::methods::distance_m;
use anyhow::Result;
use corf_scene::{Raster, Rigid3};
use serde::Serialize;

/// A pose of a way, and what measuring there is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Worth {
    /// Number of the pose along the way, from 0.
    pub pose: usize,
    /// Mean standard deviation over its spectrum as it is known now, dB.
    pub deviation_db: f64,
    /// Distance of the nearest training keyframe now, metres, a radian counted as one.
    pub nearest_m: f64,
    /// Fall of the mean standard deviation over the whole way, dB, beyond what the poses before it in this list have brought.
    pub gain_db: f64,
}

/// The `count` poses of a way that are worth measuring, the best first: each the one that lowers the mean standard deviation along the way most, where a
/// pose measured makes poses around it as certain as a training keyframe at its place would. `render` answers levels in `[0, 1]`.
///
/// # Errors
/// Those of [`TrainingKeyframes::signs`] and of `render`.
pub fn next(
    surroundings: &TrainingKeyframes,
    calibration: &Calibration,
    way: &[Rigid3],
    count: usize,
    mut render: impl FnMut(&Rigid3) -> Result<Raster<f32>>,
) -> Result<Vec<Worth>> {
    let mut now = Vec::with_capacity(way.len());
    for pose in way {
        let deviations = calibration.deviations_db(&surroundings.signs(pose, &render(pose)?)?);
        let deviation_db = deviations.iter().sum::<f64>() / deviations.len().max(1) as f64;
        now.push((deviation_db, surroundings.nearest_m(pose)?));
    }
    Ok(chosen(calibration, way, &now, count))
}

/// The same of poses whose mean standard deviations and nearest distances are known.
fn chosen(calibration: &Calibration, way: &[Rigid3], now: &[(f64, f64)], count: usize) -> Vec<Worth> {
    let mut state = now.to_vec();
    let mut out: Vec<Worth> = Vec::new();
    let after = |(deviation, nearest): (f64, f64), distance: f64| {
        (deviation * calibration.nearer(nearest, distance), nearest.min(distance))
    };
    while out.len() < count.min(way.len()) {
        let gain = |c: usize| {
            let fall = |(p, was): (usize, &(f64, f64))| was.0 - after(*was, distance_m(&way[c], &way[p], 1.0)).0;
            state.iter().enumerate().map(fall).sum::<f64>() / way.len() as f64
        };
        let free = (0..way.len()).filter(|i| out.iter().all(|w| w.pose != *i));
        let Some((pose, gain_db)) = free.map(|c| (c, gain(c))).reduce(|best, c| if c.1 > best.1 { c } else { best }) else {
            break;
        };
        let (deviation_db, nearest_m) = now[pose];
        out.push(Worth { pose, deviation_db, nearest_m, gain_db });
        let moved = |(p, was): (usize, &(f64, f64))| after(*was, distance_m(&way[pose], &way[p], 1.0));
        state = state.iter().enumerate().map(moved).collect();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_pose_that_most_of_the_way_is_near_comes_first_and_then_what_is_left() {
        let pose = |x: f64| Rigid3 { translation: DVec3::new(x, 0.0, 1.5), ..Rigid3::IDENTITY };
        let way = [0.0, 1.0, 2.0, 30.0].map(pose);
        let calibration = Calibration::of_weights([0.0, 0.0, 0.0, 0.0, 1.0]);
        let now = [(3.0, 6.0), (3.0, 6.0), (3.0, 6.0), (2.0, 6.0)];
        let worth = chosen(&calibration, &way, &now, 3);
        assert_eq!(worth.iter().map(|w| w.pose).collect::<Vec<_>>()[..2], [1, 3]);
        // 6 m become 1 m for two of them and nothing for one: (2·3·(1 − 1.1/6.1) + 3·(1 − 0.1/6.1)) / 4.
        assert!((worth[0].gain_db - (6.0 * (1.0 - 1.1 / 6.1) + 3.0 * (1.0 - 0.1 / 6.1)) / 4.0).abs() < 1e-9, "{worth:?}");
        assert!(worth.windows(2).all(|pair| pair[0].gain_db > pair[1].gain_db), "{worth:?}");
        assert_eq!((worth[1].deviation_db, worth[1].nearest_m), (2.0, 6.0));
        assert_eq!(chosen(&calibration, &way, &now, 9).len(), 4, "no pose is measured twice");
    }
}
