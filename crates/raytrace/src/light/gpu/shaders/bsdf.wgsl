// bsdf.rs: GGX over an energy-conserving Lambertian base. Behind the 256 entries of decoded bytes, `tables` holds the specular
// lobe's albedo (scale, bias) over cosine and roughness, then its means.

const TABLE_AT = 256u;
const COSINES = 64u;
const ROUGHNESSES = 32u;
const MEANS_AT = TABLE_AT + COSINES * ROUGHNESSES;
const MIN_ALPHA = 1e-3;
const WIDE_ALPHA = 0.4;
const WEAK_SHARE = 0.15;
const VERY_WIDE_ALPHA = 0.64;

struct Bsdf {
    diffuse: vec3<f32>,
    alpha: f32,
    f0: vec3<f32>,
    diffuse_scale: f32,
    albedo: vec3<f32>,
    base_transmittance: f32,
    v: vec3<f32>,
    specular_probability: f32,
}

struct BsdfSample {
    l: vec3<f32>,
    // 0 where there is none.
    pdf: f32,
    weight: vec3<f32>,
}

struct Value {
    value: vec3<f32>,
    pdf: f32,
}

fn table_row(alpha: f32) -> vec2<f32> {
    let y = min(sqrt(alpha), 1.0) * f32(ROUGHNESSES - 1u);
    let j = min(floor(y), f32(ROUGHNESSES - 2u));
    return vec2(j, y - j);
}

fn albedo_entry(v_z: f32, alpha: f32) -> vec2<f32> {
    let x = clamp(v_z, 0.0, 1.0) * f32(COSINES - 1u);
    let i = min(floor(x), f32(COSINES - 2u));
    let row = table_row(alpha);
    let at = TABLE_AT + u32(row.x) * COSINES + u32(i);
    let fx = x - i;
    let a = tables[at] + (tables[at + 1u] - tables[at]) * fx;
    let b = tables[at + COSINES] + (tables[at + COSINES + 1u] - tables[at + COSINES]) * fx;
    return a + (b - a) * row.y;
}

fn albedo_mean(alpha: f32) -> vec2<f32> {
    let row = table_row(alpha);
    let at = MEANS_AT + u32(row.x);
    return tables[at] + (tables[at + 1u] - tables[at]) * row.y;
}

// 1 / (1 − Ē).
fn diffuse_scale_of(f0_max: f32, alpha: f32) -> f32 {
    let mean = albedo_mean(alpha);
    return 1.0 / max(1.0 - (f0_max * mean.x + mean.y), 1e-4);
}

fn f0_of(base_color: vec3<f32>, metallic: f32, ior: f32) -> vec3<f32> {
    let r = (ior - 1.0) / (ior + 1.0);
    return vec3(r * r) + (base_color - vec3(r * r)) * metallic;
}

fn bsdf_of(base_color: vec3<f32>, metallic: f32, roughness: f32, ior: f32, v: vec3<f32>) -> Bsdf {
    let f0 = f0_of(base_color, metallic, ior);
    let diffuse = base_color * (1.0 - metallic);
    let alpha = max(roughness * roughness, MIN_ALPHA);
    let f0_max = max3(f0);
    let lobe = albedo_entry(v.z, alpha);
    let specular_albedo = f0 * lobe.x + vec3(lobe.y);
    let base_transmittance = max(1.0 - (f0_max * lobe.x + lobe.y), 0.0);
    let diffuse_albedo = diffuse * base_transmittance;
    let s = luminance(specular_albedo);
    let d = luminance(diffuse_albedo);
    var probability = 1.0;
    if (d > 0.0) { probability = clamp(s / (s + d), 0.1, 0.9); }
    return Bsdf(
        diffuse, alpha, f0, diffuse_scale_of(f0_max, alpha), specular_albedo + diffuse_albedo, base_transmittance, v, probability,
    );
}

fn ggx_d(h_z: f32, a2: f32) -> f32 {
    let c2 = h_z * h_z;
    let denominator = c2 * a2 + max(1.0 - c2, 0.0);
    return a2 * INVERSE_PI / max(denominator * denominator, 1e-30);
}

fn smith_lambda(z: f32, a2: f32) -> f32 {
    let c2 = max(z * z, 1e-12);
    return 0.5 * (sqrt(1.0 + a2 * max(1.0 - c2, 0.0) / c2) - 1.0);
}

