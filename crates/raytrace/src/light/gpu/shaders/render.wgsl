// Camera paths of pixels until each has `samples` of them, or as many as it wants. A thread is a pixel; whose path ends begins the
// next at once. A path that lacked a tile does not count, nor do those behind it: its pixel goes on the other list, to be gone on
// with from there. Meanwhile the rest of its paths find out what else is lacking.

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
    var item = NONE;
    if (params.list == 0u) {
        item = item_at(params.first + place);
    } else {
        item = atomicLoad(&work[params.lists_at + (params.list - 1u) * params.list_size + params.first + place]);
    }
    if (item == NONE) { return; }
    let view = item / area();
    let pixel = item % area();
    var goal = params.samples;
    if (goal == 0u) { goal = atomicLoad(&work[wish_of(item)]); }
    var begun = sums[item].n;
    var draws = draws_of(frame_of_view(view), vec2(pixel, 0u));
    var path = begin(half_line(params.viewpoints[view].origin, params.viewpoints[view].z_axis));
    bounces = 0u;
    shadows = 0u;
    lacking = false;
    var on_its_way = false;
    loop {
        if (!on_its_way) {
            if (begun >= goal) { break; }
            draws.index = begun;
            begun += 1u;
            path = begin(camera_ray(view, pixel, pair(draws, FILM)));
        }
        on_its_way = advance(&path, draws);
        if (!on_its_way && !lacking) {
            // Kept in memory, for a kernel with fewer registers hides more waits.
            var sum = sums[item];
            add_path(&sum, path);
            sum.bounces += bounces;
            sum.shadows += shadows;
            sums[item] = sum;
            bounces = 0u;
            shadows = 0u;
        }
    }
    if (lacking) {
        let other = select(0u, 1u, params.list == 1u);
        let at = atomicAdd(&work[LENGTHS + other], 1u);
        atomicStore(&work[params.lists_at + other * params.list_size + at], item);
    }
}
