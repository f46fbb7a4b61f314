// What the blends do with a pixel, whoever brings them the splats of a batch.

// What a pixel has gathered: T of light and radio; Σ c α T and Σ (1/z) α T of both.
struct Pixel { t: vec2<f32>, light: vec4<f32>, radio: vec4<f32> }

fn add(p: ptr<function, Pixel>, slot: u32, falloff: f32) -> f32 {
    let place = batch_place[slot];
    let alpha = min(place.z * falloff, MAX_ALPHA);
    let weight = select(0.0, alpha * (*p).t.x, alpha >= MIN_ALPHA && (*p).t.x >= MIN_TRANSMITTANCE);
    (*p).t.x -= weight;
    (*p).light = fma(vec4(weight), vec4(batch_color[slot], place.w), (*p).light);
    if (BOTH) {
        let radio = batch_radio[slot];
        let alpha = min(radio.w * falloff, MAX_ALPHA);
        let weight = select(0.0, alpha * (*p).t.y, alpha >= MIN_ALPHA && (*p).t.y >= MIN_TRANSMITTANCE);
        (*p).t.y -= weight;
        (*p).radio = fma(vec4(weight), vec4(radio.rgb, place.w), (*p).radio);
    }
    return weight;
}

fn falloffs(slot: u32, centre: vec2<f32>) -> vec4<f32> {
    return vec4(
        falloff(batch_power[slot], batch_place[slot].xy - centre),
        falloff(batch_power[slot + 1u], batch_place[slot + 1u].xy - centre),
        falloff(batch_power[slot + 2u], batch_place[slot + 2u].xy - centre),
        falloff(batch_power[slot + 3u], batch_place[slot + 3u].xy - centre),
    );
}

fn save(p: Pixel, checkpoint: u32, thread: u32) {
    checkpoint_heads[head_at(checkpoint, 0u, thread)] = p.t.x;
    checkpoint_heads[head_at(checkpoint, 1u, thread)] = p.light.x;
    checkpoint_heads[head_at(checkpoint, 2u, thread)] = p.light.y;
    checkpoint_tails[tail_at(checkpoint, 0u, thread)] = p.light.z;
    checkpoint_tails[tail_at(checkpoint, 1u, thread)] = p.light.w;
    if (BOTH) {
        checkpoint_heads[head_at(checkpoint, 3u, thread)] = p.t.y;
        checkpoint_heads[head_at(checkpoint, 4u, thread)] = p.radio.x;
        checkpoint_tails[tail_at(checkpoint, 2u, thread)] = p.radio.y;
        checkpoint_tails[tail_at(checkpoint, 3u, thread)] = p.radio.z;
    }
}

fn put(at: u32, value: vec4<f32>) {
    image[at] = value.x;
    image[params.pixel_total + at] = value.y;
    image[2u * params.pixel_total + at] = value.z;
    image[3u * params.pixel_total + at] = value.w;
}

// C = Σ c α T + T_N·background, and Σ (1/z) α T.
fn finish(tile: Tile, p: Pixel) {
    put(tile.at, vec4(p.light.rgb + p.t.x * params.grids[tile.modality].background.rgb, p.light.w));
    transmittance[tile.at] = p.t.x;
    if (BOTH) {
        let second = tile.at + params.grids[1].first_pixel;
        put(second, vec4(p.radio.rgb + p.t.y * params.grids[1].background.rgb, p.radio.w));
        transmittance[second] = p.t.y;
    }
}
