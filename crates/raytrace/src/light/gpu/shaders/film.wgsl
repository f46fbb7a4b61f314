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

// Slots of `work`: lengths of both lists, tiles that are wanted, whether an image's radiance is no number (a bit each); how many
// pixels want `base` paths doubled so often, and how many of those are in the list; then the numbers of the tiles; at `lists_at`
// the lists of items and the number of paths that each wants.
const LENGTHS = 0u;
const WANTED = 2u;
const NOT_FINITE = 3u;
const COUNTS = 16u;
const CURSORS = 48u;
const WANTED_AT = 80u;

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

fn area() -> u32 {
    return params.width * params.height;
}

// Key of a view's random numbers.
fn frame_of_view(view: u32) -> vec2<u32> {
    return vec2(params.viewpoints[view].frame_low, params.viewpoints[view].frame_high);
}

fn camera_ray(view: u32, pixel: u32, within: vec2<f32>) -> Ray {
    let corner = vec2(f32(pixel % params.width), f32(pixel / params.width)) - params.centre;
    let toward = normalize(vec3((corner + within) / params.focal, 1.0));
    let from_view = params.viewpoints[view];
    return half_line(from_view.origin, from_view.x_axis * toward.x + from_view.y_axis * toward.y + from_view.z_axis * toward.z);
}

// The item at a place of the list of all pixels, in blocks of 8×8; NONE beyond an edge.
fn item_at(place: u32) -> u32 {
    let blocks = (params.width + 7u) / 8u;
    let places = blocks * ((params.height + 7u) / 8u) * 64u;
    let view = place / places;
    let within = place % places;
    let block = within / 64u;
    let x = (block % blocks) * 8u + within % 8u;
    let y = (block / blocks) * 8u + (within % 64u) / 8u;
    let item = view * area() + y * params.width + x;
    return select(NONE, item, x < params.width && y < params.height && view < params.views);
}

// Place in `work` of how many paths an item wants.
fn wish_of(item: u32) -> u32 {
    return params.lists_at + 2u * params.list_size + item;
}
