@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> records: array<vec4<f32>>;

// Two halves to a batch. First a thread is a pixel and walks the batch front to back, as the forward pass did; what it finds for each
// splat, the weight α·T and dL/dσ, goes to workgroup memory. Then a thread is a splat (and one of PARTS runs of pixels) and sums over
// pixels. One record per (Gaussian, tile), in the order of emission: no atomics, and sums in a fixed order.
const ROW = AREA + 1u;      // one word more than a row of pixels: no two splats in one bank
const PARTS = AREA / BATCH;
const RUN = AREA / PARTS;   // pixels of a part: whole rows of the tile
var<workgroup> weights: array<f32, BATCH * ROW>;
var<workgroup> d_sigmas: array<f32, BATCH * ROW>;
var<workgroup> pixel_gradient: array<vec4<f32>, AREA>;
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
    var t = 0.0;
    var g = vec4(0.0);
    // g·(what is composited from here on, background included).
    var behind = 0.0;
    if (tile.inside) {
        t = 1.0;
        g = gradient[tile.at];
        behind = dot(g, image[tile.at]);
    }
    pixel_gradient[thread] = g;
    let slot_2 = thread % BATCH;
    let part = thread / BATCH;
    var begin = first;
    for (; begin < end; begin += BATCH) {
        if (thread == 0u) { atomicStore(&open, 0u); }
        workgroupBarrier();
        if (t >= MIN_TRANSMITTANCE) { atomicStore(&open, 1u); }
        for (var slot = thread; slot < BATCH; slot += AREA) {
            if (begin + slot < end) { load(slot, splats[owners[pairs[begin + slot]]], tile.corner); }
        }
        workgroupBarrier();
        if (thread == 0u) { any_open = atomicLoad(&open); }
        if (workgroupUniformLoad(&any_open) == 0u) { break; }
        let count = min(BATCH, end - begin);
        for (var slot = 0u; slot < count; slot++) {
            let free = free_alpha(slot, centre);
            let alpha = min(free, MAX_ALPHA);
            var weight = 0.0;
            var d_sigma = 0.0;
            if (alpha >= MIN_ALPHA && t >= MIN_TRANSMITTANCE) {
                weight = alpha * t;
                let shade = dot(g, batch_color[slot]);
                // dL/dα = T c·g − R·g / (1 − α), with R behind this Gaussian; dL/dσ = −α dL/dα where the cap does not hold it.
                behind -= weight * shade;
                if (free < MAX_ALPHA) { d_sigma = -alpha * (t * shade - behind / (1.0 - alpha)); }
                t -= weight;
            }
            weights[slot * ROW + thread] = weight;
            d_sigmas[slot * ROW + thread] = d_sigma;
        }
        workgroupBarrier();
        var d_color = vec4(0.0);
        // Σ dL/dσ · (1, x, y) and · (x², x y, y²), pixels counted from the tile's corner.
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
                    d_color = fma(vec4(weights[at]), pixel_gradient[row_begin + i], d_color);
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
        // Parts of a splat meet in its rows of `weights`: 10 numbers a part.
        if (part > 0u && slot_2 < count) {
            let at = slot_2 * ROW + (part - 1u) * 10u;
            weights[at] = d_color.x;
            weights[at + 1u] = d_color.y;
            weights[at + 2u] = d_color.z;
            weights[at + 3u] = d_color.w;
            weights[at + 4u] = low.x;
            weights[at + 5u] = low.y;
            weights[at + 6u] = low.z;
            weights[at + 7u] = high.x;
            weights[at + 8u] = high.y;
            weights[at + 9u] = high.z;
        }
        workgroupBarrier();
        if (part == 0u && slot_2 < count) {
            for (var p = 1u; p < PARTS; p++) {
                let at = slot_2 * ROW + (p - 1u) * 10u;
                d_color += vec4(weights[at], weights[at + 1u], weights[at + 2u], weights[at + 3u]);
                low += vec3(weights[at + 4u], weights[at + 5u], weights[at + 6u]);
                high += vec3(weights[at + 7u], weights[at + 8u], weights[at + 9u]);
            }
            let place = batch_place[slot_2];
            let moments = about_mean(place.xy, low, high);
            let at = 3u * pairs[begin + slot_2];
            records[at] = d_color;
            // α = oρ·G: Σ G dL/dα = −Σ dL/dσ / (oρ).
            records[at + 1u] = vec4(-low.x / place.z, moments);
            records[at + 2u] = vec4(place.xy * low.x - low.yz, 0.0, 0.0);
        }
        workgroupBarrier();
    }
    for (var s = begin + thread; s < end; s += AREA) {
        let at = 3u * pairs[s];
        records[at] = vec4(0.0);
        records[at + 1u] = vec4(0.0);
        records[at + 2u] = vec4(0.0);
    }
}
