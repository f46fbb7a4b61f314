// image_networks/lpips/trunk.rs, `distance`: 16 threads share a pixel, a workgroup has 16 pixels at a time and 256 in all, and leaves their sum.

const LANES = 16u;
const AT_ONCE = 16u;
const PIXELS = 256u;
const EPSILON = 1e-10;

@group(0) @binding(0) var<uniform> job: Comparison;
@group(0) @binding(1) var<storage> left: array<vec4<f32>>;
@group(0) @binding(2) var<storage> right: array<vec4<f32>>;
@group(0) @binding(3) var<storage> weights: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

var<workgroup> shares: array<vec2<f32>, 256>;

// The sum over the threads of a pixel.
fn of_pixel(thread: u32, share: vec2<f32>) -> vec2<f32> {
    workgroupBarrier();
    shares[thread] = share;
    workgroupBarrier();
    var sum = vec2<f32>(0.0);
    let first = thread / LANES * LANES;
    for (var lane = 0u; lane < LANES; lane++) { sum += shares[first + lane]; }
    return sum;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    let quads = job.channels / 4u;
    var found = 0.0;
    for (var round = 0u; round < PIXELS; round += AT_ONCE) {
        let pixel = group * PIXELS + round + thread / LANES;
        let counts = pixel < job.pixels;
        var squares = vec2<f32>(0.0);
        if (counts) {
            for (var q = thread % LANES; q < quads; q += LANES) {
                let a = left[pixel * quads + q];
                let b = right[pixel * quads + q];
                squares += vec2<f32>(dot(a, a), dot(b, b));
            }
        }
        let lengths = sqrt(of_pixel(thread, squares)) + vec2<f32>(EPSILON);
        if (counts) {
            for (var q = thread % LANES; q < quads; q += LANES) {
                let difference = left[pixel * quads + q] / lengths.x - right[pixel * quads + q] / lengths.y;
                found += dot(weights[q], difference * difference);
            }
        }
    }
    workgroupBarrier();
    shares[thread] = vec2<f32>(found, 0.0);
    workgroupBarrier();
    if (thread == 0u && group * PIXELS < job.pixels) {
        var sum = 0.0;
        for (var i = 0u; i < 256u; i++) { sum += shares[i].x; }
        sums[group] = sum;
    }
}
