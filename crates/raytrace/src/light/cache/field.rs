//! Values at the points of lattices laid on charts, filled tile by tile when first asked for.

use super::charts::{Chart, Charts};
use glam::{UVec2, Vec2, Vec3};
use std::sync::OnceLock;

/// Cells of a tile along each coordinate; it holds the points on its far edges too, so that it can be read by itself.
pub(super) const TILE_CELLS: u32 = 8;
/// Memory of a tile that nobody has asked for, bytes.
pub(super) const EMPTY_TILE_BYTES: usize = size_of::<OnceLock<Box<Tile>>>();
/// Small constant added to every point's weight in an interpolation, so that none is left out: four doubtful points are not read as
/// darkness.
const LEAST_SHARE: f32 = 1e-4;

/// Light received at a point as a function of the surface's normal: `H(n) = (x y z)·n` per colour channel, exact for the normal of the
/// surface itself and to first order for normals near it. The unit is radiance: a surface of diffuse reflectance ρ sends ρ·H.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Received {
    /// Colour per component of the normal.
    pub x: Vec3,
    pub y: Vec3,
    pub z: Vec3,
}

impl Received {
    /// Light of colour `c` (radiance × solid angle ÷ π) out of a direction.
    pub fn from(direction: Vec3, c: Vec3) -> Self {
        Self { x: c * direction.x, y: c * direction.y, z: c * direction.z }
    }

    /// Light received by a surface of unit normal `n` (irradiance ÷ π), per colour channel, not below zero.
    pub fn at(&self, n: Vec3) -> Vec3 {
        (self.x * n.x + self.y * n.y + self.z * n.z).max(Vec3::ZERO)
    }

    pub fn add_scaled(&mut self, other: &Self, share: f32) {
        self.x += other.x * share;
        self.y += other.y * share;
        self.z += other.z * share;
    }

    pub fn scaled(mut self, share: f32) -> Self {
        self.x *= share;
        self.y *= share;
        self.z *= share;
        self
    }
}

/// A lattice point's value, and how far it is to be believed: 0 not at all, 1 fully.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Point {
    pub received: Received,
    pub weight: f32,
}

impl Point {
    /// The mean of points by their weights, with the largest of them.
    pub fn mean(points: impl Iterator<Item = Self>) -> Self {
        let (mut received, mut total, mut weight) = (Received::default(), 0.0, 0.0f32);
        for p in points {
            received.add_scaled(&p.received, p.weight);
            total += p.weight;
            weight = weight.max(p.weight);
        }
        Self { received: if total > 0.0 { received.scaled(1.0 / total) } else { received }, weight }
    }
}

/// A lattice on one side of a chart: how many cells it has and how large they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lattice {
    /// Cells along each coordinate; 0 where the chart is so narrow that one row of points stands for it.
    pub cells: UVec2,
    /// Edges of a cell, metres.
    pub pitch: Vec2,
}

impl Lattice {
    /// The lattice of a chart whose cells are no larger than `spacing_m`.
    pub fn of(chart: &Chart, spacing_m: f32) -> Self {
        let along = |size: f32| if size < 0.5 * spacing_m { 0 } else { (size / spacing_m).ceil() as u32 };
        let cells = UVec2::new(along(chart.size.x), along(chart.size.y));
        Self { cells, pitch: chart.size / cells.max(UVec2::ONE).as_vec2() }
    }

    /// Coordinates of a point of the lattice, metres.
    pub fn coordinates(&self, chart: &Chart, point: UVec2) -> Vec2 {
        let along = |cells: u32, i: u32, pitch: f32, size: f32| if cells == 0 { 0.5 * size } else { i as f32 * pitch };
        Vec2::new(
            along(self.cells.x, point.x, self.pitch.x, chart.size.x),
            along(self.cells.y, point.y, self.pitch.y, chart.size.y),
        )
    }

    pub fn tiles(&self) -> UVec2 {
        self.cells.max(UVec2::ONE).map(|c| c.div_ceil(TILE_CELLS))
    }

    /// The cell that holds a coordinate, and where in it.
    fn cell(&self, coordinates: Vec2) -> (UVec2, Vec2) {
        let at = (coordinates / self.pitch.max(Vec2::splat(1e-9))).max(Vec2::ZERO);
        let last = self.cells.max(UVec2::ONE) - 1;
        let cell = at.as_uvec2().min(last);
        // Where there are no cells, the one point stands for all.
        let inside = (at - cell.as_vec2()).min(Vec2::ONE);
        let keep = |cells: u32, t: f32| if cells == 0 { 0.0 } else { t };
        (cell, Vec2::new(keep(self.cells.x, inside.x), keep(self.cells.y, inside.y)))
    }
}

