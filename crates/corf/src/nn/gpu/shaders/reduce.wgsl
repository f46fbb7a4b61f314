// Adds the parts of a weight gradient and of its biases to the gradient, in order.
struct Sum {
    rows: u32,
    columns: u32,
    parts: u32,
    part_stride: u32,
    weights_first: u32,
    weights_stride: u32,
    // 0: the biases have had their turn.
    with_bias: u32,
    bias_first: u32,
}

@group(0) @binding(0) var<uniform> sum: Sum;
@group(0) @binding(1) var<storage, read> parts: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> gradient: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * (id.y * 32768u + id.x) + t;
    let weights = sum.rows * sum.columns;
    let all = weights + sum.with_bias * sum.rows / 4u;
    if (i >= all) { return; }
    var total = vec4(0.0);
    for (var p = 0u; p < sum.parts; p++) { total += parts[p * sum.part_stride + i]; }
    var at = sum.bias_first + (i - weights);
    if (i < weights) { at = sum.weights_first + i / sum.columns * sum.weights_stride + i % sum.columns; }
    gradient[at] += total;
}
