// e^−x for 0 ≤ x ≤ 10, as on the processor.
fn exp_of_negative(x: f32) -> f32 {
    let y = x / 32.0;
    var e = 1.0 - y * (1.0 - y * (0.5 - y * (1.0 / 6.0 - y / 24.0)));
    for (var k = 0; k < 5; k++) { e *= e; }
    return e;
}

// Value of a wave's lobe at a direction, for a power of 1.
fn value_of(wave: vec4<f32>, lobe: vec4<f32>, direction: vec3<f32>) -> f32 {
    let d = direction - wave.xyz;
    let chord2 = dot(d, d);
    if (chord2 >= lobe.z) { return 0.0; }
    return lobe.y * exp_of_negative(lobe.x * chord2);
}

// Whether a lobe may reach into a tile, which has an axis and the cosine of the widest angle to it: cos(a + b) from cosines and sines.
fn touches(wave: vec4<f32>, lobe: vec4<f32>, tile: vec4<f32>) -> bool {
    let of_lobe = vec2(1.0 - 0.5 * lobe.z, sqrt(max(lobe.z - 0.25 * lobe.z * lobe.z, 0.0)));
    let of_tile = vec2(tile.w, sqrt(max(1.0 - tile.w * tile.w, 0.0)));
    // More than rounding takes off: a lobe too many costs time alone.
    const MARGIN = 4e-6;
    return wave.w > 0.0 && dot(wave.xyz, tile.xyz) > of_lobe.x * of_tile.x - of_lobe.y * of_tile.y - MARGIN;
}
