var<workgroup> sums: array<vec2<f32>, 64>;

// The sum over a workgroup of 64, in a fixed order.
fn reduced(t: u32, value: vec2<f32>) -> vec2<f32> {
    sums[t] = value;
    for (var step = 32u; step > 0u; step >>= 1u) {
        workgroupBarrier();
        if (t < step) { sums[t] += sums[t + step]; }
    }
    workgroupBarrier();
    return sums[0];
}
