// image_networks/layer.rs, `MaxPool::of`: a thread has four channels of a place.

@group(0) @binding(0) var<uniform> job: Pooling;
@group(0) @binding(1) var<storage> map: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> out: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let item = group_number(id) * 64u + thread;
    let quads = job.channels / 4u;
    let place = item / quads;
    if (place >= job.places.x * job.places.y) { return; }
    let first = job.stride * vec2<u32>(place % job.places.x, place / job.places.x);
    let end = min(first + vec2<u32>(job.side), job.size);
    var most = map[(first.y * job.size.x + first.x) * quads + item % quads];
    for (var v = first.y; v < end.y; v++) {
        for (var u = first.x; u < end.x; u++) {
            most = max(most, map[(v * job.size.x + u) * quads + item % quads]);
        }
    }
    out[item] = most;
}
