// Adaptive sampling. With `list` 0: how many paths each pixel wants, by how much its own and its neighbours' disagree. With 1: the
// list of the pixels that want more than they have, those that want most first, so that the last to be through are short.

fn variance_of(item: u32) -> f32 {
    let n = sums[item].n;
    if (n < 2u) { return 0.0; }
    return sums[item].squares / f32(n - 1u);
}

// Doublings that lead to what an item wants.
fn level_of(wish: u32) -> u32 {
    var level = 0u;
    while (level < params.levels && (params.base << level) < wish) { level += 1u; }
    return level;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = group_number(id) * 64u + thread;
    if (place >= params.count) { return; }
    let item = item_at(params.first + place);
    if (item == NONE) { return; }
    if (params.list == 1u) {
        let level = level_of(atomicLoad(&work[wish_of(item)]));
        if (level == 0u) { return; }
        var at = atomicAdd(&work[CURSORS + level], 1u);
        for (var more = level + 1u; more <= params.levels; more++) { at += atomicLoad(&work[COUNTS + more]); }
        atomicStore(&work[params.lists_at + at], item);
        return;
    }
    let first = item / area() * area();
    let x = (item - first) % params.width;
    let y = (item - first) / params.width;
    var total = 0.0;
    var count = 0.0;
    for (var j = max(y, 1u) - 1u; j < min(y + 2u, params.height); j++) {
        for (var i = max(x, 1u) - 1u; i < min(x + 2u, params.width); i++) {
            total += variance_of(first + j * params.width + i);
            count += 1.0;
        }
    }
    let needed = max(variance_of(item), total / count) / params.variance;
    var n = params.base;
    while (f32(n) < needed && n < params.most) { n *= 2u; }
    atomicStore(&work[wish_of(item)], n);
    if (n > params.base) { atomicAdd(&work[COUNTS + level_of(n)], 1u); }
}
