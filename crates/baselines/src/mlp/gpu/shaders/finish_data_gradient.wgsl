fn finish(part: u32, row: u32, column: u32, value: vec4<f32>) {
    if (row >= shape.rows || column >= shape.columns) { return; }
    let at = row * shape.c_stride + column / 4u;
    var g = value;
    if (shape.accumulate != 0u) { g += c[at]; }
    if (shape.finish != 0u) { g *= slope(extra[row * shape.extra_stride + column / 4u]); }
    c[at] = g;
}
