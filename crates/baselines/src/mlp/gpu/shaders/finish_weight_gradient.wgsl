fn finish(part: u32, row: u32, column: u32, value: vec4<f32>) {
    if (row >= shape.rows || column >= shape.columns) { return; }
    c[part * shape.c_part + row * shape.c_stride + column / 4u] = value;
}
