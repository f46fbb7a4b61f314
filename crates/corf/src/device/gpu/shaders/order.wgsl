@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> lists: array<List>;
@group(0) @binding(2) var<storage, read_write> pairs: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> entries: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> state: array<u32>;
@group(0) @binding(5) var<storage, read> chunks: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> gaussian_of: array<u32>;

// A tile's list by depth, and by the number of the Gaussian where depths are equal.
// Up to CHUNK entries are sorted in workgroup memory: runs of RUN by counting who is before whom, then by merging neighbours, where an
// entry's place is its own in its run and, found by bisection, that in the other. Longer lists are of chunks so sorted, a workgroup each,
// which `merge` joins. Still longer ones are joined by their tile's workgroup, with a bitonic network whose comparisons all point the same
// way, as if infinite depths followed; its wide comparisons are made in place.
const RUN = 16u;
var<workgroup> held: array<vec2<u32>, CHUNK>;

// The Gaussian of a pair.
fn number_of(pair: u32) -> u32 {
    let splat = pairs[pair].z;
    return gaussian_of[select(splat, splat - params.visible_capacity, splat >= params.visible_capacity)];
}

// By depth; where depths of two pairs are equal, which happens seldom, by their Gaussians.
fn before(a: vec2<u32>, b: vec2<u32>) -> bool {
    if (a.x != b.x || a.y == b.y) { return a.x < b.x; }
    return number_of(a.y) < number_of(b.y);
}

// The pair of places that comparison `i` of a step joins: mirrored within blocks of 2·half, or half apart.
fn joined(i: u32, half: u32, mirrored: bool) -> vec2<u32> {
    let block = i / half * half * 2u;
    let low = i % half;
    if (mirrored) { return vec2(block + low, block + 2u * half - 1u - low); }
    return vec2(block + low, block + low + half);
}

fn step_held(thread: u32, count: u32, half: u32, mirrored: bool) {
    // Comparisons beyond the end have nothing to move.
    let all = (count + 2u * half - 1u) / (2u * half) * half;
    for (var i = thread; i < all; i += THREADS) {
        let at = joined(i, half, mirrored);
        if (at.y < count) {
            let a = held[at.x];
            let b = held[at.y];
            if (before(b, a)) {
                held[at.x] = b;
                held[at.y] = a;
            }
        }
    }
    workgroupBarrier();
}

fn step_wide(thread: u32, first: u32, count: u32, half: u32, mirrored: bool) {
    let all = (count + 2u * half - 1u) / (2u * half) * half;
    for (var i = thread; i < all; i += THREADS) {
        let at = joined(i, half, mirrored);
        if (at.y < count) {
            let a = entries[first + at.x];
            let b = entries[first + at.y];
            if (before(b, a)) {
                entries[first + at.x] = b;
                entries[first + at.y] = a;
            }
        }
    }
    storageBarrier();
    workgroupBarrier();
}

fn fetch(thread: u32, first: u32, count: u32) {
    for (var i = thread; i < count; i += THREADS) { held[i] = entries[first + i]; }
    workgroupBarrier();
}

fn put_back(thread: u32, first: u32, count: u32) {
    for (var i = thread; i < count; i += THREADS) { entries[first + i] = held[i]; }
    storageBarrier();
    workgroupBarrier();
}

// How many entries of the sorted run from `first` on are before `mine`; `width` is a power of two and at least the run's length.
fn found_before(first: u32, count: u32, width: u32, mine: vec2<u32>) -> u32 {
    var found = 0u;
    for (var step = width; step > 0u; step >>= 1u) {
        let reach = found + step;
        let other = held[first + min(reach, max(count, 1u)) - 1u];
        if (reach <= count && before(other, mine)) { found = reach; }
    }
    return found;
}

// Where the i-th entry belongs once runs of `width` are merged in pairs.
fn merged(i: u32, width: u32, count: u32, mine: vec2<u32>) -> u32 {
    let own = i & ~(width - 1u);
    let other = own ^ width;
    let others = min(max(count, other) - other, width);
    return min(own, other) + (i - own) + found_before(other, others, width, mine);
}

// Where the i-th entry belongs in its run of RUN.
fn ranked(i: u32, count: u32, mine: vec2<u32>) -> u32 {
    let run = i & ~(RUN - 1u);
    var rank = run;
    for (var k = run; k < min(run + RUN, count); k++) { rank += u32(before(held[k], mine)); }
    return rank;
}

// Moves all entries at once: those of a thread wait in registers while the others find their places.
fn sort_held(thread: u32, count: u32) {
    for (var width = RUN / 2u; width < max(count, RUN); width <<= 1u) {
        let first = width < RUN;
LOOK
        workgroupBarrier();
MOVE
        workgroupBarrier();
    }
}

// One chunk of a list, to where `merge` looks it up: of the pairs with the list's numbers, the words that nobody reads any more. Depth,
// Gaussian, pair.
fn order_chunk(thread: u32, list: List, chunk: u32) {
    let first = list.first + chunk * CHUNK;
    let part = min(CHUNK, list.count - chunk * CHUNK);
    fetch(thread, first, part);
    sort_held(thread, part);
    for (var i = thread; i < part; i += THREADS) {
        pairs[first + i].x = held[i].x;
        pairs[first + i].y = number_of(held[i].y);
        pairs[first + i].w = held[i].y;
    }
}

// Workgroups beyond one a tile are of chunks.
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    if (group >= params.tile_total) {
        let at = group - params.tile_total;
        if (at >= state[CHUNKS]) { return; }
        order_chunk(thread, lists[chunks[at].x], chunks[at].y);
        return;
    }
    let first = lists[group].first;
    let count = lists[group].count;
    if (count == 0u || chunks_of(count) > 0u) { return; }
    for (var chunk = 0u; chunk < count; chunk += CHUNK) {
        let part = min(CHUNK, count - chunk);
        fetch(thread, first + chunk, part);
        sort_held(thread, part);
        if (count > CHUNK) { put_back(thread, first + chunk, part); }
    }
    for (var half = CHUNK; half < count; half <<= 1u) {
        step_wide(thread, first, count, half, true);
        for (var apart = half >> 1u; apart >= CHUNK; apart >>= 1u) { step_wide(thread, first, count, apart, false); }
        for (var chunk = 0u; chunk < count; chunk += CHUNK) {
            let part = min(CHUNK, count - chunk);
            fetch(thread, first + chunk, part);
            for (var apart = CHUNK >> 1u; apart > 0u; apart >>= 1u) { step_held(thread, part, apart, false); }
            put_back(thread, first + chunk, part);
        }
    }
    // What the blends want to know: splat, number of the pair.
    for (var i = thread; i < count; i += THREADS) {
        var pair: u32;
        if (count > CHUNK) { pair = entries[first + i].y; } else { pair = held[i].y; }
        entries[first + i] = vec2(pairs[pair].z, pair);
    }
}
