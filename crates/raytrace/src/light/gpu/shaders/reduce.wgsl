// The sum of what 64 threads received, in a fixed order, and of one number beside it.

var<workgroup> reduced: array<mat3x4<f32>, 64>;

fn reduce(thread: u32, own: Received, beside: f32) -> mat3x4<f32> {
    // What was reduced before is read by now.
    workgroupBarrier();
    reduced[thread] = mat3x4(vec4(own.x, beside), vec4(own.y, 0.0), vec4(own.z, 0.0));
    workgroupBarrier();
    for (var step = 32u; step > 0u; step /= 2u) {
        if (thread < step) { reduced[thread] = reduced[thread] + reduced[thread + step]; }
        workgroupBarrier();
    }
    return reduced[0];
}

fn put_point(job: Job, k: u32, sum: mat3x4<f32>, weight: f32) {
    let at = job.head + 1u + 3u * k;
    put(at, bitcast<vec4<u32>>(vec4(sum[0].xyz, weight)));
    put(at + 1u, bitcast<vec4<u32>>(vec4(sum[1].xyz, 0.0)));
    put(at + 2u, bitcast<vec4<u32>>(vec4(sum[2].xyz, 0.0)));
}
