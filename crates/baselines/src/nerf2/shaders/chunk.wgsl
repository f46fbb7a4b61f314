struct Chunk {
    first_ray: u32,
    rays: u32,
    samples: u32,
    frequencies: u32,
    position_stride: u32,
    outside_stride: u32,
    last_loss: f32,
    padding: u32,
    transmitter: vec4<f32>,
}

// Two vectors each: origin and target, direction and scale of the gradient.
@group(0) @binding(0) var<uniform> chunk: Chunk;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> distances: array<f32>;

const TAU = 6.283185307179586;
