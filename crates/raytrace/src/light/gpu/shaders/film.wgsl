// Camera rays, and what a pixel has gathered.

const FILM = 0u;
const FIRST_VERTEX = 1u;
const PAIRS_PER_VERTEX = 4u;
const PAIR_CHOICES = 0u;
const PAIR_LIGHT = 1u;
const PAIR_DIRECTION = 2u;
const PAIR_FATE = 3u;
const MAX_EVENTS = 64u;

struct Sums {
    radiance: vec3<f32>,
    n: u32,
    lamp: vec3<f32>,
    lamps: u32,
    albedo: vec3<f32>,
    // Welford's mean and squares of the developed luminance.
    mean: f32,
    normal: vec3<f32>,
    squares: f32,
    // Rays shot: bounces, towards emitters.
    bounces: u32,
    shadows: u32,
    depth_m: f32,
    object: u32,
}

// Slots of `work`: lengths of both lists, tiles that are wanted, whether a pixel's radiance is no number; then the numbers of
// those tiles; at `lists_at` the lists of pixels and the number of paths that each wants.
const LENGTHS = 0u;
const WANTED = 2u;
const NOT_FINITE = 3u;
const WANTED_AT = 16u;

// One path from the camera.
struct Path {
    ray: Ray,
    throughput: vec3<f32>,
    // Density of the last direction, below zero where emitters cannot be, or were not, asked for it.
    pdf: f32,
    radiance: vec3<f32>,
    event: u32,
    albedo: vec3<f32>,
    scattered: u32,
    normal: vec3<f32>,
    // Until the first surface that is no pane.
    straight: bool,
    // Whether it saw an emitter or the background directly.
    lamp: bool,
    // Whether what the ray meets is looked up coarsely.
    wide: bool,
    // Width of the ray's cone at its origin, metres, and how it grows.
    width_m: f32,
    cone_rad: f32,
}

var<private> bounces: u32;
var<private> shadows: u32;
// Whether a tile that a path asked for was not there.
var<private> lacking: bool;

fn begin(ray: Ray) -> Path {
    let none = vec3(0.0);
    return Path(ray, vec3(1.0), -1.0, none, 0u, none, 0u, none, true, false, false, 0.0, 1.0 / params.focal.x);
}

fn camera_ray(pixel: u32, within: vec2<f32>) -> Ray {
    let corner = vec2(f32(pixel % params.width), f32(pixel / params.width)) - params.centre;
    let toward = normalize(vec3((corner + within) / params.focal, 1.0));
    return half_line(params.origin, params.x_axis * toward.x + params.y_axis * toward.y + params.z_axis * toward.z);
}

// The pixel at a place of the list of all pixels, in blocks of 8×8; NONE beyond the edge.
fn pixel_at(place: u32) -> u32 {
    let blocks = (params.width + 7u) / 8u;
    let block = place / 64u;
    let x = (block % blocks) * 8u + place % 8u;
    let y = (block / blocks) * 8u + (place % 64u) / 8u;
    return select(NONE, y * params.width + x, x < params.width && y < params.height);
}
