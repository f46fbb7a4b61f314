var<workgroup> held: array<vec4<f32>, HELD * ENTRIES>;

// Takes tables into workgroup memory, which a workgroup of 64 does as one.
fn hold(first: u32, t: u32) {
    for (var k = t; k < HELD * ENTRIES; k += 64u) { held[k] = tables[first + k]; }
    workgroupBarrier();
}

// h(y)ᵀ T h(z) with the table from `first` on.
fn value(first: u32, phases: vec2<f32>) -> f32 {
    let turn_y = sin_cos(phases.x).yx;
    let turn_z = sin_cos(phases.y).yx;
    var h = vec2(1.0, 0.0);
    HARMONICS
    var total = 0.0;
    var y = vec2(1.0, 0.0);
    for (var l = 0u; l < COLUMNS; l++) {
        let even = first + 2u * l * QUADS;
        let odd = even + QUADS;
        total += y.x * (EVEN) + y.y * (ODD);
        y = turned(y, turn_y);
    }
    return total;
}
