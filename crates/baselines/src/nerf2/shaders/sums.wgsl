// The complex sum along each ray of a chunk, and the gradient of its squared error in the network's outputs: one thread a ray.
@group(0) @binding(3) var<storage, read> attenuation: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> signal: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> attenuation_gradient: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> signal_gradient: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> amplitudes: array<f32>;

const LEAK = 0.01;
const FREE_SPACE_M = 0.025;

// |leaky ReLU| and its derivative.
fn magnitude(z: f32) -> vec2<f32> {
    return select(vec2(-LEAK * z, -LEAK), vec2(z, 1.0), z > 0.0);
}

// 2π·sigmoid and its derivative.
fn angle(z: f32) -> vec2<f32> {
    let y = 1.0 / (1.0 + exp(-z));
    return TAU * vec2(y, y * (1.0 - y));
}

// Length of a sample's segment, and the free-space factor at its end.
fn segment(first: u32, k: u32) -> vec2<f32> {
    if (k + 1u == chunk.samples) { return vec2(0.0, chunk.last_loss); }
    let next = distances[first + k + 1u];
    return vec2(next - distances[first + k], FREE_SPACE_M / next);
}

@compute @workgroup_size(32)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let ray = 32u * (id.y * 32768u + id.x) + t;
    if (ray >= chunk.rays) { return; }
    let first = (chunk.first_ray + ray) * chunk.samples;
    let row = ray * chunk.samples;
    var depth = 0.0;
    var turned = 0.0;
    var sum = vec2(0.0);
    for (var k = 0u; k < chunk.samples; k++) {
        let a = attenuation[row + k];
        let s = signal[row + k];
        let piece = segment(first, k);
        let turn = sin_cos(angle(s.y).x + turned);
        let unit = exp(-depth) * piece.y * turn.yx;
        sum += magnitude(s.x).x * unit;
        // Kept for the way back.
        signal_gradient[row + k] = vec4(unit, 0.0, 0.0);
        depth += magnitude(a.x).x * piece.x;
        turned += angle(a.y).x * piece.x;
    }
    let amplitude = length(sum);
    amplitudes[chunk.first_ray + ray] = amplitude;
    var u = vec2(0.0);
    if (amplitude > 0.0) { u = sum / amplitude; }
    let g = rays[3u * (chunk.first_ray + ray) + 1u].w * (amplitude - rays[3u * (chunk.first_ray + ray)].w);
    // Σ over samples behind k of what each adds along the sum, and across it.
    var along_behind = 0.0;
    var across_behind = 0.0;
    for (var n = 0u; n < chunk.samples; n++) {
        let k = chunk.samples - 1u - n;
        let a = attenuation[row + k];
        let s = signal[row + k];
        let unit = signal_gradient[row + k].xy;
        let amount = magnitude(s.x);
        let along = dot(u, unit);
        let across = amount.x * (u.x * unit.y - u.y * unit.x);
        let piece = segment(first, k).x;
        signal_gradient[row + k] = vec4(g * along * amount.y, -g * across * angle(s.y).y, 0.0, 0.0);
        attenuation_gradient[row + k] =
            vec4(-g * along_behind * piece * magnitude(a.x).y, -g * across_behind * piece * angle(a.y).y, 0.0, 0.0);
        along_behind += amount.x * along;
        across_behind += across;
    }
}
