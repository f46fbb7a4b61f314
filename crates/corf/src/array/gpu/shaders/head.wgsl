// What a dispatch is about; the same for all kernels.
struct Job {
    // The first receiver of a dispatch, and how many there are.
    first: u32,
    receivers: u32,
    emitters: u32,
    // Pixels of an image, and its size.
    pixels: u32,
    width: u32,
    height: u32,
    // Directions that are let in: 0 all, 1 those before the array, 2 those of the frame.
    let_in: u32,
    // Whether targets have a background.
    has_background: u32,
    // Least and greatest tangents to the left, then upwards, of the frame.
    frame: vec4<f32>,
    // 2π times the spacing of columns and of rows, wavelengths.
    steps: vec2<f32>,
    // Of a lobe that nothing widens, rad².
    variance: f32,
    most_power: f32,
    // Of a training step.
    floor: f32,
    rate: f32,
    damping: f32,
    clip: f32,
    // Share of a correction that goes to where an emitter is seen from.
    share: f32,
    padding_a: f32,
    padding_b: f32,
    padding_c: f32,
}

// Rows of the rotation from the world into the array's frame.
struct Receiver {
    place: vec3<f32>,
    // Of its anchors in the list of all.
    first: u32,
    forward: vec3<f32>,
    anchors: u32,
    left: vec3<f32>,
    // Σ of its weights' squares.
    norm: f32,
    up: vec3<f32>,
    padding: u32,
}

struct Anchor {
    number: u32,
    weight: f32,
}

// Power of a wave that is not let in.
const ABSENT = -1.0;

// (cos x, sin x) turned on by (cos y, sin y).
fn turned(x: vec2<f32>, y: vec2<f32>) -> vec2<f32> {
    return vec2(x.x * y.x - x.y * y.y, x.x * y.y + x.y * y.x);
}

@group(0) @binding(0) var<uniform> job: Job;
