//! Settings of a pass: the uniform of every kernel.

use corf_gpu::record;

/// Bytes of the uniform.
pub(super) const PARAMS_BYTES: u64 = size_of::<Params>() as u64;

/// Views that are rendered together at most.
pub(super) const MOST_VIEWS: usize = 8;

/// Fields that lattices may have.
pub(super) const MOST_FIELDS: usize = 16;

record! {
    /// A camera: columns of the rotation into the world, position, key of its random numbers.
    pub(super) struct Viewpoint {
        pub x_axis: [f32; 3],
        pub frame_low: u32,
        pub y_axis: [f32; 3],
        pub frame_high: u32,
        pub z_axis: [f32; 3],
        pub unused_a: u32,
        pub origin: [f32; 3],
        pub unused_b: u32,
    }
}

record! {
    /// What a pass is told.
    pub(super) struct Params {
        /// Of one image, pixels.
        pub width: u32,
        pub height: u32,
        /// This dispatch takes places `first` to `first + count` of its list.
        pub first: u32,
        pub count: u32,
        /// Intrinsics, pixels.
        pub focal: [f32; 2],
        pub centre: [f32; 2],
        pub background: [f32; 3],
        pub gain: f32,
        pub seed: [u32; 2],
        /// Images that are rendered together. A pixel's item is its number in its image, behind all pixels of the images before.
        pub views: u32,
        /// Doublings that lead from `base` to at least `most`.
        pub levels: u32,
        /// Paths a pixel has when this pass is through, 0 where that is its own wish.
        pub samples: u32,
        /// Paths of every pixel.
        pub base: u32,
        /// Paths of a pixel at most.
        pub most: u32,
        /// Variance of a developed pixel that is sought.
        pub variance: f32,
        pub max_bounces: u32,
        pub roulette_after: u32,
        /// Whether emitters are sampled at every vertex.
        pub next_event: u32,
        /// 0: the list is all pixels; 1 or 2: that list. What is begun again goes to the other one.
        pub list: u32,
        /// The emitters' grid.
        pub grid_min: [f32; 3],
        pub emitters: u32,
        pub cells_per_metre: [f32; 3],
        pub first_punctual: u32,
        pub cells: [u32; 3],
        /// Textures; as many coarse ones follow.
        pub textures: u32,
        pub charts: u32,
        /// Fields of lattices: the coarse one, direct ones, indirect ones, finest last.
        pub direct_fields: u32,
        pub indirect_fields: u32,
        /// Rays of a lattice's point.
        pub rays: u32,
        /// Light below this share of the scene's mean counts as this much.
        pub dark: f32,
        /// Words of `work` before its lists, and of each list.
        pub lists_at: u32,
        pub list_size: u32,
        /// Place of the visibilities behind the guides.
        pub seen_at: u32,
        /// Points of the tile with the most of those that are being filled.
        pub points: u32,
        pub unused_a: u32,
        pub unused_b: u32,
        pub unused_c: u32,
        /// Of each field, metres, in the first place of four.
        pub spacing_m: [[f32; 4]; MOST_FIELDS],
        pub viewpoints: [Viewpoint; MOST_VIEWS],
    }
}

/// A number of 64 bits as kernels hold it: low word first.
pub(super) fn halves(value: u64) -> [u32; 2] {
    [value as u32, (value >> 32) as u32]
}
