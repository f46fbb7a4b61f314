//! Settings of a pass: the uniform that `scene.wgsl` declares.

use super::super::words::Words;
use glam::{UVec3, Vec2, Vec3};

/// Bytes of the uniform.
pub(super) const PARAMS_BYTES: u64 = 4 * (112 + 16 * MOST_VIEWS as u64);

/// Views that are rendered together at most.
pub(super) const MOST_VIEWS: usize = 8;

/// Fields that lattices may have.
pub(super) const MOST_FIELDS: usize = 16;

/// `Viewpoint` of `scene.wgsl`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Viewpoint {
    pub axes: [Vec3; 3],
    pub origin: Vec3,
    pub frame: u64,
}

/// `Params` of `scene.wgsl`, where each is explained.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Params {
    pub size: [u32; 2],
    pub first: u32,
    pub count: u32,
    pub focal: Vec2,
    pub centre: Vec2,
    pub background: Vec3,
    pub gain: f32,
    pub seed: u64,
    pub views: u32,
    pub levels: u32,
    pub samples: u32,
    pub base: u32,
    pub most: u32,
    pub variance: f32,
    pub max_bounces: u32,
    pub roulette_after: u32,
    pub next_event: bool,
    pub list: u32,
    pub grid_min: Vec3,
    pub emitters: u32,
    pub cells_per_metre: Vec3,
    pub first_punctual: u32,
    pub cells: UVec3,
    pub textures: u32,
    pub charts: u32,
    pub direct_fields: u32,
    pub indirect_fields: u32,
    pub rays: u32,
    pub dark: f32,
    pub lists_at: u32,
    pub list_size: u32,
    pub seen_at: u32,
    pub points: u32,
    pub spacing_m: [f32; MOST_FIELDS],
    pub viewpoints: [Viewpoint; MOST_VIEWS],
}

impl Params {
    pub fn words(&self) -> Vec<u32> {
        let mut w = Words::default();
        w.u(self.size[0]).u(self.size[1]).u(self.first).u(self.count);
        w.v2(self.focal).v2(self.centre).v3(self.background).f(self.gain);
        w.u64(self.seed).u(self.views).u(self.levels).u(self.samples).u(self.base).u(self.most).f(self.variance);
        w.u(self.max_bounces).u(self.roulette_after).u(u32::from(self.next_event)).u(self.list);
        w.v3(self.grid_min).u(self.emitters).v3(self.cells_per_metre).u(self.first_punctual);
        w.u(self.cells.x).u(self.cells.y).u(self.cells.z).u(self.textures);
        w.u(self.charts).u(self.direct_fields).u(self.indirect_fields).u(self.rays);
        w.f(self.dark).u(self.lists_at).u(self.list_size).u(self.seen_at);
        w.u(self.points).u(0).u(0).u(0);
        for spacing in self.spacing_m {
            w.f(spacing).u(0).u(0).u(0);
        }
        for Viewpoint { axes, origin, frame } in self.viewpoints {
            w.v3(axes[0]).u(frame as u32).v3(axes[1]).u((frame >> 32) as u32).v3(axes[2]).u(0).v3(origin).u(0);
        }
        w.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uniform_is_as_long_as_its_words() {
        assert_eq!(4 * Params::default().words().len() as u64, PARAMS_BYTES);
    }
}
