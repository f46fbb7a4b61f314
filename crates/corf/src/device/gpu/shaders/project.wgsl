// cpu/project.rs: each Gaussian in the images of a step.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sh_1: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> blocks: array<Block>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(6) var<storage, read_write> gaussian_of: array<u32>;
@group(0) @binding(7) var<storage, read_write> state: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> drawn: array<Drawn>;
@group(0) @binding(9) var<storage, read_write> shares: array<vec2<u32>>;
@group(0) @binding(10) var<storage, read_write> args: array<vec4<u32>>;

// The block's first place among the visible, first pair, first share, shares.
var<workgroup> given: vec4<u32>;

// τ = ln(255·o·ρ) bounds σ; the margin covers the rounding of the logarithm and of σ itself.
const TAU_MARGIN = 1e-3;
// Widest σ at which opacity 1 still gives 1/255: sqrt(2 ln 255) standard deviations.
const MAX_DEVIATIONS = 3.33;

fn is_finite(x: f32) -> bool { return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u; }

// A cheap, generous test against the borders of an image; the exact one follows.
fn may_be_seen(grid: GridParams, p: vec3<f32>, largest: f32) -> bool {
    let inverse_z = 1.0 / p.z;
    let r = fma(grid.reach, vec2(largest * inverse_z), vec2(MAX_DEVIATIONS * sqrt(DILATION)));
    let mean = fma(grid.focal, p.xy * inverse_z, grid.centre);
    return all(mean + r > vec2(0.0)) && all(mean - r < vec2<f32>(grid.size));
}

// What is drawn of a Gaussian, but for its colours.
struct Seen {
    tiles: vec2<u32>,
    rows: vec2<u32>,
    place: array<vec4<f32>, 2>,
    conic: array<vec4<f32>, 2>,
    determinant: vec2<f32>,
    z: f32,
    direction: vec3<f32>,
}

// Tiles and the rows of tiles they are in.
fn tiles_of(grid: GridParams, e: Ellipse, q: vec3<f32>, determinant: f32, tau: f32) -> vec2<u32> {
    let r = reach_of(grid.tiles, e.mean, q, determinant, tau);
    var count = 0u;
    for (var row = r.rows.x; row <= r.rows.y; row++) {
        let columns = columns_of(r, grid.tiles, row);
        count += u32(max(columns.y - columns.x + 1, 0));
    }
    if (count == 0u) { return vec2(0u); }
    return vec2(count, u32(r.rows.y - r.rows.x + 1));
}

// Bound of σ: o ρ exp(−σ) ≥ 1/255.
fn bound_of(opacity: f32) -> f32 { return log(max(opacity * 255.0, 1e-30)) + TAU_MARGIN; }

fn project_to(g: u32, p: vec3<f32>, s: Shape, logit: f32, seen: ptr<function, Seen>) {
    let grid = params.grids[g];
    let e = ellipse_of(grid, p, s);
    if (!(e.determinant > 0.0)) { return; }
    let opacity = e.rho / (1.0 + exp(-logit));
    let tau = bound_of(opacity);
    let q = conic_of(e);
    let determinant = 1.0 / e.determinant;
    let tiles = tiles_of(grid, e, q, determinant, tau);
    (*seen).determinant[g] = determinant;
    (*seen).tiles[g] = tiles.x;
    (*seen).rows[g] = tiles.y;
    (*seen).place[g] = vec4(e.mean, opacity, e.inverse_z);
    (*seen).conic[g] = vec4(q, tau);
}

// Both images share the ellipse, and the pairs are those of the more opaque one.
fn project_both(p: vec3<f32>, s: Shape, logits: vec2<f32>, seen: ptr<function, Seen>) {
    let grid = params.grids[0];
    let e = ellipse_of(grid, p, s);
    if (!(e.determinant > 0.0)) { return; }
    let opacity = vec2(e.rho) / (1.0 + exp(-logits));
    let tau = bound_of(max(opacity.x, opacity.y));
    let q = conic_of(e);
    let determinant = 1.0 / e.determinant;
    let tiles = tiles_of(grid, e, q, determinant, tau);
    (*seen).determinant = vec2(determinant);
    (*seen).tiles = vec2(tiles.x, 0u);
    (*seen).rows = vec2(tiles.y, 0u);
    (*seen).place[0] = vec4(e.mean, opacity.x, e.inverse_z);
    (*seen).place[1] = vec4(e.mean, opacity.y, e.inverse_z);
    (*seen).conic[0] = vec4(q, tau);
    (*seen).conic[1] = vec4(q, tau);
}

