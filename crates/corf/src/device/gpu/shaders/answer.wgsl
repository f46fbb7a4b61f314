@group(0) @binding(2) var<storage, read> places: array<u32>;
@group(0) @binding(3) var<storage, read> norm: array<f32>;
@group(0) @binding(4) var<storage, read> image: array<f32>;
@group(0) @binding(5) var<storage, read> transmittance: array<f32>;
@group(0) @binding(6) var<storage, read> main_contributor: array<u32>;
@group(0) @binding(7) var<storage, read_write> answers: array<vec4<u32>>;

// Mean over the part of the disc of radius 3 that lies inside the image, at most 1.
fn structure(at: u32) -> f32 {
    let size = vec2<i32>(params.grids[0].size);
    let centre = vec2(i32(at) % size.x, i32(at) / size.x);
    var sum = 0.0;
    var count = 0.0;
    for (var dy = -3; dy <= 3; dy++) {
        for (var dx = -3; dx <= 3; dx++) {
            let p = centre + vec2(dx, dy);
            if (dx * dx + dy * dy <= 9 && all(p >= vec2(0)) && all(p < size)) {
                sum += norm[u32(p.y * size.x + p.x)];
                count += 1.0;
            }
        }
    }
    return min(sum / count, 1.0);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let asked = group_number(id) * 256u + thread;
    if (asked >= u32(question[ASKED])) { return; }
    let at = places[asked];
    var found = 0.0;
    if (question[WEIGHTS] > 0.0) { found = structure(at); }
    let inverse_depth = image[3u * params.pixel_total + at];
    answers[asked] =
        vec4(bitcast<u32>(found), bitcast<u32>(inverse_depth), bitcast<u32>(transmittance[at]), main_contributor[at]);
}
