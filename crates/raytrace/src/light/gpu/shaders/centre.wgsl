// Depth and object at pixels' centres, by one exact ray through holes and panes.

const BARELY_HALF = 0.499999;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = group_number(id) * 64u + thread;
    if (place >= params.count) { return; }
    let pixel = pixel_at(params.first + place);
    if (pixel == NONE) { return; }
    let corner = vec2(f32(pixel % params.width), f32(pixel / params.width)) - params.centre;
    // z = 1 in the camera's frame, so t is the depth.
    let toward = (corner + vec2(0.5)) / params.focal;
    let direction = params.x_axis * toward.x + params.y_axis * toward.y + params.z_axis;
    let hit = closest_where(half_line(params.origin, direction), BARELY_HALF, false);
    sums[pixel].depth_m = hit.t;
    if (hit.triangle == NONE) {
        sums[pixel].object = NONE;
    } else {
        sums[pixel].object = attributes[hit.triangle].object;
    }
}
