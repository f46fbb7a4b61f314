// Depth and object at pixels' centres, by one exact ray through holes and panes.

const BARELY_HALF = 0.499999;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = group_number(id) * 64u + thread;
    if (place >= params.count) { return; }
    let item = item_at(params.first + place);
    if (item == NONE) { return; }
    let pixel = item % area();
    let from_view = params.viewpoints[item / area()];
    let corner = vec2(f32(pixel % params.width), f32(pixel / params.width)) - params.centre;
    // z = 1 in the camera's frame, so t is the depth.
    let toward = (corner + vec2(0.5)) / params.focal;
    let direction = from_view.x_axis * toward.x + from_view.y_axis * toward.y + from_view.z_axis;
    let hit = closest_where(half_line(from_view.origin, direction), BARELY_HALF, false);
    sums[item].depth_m = hit.t;
    if (hit.triangle == NONE) {
        sums[item].object = NONE;
    } else {
        sums[item].object = attributes[hit.triangle].object;
    }
}
