//! The edges of a mesh that diffract.

use super::super::geometry::{Geometry, TOUCHING_M};
use super::cover::open_parts;
use super::mesh_edges::{MeshEdge, Sheet, mesh_edges};
use crate::radio::geometry::face::COPLANAR_NORMAL;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::{PI, TAU};

/// Pieces of an edge this close, metres, are one.
const SAME_POINT_M: f64 = 1e-9;
/// Two sheets at one edge lie on each other, or go on from one another, when their directions differ by less than this, radians: as much
/// as triangles of one face may.
const LEVEL_RAD: f64 = 1e-3;
/// Two edges that meet in a point run on in one line when the cosine between them is this near −1.
const STRAIGHT: f64 = 1e-6;

/// A straight edge between two planar faces, or the open edge of one (a screen: both faces are the same).
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
    /// Index into the scene's objects: that of face 0.
    pub object: u32,
}

impl Wedge {
    /// Whether the point at `u` metres from the origin is on the edge, its ends aside.
    pub fn contains(&self, u: f64) -> bool {
        self.spans.iter().any(|span| u > span[0] && u < span[1])
    }

    /// Whether a point lies on the edge's line, as far as surfaces touch.
    fn is_in_line(&self, point: DVec3) -> bool {
        let from_origin = point - self.origin;
        (from_origin - self.edge * from_origin.dot(self.edge)).length() <= TOUCHING_M
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

/// The wedges of a scene with the triangles they belong to.
#[derive(Default)]
pub struct Wedges {
    /// All of them, in an order that depends on the scene alone.
    pub wedges: Vec<Wedge>,
    /// Open edges of sheets that were left out, and their length, metres.
    pub left_out: (usize, f64),
    /// (triangle, wedge), sorted.
    by_triangle: Vec<(u32, u32)>,
}

/// An edge that diffracts.
struct Diffracting {
    edge: MeshEdge,
    /// Without spans.
    wedge: Wedge,
    /// Triangles on the wedge's faces.
    triangles: Vec<u32>,
    /// The parts of the edge that are no inside of a sheet, metres from its first end.
    parts: Vec<[f64; 2]>,
}

/// A piece of an edge: its ends among the welded corners, the direction from the first, and its wedge.
struct Piece {
    ends: [u32; 2],
    direction: DVec3,
    wedge: u32,
}

impl Wedges {
    /// The edges at which faces of any objects meet around more open space than a half space, wherever triangles are cut and to whichever
    /// object they belong; `open_edges` adds those of sheets that end in the open, as screens. Pieces of one plane that overlap or touch are one
    /// sheet, which ends where all of them together do.
    pub fn new(geometry: &Geometry<'_>, open_edges: bool) -> Self {
        let mut index = Self::default();
        // One wedge per pair of faces and sense: all its edges lie on one line. Screens of one face have several lines.
        let mut known: BTreeMap<([u32; 2], [bool; 2]), Vec<u32>> = BTreeMap::new();
        let mut pieces = Vec::new();
        let found: Vec<Diffracting> = mesh_edges(geometry)
            .into_par_iter()
            .filter_map(|edge| {
                let (wedge, triangles) = wedge(geometry, &edge)?;
                let parts = open_parts(geometry, &edge);
                (!parts.is_empty()).then_some(Diffracting { edge, wedge, triangles, parts })
            })
            .collect();
        // Ends of parts that are no corners of the mesh have numbers of their own.
        let mut ends_within = (0..u32::MAX).rev();
        for Diffracting { edge, wedge, triangles, parts } in found {
            if wedge.is_screen() && !open_edges {
                let length_m = parts.iter().map(|[from, to]| to - from).sum::<f64>();
                index.left_out = (index.left_out.0 + 1, index.left_out.1 + length_m);
                continue;
            }
            let sense = [0, 1].map(|i| geometry.faces[wedge.faces[i] as usize].normal.dot(wedge.normals[i]) > 0.0);
            let homes = known.entry((wedge.faces, sense)).or_default();
            let in_line = |home: &&u32| {
                let home = &index.wedges[**home as usize];
                !wedge.is_screen() || (edge.ends.iter().all(|end| home.is_in_line(*end)) && home.edge.dot(wedge.edge) > 0.0)
            };
            let number = match homes.iter().find(in_line) {
                Some(number) => *number,
                None => {
                    let number = index.wedges.len() as u32;
                    homes.push(number);
                    index.wedges.push(wedge);
                    number
                }
            };
            let home = &mut index.wedges[number as usize];
            index.by_triangle.extend(triangles.into_iter().map(|triangle| (triangle, number)));
            let ([a, b], length_m) = (edge.ends, edge.length_m());
            let direction = (b - a).normalize();
            for part in parts {
                let [from, to] = part.map(|at_m| {
                    if at_m == 0.0 {
                        (edge.corners[0], a)
                    } else if at_m == length_m {
                        (edge.corners[1], b)
                    } else {
                        (ends_within.next().unwrap_or(u32::MAX), a + direction * at_m)
                    }
                });
                let [u, v] = [from.1, to.1].map(|p| (p - home.origin).dot(home.edge));
                home.spans.push([u.min(v), u.max(v)]);
                pieces.push(Piece { ends: [from.0, to.0], direction, wedge: number });
            }
        }
        index.close_seams(&pieces);
        index.wedges.iter_mut().for_each(|wedge| join(&mut wedge.spans));
        index.by_triangle.sort_unstable();
        index.by_triangle.dedup();
        index
    }

    /// Lets both wedges hold the point where one edge goes on as another, between other faces: it belongs to either, and is no end.
    fn close_seams(&mut self, pieces: &[Piece]) {
        let mut at_corner: HashMap<u32, Vec<(DVec3, u32)>> = HashMap::new();
        for piece in pieces {
            for (corner, away) in piece.ends.into_iter().zip([piece.direction, -piece.direction]) {
                at_corner.entry(corner).or_default().push((away, piece.wedge));
            }
        }
        // By wedge, in order: its pieces are its spans.
        let mut next = vec![0; self.wedges.len()];
        for piece in pieces {
            let wedge = &mut self.wedges[piece.wedge as usize];
            let along = piece.direction.dot(wedge.edge) > 0.0;
            let span = &mut wedge.spans[next[piece.wedge as usize]];
            next[piece.wedge as usize] += 1;
            for (i, away) in [piece.direction, -piece.direction].into_iter().enumerate() {
                let goes_on = |(other, number): &(DVec3, u32)| *number != piece.wedge && other.dot(away) < STRAIGHT - 1.0;
                if at_corner[&piece.ends[i]].iter().any(goes_on) {
                    let low = (i == 0) == along;
                    if low { span[0] -= SAME_POINT_M } else { span[1] += SAME_POINT_M }
                }
            }
        }
    }

    /// The wedges that a triangle has an edge of.
    pub fn of_triangle(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.by_triangle.partition_point(|(t, _)| *t < triangle);
        self.by_triangle[first..].iter().take_while(move |(t, _)| *t == triangle).map(|(_, wedge)| *wedge)
    }
}

/// The wedge around an edge, without spans, and the triangles on its faces: the sector between two neighbouring sheets that is larger than a
/// half space, if there is one. What else meets at the edge lies behind these two.
fn wedge(geometry: &Geometry<'_>, edge: &MeshEdge) -> Option<(Wedge, Vec<u32>)> {
    let direction = (edge.ends[1] - edge.ends[0]).try_normalize()?;
    let across = edge.sheets.first()?.into;
    let azimuth = |sheet: &Sheet| sheet.into.dot(direction.cross(across)).atan2(sheet.into.dot(across)).rem_euclid(TAU);
    let mut around: Vec<(f64, &Sheet)> = edge.sheets.iter().map(|sheet| (azimuth(sheet), sheet)).collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.face.cmp(&b.1.face)));
    let count = around.len();
    let (open_rad, last) = (0..count)
        .map(|i| (if i + 1 < count { around[i + 1].0 } else { around[0].0 + TAU } - around[i].0, i))
        .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
    if open_rad < PI + LEVEL_RAD {
        return None;
    }
    // Sheets that lie on each other at either side of the open sector: the first face stands for them.
    let level = |at: f64| move |sheet: &&(f64, &Sheet)| ((sheet.0 - at + PI).rem_euclid(TAU) - PI).abs() < LEVEL_RAD;
    let (ends_at, begins_at) = (around[last].0, around[(last + 1) % count].0);
    let side = |at: f64| around.iter().filter(level(at)).map(|(_, sheet)| *sheet).min_by_key(|sheet| sheet.face);
    let (one, other) = (side(ends_at)?, side(begins_at)?);
    let triangles: Vec<u32> =
        around.iter().filter(|s| level(ends_at)(s) || level(begins_at)(s)).map(|(_, sheet)| sheet.triangle).collect();
    let wedge = if open_rad > TAU - LEVEL_RAD { screen(geometry, edge, one) } else { solid(geometry, edge, one, other)? };
    Some((wedge, triangles))
}

