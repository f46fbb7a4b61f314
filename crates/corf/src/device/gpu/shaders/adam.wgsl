// m and v after this gradient, and the step in units of the rate.
fn adam(g: vec4<f32>, m: ptr<function, vec4<f32>>, v: ptr<function, vec4<f32>>) -> vec4<f32> {
    *m = params.beta1 * *m + (1.0 - params.beta1) * g;
    *v = params.beta2 * *v + (1.0 - params.beta2) * g * g;
    return *m / (sqrt(*v) + params.epsilon);
}
