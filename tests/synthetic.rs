//! A world that tests render themselves: the inside of a textured room with a textured block in it, exact depth, and a radio pattern whose
//! structure is not light's (a transmitter, its image in a wall, and a smooth glow).

use corf_scene::{Keyframe, Light, Pinhole, Radio, Raster, Rigid3, color, keyframe::DbRange};
use glam::DVec3;

/// Half extents of the room, metres: x, y; the floor is z = 0.
const ROOM: DVec3 = DVec3::new(4.0, 3.0, 2.8);
/// The block's corners.
const BLOCK: (DVec3, DVec3) = (DVec3::new(1.2, -0.8, 0.0), DVec3::new(2.2, 0.6, 1.4));
const TRANSMITTER: DVec3 = DVec3::new(3.2, 1.5, 2.0);
/// Rays per pixel and axis: textures are band-limited by averaging, as a camera's pixel does.
const SUPERSAMPLES: usize = 3;

pub const DB_RANGE: DbRange = DbRange { min_db: -120.0, max_db: -60.0 };

/// Intersection of a ray: distance along the (unnormalised) ray, surface index, texture coordinates (metres).
struct Hit {
    t: f64,
    surface: u32,
    uv: (f64, f64),
}

fn intersect(origin: DVec3, ray: DVec3) -> Hit {
    let planes = |low: DVec3, high: DVec3, inside: bool, base: u32| {
        let mut best: Option<Hit> = None;
        for axis in 0..3 {
            for (side, bound) in [low[axis], high[axis]].into_iter().enumerate() {
                let t = (bound - origin[axis]) / ray[axis];
                let p = origin + ray * t;
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                let within = [a, b].iter().all(|&k| p[k] >= low[k] - 1e-9 && p[k] <= high[k] + 1e-9);
                if t > 1e-6 && within && best.as_ref().is_none_or(|h| t < h.t) {
                    best = Some(Hit { t, surface: base + 2 * axis as u32 + side as u32, uv: (p[a], p[b]) });
                }
            }
        }
        assert!(!inside || best.is_some());
        best
    };
    let room = planes(DVec3::new(-ROOM.x, -ROOM.y, 0.0), ROOM, true, 0).unwrap();
    match planes(BLOCK.0, BLOCK.1, false, 6) {
        Some(block) if block.t < room.t => block,
        _ => room,
    }
}

/// A lattice of smooth random values, so that no two places look alike.
fn noise(u: f64, v: f64, surface: u32, salt: u64) -> f64 {
    let corner = |i: f64, j: f64| {
        let item = (i as i64 as u64).wrapping_mul(0x1_0001).wrapping_add(j as i64 as u64);
        corf_scene::Rng::keyed(salt, u64::from(surface), item).uniform_f64()
    };
    let (i, j) = (u.floor(), v.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fu, fv) = (smooth(u - i), smooth(v - j));
    let top = corner(i, j) * (1.0 - fu) + corner(i + 1.0, j) * fu;
    let bottom = corner(i, j + 1.0) * (1.0 - fu) + corner(i + 1.0, j + 1.0) * fu;
    top * (1.0 - fv) + bottom * fv
}

/// sRGB-encoded colour of a surface; `textured` walls carry detail down to 8 cm.
fn texture(hit: &Hit, textured: bool) -> [f64; 3] {
    let (u, v) = hit.uv;
    let base = f64::from(hit.surface % 5) * 0.08 + 0.25;
    if !textured {
        return [base + 0.1; 3];
    }
    let coarse = noise(u * 1.5, v * 1.5, hit.surface, 1);
    let mid = noise(u * 4.0, v * 4.0, hit.surface, 2);
    let fine = noise(u * 12.0, v * 12.0, hit.surface, 3);
    let value = base + 0.3 * (coarse - 0.5) + 0.35 * (mid - 0.5) + 0.3 * (fine - 0.5);
    [value + 0.2 * (mid - 0.5), value, value + 0.2 * (coarse - 0.5)].map(|c| c.clamp(0.0, 1.0))
}

