//! The edges of all triangles, put together by place: whatever objects they belong to, wherever they are cut, across gaps that let nothing through.

use super::super::geometry::{Geometry, TOUCHING_M};
use glam::{DVec3, I64Vec3};
use std::collections::HashMap;

/// Cells of the grid of corners along the longest side of the box around them, at most.
const CELLS: f64 = 256.0;

/// A piece of an edge between two corners with none between them.
pub struct MeshEdge {
    /// Numbers of the two corners; edges with a common end share one.
    pub corners: [u32; 2],
    /// Positions of the two corners, metres.
    pub ends: [DVec3; 2],
    /// Faces that begin at the edge.
    pub sheets: Vec<Sheet>,
}

impl MeshEdge {
    /// Its length, metres.
    pub fn length_m(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}

/// A face that begins at an edge.
pub struct Sheet {
    /// Index into [`Geometry::faces`].
    pub face: u32,
    /// Its triangle at the edge.
    pub triangle: u32,
    /// Unit direction in the face's plane, square to the edge, from there into the face.
    pub into: DVec3,
}

/// One side of a triangle at the rim of its face.
struct Side {
    ends: [DVec3; 2],
    far: DVec3,
    triangle: u32,
    face: u32,
}

/// The edges at rims of faces, in the order of their first triangle. Where two triangles of one face meet there is none.
pub fn mesh_edges(geometry: &Geometry<'_>) -> Vec<MeshEdge> {
    let sides = rim(geometry);
    let mut corners = Corners::default();
    let ids: Vec<[u32; 2]> = sides.iter().map(|side| side.ends.map(|end| corners.weld(end))).collect();
    let grid = Grid::of(&corners.places);
    let (mut numbers, mut edges): (HashMap<[u32; 2], usize>, Vec<MeshEdge>) = (HashMap::new(), Vec::new());
    for (side, [a, b]) in sides.iter().zip(ids) {
        let normal = geometry.faces[side.face as usize].normal;
        for pair in grid.pieces(&corners.places, a, b).windows(2) {
            let (ends, key) =
                ([pair[0], pair[1]].map(|id| corners.places[id as usize]), [pair[0].min(pair[1]), pair[0].max(pair[1])]);
            let Some(across) = normal.cross(ends[1] - ends[0]).try_normalize() else { continue };
            let into = if across.dot(side.far - ends[0]) < 0.0 { -across } else { across };
            let number = *numbers.entry(key).or_insert_with(|| {
                edges.push(MeshEdge { corners: [pair[0], pair[1]], ends, sheets: Vec::new() });
                edges.len() - 1
            });
            edges[number].sheets.push(Sheet { face: side.face, triangle: side.triangle, into });
        }
    }
    edges
}

/// The sides of triangles that no other triangle of the face continues.
fn rim(geometry: &Geometry<'_>) -> Vec<Side> {
    type Key = (u32, [[u64; 3]; 2]);
    // Adding 0 makes −0 and 0 one position.
    let bits = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    let mut sides: Vec<(Side, Key)> = Vec::new();
    // Whether triangles of the face lie on the one and on the other hand of the side.
    let mut hands: HashMap<Key, [bool; 2]> = HashMap::new();
    for triangle in 0..geometry.triangle_count() as u32 {
        let corners = geometry.corners(triangle);
        if (corners[1] - corners[0]).cross(corners[2] - corners[0]) == DVec3::ZERO {
            continue;
        }
        let face = geometry.face_of_triangle(triangle);
        let normal = geometry.faces[face as usize].normal;
        for i in 0..3 {
            let (a, b, far) = (corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]);
            let [low, high] = if bits(a) < bits(b) { [a, b] } else { [b, a] };
            let key = (face, [bits(low), bits(high)]);
            let hand = normal.cross(high - low).dot(far - low) < 0.0;
            hands.entry(key).or_default()[usize::from(hand)] = true;
            sides.push((Side { ends: [a, b], far, triangle, face }, key));
        }
    }
    sides.into_iter().filter(|(_, key)| hands[key] != [true; 2]).map(|(side, _)| side).collect()
}

/// Corners of edges, those that touch as one.
#[derive(Default)]
struct Corners {
    places: Vec<DVec3>,
    by_cell: HashMap<I64Vec3, Vec<u32>>,
}

impl Corners {
    /// The number of a corner: of the first that it touches, or its own.
    fn weld(&mut self, place: DVec3) -> u32 {
        let cell = (place / TOUCHING_M).floor().as_i64vec3();
        let around = neighbours(cell).filter_map(|cell| self.by_cell.get(&cell)).flatten().copied();
        let touches = |id: &u32| self.places[*id as usize].distance(place) <= TOUCHING_M;
        around.filter(touches).min().unwrap_or_else(|| {
            let id = self.places.len() as u32;
            self.places.push(place);
            self.by_cell.entry(cell).or_default().push(id);
            id
        })
    }
}

/// A cell and those around it.
fn neighbours(cell: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    (0..27).map(move |i| cell + I64Vec3::new(i % 3, i / 3 % 3, i / 9) - 1)
}

/// Corners by cells large enough to be walked along an edge.
struct Grid {
    cell_m: f64,
    corners: HashMap<I64Vec3, Vec<u32>>,
}

impl Grid {
    fn of(places: &[DVec3]) -> Self {
        let (min, max) = places.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
        let cell_m = ((max - min).max_element() / CELLS).max(4.0 * TOUCHING_M);
        let mut corners: HashMap<I64Vec3, Vec<u32>> = HashMap::new();
        for (id, place) in places.iter().enumerate() {
            corners.entry((place / cell_m).floor().as_i64vec3()).or_default().push(id as u32);
        }
        Self { cell_m, corners }
    }

    /// The corners from one end of a straight edge to the other, those on the way in order: where an edge of another triangle ends it is
    /// cut. Empty where the ends are one corner.
    fn pieces(&self, places: &[DVec3], from: u32, to: u32) -> Vec<u32> {
        let (a, b) = (places[from as usize], places[to as usize]);
        let length = a.distance(b);
        if from == to || length <= TOUCHING_M {
            return Vec::new();
        }
        let direction = (b - a) / length;
        let steps = (length / self.cell_m).ceil() as usize;
        // Every point of the edge is within half a step of one of these, in its cell or one beside it.
        let mut cells: Vec<I64Vec3> = (0..=steps)
            .map(|i| ((a + direction * (length * i as f64 / steps as f64)) / self.cell_m).floor().as_i64vec3())
            .flat_map(neighbours)
            .collect();
        cells.sort_unstable_by_key(|cell| cell.to_array());
        cells.dedup();
        let mut on_the_way: Vec<(f64, u32)> = cells
            .iter()
            .filter_map(|cell| self.corners.get(cell))
            .flatten()
            .map(|&id| ((places[id as usize] - a).dot(direction), id))
            .filter(|&(u, id)| {
                u > TOUCHING_M && u < length - TOUCHING_M && places[id as usize].distance(a + direction * u) <= TOUCHING_M
            })
            .collect();
        on_the_way.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        std::iter::once(from).chain(on_the_way.into_iter().map(|(_, id)| id)).chain([to]).collect()
    }
}
