// The scene as the host packs it (records.rs, gpu/params.rs, from which the structs are written). Triangles are numbered in the order of the
// tree's leaves; `NONE` is no triangle.

const COVER_ALPHA = 1u;
const COVER_PANE = 2u;
const WITHOUT_UV = 0x80000000u;
const EMITTER_PATCH = 0u;
const EMITTER_POINT = 1u;
const EMITTER_SPOT = 2u;
const EMITTER_DIRECTIONAL = 3u;
const DOUBLE_SIDED = 4u;

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
