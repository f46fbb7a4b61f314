// Sites of tiles' points. A thread is a point.

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = group_number(id) * 64u + thread;
    if (i >= params.count * params.points) { return; }
    let job = jobs[i / params.points];
    let k = i % params.points;
    if (k < point_count(job)) { sites[i] = site_of(job, vec2(k % job.points.x, k / job.points.x)); }
}
