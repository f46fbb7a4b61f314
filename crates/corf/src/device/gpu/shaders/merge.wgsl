@group(0) @binding(0) var<storage, read> state: array<u32>;
@group(0) @binding(1) var<storage, read> lists: array<List>;
@group(0) @binding(2) var<storage, read> chunks: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> pairs: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read_write> entries: array<vec2<u32>>;

// How many of the entries of four sorted chunks from `first` on are before `mine`; `counts` are theirs. Four at once, because each look
// waits for memory.
fn found_before(first: u32, counts: vec4<u32>, mine: vec2<u32>) -> u32 {
    let starts = vec4(first) + vec4(0u, CHUNK, 2u * CHUNK, 3u * CHUNK);
    // Looks beyond a chunk go to its first entry, of a chunk that is none to the first one's: they count for nothing.
    let firsts = select(vec4(first), starts, counts > vec4(0u));
    var found = vec4(0u);
    for (var step = CHUNK; step > 0u; step >>= 1u) {
        let reach = found + step;
        let inside = reach <= counts;
        let at = firsts + select(vec4(0u), reach - 1u, inside);
        let depths = vec4(pairs[at.x].x, pairs[at.y].x, pairs[at.z].x, pairs[at.w].x);
        let numbers = vec4(pairs[at.x].y, pairs[at.y].y, pairs[at.z].y, pairs[at.w].y);
        let before = (depths < vec4(mine.x)) | ((depths == vec4(mine.x)) & (numbers < vec4(mine.y)));
        found = select(found, reach, inside & before);
    }
    return found.x + found.y + found.z + found.w;
}

// Joins the sorted chunks of a list: a workgroup a chunk, a thread an entry, whose place is how many entries of all chunks are before it.
@compute @workgroup_size(CHUNK)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    if (group >= state[CHUNKS]) { return; }
    let chunk = chunks[group];
    let list = lists[chunk.x];
    let at = chunk.y * CHUNK + thread;
    if (at >= list.count) { return; }
    let own = pairs[list.first + at];
    let mine = own.xy;
    var place = thread;
    for (var begin = 0u; begin < list.count; begin += 4u * CHUNK) {
        var counts = vec4(0u);
        for (var k = 0u; k < 4u; k++) {
            let other = begin + k * CHUNK;
            if (other < list.count && other != chunk.y * CHUNK) { counts[k] = min(CHUNK, list.count - other); }
        }
        place += found_before(list.first + begin, counts, mine);
    }
    // What the blends want to know: splat, number of the pair.
    entries[list.first + place] = vec2(pairs[own.w].z, own.w);
}
