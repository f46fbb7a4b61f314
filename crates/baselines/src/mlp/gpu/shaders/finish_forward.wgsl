fn finish(part: u32, row: u32, column: u32, value: vec4<f32>) {
    if (row >= shape.rows || column >= shape.columns) { return; }
    let at = row * shape.c_stride + column / 4u;
    var z = value;
    if (shape.accumulate != 0u) { z += c[at]; }
    if (shape.finish != 0u) { z = activated(z + extra[shape.extra_first + column / 4u]); }
    c[at] = z;
}
