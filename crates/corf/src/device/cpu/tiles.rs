//! Depth order, then lists per tile: one radix sort of the visible Gaussians by z and a stable counting sort by tile.

use super::{
    geometry::Grid,
    project::{CHUNK, Projection, TILE_HEIGHT, TILE_WIDTH},
};

/// Visible Gaussians from near to far, named by `chunk·CHUNK + local`; equal depths stay in order.
#[derive(Default)]
pub(crate) struct DepthOrder {
    pub order: Vec<u32>,
    keys: Vec<(u32, u32)>,
    other: Vec<(u32, u32)>,
}

const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;

impl DepthOrder {
    /// Sorts by the bits of z, which order like z as z > 0.
    pub fn run(&mut self, projection: &Projection) {
        self.keys.clear();
        let mut histograms = [[0_u32; DIGITS]; 3];
        for (c, chunk) in projection.chunks.iter().enumerate() {
            for (local, depth) in chunk.depth.iter().enumerate() {
                let key = depth.to_bits();
                for (pass, histogram) in histograms.iter_mut().enumerate() {
                    histogram[(key >> (DIGIT_BITS * pass as u32)) as usize % DIGITS] += 1;
                }
                self.keys.push((key, (c * CHUNK + local) as u32));
            }
        }
        self.other.resize(self.keys.len(), (0, 0));
        for (pass, histogram) in histograms.iter_mut().enumerate() {
            let mut sum = 0;
            for count in histogram.iter_mut() {
                (*count, sum) = (sum, sum + *count);
            }
            for &(key, name) in &self.keys {
                let cursor = &mut histogram[(key >> (DIGIT_BITS * pass as u32)) as usize % DIGITS];
                self.other[*cursor as usize] = (key, name);
                *cursor += 1;
            }
            std::mem::swap(&mut self.keys, &mut self.other);
        }
        self.order.clear();
        self.order.extend(self.keys.iter().map(|k| k.1));
    }
}

/// Per tile, the Gaussians that reach it from near to far.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Tile `t` owns `entries[start[t]..start[t+1]]`.
    pub start: Vec<u32>,
    pub entries: Vec<u32>,
    cursor: Vec<u32>,
}

impl TileLists {
    /// Fills the lists of image `g` and returns, chunk by chunk through `places`, where each (Gaussian, tile) pair landed.
    pub fn run(&mut self, g: usize, grid: &Grid, projection: &Projection, order: &[u32], places: &mut [Vec<u32>]) {
        let tiles = tile_count(grid);
        self.start.clear();
        self.start.resize(tiles + 1, 0);
        for (chunk, place) in projection.chunks.iter().zip(places.iter_mut()) {
            let list = &chunk.tiles[g];
            place.resize(list.tiles.len(), 0);
            for &tile in &list.tiles {
                self.start[tile as usize + 1] += 1;
            }
        }
        for t in 0..tiles {
            self.start[t + 1] += self.start[t];
        }
        self.cursor.clear();
        self.cursor.extend_from_slice(&self.start[..tiles]);
        self.entries.resize(self.start[tiles] as usize, 0);
        for &name in order {
            let (c, local) = (name as usize / CHUNK, name as usize % CHUNK);
            let list = &projection.chunks[c].tiles[g];
            for entry in list.run(local) {
                let cursor = &mut self.cursor[list.tiles[entry] as usize];
                self.entries[*cursor as usize] = name;
                places[c][entry] = *cursor;
                *cursor += 1;
            }
        }
    }

    /// The list of one tile.
    pub fn of(&self, tile: usize) -> &[u32] {
        &self.entries[self.start[tile] as usize..self.start[tile + 1] as usize]
    }
}

/// Tiles that cover an image.
pub(crate) fn tile_count(grid: &Grid) -> usize {
    grid.width.div_ceil(TILE_WIDTH) * grid.height.div_ceil(TILE_HEIGHT)
}
