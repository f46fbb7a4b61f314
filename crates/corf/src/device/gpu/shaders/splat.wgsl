// One Gaussian in one image, three words of four.
struct Splat {
    // u, v, o·ρ, 1/z.
    place: vec4<f32>,
    // Q_xx, Q_xy, Q_yy, τ.
    conic: vec4<f32>,
    // Colour, clamped at 0; z.
    color: vec4<f32>,
}
// Blending weights below this are not drawn.
const MIN_ALPHA = 1.0 / 255.0;
// A pixel ends when less than this remains.
const MIN_TRANSMITTANCE = 1e-4;
// No Gaussian hides more than this.
const MAX_ALPHA = 0.999;
const LOG2E = 1.4426950408889634;
