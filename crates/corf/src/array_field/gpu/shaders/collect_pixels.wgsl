// Two weights, and two tables.
@group(0) @binding(1) var<storage, read> phases: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> by_pixel: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> parts: array<vec4<f32>>;

alias Weight = vec2<f32>;
struct Direction { phases: vec2<f32>, weight: vec2<f32> }

fn directions() -> u32 { return job.pixels; }
fn lists() -> u32 { return 1u; }

fn direction(list: u32, i: u32, inside: bool) -> Direction {
    return Direction(phases[i], select(vec2(0.0), by_pixel[i], inside));
}
