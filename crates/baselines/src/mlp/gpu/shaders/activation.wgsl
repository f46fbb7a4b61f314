const LEAK = 0.01;

// y of z; 0: identity, 1: ReLU, 2: leaky ReLU, 3: sigmoid.
fn activated(z: vec4<f32>) -> vec4<f32> {
    switch shape.activation {
        case 1u: { return max(z, vec4(0.0)); }
        case 2u: { return select(LEAK * z, z, z > vec4(0.0)); }
        case 3u: { return 1.0 / (1.0 + exp(-z)); }
        default: { return z; }
    }
}

// dy/dz, by y.
fn slope(y: vec4<f32>) -> vec4<f32> {
    switch shape.activation {
        case 1u: { return select(vec4(0.0), vec4(1.0), y > vec4(0.0)); }
        case 2u: { return select(vec4(LEAK), vec4(1.0), y > vec4(0.0)); }
        case 3u: { return y * (1.0 - y); }
        default: { return vec4(1.0); }
    }
}
