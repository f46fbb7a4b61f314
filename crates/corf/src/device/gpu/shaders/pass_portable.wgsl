// A lane takes from the one before it through workgroup memory.
var<workgroup> shown: array<vec2<f32>, BACKWARD_THREADS>;

fn from_before(value: vec2<f32>, thread: u32) -> vec2<f32> {
    shown[thread] = value;
    workgroupBarrier();
    let before = shown[max(thread, 1u) - 1u];
    workgroupBarrier();
    return before;
}

@compute @workgroup_size(BACKWARD_THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    backward(group_number(id), thread);
}
