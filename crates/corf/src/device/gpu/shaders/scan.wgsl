// Inclusive sums over the SCAN threads of a workgroup (Hillis, Steele).
var<workgroup> scan_memory: array<u32, SCAN>;

fn inclusive_scan(thread: u32, value: u32) -> u32 {
    var sum = value;
    scan_memory[thread] = sum;
    workgroupBarrier();
    for (var step = 1u; step < SCAN; step <<= 1u) {
        if (thread >= step) { sum += scan_memory[thread - step]; }
        workgroupBarrier();
        scan_memory[thread] = sum;
        workgroupBarrier();
    }
    return sum;
}
