// cpu/update.rs: Adam's step of spherical harmonics.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> gaussian_of: array<u32>;
@group(0) @binding(3) var<storage, read> drawn: array<Drawn>;
@group(0) @binding(4) var<storage, read> record_heads: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> record_tails: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> splats: array<Splat>;
@group(0) @binding(7) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> sh_0: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> moments_0: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> sh_1: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> moments_1: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> ellipse_sums: array<EllipseSum>;
@group(0) @binding(13) var<storage, read_write> directions: array<vec4<f32>>;
GRADIENTS
// EACH visible Gaussians a workgroup, LANES threads each: they sum its records, then step its harmonics word by word. What is computed once a
// Gaussian is left to as few subgroups as hold that many threads.
const LANES = 8u;
const THREADS = EACH * LANES;
const BASES = (DEGREE + 1u) * (DEGREE + 1u);
const BASE_QUADS = (BASES + 3u) / 4u;
// From one lane's shares to the next's, so that lanes write to different banks of memory.
const APART = EACH + 1u;

// A lane's sums over the records of each image, then its share of the gradient of the direction.
var<workgroup> partial: array<vec4<f32>, 2u * THREADS>;
// Four Y_k(d) each; likewise ∂Y_k/∂x, ∂Y_k/∂y, ∂Y_k/∂z.
var<workgroup> basis: array<vec4<f32>, EACH * BASE_QUADS>;
var<workgroup> slopes: array<vec4<f32>, 3u * EACH * BASE_QUADS>;
// dL/dcolour of each image; w: 1 where it is seen.
var<workgroup> d_colors: array<vec4<f32>, 2u * EACH>;

// A Gaussian with more records than this in an image is summed by the whole workgroup.
const LONG = 64u;
const STRIPES = THREADS / 4u;
var<workgroup> long_count: atomic<u32>;
var<workgroup> long_total: u32;
var<workgroup> long_ones: array<u32, 2u * EACH>;
var<workgroup> stripes: array<vec4<f32>, THREADS>;
var<workgroup> firsts: array<vec2<u32>, EACH>;
var<workgroup> counts: array<vec2<u32>, EACH>;

fn word_of_record(pair: u32, word: u32) -> vec4<f32> {
    if (word < 2u) { return record_heads[2u * pair + word]; }
    return record_tails[(1u + params.fused) * pair + word - 2u];
}

// Word `word` of every `stride`-th record.
fn sum_of(first: u32, count: u32, stride: u32, word: u32) -> vec4<f32> {
    var sum = vec4(0.0);
    if (word < 3u + params.fused) {
        var pair = first;
        let end = first + count;
        // Four are on their way at once; they are added in their order.
        for (; pair + 3u * stride < end; pair += 4u * stride) {
            let a = word_of_record(pair, word);
            let b = word_of_record(pair + stride, word);
            let c = word_of_record(pair + 2u * stride, word);
            let d = word_of_record(pair + 3u * stride, word);
            sum = sum + a + b + c + d;
        }
        for (; pair < end; pair += stride) { sum += word_of_record(pair, word); }
    }
    return sum;
}

// Word `word` of a Gaussian's sum over the records of an image.
fn total(k: u32, image: u32, word: u32) -> vec4<f32> {
    let at = 2u * (k * LANES + word) + image;
    var sum = partial[at];
    for (var lane = 4u; lane < LANES; lane += 4u) { sum += partial[at + 2u * lane]; }
    return sum;
}

// A Gaussian's sums over the records of one image, which are of both images where these share their pairs.
fn record_sum(k: u32, place: u32, image: u32) -> RecordSum {
    if (params.fused == 0u) {
        let color = total(k, image, 0u);
        let ellipse = total(k, image, 1u);
        let seen = f32(counts[k][image] > 0u);
        return RecordSum(color.rgb, color.w, ellipse.yzw, ellipse.x, total(k, image, 2u).xy, seen);
    }
    // The pairs are those of the more opaque one; the other is seen if it can be drawn at all.
    let of_light = f32(splats[place].place.z >= MIN_ALPHA);
    let radio = total(k, 0u, 1u);    // dL/dcolour of radio; dL/d(oρ) of light
    let ellipse = total(k, 0u, 2u);  // dL/d(oρ) of radio; moments of both
    let first = total(k, 0u, 3u).xy;
    // What the images say about the ellipse goes through one of them, once.
    if (image == 0u) {
        let light = total(k, 0u, 0u);
        return RecordSum(light.rgb, light.w, ellipse.yzw, radio.w, first, of_light);
    }
    let of_radio = f32(splats[params.visible_capacity + place].place.z >= MIN_ALPHA);
    return RecordSum(radio.rgb, 0.0, ellipse.yzw * (1.0 - of_light), ellipse.x, first * (1.0 - of_light), of_radio);
}

// The gradient of a word of four, and what it says about the direction: dL/dc Y, and dL/dc sh ∂Y/∂d of the old ones.
struct Word { gradient: vec4<f32>, rates: vec4<f32>, direction: vec3<f32> }

// Numbers `n` to n + 3 of the harmonics of Gaussian k in an image, all of one channel.
fn word_of_channel(k: u32, image: u32, n: u32, old: vec4<f32>, coefficients: u32) -> Word {
    let d = d_colors[2u * k + image][n / coefficients];
    let quad = k * BASE_QUADS + n % coefficients / 4u;
    let rest = params.rates[image].sh_rest;
    let first = select(rest, params.rates[image].sh_dc, n % coefficients == 0u);
    let along = vec3(dot(old, slopes[3u * quad]), dot(old, slopes[3u * quad + 1u]), dot(old, slopes[3u * quad + 2u]));
    return Word(d * basis[quad], vec4(first, vec3(rest)), d * along);
}

