@group(0) @binding(2) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> judged: array<u32>;

// Bit 0: faint, bit 1: oversized.
fn judgement(i: u32) -> u32 {
    // Position (3), quaternion (4), ln scale (3), opacity logits (optical, RF).
    let a = core[3u * i];
    let b = core[3u * i + 1u];
    let c = core[3u * i + 2u];
    let opacity = select(c.z, max(c.z, c.w), question[BOTH] > 0.0);
    let grid = params.grids[0];
    let world = vec4(a.xyz, 1.0);
    let z = dot(params.camera_from_world[2], world);
    let at = grid.focal * vec2(dot(params.camera_from_world[0], world), dot(params.camera_from_world[1], world)) / z + grid.centre;
    let in_frame = z > 0.0 && all(at >= vec2(0.0)) && all(at < vec2<f32>(grid.size));
    let deviation = exp(max(b.w, max(c.x, c.y)));
    let oversized = in_frame && deviation > question[OVERSIZED] * max(z, 1e-3);
    return u32(opacity <= question[FAINT]) | (u32(oversized) << 1u);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let word = group_number(id) * 256u + thread;
    let first = 16u * word;
    if (first >= params.gaussians) { return; }
    let count = min(16u, params.gaussians - first);
    var bits = 0u;
    for (var k = 0u; k < count; k++) { bits |= judgement(first + k) << (2u * k); }
    judged[word] = bits;
}
