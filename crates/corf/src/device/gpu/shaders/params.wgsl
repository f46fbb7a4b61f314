// One frame: where it is taken from, what is rendered, how it is trained. Laid out as `params.rs` writes it.
struct Grid {
    focal: vec2<f32>,
    centre: vec2<f32>,
    // Bounds of x/z and y/z inside J.
    x_limits: vec2<f32>,
    y_limits: vec2<f32>,
    // Half extent in pixels per (standard deviation / z), for culling.
    reach: vec2<f32>,
    // Pixels; 0 where the modality is not rendered.
    size: vec2<u32>,
    // Tiles across and down.
    tiles: vec2<u32>,
    first_tile: u32,
    first_pixel: u32,
    background: vec4<f32>,
    // First word of the target, channels, first loss block and loss blocks across.
    target_at: u32,
    channels: u32,
    first_block: u32,
    blocks: u32,
    // Weight of the loss over its number of values.
    scale: f32,
    // dL/d(inverse depth) per unit of confidence; 0 without a depth target.
    depth_scale: f32,
    // First word of the inverse depths and their confidences.
    depth_at: u32,
    // Numbers of a word of the target, as a power of two: 4 bytes, 2 sums of bytes, 1 float; value of a byte's or a sum's unit.
    target_shift: u32,
    target_unit: f32,
    // First word of the mask, one bit a pixel, 1 where it counts; all ones without a mask.
    mask_at: u32,
}

struct Rates {
    sh_dc: f32,
    sh_rest: f32,
    opacity: f32,
    // Of a dense step: coefficients of a channel that have a gradient.
    learnt: u32,
}

struct Params {
    // Rows of R, with t.
    camera_from_world: array<vec4<f32>, 3>,
    // The camera's centre in the world; w: the near plane.
    eye: vec4<f32>,
    grids: array<Grid, 2>,
    rates: array<Rates, 2>,
    position_rate: f32,
    position_decay: f32,
    log_scale_rate: f32,
    rotation_rate: f32,
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    ssim_weight: f32,
    train_geometry: u32,
    gaussians: u32,
    pair_capacity: u32,
    tile_total: u32,
    pixel_total: u32,
    blocks_total: u32,
    // 1: both images have one camera and share one list of pairs.
    fused: u32,
    visible_capacity: u32,
    shape: u32,
    // Of a dense step: what it marks the Gaussians it sees with, and whether it sums their gradients on the screen.
    marker: u32,
    screen_gradients: u32,
}

fn is_finite(x: f32) -> bool { return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u; }
