// The wave of each emitter at each receiver: one thread each.
@group(0) @binding(1) var<storage, read> emitters: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> gains: array<f32>;
@group(0) @binding(3) var<storage, read> seen_from: array<f32>;
@group(0) @binding(4) var<storage, read> receivers: array<ReceiverRow>;
@group(0) @binding(5) var<storage, read> anchors: array<Near>;
@group(0) @binding(6) var<storage, read_write> waves: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> lobes: array<vec4<f32>>;

fn is_let_in(u: vec3<f32>) -> bool {
    if (job.let_in == 0u) { return true; }
    let within = vec4(u.y, -u.y, u.z, -u.z) > u.x * vec4(job.frame.x, -job.frame.y, job.frame.z, -job.frame.w);
    return u.x > 0.0 && (job.let_in == 1u || all(within));
}

// Half of κ, peak and squared chord at which it ends of a lobe that is widened by a variance.
fn lobe_of(spread2: f32) -> vec4<f32> {
    let variance = min(job.variance + spread2, WIDEST * WIDEST);
    let kappa = 1.0 / variance;
    let end = 2.0 * sin_cos(0.5 * REACH * sqrt(variance)).x;
    return vec4(0.5 * kappa, kappa / (TAU * (1.0 - exp(-2.0 * kappa))), end * end, 0.0);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    if (i >= job.receivers * job.emitters) { return; }
    let e = i % job.emitters;
    let receiver = receivers[job.first + i / job.emitters];
    let v = emitters[e].xyz - receiver.place;
    let d2 = dot(v, v);
    var u = vec3(0.0);
    var power = ABSENT;
    if (d2 >= NEAREST_M * NEAREST_M) {
        u = vec3(dot(receiver.forward, v), dot(receiver.left, v), dot(receiver.up, v)) / sqrt(d2);
        if (is_let_in(u)) {
            var g = gains[e];
            for (var k = 0u; k < receiver.anchors; k++) {
                let anchor = anchors[receiver.first + k];
                g += anchor.weight * seen_from[anchor.number * job.emitters + e];
            }
            power = min(exp(min(g, MOST_EXPONENT)) / d2, job.most_power);
        }
    }
    waves[i] = vec4(u, power);
    if (LOBES) { lobes[i] = lobe_of(emitters[e].w / max(d2, NEAREST_M * NEAREST_M)); }
}
