// Camera paths of pixels until each has `samples` of them. A thread is a pixel; whose path ends begins the next at once. A pixel
// that lacked a tile
// is left as it was and put on the other list.

fn add_path(sum: ptr<function, Sums>, path: Path) {
    (*sum).n += 1u;
    (*sum).radiance += path.radiance;
    if (path.lamp) {
        (*sum).lamp += path.radiance;
        (*sum).lamps += 1u;
    }
    (*sum).albedo += path.albedo;
    (*sum).normal += path.normal;
    let value = develop_value(luminance(path.radiance) * params.gain);
    let step = value - (*sum).mean;
    (*sum).mean += step / f32((*sum).n);
    (*sum).squares += step * (value - (*sum).mean);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = group_number(id) * 64u + thread;
    if (place >= params.count) { return; }
    var pixel = NONE;
    if (params.list == 0u) {
        pixel = pixel_at(params.first + place);
    } else if (params.first + place < atomicLoad(&work[LENGTHS + params.list - 1u])) {
        pixel = atomicLoad(&work[params.lists_at + (params.list - 1u) * params.list_size + params.first + place]);
    }
    if (pixel == NONE) { return; }
    var sum = sums[pixel];
    var draws = draws_of(params.frame, vec2(pixel, 0u));
    var path = begin(half_line(params.origin, params.z_axis));
    bounces = 0u;
    shadows = 0u;
    lacking = false;
    var on_its_way = false;
    loop {
        if (!on_its_way) {
            if (sum.n >= params.samples) { break; }
            draws.index = sum.n;
            path = begin(camera_ray(pixel, pair(draws, FILM)));
        }
        on_its_way = advance(&path, draws);
        if (!on_its_way) { add_path(&sum, path); }
    }
    if (lacking) {
        let other = select(0u, 1u, params.list == 1u);
        let at = atomicAdd(&work[LENGTHS + other], 1u);
        atomicStore(&work[params.lists_at + other * params.list_size + at], pixel);
    } else {
        sum.bounces += bounces;
        sum.shadows += shadows;
        sums[pixel] = sum;
    }
}
