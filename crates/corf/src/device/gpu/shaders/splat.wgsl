// One Gaussian in one image, three words of four.
struct Splat {
    // u, v, o·ρ, 1/z.
    place: vec4<f32>,
    // Q_xx, Q_xy, Q_yy, τ.
    conic: vec4<f32>,
    // Colour, clamped at 0; z.
    color: vec4<f32>,
}
// No Gaussian hides more than this.
const MAX_ALPHA = 0.999;
const LOG2E = 1.4426950408889634;
