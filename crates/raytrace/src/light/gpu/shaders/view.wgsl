// cache/view.rs: one event of a camera path that ends in cached light; whether it goes on.

const HIGHLIGHT_EFFORT = 4.0;
const LEAST_EFFORT = 0.05;
const CONE = 0.5;
const FEW_PUNCTUAL = 4u;
const WIDE_RAY_PDF = 10.0;

fn add_light(path: ptr<function, Path>, light: vec3<f32>) {
    if (all_finite(light)) { (*path).radiance += light; }
}

// Radiance, before shadows, that a light without extent sends to the viewer by way of a surface.
fn arriving(i: u32, surface: Surface, world_from_local: mat3x3<f32>, bsdf: Bsdf, with_highlight: bool) -> Arriving {
    var light = punctual_at(i, surface.position);
    let direction = normalize(light.to_light);
    let l = direction * world_from_local;
    if (light.there == 0u || l.z <= 0.0 || dot(direction, surface.geometric_normal) <= 0.0) {
        return Arriving(light.to_light, 0u, vec3(0.0));
    }
    var value = diffuse_toward_viewer(bsdf) * (l.z * received_by(bsdf, l.z) * INVERSE_PI);
    if (with_highlight) { value += evaluate_specular(bsdf, l).value; }
    light.irradiance *= value;
    return light;
}

fn passed(surface: Surface, light: Arriving) -> vec3<f32> {
    shadows += 1u;
    return light.irradiance * transmittance(segment(leave(surface, light.to_light), surface.position + light.to_light));
}

fn punctual_light(surface: Surface, world_from_local: mat3x3<f32>, bsdf: Bsdf, with_highlight: bool, u: f32) -> vec3<f32> {
    var sum = vec3(0.0);
    if (params.emitters - params.first_punctual <= FEW_PUNCTUAL) {
        for (var i = params.first_punctual; i < params.emitters; i++) {
            let light = arriving(i, surface, world_from_local, bsdf, with_highlight);
            if (light.there != 0u) { sum += passed(surface, light); }
        }
        return sum;
    }
    var total = 0.0;
    for (var i = params.first_punctual; i < params.emitters; i++) {
        total += luminance(arriving(i, surface, world_from_local, bsdf, with_highlight).irradiance);
    }
    var left = u * total;
    for (var i = params.first_punctual; i < params.emitters; i++) {
        let light = arriving(i, surface, world_from_local, bsdf, with_highlight);
        let share = luminance(light.irradiance);
        if (light.there != 0u && left < share) { return passed(surface, light) * (total / share); }
        left -= share;
    }
    return vec3(0.0);
}

fn advance(path: ptr<function, Path>, draws: Draws) -> bool {
    let event = (*path).event;
    if (event >= MAX_EVENTS) { return false; }
    (*path).event = event + 1u;
    bounces += u32(event > 0u);
    let ray = (*path).ray;
    let hit = closest(ray);
    if (hit.triangle == NONE) {
        add_light(path, (*path).throughput * params.background);
        if ((*path).straight) {
            (*path).lamp = true;
            (*path).albedo = vec3(1.0);
        }
        return false;
    }
    let surface = surface_at(ray, hit, (*path).wide);
    let dimension = FIRST_VERTEX + PAIRS_PER_VERTEX * event;
    let fated = pair(draws, dimension + PAIR_FATE);
    let fate = fate_of(surface, ray, fated.x);
    if (fate != ABSENT && any(surface.emitted != vec3(0.0))) {
        add_light(path, (*path).throughput * surface.emitted * chance_weight(surface, ray, hit, (*path).pdf));
        (*path).lamp = (*path).lamp || (*path).straight;
    }
    if (fate == ABSENT || fate == PASSES) {
        if (fate == PASSES) { (*path).throughput *= surface.base_color; }
        (*path).ray.t_min = hit.t + offset_at(surface.position);
        return true;
    }
    (*path).width_m += (*path).cone_rad * hit.t;
    if (fate == MIRRORED) {
        if ((*path).straight) {
            (*path).albedo = vec3(1.0);
            (*path).normal = surface.geometric_normal;
        }
        (*path).straight = false;
        (*path).ray = mirrored_ray(surface, ray);
        (*path).pdf = -1.0;
        return true;
    }
    let world_from_local = frame_of(surface.normal);
    let bsdf = reflection(surface, ray, fate, world_from_local);
    if ((*path).straight) {
        (*path).albedo = bsdf.albedo * (*path).throughput;
        (*path).normal = surface.normal;
        (*path).straight = false;
    }
    // Met by a wide ray, a weak highlight is as good as diffuse; a very wide one is read off the received light in any case.
    let folded = (*path).wide && is_nearly_diffuse(bsdf);
    let is_wide_highlight = !folded && has_wide_highlight(bsdf);
    let base = (*path).throughput * select(diffuse_toward_viewer(bsdf), bsdf.albedo, folded);
    let choices = pair(draws, dimension + PAIR_CHOICES);
    if (any(base != vec3(0.0))) {
        let answer = received_on(surface, hit.triangle, (*path).width_m);
        add_light(path, base * received_at(answer.received, surface.normal));
        if (is_wide_highlight) {
            let axis = wide_highlight_axis(bsdf);
            let albedo = bsdf.albedo - diffuse_toward_viewer(bsdf);
            add_light(path, (*path).throughput * albedo * received_at(answer.received, world_from_local * axis) / axis.z);
        }
        if (!answer.has_punctual && has_punctual_lights()) {
            add_light(path, (*path).throughput * punctual_light(surface, world_from_local, bsdf, is_wide_highlight, choices.y));
        }
    }
    let share = specular_share(bsdf);
    let keep = clamp(HIGHLIGHT_EFFORT * share * luminance((*path).throughput), LEAST_EFFORT, 1.0);
    if (folded || is_wide_highlight || share <= 0.0 || fated.y >= keep) { return false; }
    (*path).throughput /= keep;
    let asks = asks_emitters(bsdf);
    if (asks) {
        let u = pair(draws, dimension + PAIR_LIGHT);
        add_light(path, (*path).throughput * highlight(surface, world_from_local, bsdf, choices.x, u));
    }
    let next = sample_specular(bsdf, pair(draws, dimension + PAIR_DIRECTION));
    if (next.pdf <= 0.0) { return false; }
    let direction = normalize(world_from_local * next.l);
    if (dot(surface.geometric_normal, direction) <= 0.0) { return false; }
    (*path).throughput *= next.weight;
    (*path).pdf = select(-1.0, next.pdf, asks);
    (*path).wide = (*path).wide || next.pdf < WIDE_RAY_PDF;
    (*path).cone_rad = max((*path).cone_rad, CONE / sqrt(next.pdf));
    (*path).ray = half_line(leave(surface, direction), direction);
    return true;
}