/// Linear power per steradian from a direction: the transmitter where it is seen, its image in the wall y = −3, and a glow of the walls.
fn power(origin: DVec3, direction: DVec3) -> f32 {
    let hit = intersect(origin, direction);
    let lobe = |towards: DVec3, db: f64| {
        let angle_deg = direction.angle_between(towards - origin).to_degrees();
        10f64.powf((db - 0.2 * angle_deg * angle_deg) / 10.0)
    };
    let block_free =
        |towards: DVec3| intersect(origin, towards - origin).t >= 0.999 || intersect(origin, towards - origin).surface < 6;
    let image = DVec3::new(TRANSMITTER.x, -2.0 * ROOM.y - TRANSMITTER.y, TRANSMITTER.z);
    let mut sum = 10f64.powf((-112.0 + 20.0 * noise(hit.uv.0 * 0.6, hit.uv.1 * 0.6, hit.surface, 9)) / 10.0);
    if block_free(TRANSMITTER) {
        sum += lobe(TRANSMITTER, -64.0);
    }
    sum += lobe(image, -78.0);
    sum as f32
}

/// A keyframe of the room as seen by the two cameras.
pub fn keyframe(index: usize, world_from_camera: Rigid3, light: &Pinhole, radio: &Pinhole, textured: bool) -> Keyframe {
    let origin = world_from_camera.translation;
    let ray = |c: &Pinhole, u: f64, v: f64| world_from_camera.transform_vector(c.unproject(u, v));
    let image = Raster::from_fn(light.width, light.height, |x, y| {
        let mut sum = [0.0; 3];
        for s in 0..SUPERSAMPLES * SUPERSAMPLES {
            let at = |k: usize| (0.5 + k as f64) / SUPERSAMPLES as f64;
            let hit = intersect(origin, ray(light, x as f64 + at(s % SUPERSAMPLES), y as f64 + at(s / SUPERSAMPLES)));
            texture(&hit, textured).iter().zip(&mut sum).for_each(|(c, s)| *s += c);
        }
        sum.map(|c| color::quantize8((c / (SUPERSAMPLES * SUPERSAMPLES) as f64) as f32))
    });
    // The ray has z = 1 in the camera frame, so the parameter is the z-depth.
    let hit = |x: usize, y: usize| intersect(origin, ray(light, x as f64 + 0.5, y as f64 + 0.5));
    Keyframe {
        index,
        time_s: index as f64 * 0.1,
        world_from_camera,
        light: Some(Light {
            image,
            depth_m: Some(Raster::from_fn(light.width, light.height, |x, y| hit(x, y).t as f32)),
            surface: Some(Raster::from_fn(light.width, light.height, |x, y| hit(x, y).surface)),
            mask: None,
        }),
        radio: Some(Radio {
            spectrum: Raster::from_fn(radio.width, radio.height, |x, y| {
                power(origin, ray(radio, x as f64 + 0.5, y as f64 + 0.5))
            }),
        }),
    }
}

/// What the camera of a keyframe that has light saw.
pub fn light(keyframe: &Keyframe) -> &Light {
    keyframe.light.as_ref().expect("the keyframe has light")
}

/// The spectrum of a keyframe that has radio.
pub fn spectrum(keyframe: &Keyframe) -> &Raster<f32> {
    &keyframe.radio.as_ref().expect("the keyframe has radio").spectrum
}

/// The same keyframe, of which something else was seen.
pub fn seen(keyframe: &Keyframe, change: impl FnOnce(&mut Light)) -> Keyframe {
    let mut light = light(keyframe).clone();
    change(&mut light);
    Keyframe { light: Some(light), ..keyframe.clone() }
}

/// The same keyframe with another spectrum.
pub fn with_spectrum(keyframe: &Keyframe, spectrum: Raster<f32>) -> Keyframe {
    Keyframe { radio: Some(Radio { spectrum }), ..keyframe.clone() }
}

/// Pose `i` of a walk along the room that looks ahead and slightly sideways, with slow changes of height: baselines of about 0.25 m.
pub fn pose(i: f64) -> Rigid3 {
    let eye = DVec3::new(-3.0 + 0.2 * i, -1.8 + 0.13 * i, 1.5 + 0.1 * (0.7 * i).sin());
    let target = DVec3::new(3.0, 0.5 + 0.1 * i, 1.0 + 0.05 * i);
    Rigid3::looking_at(eye, target, DVec3::Z)
}
