// depth/view.rs: where a patch of one view lands in another.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage> views: array<ViewRow>;
@group(0) @binding(2) var<storage> words: array<u32>;
@group(0) @binding(3) var<storage> starts: array<StartRow>;
@group(0) @binding(4) var<storage, read_write> found: array<f32>;

// Stands for a correlation where a patch lands outside; less than any.
const MISSED = -2.0;
// Stands for an inverse depth where there is none.
const NONE = -1.0;

struct Warp {
    center: vec2<f32>,
    // Derivatives by the position in the image that is left.
    x: vec2<f32>,
    y: vec2<f32>,
    // Whether it is before the camera.
    before: bool,
}

fn ray_of(image: ImageRow, position: vec2<f32>) -> vec3<f32> {
    return vec3((position - image.centre) / image.focal, 1.0);
}

// The point ray / w; w times it has the same image.
fn point_of(pose: PoseRow, ray: vec3<f32>, w: f32) -> vec3<f32> {
    return pose.x_axis * ray.x + pose.y_axis * ray.y + pose.z_axis * ray.z + pose.translation * w;
}

// A plane whose inverse depth at the ray is w and changes by `slope` per pixel of an image of focal lengths `focal`.
fn warp(pose: PoseRow, focal: vec2<f32>, to: ImageRow, ray: vec3<f32>, w: f32, slope: vec2<f32>) -> Warp {
    let p = point_of(pose, ray, w);
    let before = p.z > 1e-3;
    let z = select(1.0, p.z, before);
    let q = p.xy / z;
    let du = pose.x_axis / focal.x + pose.translation * slope.x;
    let dv = pose.y_axis / focal.y + pose.translation * slope.y;
    let f = to.focal / z;
    return Warp(to.focal * q + to.centre, f * (du.xy - q * du.z), f * (dv.xy - q * dv.z), before);
}

// Whether all pixels of a rectangle inside an image count, from its first to its last.
fn counts(image: ImageRow, first: vec2<u32>, last: vec2<u32>) -> bool {
    if (image.left_out_at == ALL_COUNT) { return true; }
    let row = image.size.x + 1u;
    let above = image.left_out_at + first.y * row;
    let below = image.left_out_at + (last.y + 1u) * row;
    return words[below + last.x + 1u] + words[above + first.x] == words[below + first.x] + words[above + last.x + 1u];
}

fn lands_inside(image: ImageRow, warp: Warp) -> bool {
    if (!warp.before) { return false; }
    let reach = f32(RADIUS) * (abs(warp.x) + abs(warp.y));
    let low = warp.center - 0.5 - reach;
    let high = warp.center - 0.5 + reach;
    if (!(all(low >= vec2(0.0)) && all(high < vec2<f32>(image.size) - 1.0))) { return false; }
    return counts(image, vec2<u32>(low), vec2<u32>(high) + 1u);
}
