// image_networks/layer.rs, `convolve`, and the rectifier behind it: a matrix product of what the window sees at each place (one row a place) with the
// weights. A workgroup has 128 places and 128 channels, a thread eight of each; eight inputs are shared at a time.

const PLACES = 128u;
const CHANNELS = 128u;
const DEPTH = 8u;
// Vectors of four places a row, and one that keeps threads of one row in different banks.
const ROW = 33u;

@group(0) @binding(0) var<uniform> job: Convolution;
@group(0) @binding(1) var<storage> map: array<f32>;
@group(0) @binding(2) var<storage> weights: array<vec4<f32>>;
@group(0) @binding(3) var<storage> bias: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> out: array<vec4<f32>>;

var<workgroup> seen: array<vec4<f32>, DEPTH * ROW>;
var<workgroup> factors: array<vec4<f32>, DEPTH * ROW>;

// Input k = (row, column, channel) of the window whose corner, without the border, is `corner`.
fn input(corner: vec2<i32>, k: u32) -> f32 {
    if (k >= job.inputs) { return 0.0; }
    let tap = k / job.channels;
    let at = corner + vec2<i32>(vec2<u32>(tap % job.side, tap / job.side));
    if (any(at < vec2<i32>(0)) || any(at >= vec2<i32>(job.size))) { return 0.0; }
    return map[(u32(at.y) * job.size.x + u32(at.x)) * job.channels + k % job.channels];
}

fn corner(place: u32) -> vec2<i32> {
    let at = vec2<u32>(place % job.places.x, place / job.places.x);
    return vec2<i32>(job.stride * at) - vec2<i32>(i32(job.border));
}

fn keep(place: u32, channel: u32, value: vec4<f32>) {
    if (place < job.places.x * job.places.y && channel < job.outputs) {
        out[(place * job.out_channels + job.out_first + channel) / 4u] = max(value + bias[channel / 4u], vec4<f32>(0.0));
    }
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let tiles = (job.outputs + CHANNELS - 1u) / CHANNELS;
    let group = group_number(id);
    let first_place = group / tiles * PLACES;
    let first_channel = group % tiles * CHANNELS;
    // What a thread brings: four places of one input, four channels of one input.
    let place_k = thread % DEPTH;
    let place_quad = thread / DEPTH;
    let channel_k = thread / 32u;
    let channel_quad = thread % 32u;
    let place = first_place + 4u * place_quad;
    let corner_0 = corner(place);
    let corner_1 = corner(place + 1u);
    let corner_2 = corner(place + 2u);
    let corner_3 = corner(place + 3u);
    let channel = first_channel + 4u * channel_quad;
    let y = thread / 16u;
    let x = thread % 16u;
    var s00 = vec4<f32>(0.0); var s01 = vec4<f32>(0.0);
    var s10 = vec4<f32>(0.0); var s11 = vec4<f32>(0.0);
    var s20 = vec4<f32>(0.0); var s21 = vec4<f32>(0.0);
    var s30 = vec4<f32>(0.0); var s31 = vec4<f32>(0.0);
    var s40 = vec4<f32>(0.0); var s41 = vec4<f32>(0.0);
    var s50 = vec4<f32>(0.0); var s51 = vec4<f32>(0.0);
    var s60 = vec4<f32>(0.0); var s61 = vec4<f32>(0.0);
    var s70 = vec4<f32>(0.0); var s71 = vec4<f32>(0.0);
    for (var first = 0u; first < job.inputs; first += DEPTH) {
        let k = first + place_k;
        let brought = vec4<f32>(input(corner_0, k), input(corner_1, k), input(corner_2, k), input(corner_3, k));
        var factor = vec4<f32>(0.0);
        if (first + channel_k < job.inputs && channel < job.outputs) {
            factor = weights[((first + channel_k) * job.outputs + channel) / 4u];
        }
        workgroupBarrier();
        seen[place_k * ROW + place_quad] = brought;
        factors[channel_k * ROW + channel_quad] = factor;
        workgroupBarrier();
        for (var i = 0u; i < DEPTH; i++) {
            let a = seen[i * ROW + y];
            let b = seen[i * ROW + 16u + y];
            let c = factors[i * ROW + x];
            let d = factors[i * ROW + 16u + x];
            s00 = fma(vec4<f32>(a.x), c, s00); s01 = fma(vec4<f32>(a.x), d, s01);
            s10 = fma(vec4<f32>(a.y), c, s10); s11 = fma(vec4<f32>(a.y), d, s11);
            s20 = fma(vec4<f32>(a.z), c, s20); s21 = fma(vec4<f32>(a.z), d, s21);
            s30 = fma(vec4<f32>(a.w), c, s30); s31 = fma(vec4<f32>(a.w), d, s31);
            s40 = fma(vec4<f32>(b.x), c, s40); s41 = fma(vec4<f32>(b.x), d, s41);
            s50 = fma(vec4<f32>(b.y), c, s50); s51 = fma(vec4<f32>(b.y), d, s51);
            s60 = fma(vec4<f32>(b.z), c, s60); s61 = fma(vec4<f32>(b.z), d, s61);
            s70 = fma(vec4<f32>(b.w), c, s70); s71 = fma(vec4<f32>(b.w), d, s71);
        }
    }
    let near = first_channel + 4u * x;
    let far = near + 64u;
    let upper = first_place + 4u * y;
    let lower = upper + 64u;
    keep(upper, near, s00); keep(upper, far, s01);
    keep(upper + 1u, near, s10); keep(upper + 1u, far, s11);
    keep(upper + 2u, near, s20); keep(upper + 2u, far, s21);
    keep(upper + 3u, near, s30); keep(upper + 3u, far, s31);
    keep(lower, near, s40); keep(lower, far, s41);
    keep(lower + 1u, near, s50); keep(lower + 1u, far, s51);
    keep(lower + 2u, near, s60); keep(lower + 2u, far, s61);
    keep(lower + 3u, near, s70); keep(lower + 3u, far, s71);
}
