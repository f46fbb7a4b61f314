// What a visible Gaussian's tiles take: its first pair, pairs in each image, rows of tiles in each; the determinants of its conics.
struct Drawn {
    begin: u32,
    in_first: u32,
    in_second: u32,
    rows_in_first: u32,
    rows_in_second: u32,
    in_first_determinant: f32,
    in_second_determinant: f32,
}
// Of a block of Gaussians: how many are visible, their pairs; the first one's place among the visible, the first pair.
struct Block { visible: u32, pairs: u32, place: u32, begin: u32 }
