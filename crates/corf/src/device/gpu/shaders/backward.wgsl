// cpu/blend.rs, Backward: gradients of splats, pixel by pixel from the last to the first.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> lists: array<List>;
@group(0) @binding(3) var<storage, read> bucket_tiles: array<u32>;
@group(0) @binding(4) var<storage, read> entries: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> splats: array<Splat>;
@group(0) @binding(6) var<storage, read> image: array<f32>;
@group(0) @binding(7) var<storage, read> gradient: array<f32>;
@group(0) @binding(8) var<storage, read> checkpoint_heads: array<f32>;
@group(0) @binding(9) var<storage, read> checkpoint_tails: array<f32>;
@group(0) @binding(10) var<storage, read> visited: array<u32>;
@group(0) @binding(11) var<storage, read_write> record_heads: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> record_tails: array<vec4<f32>>;

// A lane is a splat, a bucket is BUCKET splats of one tile that stand one behind the other. The tile's pixels pass through the bucket,
// from lane to lane, one a step; what a pixel is when it comes to the bucket's first splat was kept by the forward pass. Each lane sums
// over the pixels on its own, in their order: no atomics, and a fixed order. One record per pair, its first two words in the heads of
// records, the others in their tails. A record of one image: dL/dcolour,
// dL/d(1/z); dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²); Σ dL/dσ (dx, dy). Of both: dL/dcolour of light, dL/d(1/z); dL/dcolour of radio,
// dL/d(oρ) of light; dL/d(oρ) of radio, Σ dL/dσ (dx², dx dy, dy²) of both; Σ dL/dσ (dx, dy) of both.
// T and g·(what is composited from here on, background included) of a bucket's pixels as they come to it.
var<workgroup> light_before: array<vec2<f32>, PIXELS>;
var<workgroup> radio_before: array<vec2<f32>, RADIO_PIXELS>;
// dL/dimage.
var<workgroup> light_gradient: array<vec4<f32>, PIXELS>;
// One plane a channel: words of three would be kept as four, and how much of this memory a bucket takes decides how many run at once.
var<workgroup> radio_gradient: array<f32, 3u * RADIO_PIXELS>;
var<workgroup> live: atomic<u32>;
var<workgroup> any_live: u32;

fn color_of(at: u32) -> vec3<f32> {
    return vec3(image[at], image[params.pixel_total + at], image[2u * params.pixel_total + at]);
}

fn gradient_of(at: u32) -> vec3<f32> {
    return vec3(gradient[at], gradient[params.pixel_total + at], gradient[2u * params.pixel_total + at]);
}

fn set_radio_gradient(at: u32, g: vec3<f32>) {
    radio_gradient[at] = g.x;
    radio_gradient[RADIO_PIXELS + at] = g.y;
    radio_gradient[2u * RADIO_PIXELS + at] = g.z;
}

// Brings a pixel of a tile to the entrance of a bucket: place `to` of workgroup memory. Whether anything can be drawn there.
fn bring(index: u32, pixel: u32, to: u32, checkpoint: u32, is_first: bool) -> bool {
    let tile = tile_of(index, pixel);
    light_before[to] = vec2(0.0);
    light_gradient[to] = vec4(0.0);
    if (BOTH) {
        radio_before[to] = vec2(0.0);
        set_radio_gradient(to, vec3(0.0));
    }
    if (!tile.inside) { return false; }
    var t = 1.0;
    var passed = vec4(0.0);
    if (!is_first) {
        t = checkpoint_heads[head_at(checkpoint, 0u, pixel)];
        passed = vec4(
            checkpoint_heads[head_at(checkpoint, 1u, pixel)],
            checkpoint_heads[head_at(checkpoint, 2u, pixel)],
            checkpoint_tails[tail_at(checkpoint, 0u, pixel)],
            checkpoint_tails[tail_at(checkpoint, 1u, pixel)],
        );
    }
    let g = vec4(gradient_of(tile.at), gradient[3u * params.pixel_total + tile.at]);
    let whole = vec4(color_of(tile.at), image[3u * params.pixel_total + tile.at]);
    light_gradient[to] = g;
    light_before[to] = vec2(t, dot(g, whole - passed));
    var open = t >= MIN_TRANSMITTANCE;
    if (BOTH) {
        let second = tile.at + params.grids[1].first_pixel;
        t = 1.0;
        var passed = vec3(0.0);
        if (!is_first) {
            t = checkpoint_heads[head_at(checkpoint, 3u, pixel)];
            passed = vec3(
                checkpoint_heads[head_at(checkpoint, 4u, pixel)],
                checkpoint_tails[tail_at(checkpoint, 2u, pixel)],
                checkpoint_tails[tail_at(checkpoint, 3u, pixel)],
            );
        }
        let g = gradient_of(second);
        set_radio_gradient(to, g);
        radio_before[to] = vec2(t, dot(g, color_of(second) - passed));
        open |= t >= MIN_TRANSMITTANCE;
    }
    return open;
}

