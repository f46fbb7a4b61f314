@group(0) @binding(0) var<storage, read> totals: array<u32>;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> args: array<vec4<u32>>;

// How many Gaussians are visible (the keys that the first pass of the depth sort counted), and the workgroups that follow from it.
@compute @workgroup_size(SCAN)
fn main(@builtin(local_invocation_index) thread: u32) {
    let sum = inclusive_scan(thread, totals[thread]);
    if (thread == SCAN - 1u) {
        state[VISIBLE] = sum;
        args[ARGS_DEPTH_SORT] = folded((sum + SORT_BLOCK - 1u) / SORT_BLOCK);
        args[ARGS_VISIBLE_256] = folded((sum + 255u) / 256u);
        args[ARGS_VISIBLE_64] = folded((sum + 63u) / 64u);
    }
}