// One number of them: dL/dc Y, and dL/dc sh ∂Y/∂d of the old one. Nothing beyond the last.
fn of_number(k: u32, image: u32, number: u32, old: f32, coefficients: u32, numbers: u32) -> vec4<f32> {
    if (number >= numbers) { return vec4(0.0); }
    let d = d_colors[2u * k + image][number / coefficients];
    let c = number % coefficients;
    let quad = k * BASE_QUADS + c / 4u;
    let slope = vec3(slopes[3u * quad][c % 4u], slopes[3u * quad + 1u][c % 4u], slopes[3u * quad + 2u][c % 4u]);
    return d * vec4(basis[quad][c % 4u], old * slope);
}

// The same word where channels begin anywhere.
fn word_of_any(k: u32, image: u32, n: u32, old: vec4<f32>, coefficients: u32, numbers: u32) -> Word {
    let a = of_number(k, image, n, old.x, coefficients, numbers);
    let b = of_number(k, image, n + 1u, old.y, coefficients, numbers);
    let c = of_number(k, image, n + 2u, old.z, coefficients, numbers);
    let d = of_number(k, image, n + 3u, old.w, coefficients, numbers);
    let is_dc = (vec4(n) + vec4(0u, 1u, 2u, 3u)) % vec4(coefficients) == vec4(0u);
    let rates = select(vec4(params.rates[image].sh_rest), vec4(params.rates[image].sh_dc), is_dc);
    return Word(vec4(a.x, b.x, c.x, d.x), rates, a.yzw + b.yzw + c.yzw + d.yzw);
}

fn word_of(k: u32, image: u32, n: u32, old: vec4<f32>, coefficients: u32, numbers: u32) -> Word {
    if (coefficients % 4u == 0u) { return word_of_channel(k, image, n, old, coefficients); }
    return word_of_any(k, image, n, old, coefficients, numbers);
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    if (state[FAILED] != 0u) { return; }
    let begin = group_number(id) * EACH;
    let visible = state[VISIBLE];
    if (begin >= visible) { return; }
    let k = thread / LANES;
    let lane = thread % LANES;
    let v = begin + k;
    let alive = v < visible;
    var i = 0u;
    var own = vec2(0u);
    var first = vec2(0u);
    if (alive) {
        i = gaussian_of[v];
        let taken = drawn[v];
        own = vec2(taken.in_first, taken.in_second);
        first = vec2(taken.begin, taken.begin + own.x);
    }
    if (thread == 0u) { atomicStore(&long_count, 0u); }
    if (lane == 0u) {
        counts[k] = own;
        firsts[k] = first;
    }
    workgroupBarrier();
    let half = lane / 4u;
    var sum_0 = vec4(0.0);
    var sum_1 = vec4(0.0);
    if (own.x <= LONG) {
        sum_0 = sum_of(first.x + half, max(own.x, half) - half, LANES / 4u, lane % 4u);
    } else if (lane == 0u) {
        long_ones[atomicAdd(&long_count, 1u)] = 2u * k;
    }
    if (own.y <= LONG) {
        sum_1 = sum_of(first.y + half, max(own.y, half) - half, LANES / 4u, lane % 4u);
    } else if (lane == 0u) {
        long_ones[atomicAdd(&long_count, 1u)] = 2u * k + 1u;
    }
    partial[2u * thread] = sum_0;
    partial[2u * thread + 1u] = sum_1;
    workgroupBarrier();
    if (thread == 0u) { long_total = atomicLoad(&long_count); }
    let longs = workgroupUniformLoad(&long_total);
    for (var l = 0u; l < longs; l++) {
        let one = long_ones[l] / 2u;
        let image = long_ones[l] % 2u;
        let stripe = thread / 4u;
        let count = counts[one][image];
        stripes[thread] = sum_of(firsts[one][image] + stripe, max(count, stripe) - stripe, STRIPES, thread % 4u);
        workgroupBarrier();
        for (var step = THREADS / 2u; step >= 4u; step >>= 1u) {
            if (thread < step) { stripes[thread] += stripes[thread + step]; }
            workgroupBarrier();
        }
        if (thread < 4u) { partial[2u * (one * LANES + thread) + image] = stripes[thread]; }
        workgroupBarrier();
    }
    let of_sum = thread / 2u;
    let of_basis = thread - min(thread, THREADS / 2u);
    if (thread < 2u * EACH && begin + of_sum < visible) {
        let image = thread % 2u;
        let sum = record_sum(of_sum, begin + of_sum, image);
        ellipse_sums[2u * begin + thread] = ellipse_sum(sum);
        // The clamp at 0 passes no gradient.
        let color = splats[image * params.visible_capacity + begin + of_sum].color.rgb;
        d_colors[thread] = vec4(select(vec3(0.0), sum.color, color > vec3(0.0)), sum.seen);
    }
    if (thread >= THREADS / 2u && of_basis < EACH && begin + of_basis < visible) {
        let d = direction_of(core[3u * gaussian_of[begin + of_basis]].xyz).xyz;
        let y = basis_of(d);
        let slope = slopes_of(d);
        let quad = of_basis * BASE_QUADS;
BASIS
    }
    workgroupBarrier();
    var direction = vec3(0.0);
    if (alive) {
        if (d_colors[2u * k].w > 0.0) { direction += step_0(i, k, lane); }
        if (d_colors[2u * k + 1u].w > 0.0) { direction += step_1(i, k, lane); }
    }
    partial[lane * APART + k] = vec4(direction, 0.0);
    workgroupBarrier();
    if (thread < EACH && begin + thread < visible) {
        var sum = vec4(0.0);
        for (var l = 0u; l < LANES; l++) { sum += partial[l * APART + thread]; }
        directions[begin + thread] = sum;
    }
}
