// Three vectors a Gaussian: mean and w of the quaternion; x, y, z of it and the first ln of a standard deviation; the other two and the logits of
// the opacities in light and RF.
@group(0) @binding(0) var<uniform> params: Chunk;

// Standard deviations are not taken below this, metres.
const LEAST = 1e-6;

fn inverse_norm(q: vec4<f32>) -> f32 { return 1.0 / sqrt(max(dot(q, q), 1e-30)); }
