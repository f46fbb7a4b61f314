// develop.rs: what a pixel gathered, as 8-bit sRGB, depth and object: three planes of words an image. Says where radiance is no number.

fn exposed(radiance: vec3<f32>, share: f32) -> vec3<f32> {
    if (share <= 0.0) { return vec3(0.0); }
    let x = max(radiance / share * params.gain, vec3(0.0));
    return share * vec3(shoulder(x.x), shoulder(x.y), shoulder(x.z));
}

fn byte(linear: f32) -> u32 {
    return u32(clamp(srgb_from_linear(linear), 0.0, 1.0) * 255.0 + 0.5);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let item = params.first + group_number(id) * 64u + thread;
    if (item >= area() * params.views) { return; }
    let view = item / area();
    let sum = sums[item];
    let share = 1.0 / f32(max(sum.n, 1u));
    let radiance = sum.radiance * share;
    if (!all_finite(radiance)) { atomicOr(&work[NOT_FINITE], 1u << view); }
    let lamp = sum.lamp * share;
    let lamps = f32(sum.lamps) * share;
    let color = exposed(lamp, lamps) + exposed(radiance - lamp, 1.0 - lamps);
    let at = item + 2u * view * area();
    picture[at] = byte(color.x) | (byte(color.y) << 8u) | (byte(color.z) << 16u);
    picture[at + area()] = bitcast<u32>(sum.depth_m);
    picture[at + 2u * area()] = sum.object;
}
