@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> drawn: array<Drawn>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> blocks: array<Block>;
@group(0) @binding(5) var<storage, read> shares: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> tile_sizes: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> pairs: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> record_heads: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> record_tails: array<vec4<f32>>;

// Of the block's visible Gaussians: pairs up to and with each, how many of its own are in the first image; the same of rows of tiles,
// none where a Gaussian has no pair in the share.
var<workgroup> ends: array<u32, SCAN>;
var<workgroup> in_first: array<u32, SCAN>;
var<workgroup> row_ends: array<u32, SCAN>;
var<workgroup> rows_in_first: array<u32, SCAN>;
// Of SCAN rows of tiles: the first pair's number within the block, its tile, 2·SCAN·(how many) + 2·(which Gaussian) + image.
var<workgroup> row_starts: array<u32, SCAN>;
var<workgroup> row_tiles: array<u32, SCAN>;
var<workgroup> row_parts: array<u32, SCAN>;
// Where the pairs of the last of these rows would end had its Gaussian as many as it takes.
var<workgroup> reached: u32;
var<workgroup> scan_memory: array<u32, 2u * SCAN>;

// Where sums over threads begin anew.
const ANEW = 0x80000000u;

// A row of tiles: `tile` and the `width` − 1 after it are reached. Its Gaussian's pairs in that image are from `begin` to `end`, and
// this row's are the first of them or follow the row before.
struct Row { begin: u32, end: u32, is_first: bool, tile: u32, width: u32, part: u32 }

// Inclusive sums over the threads (Hillis, Steele, as with four numbers), begun anew at each that adds ANEW.
fn sums_anew(thread: u32, value: u32) -> u32 {
    var sum = value;
    var half = 0u;
    for (var step = 1u; step < SCAN; step <<= 1u) {
        scan_memory[half + thread] = sum;
        workgroupBarrier();
        if (thread >= step && sum < ANEW) { sum += scan_memory[half + thread - step]; }
        half = SCAN - half;
    }
    return sum & ~ANEW;
}

// Pairs of the block before its k-th visible Gaussian's.
fn begin_of(k: u32) -> u32 {
    if (k == 0u) { return 0u; }
    return ends[k - 1u];
}

// The share's row number `row`; `splats_before` is the block's first splat.
fn row_at(row: u32, splats_before: u32) -> Row {
    var k = 0u;
    for (var step = SCAN / 2u; step > 0u; step >>= 1u) {
        if (row_ends[k + step - 1u] <= row) { k += step; }
    }
    var down = row;
    if (k > 0u) { down -= row_ends[k - 1u]; }
    let g = u32(down >= rows_in_first[k]);
    var found: Row;
    found.begin = begin_of(k);
    found.end = found.begin + in_first[k];
    if (g == 1u) {
        down -= rows_in_first[k];
        found.begin = found.end;
        found.end = ends[k];
    }
    found.is_first = down == 0u;
    found.part = 2u * k + g;
    let tiles = params.grids[g].tiles;
    let splat = g * params.visible_capacity + splats_before + k;
    let own = splats_before + k;
    let determinant = select(drawn[own].in_first_determinant, drawn[own].in_second_determinant, g == 1u);
    let reach = reach_of(tiles, splats[splat].place.xy, splats[splat].conic.xyz, determinant, splats[splat].conic.w);
    let y = reach.rows.x + i32(down);
    if (y <= reach.rows.y) {
        let columns = columns_of(reach, tiles, y);
        found.width = u32(max(columns.y - columns.x + 1, 0));
        found.tile = params.grids[g].first_tile + u32(y) * tiles.x + u32(columns.x);
    }
    return found;
}

// Finds the tiles of SCAN rows of the share's `rows`, a thread each.
fn find_rows(thread: u32, first: u32, rows: u32, splats_before: u32) {
    var row: Row;
    let exists = first + thread < rows;
    if (exists) { row = row_at(first + thread, splats_before); }
    var width = row.width;
    if (row.is_first) { width += row.begin + ANEW; } else if (thread == 0u) { width += reached; }
    let end = sums_anew(thread, width);
    // Compilers may have made the count smaller than what is found here: what is beyond it is none of this Gaussian's.
    let start = min(end - row.width, row.end);
    row_starts[thread] = select(0xffffffffu, start, exists);
    row_tiles[thread] = row.tile;
    row_parts[thread] = 2u * SCAN * (min(end, row.end) - start) + row.part;
    if (thread == SCAN - 1u) { reached = end; }
    workgroupBarrier();
}

// The last of the rows that begins with this pair or before it; the first if none does.
fn row_with(pair: u32) -> u32 {
    var row = 0u;
    for (var step = SCAN / 2u; step > 0u; step >>= 1u) {
        if (row_starts[row + step] <= pair) { row += step; }
    }
    return row;
}

// A pair of the block: tile, place within the tile (in no order), splat, depth.
fn emit(pair: u32, block: Block) {
    let row = row_with(pair);
    let part = row_parts[row];
    let column = pair - row_starts[row];
    let at = block.begin + pair;
    if (column < part / (2u * SCAN)) {
        let tile = row_tiles[row] + column;
        let owner = part % 2u * params.visible_capacity + block.place + part / 2u % SCAN;
        // The bits of positive numbers order like the numbers.
        pairs[at] = vec4(tile, atomicAdd(&tile_sizes[COUNTER * tile], 1u), owner, bitcast<u32>(splats[owner].color.w));
    } else {
        // Compilers made the count larger than what is found here.
        record_heads[2u * at] = vec4(0.0);
        record_heads[2u * at + 1u] = vec4(0.0);
        let words = 1u + params.fused;
        for (var w = 0u; w < words; w++) { record_tails[words * at + w] = vec4(0.0); }
        pairs[at] = vec4(params.tile_total, 0u, 0u, 0u);
    }
}

// Brings the block's visible Gaussians, with the rows of those that have pairs from `first` on and before `last`; how many rows these are.
fn bring(thread: u32, block: Block, first: u32, last: u32) -> u32 {
    var rows = vec2(0u);
    if (thread < block.visible) {
        let own = drawn[block.place + thread];
        let begin = own.begin - block.begin;
        let end = begin + own.in_first + own.in_second;
        ends[thread] = end;
        in_first[thread] = own.in_first;
        if (end > first && begin < last) { rows = vec2(own.rows_in_first, own.rows_in_second); }
    }
    rows_in_first[thread] = rows.x;
    row_ends[thread] = sums_anew(thread, rows.x + rows.y);
    workgroupBarrier();
    return row_ends[SCAN - 1u];
}

// A share of a block's pairs: first a thread is a Gaussian, then a row of tiles of one, then a pair.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let number = group_number(id);
    if (state[FAILED] != 0u || number >= state[SHARES]) { return; }
    let share = shares[number];
    let block = blocks[share.x];
    let first = share.y * SHARE;
    let last = min(first + SHARE, block.pairs);
    let rows = bring(thread, block, first, last);
    var done = first;
    // Once also where compilers find no row at all.
    for (var row = 0u; row < max(rows, 1u) && done < last; row += SCAN) {
        find_rows(thread, row, rows, block.place);
        var end = last;
        if (row + SCAN < rows) { end = min(last, row_starts[SCAN - 1u] + row_parts[SCAN - 1u] / (2u * SCAN)); }
        for (var pair = done + thread; pair < end; pair += SCAN) { emit(pair, block); }
        done = max(done, end);
        workgroupBarrier();
    }
}
