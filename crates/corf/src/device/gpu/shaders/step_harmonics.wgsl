// One step of an image's harmonics of Gaussian i, the k-th of the workgroup, by one of its lanes: every LANES-th word.
fn step_GRID(i: u32, k: u32, lane: u32) -> vec3<f32> {
    var direction = vec3(0.0);
    for (var quad = lane; quad < QUADS_GRID; quad += LANES) {
        let at = i * QUADS_GRID + quad;
        let old = sh_GRID[at];
        var m = sh_GRID_m[at];
        var v = sh_GRID_v[at];
        let w = word_of(k, IMAGE_GRID, 4u * quad, old, COEFFICIENTS_GRID, NUMBERS_GRID);
        direction += w.direction;
        if (WRITE_GRADIENTS) {
            sh_GRID_m[at] = w.gradient;
        } else {
            let step = adam(w.gradient, &m, &v);
            sh_GRID[at] = old - w.rates * step;
            sh_GRID_m[at] = m;
            sh_GRID_v[at] = v;
        }
    }
    return direction;
}
