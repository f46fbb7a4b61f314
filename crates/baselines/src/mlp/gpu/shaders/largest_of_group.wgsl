const THREADS = 256u;
var<workgroup> largest: array<f32, THREADS>;

// The largest of what the threads of a workgroup hold, for each of them.
fn largest_of_group(t: u32, value: f32) -> f32 {
    largest[t] = value;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (t < half) { largest[t] = max(largest[t], largest[t + half]); }
    }
    workgroupBarrier();
    return largest[0];
}
