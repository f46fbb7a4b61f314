//! What kernels of light read, field by field: the scene, its charts, tiles to be filled. The declarations in WGSL follow from these.

use corf_gpu::record;

record! {
    /// A node of the tree: the boxes of its two children, and what they are.
    pub(super) struct Node {
        pub low_a: [f32; 3],
        pub a: u32,
        pub high_a: [f32; 3],
        pub b: u32,
        pub low_b: [f32; 3],
        pub unused_a: u32,
        pub high_b: [f32; 3],
        pub unused_b: u32,
    }
}

record! {
    /// A triangle's corners. Triangles are numbered in the order of the tree's leaves.
    pub(super) struct Triangle {
        pub a: [f32; 3],
        /// Bits of `COVER_*`.
        pub cover: u32,
        pub b: [f32; 3],
        /// Its number in the scene.
        pub number: u32,
        pub c: [f32; 3],
        pub unused: u32,
    }
}

record! {
    /// The rest of a triangle.
    pub(super) struct Attributes {
        pub normal_a: [f32; 3],
        pub material: u32,
        pub normal_b: [f32; 3],
        pub object: u32,
        pub normal_c: [f32; 3],
        pub chart: u32,
        pub uv_a: [f32; 2],
        pub uv_b: [f32; 2],
        pub uv_c: [f32; 2],
        /// Its first emitting patch, or `NONE`.
        pub emitter: u32,
        /// Into how many parts its edges are divided; with `WITHOUT_UV`.
        pub parts: u32,
    }
}

record! {
    /// A texture as a material uses it.
    pub(super) struct Map {
        pub x_axis: [f32; 2],
        pub y_axis: [f32; 2],
        pub origin: [f32; 2],
        /// `NONE` where there is none.
        pub texture: u32,
        pub unused: u32,
    }
}

record! {
    /// What a surface is to light.
    pub(super) struct Material {
        pub base_color: [f32; 3],
        pub alpha: f32,
        pub emissive: [f32; 3],
        pub normal_scale: f32,
        pub metallic: f32,
        pub roughness: f32,
        pub transmission: f32,
        pub ior: f32,
        pub cutoff: f32,
        /// 0 opaque, 1 mask, 2 blend.
        pub alpha_mode: u32,
        pub double_sided: u32,
        pub unused: u32,
        pub base_color_map: Map,
        pub metallic_roughness_map: Map,
        pub normal_map: Map,
        pub emissive_map: Map,
    }
}

record! {
    /// A texture's place among the texels.
    pub(super) struct Texture {
        /// First texel.
        pub first: u32,
        pub width: u32,
        pub height: u32,
        /// Wrap along u (0 repeat, 1 mirror, 2 clamp), along v times 4, nearest times 16.
        pub mode: u32,
    }
}

record! {
    /// A patch that emits, or a light without extent, which has its position and its direction in `a` and `normal`.
    pub(super) struct Emitter {
        pub a: [f32; 3],
        pub area: f32,
        pub b: [f32; 3],
        pub triangle: u32,
        pub c: [f32; 3],
        /// `EMITTER_*` in the low bits; `DOUBLE_SIDED`.
        pub kind: u32,
        pub normal: [f32; 3],
        pub luminance: f32,
        pub power: [f32; 3],
        /// Of a light without extent, metres; the largest number without.
        pub range_m: f32,
        /// Barycentric coordinates of the patch's corners in the whole triangle.
        pub weight_a: [f32; 2],
        pub weight_b: [f32; 2],
        pub weight_c: [f32; 2],
        /// Cosines of a spot's inner and outer half angle.
        pub cone: [f32; 2],
    }
}

record! {
    /// Coplanar triangles that lattices lie on.
    pub(super) struct Chart {
        pub origin: [f32; 3],
        /// Range of `members`.
        pub first: u32,
        pub x_axis: [f32; 3],
        pub count: u32,
        pub y_axis: [f32; 3],
        pub unused_a: u32,
        pub normal: [f32; 3],
        pub unused_b: u32,
        pub size: [f32; 2],
        pub unused_c: u32,
        pub unused_d: u32,
    }
}

record! {
    /// A tile that is being filled.
    pub(super) struct Job {
        pub field: u32,
        pub chart: u32,
        pub side: u32,
        /// Of the tile in its field: the key of its random numbers.
        pub number: u32,
        /// Its first point in the lattice, and how many it has each way.
        pub first: [u32; 2],
        pub points: [u32; 2],
        /// Place of its head in the pages, and its slot.
        pub head: u32,
        pub slot: u32,
        /// Emitters that may light it; written by a kernel.
        pub candidates: u32,
        /// Number of its first point in the coarse lattice.
        pub first_point: u32,
        /// Number of its first point among those of the coarse lattice that are worked on together.
        pub first_record: u32,
        pub unused: u32,
    }
}

/// What all kernels know of the scene.
pub(super) fn scene_declarations() -> String {
    [
        Node::declaration(),
        Triangle::declaration(),
        Attributes::declaration(),
        Map::declaration(),
        Material::declaration(),
        Texture::declaration(),
        Emitter::declaration(),
        Chart::declaration(),
    ]
    .concat()
}
