// A lane group is a subgroup: lanes of one digit find each other by ballots, and the first of them counts for all.
fn rank_in_group(digit: u32, valid: bool, thread: u32, lane: u32, group: u32) -> u32 {
    var peers = subgroupBallot(valid).x;
    for (var b = 0u; b < 8u; b++) {
        let bit = ((digit >> b) & 1u) == 1u;
        let votes = subgroupBallot(bit).x;
        peers &= select(~votes, votes, bit);
    }
    let leader = select(lane, firstTrailingBit(peers), valid);
    var before = 0u;
    if (valid && lane == leader) { before = atomicAdd(&counts[group * DIGITS + digit], countOneBits(peers)); }
    before = subgroupShuffle(before, leader);
    return before + countOneBits(peers & ((1u << lane) - 1u));
}

@compute @workgroup_size(SORT_THREADS)
fn main(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) group: u32,
    @builtin(subgroup_size) width: u32,
) {
    scatter(group_number(id), group * width + lane, lane, group, width);
}
