// The scene as the host packs it (scene.rs). Triangles are numbered in the order of the tree's leaves; `NONE` is no triangle.

struct Node {
    low_a: vec3<f32>,
    a: u32,
    high_a: vec3<f32>,
    b: u32,
    low_b: vec3<f32>,
    unused_a: u32,
    high_b: vec3<f32>,
    unused_b: u32,
}

struct Triangle {
    a: vec3<f32>,
    // Bits of COVER_*.
    cover: u32,
    b: vec3<f32>,
    // Its number in the scene.
    number: u32,
    c: vec3<f32>,
    unused: u32,
}

const COVER_ALPHA = 1u;
const COVER_PANE = 2u;

struct Attributes {
    normal_a: vec3<f32>,
    material: u32,
    normal_b: vec3<f32>,
    object: u32,
    normal_c: vec3<f32>,
    chart: u32,
    uv_a: vec2<f32>,
    uv_b: vec2<f32>,
    uv_c: vec2<f32>,
    // Its first emitting patch, or NONE.
    emitter: u32,
    // Into how many parts its edges are divided; with WITHOUT_UV.
    parts: u32,
}

const WITHOUT_UV = 0x80000000u;

// A texture as a material uses it; `texture` is NONE where there is none.
struct Map {
    x_axis: vec2<f32>,
    y_axis: vec2<f32>,
    origin: vec2<f32>,
    texture: u32,
    unused: u32,
}

struct Material {
    base_color: vec3<f32>,
    alpha: f32,
    emissive: vec3<f32>,
    normal_scale: f32,
    metallic: f32,
    roughness: f32,
    transmission: f32,
    ior: f32,
    cutoff: f32,
    // 0 opaque, 1 mask, 2 blend.
    alpha_mode: u32,
    double_sided: u32,
    unused: u32,
    base_color_map: Map,
    metallic_roughness_map: Map,
    normal_map: Map,
    emissive_map: Map,
}

struct Texture {
    // First texel.
    first: u32,
    width: u32,
    height: u32,
    // Wrap along u (0 repeat, 1 mirror, 2 clamp), along v times 4, nearest times 16.
    mode: u32,
}

struct Emitter {
    // Corners of a patch; a light without extent has its position and its direction in `a` and `normal`.
    a: vec3<f32>,
    area: f32,
    b: vec3<f32>,
    triangle: u32,
    c: vec3<f32>,
    // EMITTER_* in the low bits; DOUBLE_SIDED.
    kind: u32,
    normal: vec3<f32>,
    luminance: f32,
    power: vec3<f32>,
    // Of a light without extent; infinite without.
    range_m: f32,
    // Barycentric coordinates of the patch's corners in the whole triangle.
    weight_a: vec2<f32>,
    weight_b: vec2<f32>,
    weight_c: vec2<f32>,
    // Cosines of a spot's inner and outer half angle.
    cone: vec2<f32>,
}

const EMITTER_PATCH = 0u;
const EMITTER_POINT = 1u;
const EMITTER_SPOT = 2u;
const EMITTER_DIRECTIONAL = 3u;
const DOUBLE_SIDED = 4u;

struct Chart {
    origin: vec3<f32>,
    // Range of `members`.
    first: u32,
    x_axis: vec3<f32>,
    count: u32,
    y_axis: vec3<f32>,
    unused_a: u32,
    normal: vec3<f32>,
    unused_b: u32,
    size: vec2<f32>,
    unused_c: u32,
    unused_d: u32,
}

// A camera: columns of the rotation into the world, position, key of its random numbers.
struct Viewpoint {
    x_axis: vec3<f32>,
    frame_low: u32,
    y_axis: vec3<f32>,
    frame_high: u32,
    z_axis: vec3<f32>,
    unused_a: u32,
    origin: vec3<f32>,
    unused_b: u32,
}

struct Params {
    // Of one image, pixels.
    width: u32,
    height: u32,
    // This dispatch takes places `first` to `first + count` of its list.
    first: u32,
    count: u32,
    // Intrinsics, pixels.
    focal: vec2<f32>,
    centre: vec2<f32>,
    background: vec3<f32>,
    gain: f32,
    seed: vec2<u32>,
    // Images that are rendered together. A pixel's item is its number in its image, behind all pixels of the images before.
    views: u32,
    // Doublings that lead from `base` to at least `most`.
    levels: u32,
    // Paths a pixel has when this pass is through, 0 where that is its own wish; those of every pixel; the most; the variance of a
    // developed pixel that is sought.
    samples: u32,
    base: u32,
    most: u32,
    variance: f32,
    max_bounces: u32,
    roulette_after: u32,
    // Whether emitters are sampled at every vertex.
    next_event: u32,
    // 0: the list is all pixels; 1 or 2: that list. What is begun again goes to the other one.
    list: u32,
    // Emitters.
    grid_min: vec3<f32>,
    emitters: u32,
    cells_per_metre: vec3<f32>,
    first_punctual: u32,
    cells: vec3<u32>,
    // Textures; as many coarse ones follow.
    textures: u32,
    // Lattices: charts, fields (the coarse one, direct ones, indirect ones, finest last), rays of a point.
    charts: u32,
    direct_fields: u32,
    indirect_fields: u32,
    rays: u32,
    // Light below this share of the scene's mean counts as this much.
    dark: f32,
    // Words of `work` before its lists, and of each list.
    lists_at: u32,
    list_size: u32,
    // Place of the visibilities behind the guides.
    seen_at: u32,
    // Points of the tile with the most of those that are being filled.
    points: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
    spacing_m: array<vec4<f32>, 16>,
    viewpoints: array<Viewpoint, 8>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(3) var<storage, read> attributes: array<Attributes>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> materials: array<Material>;
@group(0) @binding(6) var<storage, read> textures: array<Texture>;
@group(0) @binding(7) var<storage, read> texels: array<u32>;
@group(0) @binding(8) var<storage, read> tables: array<vec2<f32>>;
@group(0) @binding(9) var<storage, read> emitters: array<Emitter>;
@group(0) @binding(10) var<storage, read> cumulative: array<f32>;
@group(0) @binding(11) var<storage, read> guides: array<u32>;
