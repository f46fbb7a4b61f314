// Buckets lie within subgroups: a lane takes from the one before it by a shuffle.
fn from_before(value: vec2<f32>, thread: u32) -> vec2<f32> { return subgroupShuffleUp(value, 1u); }

@compute @workgroup_size(BACKWARD_THREADS)
fn main(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) group: u32,
    @builtin(subgroup_size) width: u32,
) {
    backward(group_number(id), group * width + lane);
}
