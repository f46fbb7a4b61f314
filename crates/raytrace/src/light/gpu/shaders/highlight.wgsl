// cache/walk.rs: light of emitters in highlights.

const ROUGH_ALPHA = 0.02;

fn has_punctual_lights() -> bool {
    return params.first_punctual < params.emitters;
}

fn asks_emitters(bsdf: Bsdf) -> bool {
    return (bsdf.alpha >= ROUGH_ALPHA && params.emitters > 0u) || has_punctual_lights();
}

fn highlight(surface: Surface, world_from_local: mat3x3<f32>, bsdf: Bsdf, choice: f32, u: vec2<f32>) -> vec3<f32> {
    let light = sample_emitters(surface.position, choice, u);
    if (light.pdf == 0.0) { return vec3(0.0); }
    let direction = normalize(light.to_light);
    let reflected = evaluate_specular(bsdf, direction * world_from_local);
    let weight = reflected.value * light.weight * power_heuristic(light.pdf, reflected.pdf);
    if (all(weight == vec3(0.0)) || dot(surface.geometric_normal, direction) <= 0.0) { return vec3(0.0); }
    shadows += 1u;
    return weight * transmittance(segment(leave(surface, direction), surface.position + light.to_light));
}

// Weight of an emitter met by chance, by a ray whose direction had density `pdf`; below zero where emitters were not asked.
fn chance_weight(surface: Surface, ray: Ray, hit: Hit, pdf: f32) -> f32 {
    if (pdf < 0.0) { return 1.0; }
    return power_heuristic(pdf, emitters_pdf(ray.origin, hit, abs(dot(surface.geometric_normal, ray.direction))));
}
