// Rows of the result, words of each; words of a row of the source, the first one wanted; the first name.
struct Piece { count: u32, words: u32, stride: u32, offset: u32, first: u32 }
@group(0) @binding(0) var<uniform> piece: Piece;
@group(0) @binding(1) var<storage, read> kept: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<u32>;
@group(0) @binding(3) var<storage, read_write> out: array<u32>;

// Row k of the result is of row kept[first + k] of the source.
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    if (at >= piece.count * piece.words) { return; }
    let row = kept[piece.first + at / piece.words];
    out[at] = source[row * piece.stride + piece.offset + at % piece.words];
}
