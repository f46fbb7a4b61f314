// texture.rs: bilinear look-ups with wrap modes. The first 256 entries of `tables` are sRGB-decoded and linear values of a byte.

const REPEAT = 0u;
const MIRROR = 1u;
const CLAMP = 2u;

// The two texels around a coordinate along an axis of n texels, and the second one's weight.
struct Neighbours {
    first: i32,
    second: i32,
    weight: f32,
}

fn wrapped(i: i32, n: i32, wrap: u32) -> i32 {
    let last = n - 1;
    if (wrap == CLAMP) { return clamp(i, 0, last); }
    if (wrap == REPEAT) { return select(select(i, 0, i > last), last, i < 0); }
    if (i < 0 || i > 2 * last + 1) { return 0; }
    return select(i, 2 * last + 1 - i, i > last);
}

fn neighbours(coordinate: f32, size: u32, wrap: u32) -> Neighbours {
    var c = coordinate;
    switch (wrap) {
        case 0u: { c = c - floor(c); }
        case 1u: { c = c - 2.0 * floor(0.5 * c); }
        default: { c = clamp(c, -1.0, 2.0); }
    }
    let n = i32(size);
    let x = c * f32(size) - 0.5;
    let low = floor(x);
    return Neighbours(wrapped(i32(low), n, wrap), wrapped(i32(low) + 1, n, wrap), x - low);
}

fn texel(texture: Texture, x: i32, y: i32, is_color: bool) -> vec4<f32> {
    let bits = texels[texture.first + u32(y) * texture.width + u32(x)];
    let r = tables[bits & 255u];
    let g = tables[(bits >> 8u) & 255u];
    let b = tables[(bits >> 16u) & 255u];
    return vec4(select(vec3(r.y, g.y, b.y), vec3(r.x, g.x, b.x), is_color), f32(bits >> 24u) * (1.0 / 255.0));
}

// The value at a mesh's texture coordinate: colour decoded, alpha linear; white without a texture. `ahead` is the number of
// textures to look ahead:
// that of all of them for coarse ones.
fn sample_map(map: Map, uv_mesh: vec2<f32>, is_color: bool, ahead: u32) -> vec4<f32> {
    if (map.texture == NONE) { return vec4(1.0); }
    let texture = textures[map.texture + ahead];
    let uv = map.x_axis * uv_mesh.x + map.y_axis * uv_mesh.y + map.origin;
    if (texture.width == 0u || texture.height == 0u || !is_finite(uv.x) || !is_finite(uv.y)) { return vec4(1.0); }
    let column = neighbours(uv.x, texture.width, texture.mode & 3u);
    let row = neighbours(uv.y, texture.height, (texture.mode >> 2u) & 3u);
    var f = vec2(column.weight, row.weight);
    if ((texture.mode & 16u) != 0u) { f = select(vec2(0.0), vec2(1.0), f >= vec2(0.5)); }
    return texel(texture, column.first, row.first, is_color) * ((1.0 - f.x) * (1.0 - f.y))
        + texel(texture, column.second, row.first, is_color) * (f.x * (1.0 - f.y))
        + texel(texture, column.first, row.second, is_color) * ((1.0 - f.x) * f.y)
        + texel(texture, column.second, row.second, is_color) * (f.x * f.y);
}
