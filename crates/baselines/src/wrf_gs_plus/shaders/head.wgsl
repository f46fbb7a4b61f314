// Constants of a step for the Gaussians of one chunk. Three vectors a Gaussian: mean and w of the quaternion; x, y, z of it and the first ln of a
// standard deviation; the other two and the logits of the opacities in light and RF.
struct Chunk {
    // Position, metres.
    receiver: vec4<f32>,
    // The first Gaussian, rows of the network's inputs, Gaussians in all.
    first: u32,
    rows: u32,
    gaussians: u32,
    move_positions: u32,
    position_frequencies: u32,
    receiver_frequencies: u32,
    // Vectors of an encoded position, and of an encoded receiver.
    position_stride: u32,
    receiver_stride: u32,
    // Of dense Adam.
    position_rate: f32,
    rotation_rate: f32,
    log_scale_rate: f32,
    opacity_rate: f32,
    signal_rate: f32,
    beta1: f32,
    beta2: f32,
    epsilon: f32,
}

@group(0) @binding(0) var<uniform> params: Chunk;

// Standard deviations are not taken below this, metres.
const LEAST = 1e-6;

fn inverse_norm(q: vec4<f32>) -> f32 { return 1.0 / sqrt(max(dot(q, q), 1e-30)); }
