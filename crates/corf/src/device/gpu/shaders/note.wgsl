@group(0) @binding(9) var<storage, read_write> marks: array<Mark>;

// Notes that a dense step, which renders one image, sees Gaussian i, and where it would move in that image: dL/d(mean) in device coordinates.
fn note(i: u32, p: vec3<f32>, s: Shape, second: bool, first_moment: vec2<f32>) {
    marks[i].seen_by = params.marker;
    if (params.screen_gradients == 0u) { return; }
    let grid = params.grids[u32(second)];
    let q = conic_of(ellipse_of(grid, p, s));
    let d_mean = vec2(dot(q.xy, first_moment), dot(q.yz, first_moment)) * 0.5 * vec2<f32>(grid.size);
    marks[i].norm_sum += length(d_mean);
    marks[i].steps += 1u;
}
