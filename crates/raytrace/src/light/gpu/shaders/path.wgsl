// path.rs: one event of an unbiased path; whether it goes on.

const MAX_SURVIVAL = 0.95;

fn add_light(path: ptr<function, Path>, light: vec3<f32>) {
    if (!all_finite(light)) { return; }
    (*path).radiance += light;
    if ((*path).straight && any(light != vec3(0.0))) { (*path).lamp = true; }
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
        if ((*path).straight) { (*path).albedo = vec3(1.0); }
        return false;
    }
    let surface = surface_at(ray, hit, false);
    if (any(surface.emitted != vec3(0.0))) {
        var weight = 1.0;
        if ((*path).pdf >= 0.0 && params.next_event != 0u) {
            let cosine = abs(dot(surface.geometric_normal, ray.direction));
            weight = power_heuristic((*path).pdf, emitters_pdf(ray.origin, hit, cosine));
        }
        add_light(path, (*path).throughput * surface.emitted * (weight * surface.coverage));
    }
    let dimension = FIRST_VERTEX + PAIRS_PER_VERTEX * event;
    let fated = pair(draws, dimension + PAIR_FATE);
    let fate = fate_of(surface, ray, fated.x);
    if (fate == ABSENT || fate == PASSES) {
        if (fate == PASSES) { (*path).throughput *= surface.base_color; }
        (*path).ray.t_min = hit.t + offset_at(surface.position);
        return true;
    }
    if (fate == MIRRORED) {
        if ((*path).straight) {
            (*path).albedo = vec3(1.0);
            (*path).normal = surface.geometric_normal;
        }
        (*path).straight = false;
        if ((*path).scattered >= params.max_bounces) { return false; }
        (*path).scattered += 1u;
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
    if ((*path).scattered >= params.max_bounces) { return false; }
    (*path).scattered += 1u;
    let choices = pair(draws, dimension + PAIR_CHOICES);
    if (params.next_event != 0u) {
        let light = sample_emitters(surface.position, choices.x, pair(draws, dimension + PAIR_LIGHT));
        if (light.pdf != 0.0) {
            let direction = normalize(light.to_light);
            let reflected = evaluate(bsdf, direction * world_from_local);
            let weight = (*path).throughput * reflected.value * light.weight * power_heuristic(light.pdf, reflected.pdf);
            if (any(weight != vec3(0.0)) && dot(surface.geometric_normal, direction) > 0.0) {
                shadows += 1u;
                add_light(path, weight * transmittance(segment(leave(surface, direction), surface.position + light.to_light)));
            }
        }
    }
    let next = sample_bsdf(bsdf, choices.y, pair(draws, dimension + PAIR_DIRECTION));
    if (next.pdf <= 0.0) { return false; }
    let direction = normalize(world_from_local * next.l);
    if (dot(surface.geometric_normal, direction) <= 0.0) { return false; }
    (*path).throughput *= next.weight;
    (*path).pdf = next.pdf;
    if ((*path).scattered > params.roulette_after) {
        let survival = min(max3((*path).throughput), MAX_SURVIVAL);
        if (fated.y >= survival) { return false; }
        (*path).throughput /= survival;
    }
    (*path).ray = half_line(leave(surface, direction), direction);
    return true;
}
