// develop.rs: exposed radiance to an sRGB value.

const KNEE = 0.6;

fn shoulder(x: f32) -> f32 {
    return select(KNEE + (1.0 - KNEE) * (1.0 - exp(-(max(x, KNEE) - KNEE) / (1.0 - KNEE))), x, x <= KNEE);
}

fn srgb_from_linear(linear: f32) -> f32 {
    let l = clamp(linear, 0.0, 1.0);
    return select(1.055 * pow(max(l, 1e-6), 1.0 / 2.4) - 0.055, 12.92 * l, l <= 0.0031308);
}

fn develop_value(exposed: f32) -> f32 {
    return srgb_from_linear(shoulder(max(exposed, 0.0)));
}
