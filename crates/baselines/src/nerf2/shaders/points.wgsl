// Inputs of the network for the points of a chunk of rays: one thread a vector.
@group(0) @binding(3) var<storage, read_write> position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> outside: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * (id.y * 32768u + id.x) + t;
    let stride = chunk.position_stride + chunk.outside_stride;
    let point = i / stride;
    let at = i % stride;
    if (point >= chunk.rays * chunk.samples) { return; }
    let width = 3u + 6u * chunk.frequencies;
    let ray = 3u * (chunk.first_ray + point / chunk.samples);
    let direction = rays[ray + 1u].xyz;
    var out = vec4(0.0);
    if (at < chunk.position_stride) {
        let r = distances[chunk.first_ray * chunk.samples + point];
        let x = rays[ray].xyz + direction * r;
        for (var n = 0u; n < 4u; n++) {
            let column = 4u * at + n;
            if (column < width) { out[n] = encoded(x, column); }
        }
        position[point * chunk.position_stride + at] = out;
    } else {
        let first = 4u * (at - chunk.position_stride);
        for (var n = 0u; n < 4u; n++) {
            let column = first + n;
            if (column < width) {
                out[n] = encoded(direction, column);
            } else if (column < 2u * width) {
                out[n] = encoded(rays[ray + 2u].xyz, column - width);
            }
        }
        outside[point * chunk.outside_stride + at - chunk.position_stride] = out;
    }
}
