// A workgroup is a tile, a thread is a pixel. With BOTH, one tile is of both images: one list, one exp(−σ) a pixel and splat; their own
// opacity, colour, transmittance and end.
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

// A splat as the blends use it.
struct Drawn {
    // u, v from the tile's corner, o·ρ, 1/z.
    place: vec4<f32>,
    // −½ log₂e Q_xx, −log₂e Q_xy, −½ log₂e Q_yy.
    power: vec3<f32>,
    color: vec3<f32>,
    // With BOTH: colour and o·ρ of the RF field.
    radio: vec4<f32>,
}

// Of opacity 0: drawn nowhere.
fn nothing() -> Drawn { return Drawn(vec4(0.0), vec3(0.0), vec3(0.0), vec4(0.0)); }

fn drawn(owner: u32, corner: vec2<u32>) -> Drawn {
    let splat = splats[owner];
    var d: Drawn;
    d.place = vec4(splat.place.xy - vec2<f32>(corner), splat.place.zw);
    d.power = splat.conic.xyz * vec3(-0.5 * LOG2E, -LOG2E, -0.5 * LOG2E);
    d.color = splat.color.rgb;
    if (BOTH) {
        let second = params.visible_capacity + owner;
        d.radio = vec4(splats[second].color.rgb, splats[second].place.z);
    }
    return d;
}

// exp(−σ) at d = mean − pixel.
fn falloff(power: vec3<f32>, d: vec2<f32>) -> f32 {
    return exp2(min(d.x * (power.x * d.x + power.y * d.y) + power.z * d.y * d.y, 0.0));
}

// A checkpoint is the state of a tile's pixels before every BUCKET-th splat but the first: T, Σ c α T of three channels and Σ (1/z) α T;
// with BOTH the radio's T and Σ c α T as well. It lies in two buffers, as an adapter limits what one binding holds: the head is T and two
// channels, with BOTH the radio's T and one channel; the tail is what is left of each.
fn head_at(checkpoint: u32, number: u32, pixel: u32) -> u32 { return (checkpoint * HEAD_NUMBERS + number) * AREA + pixel; }

fn tail_at(checkpoint: u32, number: u32, pixel: u32) -> u32 { return (checkpoint * TAIL_NUMBERS + number) * AREA + pixel; }
