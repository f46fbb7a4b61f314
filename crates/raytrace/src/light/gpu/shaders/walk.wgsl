// cache/walk.rs: a ray's way from a diffuse surface through mirrors, panes and highlights to the next one.

const PAIRS_PER_VERTEX = 4u;
const PAIR_CHOICES = 0u;
const PAIR_LIGHT = 1u;
const PAIR_DIRECTION = 2u;
const PAIR_FATE = 3u;
const MAX_EVENTS = 64u;
const MAX_HIGHLIGHTS = 6u;
// Those before belong to a walk's start.
const FIRST_WALK_PAIR = 2u;

struct Walk {
    // Light met on the way.
    light: vec3<f32>,
    // Whether the first surface hides where the walk began.
    buried: bool,
    // Share of what the surface at the end receives that arrives where the walk began; zero where there is no end.
    throughput: vec3<f32>,
    normal: vec3<f32>,
    spot: Spot,
}

fn walk(start: Ray, near_m: f32, draws: Draws, first_pair: u32) -> Walk {
    var result = Walk(vec3(0.0), false, vec3(0.0), vec3(0.0), Spot(0u, 0u, vec2(0.0)));
    var ray = start;
    var throughput = vec3(1.0);
    var highlights = 0u;
    var is_direct = true;
    var pdf = -1.0;
    for (var event = 0u; event < MAX_EVENTS; event++) {
        let hit = closest(ray);
        if (hit.triangle == NONE) {
            result.light += throughput * params.background;
            break;
        }
        let surface = surface_at(ray, hit, true);
        if (!is_direct && any(surface.emitted != vec3(0.0))) {
            result.light += throughput * surface.emitted * (chance_weight(surface, ray, hit, pdf) * surface.coverage);
        }
        let dimension = first_pair + PAIRS_PER_VERTEX * event;
        let fated = pair(draws, dimension + PAIR_FATE);
        let fate = fate_of(surface, ray, fated.x);
        if (fate == ABSENT || fate == PASSES) {
            if (fate == PASSES) { throughput *= surface.base_color; }
            ray.t_min = hit.t + offset_at(surface.position);
            continue;
        }
        if (fate == MIRRORED) {
            ray = mirrored_ray(surface, ray);
            is_direct = false;
            pdf = -1.0;
            continue;
        }
        if (is_direct) { result.buried = buries(ray, hit, near_m); }
        let world_from_local = frame_of(surface.normal);
        let bsdf = reflection(surface, ray, fate, world_from_local);
        let share = specular_share(bsdf);
        let folded = is_nearly_diffuse(bsdf);
        var specular = select(clamp(share, 0.0, 0.9), 1.0, share >= 1.0);
        if (folded) { specular = 0.0; }
        if (fated.y >= specular) {
            let reflected = select(diffuse_toward_viewer(bsdf), bsdf.albedo, folded);
            result.throughput = throughput * reflected / (1.0 - specular);
            result.normal = surface.normal;
            result.spot = spot_of(surface, hit.triangle);
            break;
        }
        if (highlights >= MAX_HIGHLIGHTS) { break; }
        highlights += 1u;
        throughput /= specular;
        let asks = asks_emitters(bsdf);
        if (asks) {
            let choices = pair(draws, dimension + PAIR_CHOICES);
            let u = pair(draws, dimension + PAIR_LIGHT);
            result.light += throughput * highlight(surface, world_from_local, bsdf, choices.x, u);
        }
        let next = sample_specular(bsdf, pair(draws, dimension + PAIR_DIRECTION));
        if (next.pdf <= 0.0) { break; }
        let direction = normalize(world_from_local * next.l);
        if (dot(surface.geometric_normal, direction) <= 0.0) { break; }
        throughput *= next.weight;
        is_direct = false;
        pdf = select(-1.0, next.pdf, asks);
        ray = half_line(leave(surface, direction), direction);
    }
    return result;
}

const LEAST_COS = 0.1;

// The vector that stands for light out of a cosine-distributed direction.
fn spread(normal: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    let cosine = dot(direction, normal);
    return normal + (direction - normal * cosine) / max(cosine, LEAST_COS);
}
