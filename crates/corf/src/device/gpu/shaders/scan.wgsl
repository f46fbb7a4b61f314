// Inclusive sums over the SCAN threads of a workgroup (Hillis, Steele), of four numbers at once; reads from one half, writes the other.
var<workgroup> scan_memory: array<vec4<u32>, 2u * SCAN>;

fn inclusive_scan(thread: u32, value: vec4<u32>) -> vec4<u32> {
    var sum = value;
    var half = 0u;
    for (var step = 1u; step < SCAN; step <<= 1u) {
        scan_memory[half + thread] = sum;
        workgroupBarrier();
        if (thread >= step) { sum += scan_memory[half + thread - step]; }
        half = SCAN - half;
    }
    return sum;
}
