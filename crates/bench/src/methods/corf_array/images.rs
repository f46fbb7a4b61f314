//! The transmitter's true mirror images, from the scene behind a data set: sources of an oracle, which bounds what knowing them is worth.

use crate::scenes::behind::SceneBehind;
use crate::terminal::interrupt;
use crate::terminal::progress::Stage;
use anyhow::Result;
use corf::array_field::Image;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{Antenna, AntennaPattern, InteractionKind, Path, RadioTracer};
use corf_raytrace::sensor::{SensorPlan, element_at};
use corf_scene::Rigid3;

/// The images that are seen from each pose of a platform's camera with a power of `least_power` or more (linear, relative to 1 W transmitted): a
/// path's is its length away from where it arrives from, straight on through slabs, with the transmitter itself as that of the line of sight.
/// Paths are those of the data set's own settings; what is diffracted has no image that stays in its place.
///
/// # Errors
/// A scene or receiver that cannot be traced, an interrupt.
pub(super) fn seen(behind: &SceneBehind, poses: &[Rigid3], least_power: f64) -> Result<Vec<Vec<Image>>> {
    let SceneBehind { config, scene_config, scene } = behind;
    let plan = SensorPlan::of(config, scene_config)?;
    let bvh = Bvh::build(scene);
    let tracer = RadioTracer::new(scene, &bvh, plan.tracing)?;
    let mirrors = || tracer.transmitter(plan.transmitter.position());
    let transmitter = Stage::of("mirrors that the transmitter sees", mirrors)?;
    let from = |pose: &Rigid3| {
        interrupt::check()?;
        // The field knows the elements' pattern itself: an image's gain is what an isotropic one receives.
        let element = Antenna { pattern: AntennaPattern::Iso, ..element_at(&plan.receiver, pose) };
        let image = |path: Path| {
            let power = path.received(&plan.tracing.tx_antenna, &element);
            let stays = path.interactions.iter().all(|i| i.kind != InteractionKind::Diffraction);
            let place_m = pose.translation + path.length_m * path.arrival;
            (stays && power >= least_power).then_some(Image { place_m, gain: power * path.length_m * path.length_m })
        };
        Ok(transmitter.paths(pose.translation)?.into_iter().filter_map(image).collect())
    };
    poses.iter().map(from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::config::{DatasetConfig, SceneConfig};
    use glam::DVec3;
    use std::path::Path as File;

    /// Sides of the room that `scenes/room.obj` is, metres.
    const SIDES: [f64; 3] = [5.0, 4.0, 2.7];

    #[test]
    fn images_of_a_room_stand_where_its_walls_mirror_the_transmitter() {
        let scenes = File::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        let mut config = DatasetConfig::load(scenes.join("room-mini.toml")).unwrap();
        config.radio.max_interactions = 2;
        let scene_config = SceneConfig::load(scenes.join("room.toml")).unwrap();
        let (scene, _) = scene_config.load_scene().unwrap();
        let tx = scene_config.transmitter.position();
        let behind = SceneBehind { config, scene_config, scene };
        let pose = |x: f64, y: f64| Rigid3::looking_at(DVec3::new(x, y, 1.5), DVec3::new(2.5, 2.0, 1.2), DVec3::Z);
        let all = seen(&behind, &[pose(1.0, 1.3), pose(3.6, 2.95)], 0.0).unwrap();
        let wavelength_m = corf_raytrace::radio::SPEED_OF_LIGHT / behind.scene_config.radio.frequency_hz;
        // Reflected n times between two walls that are a side apart, at 0 and `side`: 2k·side ± x.
        let mirrored = |side: f64, x: f64, at: f64| {
            [-1.0, 0.0, 1.0].iter().flat_map(|k| [2.0 * k * side + x, 2.0 * k * side - x]).any(|image| (image - at).abs() < 1e-3)
        };
        let of_walls = |p: DVec3| (0..3).all(|axis| mirrored(SIDES[axis], tx[axis], p[axis]));
        for (images, place) in all.iter().zip([pose(1.0, 1.3), pose(3.6, 2.95)].map(|p| p.translation)) {
            let at = |wanted: DVec3| images.iter().find(|image| image.place_m.distance(wanted) < 1e-3);
            for axis in 0..3 {
                let mut wanted = tx;
                wanted[axis] *= -1.0;
                assert!(axis == 2 || at(wanted).is_some(), "mirrored at wall {axis}: {images:?}");
            }
            let own = at(tx).unwrap();
            // The line of sight in free space: (λ/4π)², with the gain and the match of the transmitter's element.
            let free = (wavelength_m / (2.0 * std::f64::consts::TAU)).powi(2);
            assert!(own.gain > 1e-3 * free && own.gain < 10.0 * free, "{} of {free}", own.gain);
            let walls = images.iter().filter(|image| of_walls(image.place_m)).count();
            assert!(walls >= 10, "{walls} of {} images are of walls, seen from {place}", images.len());
        }
        let strongest =
            all[0].iter().map(|i| i.gain / i.place_m.distance_squared(pose(1.0, 1.3).translation)).fold(0.0, f64::max);
        let few = seen(&behind, &[pose(1.0, 1.3)], 0.99 * strongest).unwrap();
        assert!(few[0].len() < all[0].len() && !few[0].is_empty(), "what is too weak to be seen is left out");
    }
}
