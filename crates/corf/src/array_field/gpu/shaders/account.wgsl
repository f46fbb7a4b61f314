// Waves that are let in, and what they account for, in sums of 64.
@group(0) @binding(1) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> pulls: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> accounts: array<vec2<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let group = group_number(id);
    let i = 64u * group + t;
    var account = vec2(0.0);
    if (i < job.emitters && waves[min(i, job.emitters - 1u)].w != ABSENT) { account = vec2(1.0, pulls[i].y); }
    let sum = reduced(t, account);
    if (t == 0u && 64u * group < job.emitters) { accounts[group] = sum; }
}
