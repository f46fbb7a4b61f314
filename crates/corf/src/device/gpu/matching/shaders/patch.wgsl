// depth/patch.rs: a patch of a view and its correlation with another under a warp. Values are of 16 bits, less the patch's own mean, so that little
// cancels.

// Its pixels, and with their mean taken off and of norm 1.
var<workgroup> pixels: array<f32, AREA>;
var<workgroup> patch_values: array<f32, AREA>;
// Mean of its pixels.
var<private> shift: f32;

// Takes the patch around a pixel, all threads of a workgroup together; whether it is one: inside, of pixels that count, and not blank.
fn take_patch(thread: u32, image: ImageRow, at: vec2<u32>) -> bool {
    var is_one = all(at >= vec2(RADIUS)) && all(at + RADIUS < image.size);
    if (is_one) { is_one = counts(image, at - RADIUS, at + RADIUS); }
    let corner = select(vec2(0u), at - RADIUS, vec2(is_one));
    workgroupBarrier();
    for (var i = thread; i < AREA; i += THREADS) {
        let place = image.at + (corner.y + i / SIDE) * image.size.x + corner.x + i % SIDE;
        var value = 0.0;
        if (is_one) { value = f32(words[place] & 0xffffu); }
        pixels[i] = value;
    }
    workgroupBarrier();
    var sum = 0.0;
    for (var i = 0u; i < AREA; i++) { sum += pixels[i]; }
    shift = sum / f32(AREA);
    var square = 0.0;
    for (var i = 0u; i < AREA; i++) {
        let value = pixels[i] - shift;
        square += value * value;
    }
    let norm = sqrt(square);
    is_one = is_one && norm >= LEAST_DEVIATION * f32(SIDE);
    for (var i = thread; i < AREA; i += THREADS) { patch_values[i] = (pixels[i] - shift) / max(norm, 1.0); }
    workgroupBarrier();
    return is_one;
}

// Correlation of the patch with an image in which it lands.
fn zncc(image: ImageRow, warp: Warp) -> f32 {
    let c = warp.center - 0.5;
    var sum = 0.0;
    var square = 0.0;
    var cross_sum = 0.0;
    for (var v = 0u; v < SIDE; v++) {
        let row = c + warp.y * (f32(v) - f32(RADIUS));
        for (var u = 0u; u < SIDE; u++) {
            let p = max(row + warp.x * (f32(u) - f32(RADIUS)), vec2(0.0));
            let whole = floor(p);
            let part = p - whole;
            let place = image.at + u32(whole.y) * image.size.x + u32(whole.x);
            let above = words[place];
            let below = words[place + image.size.x];
            let a = vec2(f32(above & 0xffffu), f32(below & 0xffffu));
            let b = vec2(f32(above >> 16u), f32(below >> 16u));
            let sides = a + part.x * (b - a);
            let value = sides.x + part.y * (sides.y - sides.x) - shift;
            sum += value;
            square += value * value;
            cross_sum += value * patch_values[v * SIDE + u];
        }
    }
    let variance = square - sum * sum / f32(AREA);
    let least = f32(AREA) * LEAST_DEVIATION * LEAST_DEVIATION;
    return select(cross_sum / sqrt(max(variance, least)), 0.0, variance < least);
}

fn correlation(image: ImageRow, warp: Warp) -> f32 {
    var found = MISSED;
    if (lands_inside(image, warp)) { found = zncc(image, warp); }
    return found;
}

// The vertex of the parabola through three equally spaced values, relative to the middle one in steps.
fn parabola_offset(before: f32, middle: f32, after: f32) -> f32 {
    let curvature = before - 2.0 * middle + after;
    if (abs(curvature) < 1e-12) { return 0.0; }
    return clamp(0.5 * (before - after) / curvature, -0.5, 0.5);
}
