// Without subgroup operations: a lane group is 32 threads that see each other's digits in workgroup memory.
const WIDTH = 32u;
var<workgroup> shown: array<u32, SORT_THREADS>;

fn rank_in_group(digit: u32, valid: bool, thread: u32, lane: u32, group: u32) -> u32 {
    let own = select(DIGITS, digit, valid);
    shown[thread] = own;
    workgroupBarrier();
    var peers = 0u;
    for (var i = 0u; i < WIDTH; i++) {
        if (shown[group * WIDTH + i] == own) { peers |= 1u << i; }
    }
    workgroupBarrier();
    let leader = firstTrailingBit(peers);
    if (valid && lane == leader) { shown[thread] = atomicAdd(&counts[group * DIGITS + digit], countOneBits(peers)); }
    workgroupBarrier();
    let before = shown[group * WIDTH + leader];
    workgroupBarrier();
    return before + countOneBits(peers & ((1u << lane) - 1u));
}

@compute @workgroup_size(SORT_THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    scatter(group_number(id), thread, thread % WIDTH, thread / WIDTH, WIDTH);
}
