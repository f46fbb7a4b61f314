//! Where pixels look, as kernels read it: phase steps of an array, or directions and tiles of lobes.

use super::super::{ArrayField, SensorSettings};
use super::shape::TILE;
use crate::Result;
use corf_gpu::Context;
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use glam::DVec3;

/// Pixels of a camera.
pub(super) struct Pixels {
    /// Of each pixel: phase steps between columns and between rows, or the unit direction in the array's frame and a zero.
    pub looks: wgpu::Buffer,
    /// Of each tile: mean direction and cosine of the widest angle to it; nothing for beams.
    pub tiles: wgpu::Buffer,
    /// Workgroups that observe an image.
    pub groups: usize,
    pub count: usize,
}

impl Pixels {
    pub fn new(context: &Context, field: &ArrayField) -> Result<Self> {
        let camera = &field.camera;
        let count = camera.width * camera.height;
        let directions: Vec<DVec3> = (0..count).map(|i| direction(camera, i % camera.width, i / camera.width)).collect();
        let (looks, tiles, groups) = match field.sensor {
            SensorSettings::Beam { spacing_wavelengths, .. } | SensorSettings::Capon { spacing_wavelengths, .. } => {
                let [y, z] = spacing_wavelengths.map(|s| std::f64::consts::TAU * s);
                let phases: Vec<f32> = directions.iter().flat_map(|u| [(y * u.y) as f32, (z * u.z) as f32]).collect();
                (phases, vec![], count.div_ceil(64))
            }
            SensorSettings::Lobes { .. } => {
                let looks = directions.iter().flat_map(|u| [u.x as f32, u.y as f32, u.z as f32, 0.0]).collect();
                let tiles = tiles(camera);
                let groups = tiles.len();
                (looks, tiles.concat(), groups)
            }
        };
        let made = Self {
            looks: context.storage("directions of pixels", 4 * looks.len() as u64)?,
            tiles: context.storage("tiles of pixels", 4 * tiles.len() as u64)?,
            groups,
            count,
        };
        context.fill(&made.looks, 0, &looks);
        context.fill(&made.tiles, 0, &tiles);
        Ok(made)
    }
}

fn direction(camera: &Pinhole, x: usize, y: usize) -> DVec3 {
    ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(x, y)
}

/// Mean direction of each tile's pixels, row by row, and the cosine of the widest angle to it.
fn tiles(camera: &Pinhole) -> Vec<[f32; 4]> {
    let (across, down) = (camera.width.div_ceil(TILE), camera.height.div_ceil(TILE));
    let tile = |tile: usize| {
        let (left, top) = (tile % across * TILE, tile / across * TILE);
        let rows = top..(top + TILE).min(camera.height);
        let inside: Vec<DVec3> =
            rows.flat_map(|y| (left..(left + TILE).min(camera.width)).map(move |x| direction(camera, x, y))).collect();
        let axis = inside.iter().sum::<DVec3>().normalize();
        let cosine = inside.iter().map(|u| u.dot(axis)).fold(1.0, f64::min);
        [axis.x as f32, axis.y as f32, axis.z as f32, cosine as f32]
    };
    (0..across * down).map(tile).collect()
}