/// The points of a tile.
#[derive(Debug)]
pub(super) struct Tile {
    /// Row by row.
    pub values: Vec<Point>,
    /// A bit per cell (`x + 8·y`): interpolation within it is likely to be poor.
    pub rough: u64,
}

impl Tile {
    /// A tile without light.
    pub fn dark(points: UVec2) -> Self {
        Self { values: vec![Point::default(); points.element_product() as usize], rough: 0 }
    }
}

/// Key of a tile: chart, side (0 the front, 1 the back), lattice and first point.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileKey {
    pub chart: u32,
    pub side: u32,
    pub lattice: Lattice,
    /// Indices of the tile's first point in the lattice.
    pub first: UVec2,
    /// Points along each coordinate, at most [`TILE_CELLS`] + 1.
    pub points: UVec2,
    /// A number of its own: the key of its random numbers.
    pub number: u64,
}

/// Lattices of one spacing on both sides of all charts.
#[derive(Debug)]
pub(super) struct Field {
    spacing_m: f32,
    /// Per chart: its first tile on the front; those of the back follow.
    offsets: Vec<u32>,
    tiles: Vec<OnceLock<Box<Tile>>>,
}

impl Field {
    /// An empty field.
    pub fn new(charts: &Charts, spacing_m: f32) -> Self {
        let mut offsets = Vec::with_capacity(charts.list.len());
        let mut total = 0;
        for chart in &charts.list {
            offsets.push(total);
            total += 2 * Lattice::of(chart, spacing_m).tiles().element_product();
        }
        Self { spacing_m, offsets, tiles: (0..total).map(|_| OnceLock::new()).collect() }
    }

    /// The wished edge of cells, metres.
    pub fn spacing_m(&self) -> f32 {
        self.spacing_m
    }

    /// The first tile of a chart, on its front.
    #[cfg(feature = "gpu")]
    pub fn first_tile(&self, chart: u32) -> u32 {
        self.offsets[chart as usize]
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.tiles.len()
    }

    /// The key of the tile of a number.
    pub fn key_of(&self, charts: &Charts, number: usize) -> TileKey {
        let chart = self.offsets.partition_point(|first| *first as usize <= number) - 1;
        let lattice = Lattice::of(&charts.list[chart], self.spacing_m);
        let within = number as u32 - self.offsets[chart];
        let tiles = lattice.tiles();
        let (side, index) = (within / tiles.element_product(), within % tiles.element_product());
        self.key(chart as u32, side, lattice, UVec2::new(index % tiles.x, index / tiles.x))
    }

    fn key(&self, chart: u32, side: u32, lattice: Lattice, tile: UVec2) -> TileKey {
        let tiles = lattice.tiles();
        let first = tile * TILE_CELLS;
        let points = (lattice.cells - first.min(lattice.cells)).min(UVec2::splat(TILE_CELLS)) + 1;
        let number = u64::from(self.offsets[chart as usize] + side * tiles.element_product() + tile.x + tile.y * tiles.x);
        TileKey { chart, side, lattice, first, points, number }
    }

    /// The four points around coordinates of a chart's side: the tile that holds them, the cell's place in it, and of each point its
    /// number in the tile and its share in bilinear interpolation.
    fn corners(&self, chart: &Chart, index: u32, side: u32, coordinates: Vec2) -> (TileKey, UVec2, [(usize, f32); 4]) {
        let lattice = Lattice::of(chart, self.spacing_m);
        let (cell, inside) = lattice.cell(coordinates);
        let key = self.key(index, side, lattice, cell / TILE_CELLS);
        let local = cell - key.first;
        let next = (local + 1).min(key.points - 1);
        let number = |x: u32, y: u32| (x + y * key.points.x) as usize;
        // No point is left out altogether, so that none of four doubtful ones is read as darkness.
        let shares = [
            (number(local.x, local.y), (1.0 - inside.x) * (1.0 - inside.y) + LEAST_SHARE),
            (number(next.x, local.y), inside.x * (1.0 - inside.y) + LEAST_SHARE),
            (number(local.x, next.y), (1.0 - inside.x) * inside.y + LEAST_SHARE),
            (number(next.x, next.y), inside.x * inside.y + LEAST_SHARE),
        ];
        (key, local, shares)
    }

