//! The edges of a mesh that diffract.

use super::super::faces::COPLANAR_NORMAL;
use super::super::geometry::Geometry;
use glam::DVec3;
use std::collections::BTreeMap;

/// Edges shorter than this, metres, are degenerate.
const MIN_EDGE_M: f64 = 1e-9;

/// A straight edge between two planar faces of one object, or the open edge of one (a screen: both faces are the same).
#[derive(Clone, Debug, PartialEq)]
pub struct Wedge {
    /// Indices into [`Geometry::faces`].
    pub faces: [u32; 2],
    /// Unit normals that point away from the other face: the open space lies on their sides. A screen has n and −n.
    pub normals: [DVec3; 2],
    /// A point of the edge's line, metres.
    pub origin: DVec3,
    /// Unit direction; `normals[0] × edge` points from the edge into face 0.
    pub edge: DVec3,
    /// Angle of the open space, radians: between π and 2π.
    pub exterior_angle_rad: f64,
    /// The parts of the line that are edge: disjoint intervals of the distance from `origin`, metres, ascending.
    pub spans: Vec<[f64; 2]>,
    /// Index into the scene's objects.
    pub object: u32,
}

impl Wedge {
    /// Whether the point at `u` metres from the origin is on the edge, its ends aside.
    pub fn contains(&self, u: f64) -> bool {
        self.spans.iter().any(|span| u > span[0] && u < span[1])
    }

    /// The point at `u` metres from the origin.
    pub fn point(&self, u: f64) -> DVec3 {
        self.origin + self.edge * u
    }

    /// Whether it is the open edge of a single face.
    pub fn is_screen(&self) -> bool {
        self.faces[0] == self.faces[1]
    }

    /// Unit direction from the edge into the open, midway between its faces.
    pub fn outward(&self) -> DVec3 {
        if self.is_screen() { -self.normals[0].cross(self.edge) } else { (self.normals[0] + self.normals[1]).normalize_or_zero() }
    }

    /// The first and the last point of the edge.
    pub fn ends(&self) -> [DVec3; 2] {
        let (first, last) = (self.spans[0][0], self.spans[self.spans.len() - 1][1]);
        [self.point(first), self.point(last)]
    }
}

/// An edge of the mesh: its ends, and the far corner of each triangle that has it.
struct MeshEdge {
    ends: [DVec3; 2],
    triangles: Vec<(u32, DVec3)>,
}

/// The wedges of a scene with the triangles they belong to.
#[derive(Default)]
pub struct Wedges {
    /// All of them, in an order that depends on the scene alone.
    pub wedges: Vec<Wedge>,
    /// (triangle, wedge), sorted.
    by_triangle: Vec<(u32, u32)>,
}

impl Wedges {
    /// Edges between triangles of one object whose corners are equal (float32) positions. Coplanar triangles have no edge between
    /// them; an edge of three triangles or more is no wedge; `open_edges` adds those of a single triangle, as screens.
    pub fn new(geometry: &Geometry<'_>, open_edges: bool) -> Self {
        let mut index = Self { wedges: Vec::new(), by_triangle: Vec::new() };
        // One wedge per pair of faces and sense: all its edges lie on one line.
        let mut known: BTreeMap<([u32; 2], [bool; 2]), u32> = BTreeMap::new();
        for edge in mesh_edges(geometry) {
            let [a, b] = edge.ends;
            if a.distance(b) < MIN_EDGE_M {
                continue;
            }
            match edge.triangles.as_slice() {
                [one] if open_edges => {
                    let wedge = screen(geometry, &edge, one);
                    index.wedges.push(wedge);
                    index.by_triangle.push((one.0, index.wedges.len() as u32 - 1));
                }
                [one, other] => {
                    let Some(wedge) = solid(geometry, &edge, one, other) else { continue };
                    let sense = [0, 1].map(|i| geometry.faces[wedge.faces[i] as usize].normal.dot(wedge.normals[i]) > 0.0);
                    let number = *known.entry((wedge.faces, sense)).or_insert_with(|| {
                        index.wedges.push(Wedge { spans: Vec::new(), ..wedge.clone() });
                        index.wedges.len() as u32 - 1
                    });
                    let home = &mut index.wedges[number as usize];
                    let [u, v] = [a, b].map(|p| (p - home.origin).dot(home.edge));
                    home.spans.push([u.min(v), u.max(v)]);
                    index.by_triangle.extend([(one.0, number), (other.0, number)]);
                }
                _ => {}
            }
        }
        index.wedges.iter_mut().for_each(|wedge| join(&mut wedge.spans));
        index.by_triangle.sort_unstable();
        index.by_triangle.dedup();
        index
    }

