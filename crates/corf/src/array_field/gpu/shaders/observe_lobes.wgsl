// The lobes at each pixel: a tile of 8 × 8 of a receiver a workgroup, which looks for those that reach it, 64 at once, and then adds them in order.
@group(0) @binding(1) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tiles: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> lobes: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> observed: array<f32>;

var<workgroup> found: array<atomic<u32>, 2>;
var<workgroup> held_waves: array<vec4<f32>, 64>;
var<workgroup> held_lobes: array<vec4<f32>, 64>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let across = (job.width + 7u) / 8u;
    let count = across * ((job.height + 7u) / 8u);
    let group = group_number(id);
    let receiver = group / count;
    if (receiver >= job.receivers) { return; }
    let tile = group % count;
    let x = tile % across * 8u + t % 8u;
    let y = tile / across * 8u + t / 8u;
    let direction = directions[min(y, job.height - 1u) * job.width + min(x, job.width - 1u)].xyz;
    var total = 0.0;
    for (var base = 0u; base < job.emitters; base += 64u) {
        if (t < 2u) { atomicStore(&found[t], 0u); }
        workgroupBarrier();
        let e = base + t;
        if (e < job.emitters) {
            let wave = waves[receiver * job.emitters + e];
            let lobe = lobes[receiver * job.emitters + e];
            held_waves[t] = wave;
            held_lobes[t] = lobe;
            if (touches(wave, lobe, tiles[tile])) { atomicOr(&found[t / 32u], 1u << (t % 32u)); }
        }
        workgroupBarrier();
        for (var word = 0u; word < 2u; word++) {
            var left = atomicLoad(&found[word]);
            while (left != 0u) {
                let k = 32u * word + countTrailingZeros(left);
                left &= left - 1u;
                total += held_waves[k].w * value_of(held_waves[k], held_lobes[k], direction);
            }
        }
        workgroupBarrier();
    }
    if (x < job.width && y < job.height) { observed[receiver * job.pixels + y * job.width + x] = total; }
}
