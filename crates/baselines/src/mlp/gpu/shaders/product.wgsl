struct Shape {
    rows: u32,
    columns: u32,
    inner: u32,
    part: u32,
    a_first: u32,
    a_stride: u32,
    b_first: u32,
    b_stride: u32,
    c_stride: u32,
    c_part: u32,
    extra_first: u32,
    extra_stride: u32,
    activation: u32,
    accumulate: u32,
    finish: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> shape: Shape;
@group(0) @binding(1) var<storage, read> a: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> b: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> extra: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> c: array<vec4<f32>>;
