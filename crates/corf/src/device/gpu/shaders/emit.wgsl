@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> tile_counts: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> block_sums: array<u32>;
@group(0) @binding(6) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(7) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> owners: array<u32>;
@group(0) @binding(9) var<storage, read_write> records: array<vec4<f32>>;

// The pairs of a Gaussian in one image from `at` on, as many as were counted.
fn emit(g: u32, i: u32, begin: u32, count: u32) {
    if (count == 0u) { return; }
    let grid = params.grids[g];
    let owner = g * params.gaussians + i;
    let splat = splats[owner];
    let r = reach_of(grid.tiles, splat.place.xy, splat.conic.xyz, splat.conic.w);
    let end = min(begin + count, params.pair_capacity);
    var at = begin;
    for (var row = r.rows.x; row <= r.rows.y; row++) {
        let columns = columns_of(r, grid.tiles, row);
        for (var column = columns.x; column <= columns.y && at < end; column++) {
            pair_tiles[at] = grid.first_tile + u32(row) * grid.tiles.x + u32(column);
            owners[at] = owner;
            at++;
        }
    }
    // A count larger than what is found (a compiler's doing) leaves pairs that belong to no tile.
    for (; at < end; at++) {
        pair_tiles[at] = params.tile_total;
        owners[at] = owner;
        let words = 3u + params.fused;
        for (var k = 0u; k < words; k++) { records[words * at + k] = vec4(0.0); }
    }
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    let v = block * 256u + thread;
    if (v >= state[VISIBLE]) { return; }
    let at = offsets[v] + block_sums[block];
    offsets[v] = at;
    let i = order[v];
    let counts = tile_counts[i];
    emit(0u, i, at, counts.x);
    emit(1u, i, at + counts.x, counts.y);
}
