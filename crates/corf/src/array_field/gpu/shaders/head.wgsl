// Power of a wave that is not let in.
const ABSENT = -1.0;

// (cos x, sin x) turned on by (cos y, sin y).
fn turned(x: vec2<f32>, y: vec2<f32>) -> vec2<f32> {
    return vec2(x.x * y.x - x.y * y.y, x.x * y.y + x.y * y.x);
}

@group(0) @binding(0) var<uniform> job: Job;
