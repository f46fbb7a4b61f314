// surface.rs: shading data of a hit.

const OFFSET = 1e-5;
const MIN_VISIBLE_COS = 0.01;

struct Surface {
    position: vec3<f32>,
    metallic: f32,
    geometric_normal: vec3<f32>,
    roughness: f32,
    normal: vec3<f32>,
    transmission: f32,
    base_color: vec3<f32>,
    ior: f32,
    emitted: vec3<f32>,
    coverage: f32,
}

const ABSENT = 0u;
const PASSES = 1u;
const MIRRORED = 2u;
const MEETS_BASE = 3u;
const MEETS = 4u;

fn uv_at(number: u32, u: f32, v: f32) -> vec2<f32> {
    let a = attributes[number];
    return a.uv_a * (1.0 - u - v) + a.uv_b * u + a.uv_c * v;
}

fn color_at(number: u32, u: f32, v: f32) -> vec4<f32> {
    if (!COLORS) { return vec4(1.0); }
    return colors[3u * number] * (1.0 - u - v) + colors[3u * number + 1u] * u + colors[3u * number + 2u] * v;
}

fn coverage(number: u32, u: f32, v: f32) -> f32 {
    let material = attributes[number].material;
    let mode = materials[material].alpha_mode;
    if (mode == 0u) { return 1.0; }
    let alpha = materials[material].alpha * sample_map(materials[material].base_color_map, uv_at(number, u, v), true, 0u).w
        * color_at(number, u, v).w;
    if (mode == 1u) { return select(0.0, 1.0, alpha >= materials[material].cutoff); }
    return clamp(alpha, 0.0, 1.0);
}

fn emitted_at(material: u32, uv: vec2<f32>) -> vec3<f32> {
    let emissive = materials[material].emissive;
    if (all(emissive == vec3(0.0))) { return emissive; }
    return emissive * sample_map(materials[material].emissive_map, uv, true, 0u).xyz;
}

// Emitted radiance at barycentric weights, times the share that is there.
fn emission(number: u32, u: f32, v: f32) -> vec3<f32> {
    var emitted = emitted_at(attributes[number].material, uv_at(number, u, v));
    if (!ALL_OPAQUE && (triangles[number].cover & COVER_ALPHA) != 0u) { emitted *= coverage(number, u, v); }
    return emitted;
}

fn facing_of(number: u32) -> vec3<f32> {
    let t = triangles[number];
    return normalize_or(cross(t.b - t.a, t.c - t.a), vec3(0.0, 0.0, 1.0));
}

