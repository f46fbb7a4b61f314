//! A walk of any length through a drawn room: keyframes made in memory, cheaply, with all that a reconstruction reads of them.
//!
//! The room is that of [`crate::studies::workload`]. Its surfaces carry band-limited noise of three sizes; the spectrum has a transmitter, its images
//! in the four walls, and a glow of the surfaces. The walk goes round and round at changing distances, heights and views, so that a long sequence
//! sees ever more of one place, as a platform does that stays in a building.

use crate::studies::workload::{FURNITURE_M, ROOM_M};
use corf_scene::{Keyframe, Light, Pinhole, Radio, Raster, Rigid3, color, keyframe::DbRange};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Horizontal field of view of both cameras.
pub const FIELD_OF_VIEW_DEG: f64 = 90.0;
/// Range of the spectra.
pub const DB_RANGE: DbRange = DbRange { min_db: -120.0, max_db: -60.0 };
/// Distance between keyframes, metres.
const BASELINE_M: f64 = 0.3;
const TRANSMITTER_M: Vec3 = Vec3::new(12.0, 13.0, 2.8);
/// Level of the transmitter's lobe, and the loss of a reflection, dB.
const DIRECT_DB: f32 = -64.0;
const REFLECTION_DB: f32 = 12.0;

/// Pose of keyframe `i`.
pub fn pose(i: usize) -> Rigid3 {
    // Once around is 21.7 m at the middle distance.
    let angle = BASELINE_M * i as f64 / 3.45;
    let lap = (angle / std::f64::consts::TAU).floor();
    let radius = 1.0 + 0.13 * (0.7 * angle.sin() + 1.9 * lap).sin();
    let (sin, cos) = angle.sin_cos();
    let eye = DVec3::new(7.0 + 3.2 * radius * cos, 7.5 + 3.7 * radius * sin, 1.5 + 0.2 * (0.37 * i as f64).sin());
    // Along the way, and on later laps more and more to one side or the other.
    let turn = 0.6 * (2.0 * lap).sin() + 0.15 * (0.11 * i as f64).sin();
    let (along, out) = (DVec3::new(-sin, cos, -0.05), DVec3::new(cos, sin, 0.0));
    Rigid3::looking_at(eye, eye + along * turn.cos() + out * turn.sin(), DVec3::Z)
}

/// Where a ray ends: its parameter, the surface, and the place on it in metres.
struct End {
    t: f32,
    surface: u32,
    place: [f32; 2],
}

/// Parameters at which a ray enters and leaves a box, and the faces.
fn crossing(eye: Vec3, ray: Vec3, [low, high]: [Vec3; 2]) -> [(f32, u32); 2] {
    let (mut enter, mut leave) = ((f32::NEG_INFINITY, 0), (f32::INFINITY, 0));
    for axis in 0..3 {
        let inverse = 1.0 / ray[axis];
        let sides =
            [((low[axis] - eye[axis]) * inverse, 2 * axis as u32), ((high[axis] - eye[axis]) * inverse, 2 * axis as u32 + 1)];
        let (near, far) = if sides[0].0 <= sides[1].0 { (sides[0], sides[1]) } else { (sides[1], sides[0]) };
        if near.0 > enter.0 {
            enter = near;
        }
        if far.0 < leave.0 {
            leave = far;
        }
    }
    [enter, leave]
}

fn corner(p: [f64; 3]) -> Vec3 {
    Vec3::from_array(p.map(|v| v as f32))
}

fn end_of(eye: Vec3, ray: Vec3) -> End {
    let (mut t, mut surface) = crossing(eye, ray, [Vec3::ZERO, corner(ROOM_M)])[1];
    for (k, corners) in FURNITURE_M.iter().enumerate() {
        let [enter, leave] = crossing(eye, ray, corners.map(corner));
        if enter.0 > 0.0 && enter.0 < leave.0 && enter.0 < t {
            (t, surface) = (enter.0, 6 * (k as u32 + 1) + enter.1);
        }
    }
    let (point, axis) = (eye + t * ray, (surface % 6 / 2) as usize);
    End { t, surface, place: [point[(axis + 1) % 3], point[(axis + 2) % 3]] }
}

/// Random number in [0, 1) of a lattice point on a surface.
fn lattice(i: i32, j: i32, salt: u32) -> f32 {
    let mut h = (i as u32).wrapping_mul(0x9e37_79b1) ^ (j as u32).wrapping_mul(0x85eb_ca77) ^ salt.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    (h >> 8) as f32 / (1 << 24) as f32
}

/// Smooth noise in [0, 1) with so many lattice points a metre.
fn noise(place: [f32; 2], a_metre: f32, salt: u32) -> f32 {
    let [u, v] = place.map(|p| p * a_metre);
    let (i, j) = (u.floor(), v.floor());
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fu, fv, i, j) = (smooth(u - i), smooth(v - j), i as i32, j as i32);
    let row = |j: i32| lattice(i, j, salt) * (1.0 - fu) + lattice(i + 1, j, salt) * fu;
    row(j) * (1.0 - fv) + row(j + 1) * fv
}

/// sRGB-encoded colour of a place.
fn colour(end: &End) -> [u8; 3] {
    let salt = 3 * end.surface;
    let [coarse, mid, fine] = [(1.2, 0), (4.0, 1), (14.0, 2)].map(|(a_metre, k)| noise(end.place, a_metre, salt + k) - 0.5);
    // Half of the walls is plain, as walls are.
    let detail = if coarse > 0.0 { 0.5 * mid + 0.35 * fine } else { 0.05 * mid };
    let value = 0.35 + 0.07 * (end.surface % 5) as f32 + 0.4 * coarse + detail;
    [value + 0.15 * mid, value, value - 0.15 * coarse].map(color::quantize8)
}

