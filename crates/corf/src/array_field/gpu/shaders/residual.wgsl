// Residuals of a step's spectrum in nepers, and the derivatives by pixel of what pulls at powers and of what a power accounts for: one thread a pixel.
@group(0) @binding(1) var<storage, read> observed: array<f32>;
@group(0) @binding(2) var<storage, read> targets: array<f32>;
@group(0) @binding(3) var<storage, read_write> by_pixel: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> residuals: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    if (i >= job.pixels) { return; }
    // Logarithms, and behind them the background where there is one.
    let at = job.first * job.pixels * (1u + job.has_background) + i;
    var p = observed[i];
    if (job.has_background != 0u) { p += targets[at + job.pixels]; }
    p = max(p, 0.0) + job.floor;
    let residual = log(p) - targets[at];
    residuals[i] = residual;
    by_pixel[i] = RESPONSE * vec2(clamp(residual, -job.clip, job.clip), 1.0) / p;
}
