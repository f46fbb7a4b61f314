// What an array sees at each pixel: 64 pixels of a receiver a workgroup.
@group(0) @binding(1) var<storage, read> phases: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> tables: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> observed: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let groups = (job.pixels + 63u) / 64u;
    let group = group_number(id);
    let receiver = group / groups;
    if (receiver >= job.receivers) { return; }
    hold(receiver * ENTRIES, t);
    let i = group % groups * 64u + t;
    if (i >= job.pixels) { return; }
    observed[receiver * job.pixels + i] = SEEN;
}