/// Linear power per steradian from a direction.
fn power(eye: Vec3, direction: Vec3) -> f32 {
    let end = end_of(eye, direction);
    let lobe = |source: Vec3, level_db: f32| {
        let degrees = direction.angle_between(source - eye).to_degrees();
        10_f32.powf((level_db - 0.2 * degrees * degrees).max(-200.0) / 10.0)
    };
    let t = TRANSMITTER_M;
    let images = [t.with_x(-t.x), t.with_x(2.0 * ROOM_M[0] as f32 - t.x), t.with_y(-t.y), t.with_y(2.0 * ROOM_M[1] as f32 - t.y)];
    let glow = 10_f32.powf((-113.0 + 18.0 * noise(end.place, 0.6, end.surface + 1000)) / 10.0);
    let sight = end_of(eye, t - eye).t >= 1.0;
    let direct = if sight { lobe(t, DIRECT_DB) } else { 0.0 };
    glow + direct + images.into_iter().map(|image| lobe(image, DIRECT_DB - REFLECTION_DB)).sum::<f32>()
}

/// Keyframe `i` of the walk.
pub fn keyframe(i: usize, light: &Pinhole, radio: &Pinhole) -> Keyframe {
    let world_from_camera = pose(i);
    let eye = world_from_camera.translation.as_vec3();
    let rays = |c: &Pinhole| {
        let c = *c;
        move |x: usize, y: usize| world_from_camera.transform_vector(c.unproject(x as f64 + 0.5, y as f64 + 0.5)).as_vec3()
    };
    let ray = rays(light);
    let (width, height) = (light.width, light.height);
    let ends: Vec<([u8; 3], f32, u32)> = (0..width * height)
        .into_par_iter()
        .with_min_len(width)
        .map(|at| {
            // Rays have z = 1 in the camera's frame: their parameter is the z-depth.
            let end = end_of(eye, ray(at % width, at / width));
            (colour(&end), end.t, end.surface)
        })
        .collect();
    let ray = rays(radio);
    Keyframe {
        index: i,
        time_s: i as f64 * 0.1,
        world_from_camera,
        light: Some(Light {
            image: Raster::from_vec(width, height, ends.iter().map(|e| e.0).collect()),
            depth_m: Some(Raster::from_vec(width, height, ends.iter().map(|e| e.1).collect())),
            surface: Some(Raster::from_vec(width, height, ends.iter().map(|e| e.2).collect())),
            mask: None,
        }),
        radio: Some(Radio { spectrum: Raster::from_fn(radio.width, radio.height, |x, y| power(eye, ray(x, y))) }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light_of(keyframe: &Keyframe) -> &Light {
        keyframe.light.as_ref().unwrap()
    }

    #[test]
    fn the_walk_keeps_clear_of_everything_and_keeps_its_pace() {
        let mut last: Option<DVec3> = None;
        for i in 0..2000 {
            let eye = pose(i).translation;
            let outside = |[low, high]: [[f64; 3]; 2]| (0..3).any(|k| eye[k] < low[k] - 0.1 || eye[k] > high[k] + 0.1);
            assert!(FURNITURE_M.iter().all(|b| outside(*b)), "keyframe {i} at {eye} stands in something");
            assert!((0..3).all(|k| eye[k] > 0.5 && eye[k] < ROOM_M[k] - 0.5), "keyframe {i} at {eye} leaves the room");
            if let Some(last) = last {
                let step = (eye - last).length();
                assert!((0.1..1.2).contains(&step), "{step} m to keyframe {i}");
            }
            last = Some(eye);
        }
    }

    #[test]
    fn keyframes_are_of_one_room() {
        let (light, radio) =
            (Pinhole::from_horizontal_fov(64, 36, FIELD_OF_VIEW_DEG), Pinhole::from_horizontal_fov(24, 16, FIELD_OF_VIEW_DEG));
        let (a, b) = (keyframe(40, &light, &radio), keyframe(41, &light, &radio));
        let depth = |k: &Keyframe, x: usize, y: usize| f64::from(light_of(k).depth_m.as_ref().unwrap()[(x, y)]);
        // What the first sees, the second sees at its place: the surface and, within the texture of a pixel, the colour.
        let (mut met, mut alike) = (0, 0);
        for y in 4..32 {
            for x in 4..60 {
                let seen = light.unproject(x as f64 + 0.5, y as f64 + 0.5) * depth(&a, x, y);
                let there = b.world_from_camera.inverse().transform_point(a.world_from_camera.transform_point(seen));
                let [u, v] = [light.fx * there.x / there.z + light.cx, light.fy * there.y / there.z + light.cy];
                if there.z < 0.1 || u < 0.0 || v < 0.0 || u >= 64.0 || v >= 36.0 {
                    continue;
                }
                met += 1;
                let (u, v) = (u as usize, v as usize);
                let same = light_of(&a).surface.as_ref().unwrap()[(x, y)] == light_of(&b).surface.as_ref().unwrap()[(u, v)];
                alike += usize::from(same && (depth(&b, u, v) / there.z - 1.0).abs() < 0.1);
            }
        }
        assert!(met > 1000 && alike * 10 > met * 8, "{alike} of {met}");
        let spectrum = &a.radio.as_ref().unwrap().spectrum;
        let peak = spectrum.pixels().iter().copied().fold(0.0_f32, f32::max);
        assert!(peak > 0.0 && DB_RANGE.scalar(peak) <= 1.0 && spectrum.pixels().iter().all(|p| *p > 0.0));
        let levels: std::collections::BTreeSet<[u8; 3]> = light_of(&a).image.pixels().iter().copied().collect();
        assert!(levels.len() > 200, "a plain image teaches nothing");
    }
}
