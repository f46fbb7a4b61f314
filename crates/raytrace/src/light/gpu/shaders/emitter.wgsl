// emitter.rs and triangle.rs: which emitter a point asks, and where on it.

const BUCKETS = 15u;
const FAR_M = 1e4;

struct LightSample {
    to_light: vec3<f32>,
    // Per steradian; below zero for lights without extent (infinite), 0 where there is no sample.
    pdf: f32,
    weight: vec3<f32>,
}

// A point of an emitting patch; `solid_angle` is 0 where there is none.
struct PatchPoint {
    position: vec3<f32>,
    solid_angle: f32,
    radiance: vec3<f32>,
}

struct Arriving {
    to_light: vec3<f32>,
    // Whether any light arrives.
    there: u32,
    irradiance: vec3<f32>,
}

fn cell_of(at: vec3<f32>) -> u32 {
    let cell = min(vec3<u32>(max((at - params.grid_min) * params.cells_per_metre, vec3(0.0))), params.cells - vec3(1u));
    return cell.x + params.cells.x * (cell.y + params.cells.y * cell.z);
}

// The emitter whose interval of a cell's distribution holds `choice`, or the number of emitters.
fn find_emitter(cell: u32, choice: f32) -> u32 {
    let bucket = min(u32(choice * f32(BUCKETS)), BUCKETS - 1u);
    let row = cell * params.emitters;
    var low = guides[cell * (BUCKETS + 1u) + bucket];
    var high = min(guides[cell * (BUCKETS + 1u) + bucket + 1u] + 1u, params.emitters);
    while (low < high) {
        let middle = (low + high) / 2u;
        if (cumulative[row + middle] <= choice) { low = middle + 1u; } else { high = middle; }
    }
    return low;
}

fn probability_of(cell: u32, i: u32) -> f32 {
    let at = cell * params.emitters + i;
    var before = 0.0;
    if (i > 0u) { before = cumulative[at - 1u]; }
    return cumulative[at] - before;
}

fn patch_index(parts: u32, u: f32, v: f32) -> u32 {
    let x = clamp(u, 0.0, 1.0) * f32(parts);
    let y = clamp(v, 0.0, 1.0) * f32(parts);
    let i = min(u32(x), parts - 1u);
    let j = min(u32(y), parts - 1u - i);
    let turned = (x - f32(i)) + (y - f32(j)) > 1.0 && i + j + 1u < parts;
    return 2u * parts * i - i * i + 2u * j + u32(turned);
}

// A point of a patch for uniform numbers, as seen from `at`.
fn patch_point(i: u32, at: vec3<f32>, u: vec2<f32>) -> PatchPoint {
    let e = emitters[i];
    let root = sqrt(u.x);
    let b1 = u.y * root;
    let b2 = 1.0 - root;
    let on_light = e.a * (1.0 - b1 - b2) + e.b * b1 + e.c * b2;
    let away = at - on_light;
    let distance2 = dot(away, away);
    let signed = dot(e.normal, away) / sqrt(distance2);
    let cosine = select(signed, abs(signed), (e.kind & DOUBLE_SIDED) != 0u);
    if (!(cosine > 1e-6) || distance2 < 1e-10) { return PatchPoint(vec3(0.0), 0.0, vec3(0.0)); }
    let weights = e.weight_a * (1.0 - b1 - b2) + e.weight_b * b1 + e.weight_c * b2;
    return PatchPoint(
        on_light + e.normal * (offset_at(on_light) * select(1.0, -1.0, signed < 0.0)),
        e.area * cosine / distance2,
        emission(e.triangle, weights.x, weights.y),
    );
}

// Vector to a light without extent and the irradiance that it sends at normal incidence.
fn punctual_at(i: u32, at: vec3<f32>) -> Arriving {
    let e = emitters[i];
    let kind = e.kind & 3u;
    if (kind == EMITTER_DIRECTIONAL) { return Arriving(-e.normal * FAR_M, 1u, e.power); }
    let to_light = e.a - at;
    let distance2 = max(dot(to_light, to_light), 1e-6);
    var falloff = 1.0 / distance2;
    if (e.range_m < INFINITE) {
        let r = distance2 / (e.range_m * e.range_m);
        falloff *= clamp(1.0 - r * r, 0.0, 1.0);
    }
    if (kind == EMITTER_SPOT) {
        let cosine = -dot(e.normal, to_light) / sqrt(distance2);
        let inside = clamp((cosine - e.cone.y) / max(e.cone.x - e.cone.y, 1e-3), 0.0, 1.0);
        falloff *= inside * inside;
    }
    return Arriving(to_light, u32(falloff > 0.0), e.power * falloff);
}

// Draws an emitter and a point on it.
fn sample_emitters(at: vec3<f32>, choice: f32, u: vec2<f32>) -> LightSample {
    if (params.emitters == 0u) { return LightSample(vec3(0.0), 0.0, vec3(0.0)); }
    let cell = cell_of(at);
    let i = find_emitter(cell, choice);
    if (i >= params.emitters) { return LightSample(vec3(0.0), 0.0, vec3(0.0)); }
    let probability = probability_of(cell, i);
    if (i < params.first_punctual) {
        let on_light = patch_point(i, at, u);
        if (on_light.solid_angle <= 0.0) { return LightSample(vec3(0.0), 0.0, vec3(0.0)); }
        let pdf = probability / on_light.solid_angle;
        return LightSample(on_light.position - at, pdf, on_light.radiance / pdf);
    }
    let light = punctual_at(i, at);
    if (light.there == 0u) { return LightSample(vec3(0.0), 0.0, vec3(0.0)); }
    return LightSample(light.to_light, -1.0, light.irradiance / probability);
}

// Density with which `sample_emitters` picks the direction of a hit.
fn emitters_pdf(at: vec3<f32>, hit: Hit, cosine: f32) -> f32 {
    let first = attributes[hit.triangle].emitter;
    if (first == NONE) { return 0.0; }
    let i = first + patch_index(attributes[hit.triangle].parts & ~WITHOUT_UV, hit.u, hit.v);
    return probability_of(cell_of(at), i) * hit.t * hit.t / max(emitters[i].area * cosine, 1e-20);
}