// Gaussian i in both images.
fn see(i: u32) -> Seen {
    var seen: Seen;
    let first = core[3u * i];
    let mean = first.xyz;
    let p = to_camera(mean);
    if (!(p.z > params.eye.w && is_finite(p.z))) { return seen; }
    let second = core[3u * i + 1u];
    let third = core[3u * i + 2u];
    let log_scale = vec3(second.w, third.xy);
    let largest = exp(max(log_scale.x, max(log_scale.y, log_scale.z)));
    let wanted = vec2(
        params.grids[0].size.x > 0u && may_be_seen(params.grids[0], p, largest),
        params.grids[1].size.x > 0u && may_be_seen(params.grids[1], p, largest),
    );
    if (any(wanted)) {
        let s = shape_of(vec4(first.w, second.xyz), log_scale);
        seen.z = p.z;
        seen.direction = direction_of(mean).xyz;
        if (params.fused != 0u) {
            project_both(p, s, third.zw, &seen);
        } else {
            if (wanted.x) { project_to(0u, p, s, third.z, &seen); }
            if (wanted.y) { project_to(1u, p, s, third.w, &seen); }
        }
    }
    return seen;
}

// By whoever comes last: the frame's counts and what is dispatched by them; those of the projection are left at zero for the next frame.
fn settle() {
    let visible = atomicExchange(&state[DRAWABLE], 0u);
    let pairs = all_pairs();
    let shares = atomicExchange(&state[CUT], 0u);
    atomicStore(&state[FINISHED], 0u);
    atomicMax(&state[NEEDED], pairs);
    atomicMax(&state[MOST_VISIBLE], visible);
    // A frame without room draws nothing and changes nothing; neither does any after it change anything.
    if (pairs > params.pair_capacity || visible > params.visible_capacity) { atomicStore(&state[FAILED], 1u); }
    let fits = u32(atomicLoad(&state[FAILED]) == 0u);
    atomicStore(&state[VISIBLE], fits * visible);
    atomicStore(&state[PAIRS], fits * pairs);
    atomicStore(&state[SHARES], fits * shares);
    atomicStore(&state[LISTED], 0u);
    atomicStore(&state[CHECKPOINTS], 0u);
    atomicStore(&state[BUCKETS], 0u);
    atomicStore(&state[CHUNKS], 0u);
    args[ARGS_APPEARANCE] = folded((fits * visible + EACH - 1u) / EACH);
    args[ARGS_GEOMETRY] = folded((fits * visible + 63u) / 64u);
    args[ARGS_PAIRS] = folded((fits * pairs + 255u) / 256u);
    args[ARGS_SHARES] = folded(fits * shares);
}

// A block of Gaussians: what each reaches, room for what that takes, the block's pairs cut into shares of SHARE, what is drawn. Which block
// is before which, whoever comes first; a block's own follow each other in order.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    let count = max((params.gaussians + SCAN - 1u) / SCAN, 1u);
    if (block >= count) { return; }
    let i = block * SCAN + thread;
    var seen: Seen;
    if (i < params.gaussians) { seen = see(i); }
    let tiles = seen.tiles.x + seen.tiles.y;
    // A block's counts are added up in a word: no Gaussian may have more than its share of one.
    if (tiles > MOST / SCAN) { atomicStore(&state[WRAPPED], 1u); }
    let sums = inclusive_scan(thread, vec4(u32(tiles > 0u), tiles, 0u, 0u));
    if (thread == SCAN - 1u) {
        let parts = (sums.y + SHARE - 1u) / SHARE;
        let place = atomicAdd(&state[DRAWABLE], sums.x);
        let begin = take_pairs(sums.y);
        given = vec4(place, begin, atomicAdd(&state[CUT], parts), parts);
        blocks[block] = Block(sums.x, sums.y, place, begin);
    }
    let first = workgroupUniformLoad(&given);
    if (thread == 0u && atomicAdd(&state[FINISHED], 1u) == count - 1u) { settle(); }
    // There is room for all shares of pairs that there is room for.
    for (var s = thread; s < min(first.w, max(arrayLength(&shares), first.z) - first.z); s += SCAN) {
        shares[first.z + s] = vec2(block, s);
    }
    let place = first.x + sums.x - 1u;
    if (tiles == 0u || place >= params.visible_capacity) { return; }
    gaussian_of[place] = i;
    drawn[place] = Drawn(
        first.y + sums.y - tiles, seen.tiles.x, seen.tiles.y, seen.rows.x, seen.rows.y, seen.determinant.x, seen.determinant.y,
    );
    if (seen.tiles.x > 0u) {
        splats[place] = Splat(seen.place[0], seen.conic[0], vec4(color_0(i, seen.direction), seen.z));
    }
    if (seen.tiles.y > 0u || params.fused != 0u) {
        splats[params.visible_capacity + place] = Splat(seen.place[1], seen.conic[1], vec4(color_1(i, seen.direction), seen.z));
    }
}
