@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> block_sums: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(7) var<storage, read_write> tile_sizes: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> pairs: array<vec4<u32>>;
@group(0) @binding(9) var<storage, read_write> records: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> places: array<u32>;

// Of the block's Gaussians: pairs up to and with each, how many of its own are in the first image, its place among the splats.
var<workgroup> ends: array<u32, SCAN>;
var<workgroup> in_first: array<u32, SCAN>;
var<workgroup> splat_of: array<u32, SCAN>;

// The tile of a Gaussian's pair `index` in one image; none where compilers made the count larger than what is found here.
fn tile_at(g: u32, splat: Splat, index: u32) -> u32 {
    let grid = params.grids[g];
    let r = reach_of(grid.tiles, splat.place.xy, splat.conic.xyz, splat.conic.w);
    var left = i32(index);
    for (var row = r.rows.x; row <= r.rows.y; row++) {
        let columns = columns_of(r, grid.tiles, row);
        let width = max(columns.y - columns.x + 1, 0);
        if (left < width) { return grid.first_tile + u32(row) * grid.tiles.x + u32(columns.x + left); }
        left -= width;
    }
    return params.tile_total;
}

// A block of Gaussians: those that are visible, in order, and their pairs: tile, place within the tile (in no order), splat, depth.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    if (state[FAILED] != 0u || block * SCAN >= params.gaussians) { return; }
    let i = block * SCAN + thread;
    var counts = vec2(0u);
    if (i < params.gaussians) { counts = tile_counts[i]; }
    let own = counts.x + counts.y;
    let sums = inclusive_scan(thread, vec4(own, u32(own > 0u), 0u, 0u));
    let end = sums.x;
    let rank = sums.y;
    ends[thread] = end;
    in_first[thread] = counts.x;
    let before = block_sums[block];
    splat_of[thread] = before.z + rank - 1u;
    if (own > 0u) {
        order[before.x + rank - 1u] = i;
        offsets[before.x + rank - 1u] = before.y + end - own;
        places[before.x + rank - 1u] = before.z + rank - 1u;
    }
    workgroupBarrier();
    let total = ends[SCAN - 1u];
    for (var pair = thread; pair < total; pair += SCAN) {
        var k = 0u;
        for (var step = SCAN / 2u; step > 0u; step >>= 1u) {
            if (ends[k + step - 1u] <= pair) { k += step; }
        }
        var index = pair;
        if (k > 0u) { index -= ends[k - 1u]; }
        let g = u32(index >= in_first[k]);
        if (g == 1u) { index -= in_first[k]; }
        let owner = g * params.visible_capacity + splat_of[k];
        let splat = splats[owner];
        let tile = tile_at(g, splat, index);
        let at = before.y + pair;
        var place = 0u;
        if (tile < params.tile_total) {
            place = atomicAdd(&tile_sizes[tile], 1u);
        } else {
            let words = 3u + params.fused;
            for (var w = 0u; w < words; w++) { records[words * at + w] = vec4(0.0); }
        }
        // The bits of positive numbers order like the numbers.
        pairs[at] = vec4(tile, place, owner, bitcast<u32>(splat.color.w));
    }
}