    /// The wedges that a triangle has an edge of.
    pub fn of_triangle(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.by_triangle.partition_point(|(t, _)| *t < triangle);
        self.by_triangle[first..].iter().take_while(move |(t, _)| *t == triangle).map(|(_, wedge)| *wedge)
    }
}

/// All edges of all triangles, welded by object and position, in the order of their first triangle.
fn mesh_edges(geometry: &Geometry<'_>) -> Vec<MeshEdge> {
    type Key = (u32, [[u64; 3]; 2]);
    let mut found: std::collections::HashMap<Key, usize> = std::collections::HashMap::new();
    let mut edges: Vec<MeshEdge> = Vec::new();
    // Adding 0 makes −0 and 0 one position.
    let bits = |p: DVec3| p.to_array().map(|x| (x + 0.0).to_bits());
    for triangle in 0..geometry.triangle_count() as u32 {
        let corners = geometry.corners(triangle);
        if (corners[1] - corners[0]).cross(corners[2] - corners[0]) == DVec3::ZERO {
            continue;
        }
        let object = geometry.faces[geometry.face_of_triangle(triangle) as usize].object;
        for i in 0..3 {
            let (a, b, far) = (corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]);
            let key = if bits(a) < bits(b) { [bits(a), bits(b)] } else { [bits(b), bits(a)] };
            let number = *found.entry((object, key)).or_insert_with(|| {
                edges.push(MeshEdge { ends: [a, b], triangles: Vec::new() });
                edges.len() - 1
            });
            edges[number].triangles.push((triangle, far));
        }
    }
    edges
}

/// The direction of an edge for which `normal × edge` points towards `far`.
fn oriented(ends: [DVec3; 2], normal: DVec3, far: DVec3) -> DVec3 {
    let edge = (ends[1] - ends[0]).normalize();
    if normal.cross(edge).dot(far - ends[0]) < 0.0 { -edge } else { edge }
}

fn screen(geometry: &Geometry<'_>, edge: &MeshEdge, triangle: &(u32, DVec3)) -> Wedge {
    let face = geometry.face_of_triangle(triangle.0);
    let normal = geometry.faces[face as usize].normal;
    let direction = oriented(edge.ends, normal, triangle.1);
    let [u, v] = edge.ends.map(|p| (p - edge.ends[0]).dot(direction));
    Wedge {
        faces: [face; 2],
        normals: [normal, -normal],
        origin: edge.ends[0],
        edge: direction,
        exterior_angle_rad: std::f64::consts::TAU,
        spans: vec![[u.min(v), u.max(v)]],
        object: geometry.faces[face as usize].object,
    }
}

/// The wedge between two triangles; `None` when they are coplanar.
fn solid(geometry: &Geometry<'_>, edge: &MeshEdge, one: &(u32, DVec3), other: &(u32, DVec3)) -> Option<Wedge> {
    // Ordered by face, so that every edge of a pair of faces gives the same wedge.
    let mut sides = [(geometry.face_of_triangle(one.0), one.1), (geometry.face_of_triangle(other.0), other.1)];
    sides.sort_by_key(|side| side.0);
    let [(face_0, far_0), (face_n, far_n)] = sides;
    if face_0 == face_n {
        return None;
    }
    let away_from = |face: u32, far: DVec3| {
        let normal = geometry.faces[face as usize].normal;
        if normal.dot(far - edge.ends[0]) > 0.0 { -normal } else { normal }
    };
    let (n_0, n_n) = (away_from(face_0, far_n), away_from(face_n, far_0));
    if n_0.dot(n_n).abs() > 1.0 - COPLANAR_NORMAL {
        return None;
    }
    let interior_angle_rad = (-n_0.dot(n_n)).clamp(-1.0, 1.0).acos();
    Some(Wedge {
        faces: [face_0, face_n],
        normals: [n_0, n_n],
        origin: edge.ends[0],
        edge: oriented(edge.ends, n_0, far_0),
        exterior_angle_rad: std::f64::consts::TAU - interior_angle_rad,
        spans: Vec::new(),
        object: geometry.faces[face_0 as usize].object,
    })
}

/// Sorts intervals and joins those that touch.
fn join(spans: &mut Vec<[f64; 2]>) {
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::with_capacity(spans.len());
    for span in spans.iter() {
        match joined.last_mut() {
            Some(last) if span[0] <= last[1] + MIN_EDGE_M => last[1] = last[1].max(span[1]),
            _ => joined.push(*span),
        }
    }
    *spans = joined;
}
