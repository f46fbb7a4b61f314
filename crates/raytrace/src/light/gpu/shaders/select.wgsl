// Adaptive sampling. In the first pass (`samples` = `base`): how many paths each pixel wants, by how much its own and its
// neighbours' disagree. In the others: the list of the pixels that want `samples`.

fn variance_of(pixel: u32) -> f32 {
    let n = sums[pixel].n;
    if (n < 2u) { return 0.0; }
    return sums[pixel].squares / f32(n - 1u);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = group_number(id) * 64u + thread;
    if (place >= params.count) { return; }
    let pixel = pixel_at(params.first + place);
    if (pixel == NONE) { return; }
    let wish_at = params.lists_at + 2u * params.list_size + pixel;
    if (params.samples > params.base) {
        if (atomicLoad(&work[wish_at]) >= params.samples) {
            let at = atomicAdd(&work[LENGTHS], 1u);
            atomicStore(&work[params.lists_at + at], pixel);
        }
        return;
    }
    let x = pixel % params.width;
    let y = pixel / params.width;
    var total = 0.0;
    var count = 0.0;
    for (var j = max(y, 1u) - 1u; j < min(y + 2u, params.height); j++) {
        for (var i = max(x, 1u) - 1u; i < min(x + 2u, params.width); i++) {
            total += variance_of(j * params.width + i);
            count += 1.0;
        }
    }
    let needed = max(variance_of(pixel), total / count) / params.variance;
    var n = params.base;
    while (f32(n) < needed && n < params.most) { n *= 2u; }
    atomicStore(&work[wish_at], n);
}
