//! Angular extent that a receiver samples at full density; directions outside of it matter for the total power alone.

use corf_scene::{Pinhole, Rigid3};
use glam::DVec3;

/// Margin of a view, degrees: beyond it a 1° lobe has fallen by 80 dB.
const VIEW_MARGIN_DEG: f64 = 6.1;
/// Margin of an array's front, degrees: cells at its edge have all their neighbours, which decide how finely they are looked at.
const FRONT_MARGIN_DEG: f64 = 2.0;

/// Part of the sphere around a receiver that is sampled at full density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WorldExtent {
    /// The whole sphere.
    Sphere,
    /// A camera's frame and a margin. The rest is sparser, which keeps the total power; an array's side lobes want more: [`WorldExtent::Front`].
    View {
        /// Intrinsics of the camera.
        camera: Pinhole,
        /// Its attitude (OpenCV axes); where it stands plays no part.
        world_from_camera: Rigid3,
    },
    /// The half-space before the plane of an array that does not receive from behind, and a margin.
    Front {
        /// The array's boresight, a unit vector of the world.
        boresight: DVec3,
    },
}

impl WorldExtent {
    /// Whether a unit direction of the world lies inside.
    pub(crate) fn inside(&self) -> Box<dyn Fn(DVec3) -> bool + Sync> {
        match *self {
            Self::Sphere => Box::new(|_| true),
            Self::View { camera, world_from_camera } => Box::new(view(&camera, &world_from_camera)),
            Self::Front { boresight } => {
                let least_cos = -FRONT_MARGIN_DEG.to_radians().sin();
                Box::new(move |direction| boresight.dot(direction) > least_cos)
            }
        }
    }
}

/// Whether a unit direction of the world lies in a camera's frame or close beside it.
fn view(camera: &Pinhole, world_from_camera: &Rigid3) -> impl Fn(DVec3) -> bool + Sync + use<> {
    let camera_from_world = world_from_camera.rotation.transpose();
    let margin = VIEW_MARGIN_DEG.to_radians();
    let left = (-camera.cx / camera.fx).atan() - margin;
    let right = ((camera.width as f64 - camera.cx) / camera.fx).atan() + margin;
    // Rows are highest above the optical axis, where their elevation is that of the frame's edge.
    let top = (-camera.cy / camera.fy).atan() - margin;
    let bottom = ((camera.height as f64 - camera.cy) / camera.fy).atan() + margin;
    let inside = inside_of([left, right], [top, bottom]);
    move |direction| inside(camera_from_world * direction)
}

/// Whether a unit direction d of a camera's axes has its azimuth atan2(x, z) in [left, right), within ±π, and its elevation asin(y) in
/// [top, bottom): by half-planes and heights instead of angles, for every direction is asked.
fn inside_of([left, right]: [f64; 2], elevation: [f64; 2]) -> impl Fn(DVec3) -> bool + Sync {
    let wide = right - left >= std::f64::consts::PI;
    let ((sin_left, cos_left), (sin_right, cos_right)) = (left.sin_cos(), right.sin_cos());
    // Beyond a pole there is nothing to leave out.
    let height = |angle: f64| if angle.abs() < std::f64::consts::FRAC_PI_2 { angle.sin() } else { f64::INFINITY.copysign(angle) };
    let [top, bottom] = elevation.map(height);
    move |d| {
        let right_of_left = d.x * cos_left >= d.z * sin_left;
        let left_of_right = d.x * cos_right < d.z * sin_right;
        let between = if wide { right_of_left || left_of_right } else { right_of_left && left_of_right };
        between && (top..bottom).contains(&d.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn the_limits_of_a_view_are_those_of_its_angles() {
        let mut rng = Rng::keyed(11, 0, 0);
        for [left, right, top, bottom] in
            [[-0.9, 0.7, -0.4, 0.6], [-1.6, 1.65, -1.2, 1.7], [-1.7, -0.2, -1.8, -0.1], [-1.62, 1.5, -1.7, 1.7]]
        {
            let inside = inside_of([left, right], [top, bottom]);
            let mut found = [0; 2];
            for _ in 0..20_000 {
                let d = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                let (across, down) = (d.x.atan2(d.z), d.y.atan2(d.x.hypot(d.z)));
                let expected = (left..right).contains(&across) && (top..bottom).contains(&down);
                assert_eq!(inside(d), expected, "{d} of {left}..{right}, {top}..{bottom}");
                found[usize::from(expected)] += 1;
            }
            assert!(found[0] > 1000 && found[1] > 1000, "{found:?}");
        }
    }
}
