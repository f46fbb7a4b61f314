@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> records: array<vec4<f32>>;

// As the backward pass of one modality; the gradients of the shared ellipse are sums over both. A record is four words: dL/dcolour of
// light and dL/d(1/z); dL/dcolour of radio, dL/d(oρ) of light; dL/d(oρ) of radio, Σ dL/dσ (dx², dx dy, dy²); Σ dL/dσ (dx, dy).
const ROW = AREA + 1u;
const PARTS = AREA / BATCH;
const RUN = AREA / PARTS;
const WORDS = 16u;
var<workgroup> weights: array<f32, BATCH * ROW>;
var<workgroup> rf_weights: array<f32, BATCH * ROW>;
var<workgroup> d_sigmas: array<f32, BATCH * ROW>;      // of both
var<workgroup> rf_d_sigmas: array<f32, BATCH * ROW>;
var<workgroup> pixel_gradient: array<vec4<f32>, AREA>;
var<workgroup> rf_pixel_gradient: array<vec4<f32>, AREA>;
var<workgroup> open: atomic<u32>;
var<workgroup> any_open: u32;

@compute @workgroup_size(AREA)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    if (index >= params.tile_total) { return; }
    let tile = tile_of(index, thread);
    let centre = vec2<f32>(tile.pixel - tile.corner) + 0.5;
    let first = starts[index];
    let end = starts[index + 1u];
    var t = vec2(0.0);
    var g_light = vec4(0.0);
    var g_radio = vec4(0.0);
    var behind = vec2(0.0);
    if (tile.inside) {
        let second = tile.at + params.grids[1].first_pixel;
        t = vec2(1.0);
        g_light = gradient[tile.at];
        g_radio = gradient[second];
        behind = vec2(dot(g_light, image[tile.at]), dot(g_radio.rgb, image[second].rgb));
    }
    pixel_gradient[thread] = g_light;
    rf_pixel_gradient[thread] = g_radio;
    let slot_2 = thread % BATCH;
    let part = thread / BATCH;
    var begin = first;
    for (; begin < end; begin += BATCH) {
        if (thread == 0u) { atomicStore(&open, 0u); }
        workgroupBarrier();
        if (max(t.x, t.y) >= MIN_TRANSMITTANCE) { atomicStore(&open, 1u); }
        for (var slot = thread; slot < BATCH; slot += AREA) {
            if (begin + slot < end) { load_both(slot, owners[pairs[begin + slot]], tile.corner); }
        }
        workgroupBarrier();
        if (thread == 0u) { any_open = atomicLoad(&open); }
        if (workgroupUniformLoad(&any_open) == 0u) { break; }
        let count = min(BATCH, end - begin);
        for (var slot = 0u; slot < count; slot++) {
            let rf = batch_rf[slot];
            let free = vec2(batch_place[slot].z, rf.w) * falloff(slot, centre);
            let alpha = min(free, vec2(MAX_ALPHA));
            let drawn = (alpha >= vec2(MIN_ALPHA)) & (t >= vec2(MIN_TRANSMITTANCE));
            let weight = select(vec2(0.0), alpha * t, drawn);
            let shade = vec2(dot(g_light, batch_color[slot]), dot(g_radio.rgb, rf.rgb));
            behind -= weight * shade;
            let slope = -alpha * (t * shade - behind / (1.0 - alpha));
            let d_sigma = select(vec2(0.0), slope, drawn & (free < vec2(MAX_ALPHA)));
            t -= weight;
            let at = slot * ROW + thread;
            weights[at] = weight.x;
            rf_weights[at] = weight.y;
            d_sigmas[at] = d_sigma.x + d_sigma.y;
            rf_d_sigmas[at] = d_sigma.y;
        }
        workgroupBarrier();
        var d_light = vec4(0.0);
        // dL/dcolour of radio, Σ dL/dσ of radio.
        var d_radio = vec4(0.0);
        var low = vec3(0.0);
        var high = vec3(0.0);
        if (slot_2 < count) {
            for (var row = 0u; row < RUN / TILE_WIDTH; row++) {
                let row_begin = part * RUN + row * TILE_WIDTH;
                var s0 = 0.0;
                var s1 = 0.0;
                var s2 = 0.0;
                for (var i = 0u; i < TILE_WIDTH; i++) {
                    let at = slot_2 * ROW + row_begin + i;
                    d_light = fma(vec4(weights[at]), pixel_gradient[row_begin + i], d_light);
                    d_radio += vec4(rf_weights[at] * rf_pixel_gradient[row_begin + i].rgb, rf_d_sigmas[at]);
                    let d = d_sigmas[at];
                    let x = f32(i) + 0.5;
                    s0 += d;
                    s1 = fma(d, x, s1);
                    s2 = fma(d, x * x, s2);
                }
                let y = f32(row_begin / TILE_WIDTH) + 0.5;
                low += vec3(s0, s1, s0 * y);
                high += vec3(s2, s1 * y, s0 * y * y);
            }
        }
        workgroupBarrier();
        // Parts of a splat meet in its rows of `weights`.
        if (part > 0u && slot_2 < count) {
            let at = slot_2 * ROW + (part - 1u) * WORDS;
            for (var k = 0u; k < 4u; k++) {
                weights[at + k] = d_light[k];
                weights[at + 4u + k] = d_radio[k];
            }
            for (var k = 0u; k < 3u; k++) {
                weights[at + 8u + k] = low[k];
                weights[at + 11u + k] = high[k];
            }
        }
        workgroupBarrier();
        if (part == 0u && slot_2 < count) {
            for (var p = 1u; p < PARTS; p++) {
                let at = slot_2 * ROW + (p - 1u) * WORDS;
                d_light += vec4(weights[at], weights[at + 1u], weights[at + 2u], weights[at + 3u]);
                d_radio += vec4(weights[at + 4u], weights[at + 5u], weights[at + 6u], weights[at + 7u]);
                low += vec3(weights[at + 8u], weights[at + 9u], weights[at + 10u]);
                high += vec3(weights[at + 11u], weights[at + 12u], weights[at + 13u]);
            }
            let place = batch_place[slot_2];
            let moments = about_mean(place.xy, low, high);
            let at = 4u * pairs[begin + slot_2];
            records[at] = d_light;
            // α = oρ·G: Σ G dL/dα = −Σ dL/dσ / (oρ).
            records[at + 1u] = vec4(d_radio.rgb, -(low.x - d_radio.w) / max(place.z, 1e-30));
            records[at + 2u] = vec4(-d_radio.w / max(batch_rf[slot_2].w, 1e-30), moments);
            records[at + 3u] = vec4(place.xy * low.x - low.yz, 0.0, 0.0);
        }
        workgroupBarrier();
    }
    for (var s = begin + thread; s < end; s += AREA) {
        let at = 4u * pairs[s];
        for (var k = 0u; k < 4u; k++) { records[at + k] = vec4(0.0); }
    }
}