/// The direction of an edge for which `normal × edge` points the way of `into`.
fn oriented(ends: [DVec3; 2], normal: DVec3, into: DVec3) -> DVec3 {
    let edge = (ends[1] - ends[0]).normalize();
    if normal.cross(edge).dot(into) < 0.0 { -edge } else { edge }
}

/// The open edge of a sheet.
fn screen(geometry: &Geometry<'_>, edge: &MeshEdge, sheet: &Sheet) -> Wedge {
    let face = &geometry.faces[sheet.face as usize];
    Wedge {
        faces: [sheet.face; 2],
        normals: [face.normal, -face.normal],
        origin: edge.ends[0],
        edge: oriented(edge.ends, face.normal, sheet.into),
        exterior_angle_rad: TAU,
        spans: Vec::new(),
        object: face.object,
    }
}

/// The wedge between two sheets; `None` when they are coplanar.
fn solid(geometry: &Geometry<'_>, edge: &MeshEdge, one: &Sheet, other: &Sheet) -> Option<Wedge> {
    // Ordered by face, so that every edge of a pair of faces gives the same wedge.
    let [first, last] = if one.face <= other.face { [one, other] } else { [other, one] };
    let away_from = |face: u32, into: DVec3| {
        let normal = geometry.faces[face as usize].normal;
        if normal.dot(into) > 0.0 { -normal } else { normal }
    };
    let (n_0, n_n) = (away_from(first.face, last.into), away_from(last.face, first.into));
    if first.face == last.face || n_0.dot(n_n).abs() > 1.0 - COPLANAR_NORMAL {
        return None;
    }
    let interior_angle_rad = (-n_0.dot(n_n)).clamp(-1.0, 1.0).acos();
    Some(Wedge {
        faces: [first.face, last.face],
        normals: [n_0, n_n],
        origin: edge.ends[0],
        edge: oriented(edge.ends, n_0, first.into),
        exterior_angle_rad: TAU - interior_angle_rad,
        spans: Vec::new(),
        object: geometry.faces[first.face as usize].object,
    })
}

/// Sorts intervals and joins those that touch.
fn join(spans: &mut Vec<[f64; 2]>) {
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::with_capacity(spans.len());
    for span in spans.iter() {
        match joined.last_mut() {
            Some(last) if span[0] <= last[1] + SAME_POINT_M => last[1] = last[1].max(span[1]),
            _ => joined.push(*span),
        }
    }
    *spans = joined;
}
