// Three vectors each: origin and target, direction and scale of the gradient, transmitter.
@group(0) @binding(0) var<uniform> chunk: Chunk;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> distances: array<f32>;

const TAU = 6.283185307179586;
