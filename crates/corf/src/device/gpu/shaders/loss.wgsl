// (1 − γ)·L1 + γ·(1 − SSIM). With the moments μ_x = E x, E x², E xy under the window, S is differentiated with respect to the moments;
// the window being symmetric, its adjoint is the same blur: dS/dx = E[∂S/∂μ_x] + 2x E[∂S/∂E x²] + y E[∂S/∂E xy].
const BLOCK = 16u;
const RADIUS = 5u;
const WIDE = BLOCK + 2u * RADIUS;
const C1 = 0.0001;
const C2 = 0.0009;

// exp(−i²/(2·1.5²)) / Σ at distance i.
fn window(i: u32) -> f32 {
    var w = array<f32, 6>(0.2660117248617943, 0.21300553771125366, 0.1093606895097, 0.03600077212843082, 0.007598758135239184, 0.001028380084479111);
    return w[i];
}

// Where a workgroup of a loss kernel is: a block of 16×16 pixels of one image.
struct Block { modality: u32, corner: vec2<i32>, size: vec2<i32> }

fn block_of(index: u32) -> Block {
    var b: Block;
    b.modality = u32(index >= params.grids[1].first_block && params.grids[1].size.x > 0u);
    let grid = params.grids[b.modality];
    let local = index - grid.first_block;
    b.corner = vec2(i32(local % grid.blocks), i32(local / grid.blocks)) * i32(BLOCK);
    b.size = vec2<i32>(grid.size);
    return b;
}
