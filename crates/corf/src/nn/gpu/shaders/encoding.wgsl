// Number `column` of the encoding of x: x, then sines and cosines of x at doubling frequencies.
fn encoded(x: vec3<f32>, column: u32) -> f32 {
    if (column < 3u) { return x[column]; }
    let wave = (column - 3u) / 6u;
    let kind = (column - 3u) % 6u;
    return sin_cos(x[kind % 3u] * f32(1u << wave))[kind / 3u];
}