// What one image does at one pixel: weight α·T and dL/dσ; T and what is behind move on. dL/dα = T c·g − R·g / (1 − α), with R behind
// this Gaussian; dL/dσ = −α dL/dα where the cap does not hold it.
fn blend_back(free: f32, shade: f32, at: ptr<function, vec2<f32>>) -> vec2<f32> {
    let alpha = min(free, MAX_ALPHA);
    if (!(alpha >= MIN_ALPHA && (*at).x >= MIN_TRANSMITTANCE)) { return vec2(0.0); }
    let weight = alpha * (*at).x;
    let behind = (*at).y - weight * shade;
    let slope = -alpha * ((*at).x * shade - behind / (1.0 - alpha));
    *at = vec2((*at).x - weight, behind);
    return vec2(weight, select(0.0, slope, free < MAX_ALPHA));
}

fn backward(group: u32, thread: u32) {
    let lane = thread % BUCKET;
    let own = thread / BUCKET;
    let bucket = group * BUCKETS_A_GROUP + own;
    if (thread == 0u) { atomicStore(&live, 0u); }
    workgroupBarrier();
    let exists = bucket < state[BUCKETS];
    var index = 0u;
    var count = 0u;
    // None where the tile had ended before.
    var taken = 0u;
    var pair = 0u;
    var corner = vec2(0u);
    var splat = nothing();
    if (exists) {
        index = bucket_tiles[bucket];
        let list = lists[index];
        let number = bucket - list.bucket;
        let begin = number * BUCKET;
        count = min(BUCKET, list.count - begin);
        if (begin < visited[index]) {
            var open = false;
            for (var pixel = lane; pixel < AREA; pixel += BUCKET) {
                open |= bring(index, pixel, own * AREA + pixel, list.checkpoint + number - 1u, number == 0u);
            }
            if (open) { atomicStore(&live, 1u); }
            taken = count;
        }
        if (lane < count) {
            let entry = entries[list.first + begin + lane];
            pair = entry.y;
            splat = drawn(entry.x, tile_of(index, 0u).corner);
        }
    }
    workgroupBarrier();
    if (thread == 0u) { any_live = atomicLoad(&live); }

    var d_light = vec4(0.0);
    var d_radio = vec3(0.0);
    // Σ dL/dσ of each.
    var mass = vec2(0.0);
    var first = vec2(0.0);
    var second = vec3(0.0);
    if (workgroupUniformLoad(&any_live) != 0u) {
        var light_at = vec2(0.0);
        var radio_at = vec2(0.0);
        for (var step = 0u; step < AREA + BUCKET - 1u; step++) {
            light_at = from_before(light_at, thread);
            if (BOTH) { radio_at = from_before(radio_at, thread); }
            // Below 0 is above AREA.
            let pixel = step - lane;
            if (pixel < AREA && lane < taken) {
                let at = own * AREA + pixel;
                if (lane == 0u) {
                    light_at = light_before[at];
                    if (BOTH) { radio_at = radio_before[at]; }
                }
                let centre = vec2(f32(pixel % TILE_WIDTH), f32(pixel / TILE_WIDTH)) + 0.5;
                let d = splat.place.xy - centre;
                let f = falloff(splat.power, d);
                let g = light_gradient[at];
                let light = blend_back(splat.place.z * f, dot(g, vec4(splat.color, splat.place.w)), &light_at);
                d_light = fma(vec4(light.x), g, d_light);
                mass.x += light.y;
                var d_sigma = light.y;
                if (BOTH) {
                    let g = vec3(radio_gradient[at], radio_gradient[RADIO_PIXELS + at], radio_gradient[2u * RADIO_PIXELS + at]);
                    let radio = blend_back(splat.radio.w * f, dot(g, splat.radio.rgb), &radio_at);
                    d_radio = fma(vec3(radio.x), g, d_radio);
                    mass.y += radio.y;
                    d_sigma += radio.y;
                }
                let moment = d_sigma * d;
                first += moment;
                second += vec3(moment.x * d.x, moment.x * d.y, moment.y * d.y);
            }
        }
    }
    if (lane >= count) { return; }
    // α = oρ·G: Σ G dL/dα = −Σ dL/dσ / (oρ).
    let d_opacity = -mass / max(vec2(splat.place.z, splat.radio.w), vec2(1e-30));
    let to = 2u * pair;
    record_heads[to] = d_light;
    if (BOTH) {
        record_heads[to + 1u] = vec4(d_radio, d_opacity.x);
        record_tails[to] = vec4(d_opacity.y, second);
        record_tails[to + 1u] = vec4(first, 0.0, 0.0);
    } else {
        record_heads[to + 1u] = vec4(d_opacity.x, second);
        record_tails[pair] = vec4(first, 0.0, 0.0);
    }
}
