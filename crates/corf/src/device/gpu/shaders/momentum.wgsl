// cpu/update.rs: steps without a gradient.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> marks: array<Mark>;
@group(0) @binding(3) var<storage, read> position_rates: array<f32>;
@group(0) @binding(4) var<storage, read_write> core: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> core_m: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> core_v: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> sh: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> moments: array<vec4<f32>>;

// A dense step of the Gaussians it does not see, without a gradient: geometry, the opacity and the harmonics of image IMAGE, word by word.
const WORDS = 3u + QUADS;

// Rates of a word of the geometry and opacities.
fn rates_of(i: u32, word: u32) -> vec4<f32> {
    let q = params.rotation_rate;
    let l = params.log_scale_rate;
    if (word == 0u) { return vec4(vec3(params.position_rate * position_rates[i]), q); }
    if (word == 1u) { return vec4(vec3(q), l); }
    return vec4(l, l, params.rates[0].opacity, params.rates[1].opacity);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    if (state[FAILED] != 0u) { return; }
    let at = group_number(id) * 256u + thread;
    let i = at / WORDS;
    let word = at % WORDS;
    if (i >= params.gaussians || marks[i].seen_by == params.marker) { return; }
    if (word >= 3u) {
        let quad = word - 3u;
        let first = 2u * i * QUADS + quad;
        var m = moments[first];
        var v = moments[first + QUADS];
        let n = vec4(4u * quad) + vec4(0u, 1u, 2u, 3u);
        let is_dc = n % vec4(COEFFICIENTS) == vec4(0u);
        let rates = select(vec4(params.rates[IMAGE].sh_rest), vec4(params.rates[IMAGE].sh_dc), is_dc);
        sh[i * QUADS + quad] -= rates * adam(vec4(0.0), &m, &v);
        moments[first] = m;
        moments[first + QUADS] = v;
        return;
    }
    let geometry = params.train_geometry != 0u;
    if (word < 2u && !geometry) { return; }
    var mask = vec4(true);
    if (word == 2u) { mask = vec4(geometry, geometry, IMAGE == 0u, IMAGE == 1u); }
    let to = 3u * i + word;
    let value = core[to];
    let old_m = core_m[to];
    let old_v = core_v[to];
    var m = old_m;
    var v = old_v;
    let step = adam(vec4(0.0), &m, &v);
    core[to] = select(value, value - rates_of(i, word) * step, mask);
    core_m[to] = select(old_m, m, mask);
    core_v[to] = select(old_v, v, mask);
}
