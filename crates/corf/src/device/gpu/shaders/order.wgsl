@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> lists: array<List>;
@group(0) @binding(2) var<storage, read> pairs: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> entries: array<vec2<u32>>;

// A tile's list by depth, and by the number of the Gaussian where depths are equal (pairs are numbered in the order of Gaussians):
// a bitonic network whose comparisons all point the same way, so that lists of any length are as if followed by infinite depths.
// Up to HELD entries are sorted in workgroup memory; of longer lists the wide comparisons are made in place.
const HELD = 1024u;
const THREADS = 128u;
var<workgroup> held: array<vec2<u32>, HELD>;

fn before(a: vec2<u32>, b: vec2<u32>) -> bool { return a.x < b.x || (a.x == b.x && a.y < b.y); }

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

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let tile = group_number(id);
    if (tile >= params.tile_total) { return; }
    let first = lists[tile].first;
    let count = lists[tile].count;
    if (count == 0u) { return; }
    for (var chunk = 0u; chunk < count; chunk += HELD) {
        let part = min(HELD, count - chunk);
        fetch(thread, first + chunk, part);
        for (var half = 1u; half < part; half <<= 1u) {
            step_held(thread, part, half, true);
            for (var apart = half >> 1u; apart > 0u; apart >>= 1u) { step_held(thread, part, apart, false); }
        }
        if (count > HELD) { put_back(thread, first + chunk, part); }
    }
    for (var half = HELD; half < count; half <<= 1u) {
        step_wide(thread, first, count, half, true);
        for (var apart = half >> 1u; apart >= HELD; apart >>= 1u) { step_wide(thread, first, count, apart, false); }
        for (var chunk = 0u; chunk < count; chunk += HELD) {
            let part = min(HELD, count - chunk);
            fetch(thread, first + chunk, part);
            for (var apart = HELD >> 1u; apart > 0u; apart >>= 1u) { step_held(thread, part, apart, false); }
            put_back(thread, first + chunk, part);
        }
    }
    // What the blends want to know: Gaussian, number of the pair.
    for (var i = thread; i < count; i += THREADS) {
        var pair: u32;
        if (count > HELD) { pair = entries[first + i].y; } else { pair = held[i].y; }
        entries[first + i] = vec2(pairs[pair].z, pair);
    }
}
