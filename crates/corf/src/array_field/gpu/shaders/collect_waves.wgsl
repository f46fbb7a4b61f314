@group(0) @binding(1) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> parts: array<vec4<f32>>;

alias Weight = f32;
struct Direction { phases: vec2<f32>, weight: f32 }

fn directions() -> u32 { return job.emitters; }
fn lists() -> u32 { return job.receivers; }

fn direction(list: u32, i: u32, inside: bool) -> Direction {
    let wave = waves[list * job.emitters + i];
    return Direction(job.steps * wave.yz, select(0.0, max(wave.w, 0.0), inside));
}
