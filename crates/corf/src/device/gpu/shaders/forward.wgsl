@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> image: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> transmittance: array<f32>;
@group(0) @binding(7) var<storage, read_write> main_contributor: array<u32>;

var<workgroup> batch_owner: array<u32, BATCH>;
var<workgroup> open: atomic<u32>;
var<workgroup> any_open: u32;

// Front to back: C = Σ c α T + T_N·background, and Σ (1/z) α T.
@compute @workgroup_size(AREA)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    if (index >= params.tile_total) { return; }
    let tile = tile_of(index, thread);
    let centre = vec2<f32>(tile.pixel - tile.corner) + 0.5;
    let first = starts[index];
    let end = starts[index + 1u];
    var t = select(0.0, 1.0, tile.inside);
    var sum = vec4(0.0);
    var best = 0.0;
    var best_owner = 0xffffffffu;
    for (var begin = first; begin < end; begin += BATCH) {
        if (thread == 0u) { atomicStore(&open, 0u); }
        workgroupBarrier();
        if (t >= MIN_TRANSMITTANCE) { atomicStore(&open, 1u); }
        for (var slot = thread; slot < BATCH; slot += AREA) {
            if (begin + slot < end) {
                let owner = owners[pairs[begin + slot]];
                load(slot, splats[owner], tile.corner);
                batch_owner[slot] = owner;
            }
        }
        workgroupBarrier();
        if (thread == 0u) { any_open = atomicLoad(&open); }
        if (workgroupUniformLoad(&any_open) == 0u) { break; }
        let count = min(BATCH, end - begin);
        for (var slot = 0u; slot < count; slot++) {
            let alpha = min(free_alpha(slot, centre), MAX_ALPHA);
            if (alpha >= MIN_ALPHA && t >= MIN_TRANSMITTANCE) {
                let weight = alpha * t;
                t -= weight;
                sum = fma(vec4(weight), batch_color[slot], sum);
                if (MAIN_CONTRIBUTOR && weight > best) {
                    best = weight;
                    best_owner = batch_owner[slot];
                }
            }
        }
        workgroupBarrier();
    }
    if (tile.inside) {
        let background = params.grids[tile.modality].background;
        image[tile.at] = vec4(sum.rgb + t * background.rgb, sum.a);
        transmittance[tile.at] = t;
        if (MAIN_CONTRIBUTOR) { main_contributor[tile.at] = best_owner; }
    }
}
