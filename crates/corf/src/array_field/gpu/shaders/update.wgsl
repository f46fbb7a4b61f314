// The step: residuals are taken off each emitter in proportion to its part in them. One thread an emitter.
@group(0) @binding(1) var<storage, read> receivers: array<ReceiverRow>;
@group(0) @binding(2) var<storage, read> anchors: array<Near>;
@group(0) @binding(3) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> pulls: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> accounts: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> gains: array<f32>;
@group(0) @binding(7) var<storage, read_write> seen_from: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let groups = (job.emitters + 63u) / 64u;
    var own = vec2(0.0);
    for (var k = t; k < groups; k += 64u) { own += accounts[k]; }
    let all = reduced(t, own);
    let e = 64u * group_number(id) + t;
    if (e >= job.emitters) { return; }
    let power = waves[e].w;
    if (power <= 0.0) { return; }
    // Without a background all emitters together account for every pixel.
    let accounted = select(f32(job.pixels), all.y, job.has_background != 0u);
    let pull = pulls[e];
    let taken = -job.rate * pull.x / (pull.y + job.damping * accounted / max(all.x, 1.0));
    let step = min(taken, log(job.most_power) - log(power));
    let receiver = receivers[job.first];
    let share = select(job.share, 0.0, receiver.anchors == 0u);
    gains[e] = clamp(gains[e] + (1.0 - share) * step, -MOST_GAIN, MOST_GAIN);
    for (var k = 0u; k < receiver.anchors; k++) {
        let anchor = anchors[receiver.first + k];
        seen_from[anchor.number * job.emitters + e] += share * anchor.weight / receiver.norm * step;
    }
}
