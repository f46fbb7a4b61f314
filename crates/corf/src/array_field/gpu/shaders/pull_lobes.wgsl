// What pulls at each wave, and what it accounts for: a workgroup a wave, which looks for the tiles that its lobe reaches, 64 at once; a thread adds up
// one pixel of each.
@group(0) @binding(1) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tiles: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> lobes: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> by_pixel: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> pulls: array<vec2<f32>>;

var<workgroup> found: array<atomic<u32>, 2>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let e = group_number(id);
    if (e >= job.emitters) { return; }
    let wave = waves[e];
    let lobe = lobes[e];
    let across = (job.width + 7u) / 8u;
    let count = across * ((job.height + 7u) / 8u);
    var total = vec2(0.0);
    for (var base = 0u; base < count; base += 64u) {
        if (t < 2u) { atomicStore(&found[t], 0u); }
        workgroupBarrier();
        if (base + t < count && touches(wave, lobe, tiles[min(base + t, count - 1u)])) {
            atomicOr(&found[t / 32u], 1u << (t % 32u));
        }
        workgroupBarrier();
        for (var word = 0u; word < 2u; word++) {
            var left = atomicLoad(&found[word]);
            while (left != 0u) {
                let tile = base + 32u * word + countTrailingZeros(left);
                left &= left - 1u;
                let x = tile % across * 8u + t % 8u;
                let y = tile / across * 8u + t / 8u;
                if (x < job.width && y < job.height) {
                    let pixel = y * job.width + x;
                    total += value_of(wave, lobe, directions[pixel].xyz) * by_pixel[pixel];
                }
            }
        }
        workgroupBarrier();
    }
    let sum = reduced(t, max(wave.w, 0.0) * total);
    if (t == 0u) { pulls[e] = sum; }
}