fn fresnel_dielectric(cosine: f32, ior: f32) -> f32 {
    let sin2_t = max(1.0 - cosine * cosine, 0.0) / (ior * ior);
    if (sin2_t >= 1.0) { return 1.0; }
    let cos_t = sqrt(1.0 - sin2_t);
    let parallel = (ior * cosine - cos_t) / (ior * cosine + cos_t);
    let perpendicular = (cosine - ior * cos_t) / (cosine + ior * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

fn fresnel_pane(cosine: f32, ior: f32) -> f32 {
    let r = fresnel_dielectric(cosine, ior);
    return 2.0 * r / (1.0 + r);
}

fn pane_transmittance(hit: Hit, direction: vec3<f32>) -> vec3<f32> {
    let material = attributes[hit.triangle].material;
    let cosine = abs(dot(facing_of(hit.triangle), normalize(direction)));
    let uv = uv_at(hit.triangle, hit.u, hit.v);
    let tint = materials[material].base_color * color_at(hit.triangle, hit.u, hit.v).xyz
        * sample_map(materials[material].base_color_map, uv, true, 0u).xyz;
    return tint * (materials[material].transmission * (1.0 - fresnel_pane(cosine, materials[material].ior)));
}

fn mapped_normal(number: u32, material: u32, uv: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    let a = attributes[number];
    if ((a.parts & WITHOUT_UV) != 0u) { return n; }
    let map = materials[material].normal_map;
    let d1 = map.x_axis * (a.uv_b.x - a.uv_a.x) + map.y_axis * (a.uv_b.y - a.uv_a.y);
    let d2 = map.x_axis * (a.uv_c.x - a.uv_a.x) + map.y_axis * (a.uv_c.y - a.uv_a.y);
    let determinant = d1.x * d2.y - d1.y * d2.x;
    if (abs(determinant) < 1e-20) { return n; }
    let t = triangles[number];
    let e1 = t.b - t.a;
    let e2 = t.c - t.a;
    let along_u = (e1 * d2.y - e2 * d1.y) / determinant;
    let along_v = (e2 * d1.x - e1 * d2.x) / determinant;
    let flat = along_u - n * dot(n, along_u);
    if (dot(flat, flat) <= 1e-36) { return n; }
    let tangent = normalize(flat);
    let handed = select(-1.0, 1.0, dot(cross(n, tangent), along_v) < 0.0);
    let sampled = sample_map(map, uv, false, 0u).xyz;
    let scale = materials[material].normal_scale;
    let m = vec3((2.0 * sampled.x - 1.0) * scale, (2.0 * sampled.y - 1.0) * scale, 2.0 * sampled.z - 1.0);
    return normalize_or(tangent * m.x + cross(n, tangent) * (handed * m.y) + n * m.z, n);
}

// With `coarse`, colour comes from the coarse textures and normal maps are left out.
fn surface_at(ray: Ray, hit: Hit, coarse: bool) -> Surface {
    let number = hit.triangle;
    let t = triangles[number];
    let a = attributes[number];
    let m = a.material;
    let w = 1.0 - hit.u - hit.v;
    let facing = facing_of(number);
    let front = dot(facing, ray.direction) < 0.0;
    let side = select(-1.0, 1.0, front);
    let uv = a.uv_a * w + a.uv_b * hit.u + a.uv_c * hit.v;
    let base_texel = sample_map(materials[m].base_color_map, uv, true, select(0u, params.textures, coarse));
    let base = materials[m].base_color * color_at(number, hit.u, hit.v).xyz * base_texel.xyz;
    let data = sample_map(materials[m].metallic_roughness_map, uv, false, 0u);
    var n = normalize_or(a.normal_a * w + a.normal_b * hit.u + a.normal_c * hit.v, facing);
    if (dot(n, facing) < 0.0) { n = -n; }
    if (!coarse && materials[m].normal_map.texture != NONE) { n = mapped_normal(number, m, uv, n); }
    n *= side;
    let visible = -dot(n, ray.direction);
    if (visible < MIN_VISIBLE_COS) { n = normalize_or(n + ray.direction * (visible - MIN_VISIBLE_COS), facing * side); }
    var there = 1.0;
    if (!ALL_OPAQUE && (t.cover & COVER_ALPHA) != 0u) { there = coverage(number, hit.u, hit.v); }
    var emitted = vec3(0.0);
    if (front || materials[m].double_sided != 0u) { emitted = emitted_at(m, uv); }
    return Surface(
        t.a * w + t.b * hit.u + t.c * hit.v,
        clamp(materials[m].metallic * data.z, 0.0, 1.0),
        facing * side,
        clamp(materials[m].roughness * data.y, 0.0, 1.0),
        n,
        clamp(materials[m].transmission, 0.0, 1.0),
        clamp(base, vec3(0.0), vec3(1.0)),
        max(materials[m].ior, 1.0),
        emitted,
        there,
    );
}

fn fate_of(surface: Surface, ray: Ray, number: f32) -> u32 {
    if (number >= surface.coverage) { return ABSENT; }
    let u = number / surface.coverage;
    if (surface.transmission <= 0.0) { return MEETS; }
    let reflectance = fresnel_pane(abs(dot(surface.geometric_normal, ray.direction)), surface.ior);
    let through = (1.0 - reflectance) * surface.transmission;
    if (u < through) { return PASSES; }
    return select(MEETS_BASE, MIRRORED, u < through + reflectance);
}

fn offset_at(position: vec3<f32>) -> f32 {
    return OFFSET * (1.0 + max3(abs(position)));
}

// A point off the surface on the side of a direction, from which a ray does not hit it again.
fn leave(surface: Surface, direction: vec3<f32>) -> vec3<f32> {
    let side = select(1.0, -1.0, dot(surface.geometric_normal, direction) < 0.0);
    return surface.position + surface.geometric_normal * (side * offset_at(surface.position));
}

fn mirrored_ray(surface: Surface, ray: Ray) -> Ray {
    let n = surface.geometric_normal;
    let direction = ray.direction - n * (2.0 * dot(n, ray.direction));
    return half_line(leave(surface, direction), direction);
}

// world_from_local of a shading frame.
fn frame_of(n: vec3<f32>) -> mat3x3<f32> {
    let across = orthonormal_pair(n);
    return mat3x3(across[0], across[1], n);
}

fn reflection(surface: Surface, ray: Ray, fate: u32, world_from_local: mat3x3<f32>) -> Bsdf {
    let v = -ray.direction * world_from_local;
    if (fate == MEETS_BASE) { return bsdf_of(surface.base_color, 0.0, 1.0, 1.0, v); }
    return bsdf_of(surface.base_color, surface.metallic, surface.roughness, surface.ior, v);
}
