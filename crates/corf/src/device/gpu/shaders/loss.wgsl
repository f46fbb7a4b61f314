// (1 − γ)·L1 + γ·(1 − SSIM). With the moments μ_x = E x, E x², E xy under the window, S is differentiated with respect to the moments;
// the window being symmetric, its adjoint is the same blur: dS/dx = E[∂S/∂μ_x] + 2x E[∂S/∂E x²] + y E[∂S/∂E xy].
//
// A workgroup takes one channel of a block. Each thread blurs four neighbours at once, along the row and then down the column.
const RADIUS = 5u;
const WIDE = BLOCK_WIDTH + 2u * RADIUS;
const TALL = BLOCK_HEIGHT + 2u * RADIUS;
// A row in workgroup memory: odd, so that rows begin in different banks.
const PITCH = WIDE + 1u;
const QUADS = BLOCK_WIDTH / 4u;
const THREADS = BLOCK_WIDTH * BLOCK_HEIGHT / 4u;
const C1 = 0.0001;
const C2 = 0.0009;
// exp(−i²/(2·1.5²)) / Σ at distance i.
const W0 = 0.2660117248617943;
const W1 = 0.21300553771125366;
const W2 = 0.1093606895097;
const W3 = 0.03600077212843082;
const W4 = 0.007598758135239184;
const W5 = 0.001028380084479111;

// Where a workgroup of a loss kernel is: a block of one image.
struct Block { modality: u32, corner: vec2<i32>, size: vec2<i32> }

fn block_of(index: u32) -> Block {
    var b: Block;
    b.modality = u32(index >= params.grids[1].first_block && params.grids[1].size.x > 0u);
    let grid = params.grids[b.modality];
    let local = index - grid.first_block;
    b.corner = vec2(i32(local % grid.blocks), i32(local / grid.blocks)) * vec2(i32(BLOCK_WIDTH), i32(BLOCK_HEIGHT));
    b.size = vec2<i32>(grid.size);
    return b;
}
