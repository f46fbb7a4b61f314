// (1 − γ)·L1 + γ·(1 − SSIM). With the moments μ_x = E x, E x², E xy under the window, S is differentiated with respect to the moments;
// the window being symmetric, its adjoint is the same blur: dS/dx = E[∂S/∂μ_x] + 2x E[∂S/∂E x²] + y E[∂S/∂E xy].
//
// A workgroup takes one channel of a block. A thread first blurs a column of it, all rows at once, straight from the image into workgroup
// memory; then eight neighbours of a row.
const RADIUS = 5u;
// A row in workgroup memory: odd, so that a warp's rows and eighths lie in different banks.
const PITCH = THREADS + 1u;
const EIGHTHS = BLOCK_WIDTH / 8u;
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

// Row `row` of the columns that a thread blurs; `at` is a pixel of the image wherever the row is.
struct Row { inside: bool, at: u32 }

fn row_of(b: Block, thread: u32, row: i32) -> Row {
    let p = b.corner + vec2(i32(thread), row) - i32(RADIUS);
    let held = clamp(p, vec2(0), b.size - 1);
    return Row(all(p == held), u32(held.y * b.size.x + held.x));
}

// Number `element` of an image's target, channel after channel.
fn target_value(grid: GridParams, element: u32) -> f32 {
    let word = goal[grid.target_at + (element >> grid.target_shift)];
    let mask = 0xffffffffu >> (32u - (32u >> grid.target_shift));
    let number = (word >> ((element << (5u - grid.target_shift)) & 31u)) & mask;
    return select(f32(number) * grid.target_unit, bitcast<f32>(word), grid.target_shift == 0u);
}
