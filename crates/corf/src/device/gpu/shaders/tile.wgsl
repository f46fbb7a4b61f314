// A workgroup is a tile, a thread is a pixel.
struct Tile {
    // 0 optical, 1 RF.
    modality: u32,
    // Corner and this thread's pixel.
    corner: vec2<u32>,
    pixel: vec2<u32>,
    inside: bool,
    // Place of the pixel in the images.
    at: u32,
}

fn tile_of(index: u32, thread: u32) -> Tile {
    var t: Tile;
    t.modality = u32(index >= params.grids[1].first_tile && params.grids[1].size.x > 0u);
    let grid = params.grids[t.modality];
    let local = index - grid.first_tile;
    t.corner = vec2(local % grid.tiles.x, local / grid.tiles.x) * vec2(TILE_WIDTH, TILE_HEIGHT);
    t.pixel = t.corner + vec2(thread % TILE_WIDTH, thread / TILE_WIDTH);
    t.inside = all(t.pixel < grid.size);
    t.at = grid.first_pixel + t.pixel.y * grid.size.x + t.pixel.x;
    return t;
}

// A splat as the blend reads it, relative to the tile's corner.
var<workgroup> batch_place: array<vec4<f32>, BATCH>;   // u, v, o·ρ, 1/z
var<workgroup> batch_power: array<vec4<f32>, BATCH>;   // −½ log₂e Q_xx, −log₂e Q_xy, −½ log₂e Q_yy
var<workgroup> batch_color: array<vec4<f32>, BATCH>;   // r, g, b, 1/z

fn load(slot: u32, splat: Splat, corner: vec2<u32>) {
    batch_place[slot] = vec4(splat.place.xy - vec2<f32>(corner), splat.place.zw);
    batch_power[slot] = vec4(splat.conic.xyz * vec3(-0.5 * LOG2E, -LOG2E, -0.5 * LOG2E), 0.0);
    batch_color[slot] = vec4(splat.color.rgb, splat.place.w);
}

// exp(−σ), d = mean − pixel.
fn falloff(slot: u32, centre: vec2<f32>) -> f32 {
    let power = batch_power[slot];
    let d = batch_place[slot].xy - centre;
    return exp2(min(d.x * (power.x * d.x + power.y * d.y) + power.z * d.y * d.y, 0.0));
}

// o·ρ·exp(−σ).
fn free_alpha(slot: u32, centre: vec2<f32>) -> f32 {
    return batch_place[slot].z * falloff(slot, centre);
}

// Σ dL/dσ (dx², dx dy, dy²) from Σ dL/dσ · (1, x, y) and · (x², x y, y²) of pixels counted from the tile's corner, as is the mean.
fn about_mean(mean: vec2<f32>, low: vec3<f32>, high: vec3<f32>) -> vec3<f32> {
    return vec3(
        mean.x * mean.x * low.x - 2.0 * mean.x * low.y + high.x,
        mean.x * mean.y * low.x - mean.x * low.z - mean.y * low.y + high.y,
        mean.y * mean.y * low.x - 2.0 * mean.y * low.z + high.z,
    );
}