    /// The value at coordinates of a chart's side, interpolated between its lattice's points, and whether that is likely to be poor;
    /// `fill` makes tiles that nobody has asked for before.
    pub fn at(
        &self,
        chart: &Chart,
        index: u32,
        side: u32,
        coordinates: Vec2,
        fill: impl Fn(&TileKey) -> Tile,
    ) -> (Received, bool) {
        let (key, cell, shares) = self.corners(chart, index, side, coordinates);
        let tile = self.tiles[key.number as usize].get_or_init(|| Box::new(fill(&key)));
        let mut sum = Received::default();
        let mut total = 0.0;
        for (k, share) in shares {
            let point = &tile.values[k];
            let weight = share * point.weight;
            sum.add_scaled(&point.received, weight);
            total += weight;
        }
        let rough = tile.rough >> (cell.x + cell.y * TILE_CELLS) & 1 == 1;
        (if total > 0.0 { sum.scaled(1.0 / total) } else { sum }, rough)
    }

    /// One of the four points around coordinates of a chart's side, drawn by its weight in the interpolation: number of its tile and of
    /// the point within. The tile is full.
    pub fn pick(&self, chart: &Chart, index: u32, side: u32, coordinates: Vec2, u: f32) -> (usize, u32) {
        let (key, _, shares) = self.corners(chart, index, side, coordinates);
        let tile = self.tiles[key.number as usize].get();
        let weights = shares.map(|(k, share)| share * tile.map_or(1.0, |t| t.values[k].weight));
        let mut left = u * weights.iter().sum::<f32>();
        for ((k, _), weight) in shares.into_iter().zip(weights) {
            if left < weight {
                return (key.number as usize, k as u32);
            }
            left -= weight;
        }
        (key.number as usize, shares[0].0 as u32)
    }

    /// Mean of `value(received, normal)` over the points that are believed and not dark.
    pub fn mean(&self, charts: &Charts, value: impl Fn(&Received, Vec3) -> f32) -> f32 {
        let (mut sum, mut count) = (0.0f64, 0usize);
        for (number, tile) in self.tiles.iter().enumerate() {
            let key = self.key_of(charts, number);
            let n = charts.normal(key.chart, key.side);
            for point in tile.get().iter().flat_map(|t| &t.values).filter(|p| p.weight >= 1.0) {
                let v = value(&point.received, n);
                if v > 0.0 {
                    sum += f64::from(v);
                    count += 1;
                }
            }
        }
        (sum / count.max(1) as f64) as f32
    }

    /// The tile of a number, where it is filled.
    pub fn tile(&self, number: usize) -> Option<&Tile> {
        self.tiles[number].get().map(Box::as_ref)
    }

    /// Puts a tile in place of whatever is there.
    pub fn replace(&mut self, number: usize, tile: Tile) {
        self.tiles[number] = OnceLock::from(Box::new(tile));
    }
}

/// Marks the cells of a tile within which bilinear interpolation errs by more than `tolerance` times the value (by its second
/// differences), which differ by more than `contrast` of it, or which touch a doubtful point; values below `floor` count as `floor`.
pub(super) fn rough_cells(points: UVec2, values: &[Point], n: Vec3, tolerance: f32, contrast: f32, floor: f32) -> u64 {
    let level: Vec<f32> = values.iter().map(|p| super::super::luminance(p.received.at(n))).collect();
    let at = |x: u32, y: u32| level[(x + y * points.x) as usize];
    let bent = |x: u32, y: u32, step: UVec2| {
        let (i, count) = if step.x == 1 { (x, points.x) } else { (y, points.y) };
        if i == 0 || i + 1 >= count {
            return 0.0;
        }
        (at(x + step.x, y + step.y) - 2.0 * at(x, y) + at(x - step.x, y - step.y)).abs() / 8.0
    };
    let mut rough = 0u64;
    for y in 0..(points.y - 1).max(1) {
        for x in 0..(points.x - 1).max(1) {
            let corners = [0, 1, 2, 3].map(|k| ((x + k % 2).min(points.x - 1), (y + k / 2).min(points.y - 1)));
            let of = corners.map(|(x, y)| at(x, y));
            let mean = (0.25 * of.iter().sum::<f32>()).max(floor);
            let (low, high) = (of.iter().copied().fold(f32::INFINITY, f32::min), of.iter().copied().fold(0.0, f32::max));
            let curved = corners.iter().any(|&(x, y)| bent(x, y, UVec2::X).max(bent(x, y, UVec2::Y)) > tolerance * mean);
            let doubtful = corners.iter().any(|&(x, y)| values[(x + y * points.x) as usize].weight < 1.0);
            if curved || doubtful || high - low > contrast * mean {
                rough |= 1 << (x + y * TILE_CELLS);
            }
        }
    }
    rough
}