fn evaluate_specular(bsdf: Bsdf, l: vec3<f32>) -> Value {
    let v = bsdf.v;
    if (l.z <= 0.0 || v.z <= 0.0) { return Value(vec3(0.0), 0.0); }
    let h = normalize_or(v + l, vec3(0.0, 0.0, 1.0));
    let v_h = clamp(dot(v, h), 0.0, 1.0);
    let a2 = bsdf.alpha * bsdf.alpha;
    let d = ggx_d(h.z, a2);
    let lambda_v = smith_lambda(v.z, a2);
    let lambda_l = smith_lambda(l.z, a2);
    let m = 1.0 - v_h;
    let fresnel = bsdf.f0 + (vec3(1.0) - bsdf.f0) * (m * m * m * m * m);
    return Value(fresnel * (d / ((1.0 + lambda_v + lambda_l) * 4.0 * v.z)), d / ((1.0 + lambda_v) * 4.0 * v.z));
}

// (1 − E(l)) / (1 − Ē).
fn received_weight(l_z: f32, alpha: f32, f0_max: f32, diffuse_scale: f32) -> f32 {
    let lobe = albedo_entry(l_z, alpha);
    return max(1.0 - (f0_max * lobe.x + lobe.y), 0.0) * diffuse_scale;
}

fn received_by(bsdf: Bsdf, l_z: f32) -> f32 {
    return received_weight(l_z, bsdf.alpha, max3(bsdf.f0), bsdf.diffuse_scale);
}

fn evaluate(bsdf: Bsdf, l: vec3<f32>) -> Value {
    if (l.z <= 0.0 || bsdf.v.z <= 0.0) { return Value(vec3(0.0), 0.0); }
    let specular = evaluate_specular(bsdf, l);
    let diffuse = bsdf.diffuse * (INVERSE_PI * l.z * bsdf.base_transmittance * received_by(bsdf, l.z));
    let p = bsdf.specular_probability;
    return Value(specular.value + diffuse, p * specular.pdf + (1.0 - p) * INVERSE_PI * l.z);
}

fn sample_cosine(u: vec2<f32>) -> vec3<f32> {
    return vec3(cos_sin_turns(u.y) * sqrt(u.x), sqrt(max(1.0 - u.x, 0.0)));
}

fn sample_visible_normal(v: vec3<f32>, alpha: f32, u: vec2<f32>) -> vec3<f32> {
    let stretched = normalize(vec3(v.x * alpha, v.y * alpha, v.z));
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let s = cos_sin_turns(u.x) * sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    let h = vec3(s, z) + stretched;
    return normalize(vec3(h.x * alpha, h.y * alpha, max(h.z, 1e-9)));
}

fn mirrored_direction(bsdf: Bsdf, u: vec2<f32>) -> vec3<f32> {
    let h = sample_visible_normal(bsdf.v, bsdf.alpha, u);
    return h * (2.0 * dot(bsdf.v, h)) - bsdf.v;
}

fn sampled(l: vec3<f32>, value: Value) -> BsdfSample {
    if (!(value.pdf > 0.0) || !is_finite(value.pdf)) { return BsdfSample(l, 0.0, vec3(0.0)); }
    return BsdfSample(l, value.pdf, value.value / value.pdf);
}

fn sample_specular(bsdf: Bsdf, u: vec2<f32>) -> BsdfSample {
    let l = mirrored_direction(bsdf, u);
    return sampled(l, evaluate_specular(bsdf, l));
}

fn sample_bsdf(bsdf: Bsdf, lobe: f32, u: vec2<f32>) -> BsdfSample {
    var l: vec3<f32>;
    if (lobe < bsdf.specular_probability) { l = mirrored_direction(bsdf, u); } else { l = sample_cosine(u); }
    return sampled(l, evaluate(bsdf, l));
}

fn diffuse_toward_viewer(bsdf: Bsdf) -> vec3<f32> {
    return bsdf.diffuse * bsdf.base_transmittance;
}

fn specular_share(bsdf: Bsdf) -> f32 {
    let d = luminance(diffuse_toward_viewer(bsdf));
    let s = luminance(bsdf.albedo) - d;
    if (s <= 0.0) { return 0.0; }
    return s / (s + d);
}

fn is_nearly_diffuse(bsdf: Bsdf) -> bool {
    return bsdf.alpha >= WIDE_ALPHA && specular_share(bsdf) < WEAK_SHARE;
}

fn has_wide_highlight(bsdf: Bsdf) -> bool {
    return bsdf.alpha >= VERY_WIDE_ALPHA && specular_share(bsdf) < WEAK_SHARE;
}

// The dominant direction of a wide highlight, in the shading frame.
fn wide_highlight_axis(bsdf: Bsdf) -> vec3<f32> {
    let smoothness = 1.0 - bsdf.alpha;
    let towards = smoothness * (sqrt(smoothness) + bsdf.alpha);
    let up = vec3(0.0, 0.0, 1.0);
    return normalize_or(up + (vec3(-bsdf.v.x, -bsdf.v.y, bsdf.v.z) - up) * towards, up);
}
