// One step of an image's harmonics of Gaussian i, the k-th of the workgroup, by one of its lanes: every LANES-th word.
fn step_GRID(i: u32, k: u32, lane: u32) -> vec3<f32> {
    var direction = vec3(0.0);
    for (var quad = lane; quad < QUADS_GRID; quad += LANES) {
        let at = i * QUADS_GRID + quad;
        let old = sh_GRID[at];
        // Behind a Gaussian's first moments are the second.
        let first = 2u * i * QUADS_GRID + quad;
        var m = moments_GRID[first];
        var v = moments_GRID[first + QUADS_GRID];
        let w = word_of(k, IMAGE_GRID, 4u * quad, old, COEFFICIENTS_GRID, NUMBERS_GRID);
        direction += w.direction;
        STORE
    }
    return direction;
}
