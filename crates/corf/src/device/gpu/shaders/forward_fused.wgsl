@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> image: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> transmittance: array<f32>;
@group(0) @binding(7) var<storage, read_write> main_contributor: array<u32>;

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
    var t = select(vec2(0.0), vec2(1.0), tile.inside);
    var light = vec4(0.0);
    var radio = vec4(0.0);
    for (var begin = first; begin < end; begin += BATCH) {
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
            let alpha = min(vec2(batch_place[slot].z, rf.w) * falloff(slot, centre), vec2(MAX_ALPHA));
            let drawn = (alpha >= vec2(MIN_ALPHA)) & (t >= vec2(MIN_TRANSMITTANCE));
            let weight = select(vec2(0.0), alpha * t, drawn);
            t -= weight;
            light = fma(vec4(weight.x), batch_color[slot], light);
            radio = fma(vec4(weight.y), vec4(rf.rgb, batch_color[slot].w), radio);
        }
        workgroupBarrier();
    }
    if (tile.inside) {
        let second = tile.at + params.grids[1].first_pixel;
        image[tile.at] = vec4(light.rgb + t.x * params.grids[0].background.rgb, light.a);
        image[second] = vec4(radio.rgb + t.y * params.grids[1].background.rgb, radio.a);
        transmittance[tile.at] = t.x;
        transmittance[second] = t.y;
    }
}
