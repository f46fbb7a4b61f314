// Adds the parts of a weight gradient and of its biases to the gradient, in order.
@group(0) @binding(0) var<uniform> sum: Sum;
@group(0) @binding(1) var<storage, read> parts: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> gradient: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * (id.y * 32768u + id.x) + t;
    let weights = sum.rows * sum.columns;
    let all = weights + sum.with_bias * sum.rows / 4u;
    if (i >= all) { return; }
    // Four sums at once: none waits for the memory that another waits for.
    var totals = mat4x4<f32>();
    var p = 0u;
    for (; p + 4u <= sum.parts; p += 4u) {
        let first = p * sum.part_stride + i;
        totals[0] += parts[first];
        totals[1] += parts[first + sum.part_stride];
        totals[2] += parts[first + 2u * sum.part_stride];
        totals[3] += parts[first + 3u * sum.part_stride];
    }
    for (; p < sum.parts; p++) { totals[0] += parts[p * sum.part_stride + i]; }
    let total = (totals[0] + totals[1]) + (totals[2] + totals[3]);
    var at = sum.bias_first + (i - weights);
    if (i < weights) { at = sum.weights_first + i / sum.columns * sum.weights_stride + i % sum.columns; }
    gradient[at] += total;
}
