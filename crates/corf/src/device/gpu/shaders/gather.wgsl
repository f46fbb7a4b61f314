@group(0) @binding(0) var<uniform> rows: vec4<u32>;
@group(0) @binding(1) var<storage, read> kept: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<u32>;
@group(0) @binding(3) var<storage, read_write> out: array<u32>;

// Row k of the result is row kept[rows.z + k] of the source; rows.x of them, rows.y words each.
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    if (at >= rows.x * rows.y) { return; }
    out[at] = source[kept[rows.z + at / rows.y] * rows.y + at % rows.y];
}
